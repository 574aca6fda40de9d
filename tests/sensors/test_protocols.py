import re
import subprocess
import sys
from pathlib import Path

import pytest

from pbd.cli.options import pair
from pbd.errors import SensorError, UsageError
from pbd.sensors.line_layout import layout_from_options, layout_from_toml
from pbd.sensors.protocols import PROTOCOLS, protocol
from pbd.tracking.noise import CLASSES
from tests.record.emulated_sensors import SPEAKERS

PAGE = Path(__file__).parents[2] / "docs" / "sensors.md"


def test_lines_has_to_be_told_its_columns() -> None:
    with pytest.raises(SensorError, match="--columns"):
        PROTOCOLS["lines"].decoder()


def test_an_unknown_sensor() -> None:
    assert protocol("xsens") is PROTOCOLS["xsens"]
    with pytest.raises(UsageError, match="'xsense' is unknown; the sensors are os5000, "):
        protocol("xsense")
    with pytest.raises(UsageError, match=r"did you mean witmotion\?$"):  # by the name on its box
        protocol("wt901")


def test_commands_that_set_the_rate() -> None:
    assert PROTOCOLS["os5000"].commands_for(40.0) == (b"\x1bR40 ",)
    assert PROTOCOLS["witmotion"].commands_for(100) == (
        bytes.fromhex("ff aa 69 88 b5"),
        bytes.fromhex("ff aa 03 09 00"),
        bytes.fromhex("ff aa 00 00 00"),
    )


def test_rates_that_can_not_be_set() -> None:
    with pytest.raises(SensorError, match="has no rate of 12345 Hz; ask for 1 to 40 Hz"):
        PROTOCOLS["os5000"].commands_for(12345.0)
    with pytest.raises(SensorError, match="ask for 1, 2, 5, 10, 20, 50, 100, 200 Hz"):
        PROTOCOLS["witmotion"].commands_for(40.0)
    with pytest.raises(SensorError, match="maker's program"):
        PROTOCOLS["xsens"].commands_for(100.0)


def test_the_registry_is_light() -> None:
    code = "import pbd.sensors.protocols, sys; print('numpy' in sys.modules, 'pbd.sensors.lines' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "False"]


def test_each_has_a_class_of_errors() -> None:
    unknown = {name for name in PROTOCOLS if not any(word in name for word in CLASSES)}
    assert unknown == {"lines", "gamepad"}, "name it in CLASSES, pbd/tracking/noise.py: else its errors are a guess"


def test_each_with_a_serial_port_is_recorded() -> None:
    emulated = {each.sensor for each in SPEAKERS.values()}
    serial = {name for name, one in PROTOCOLS.items() if one.bauds}
    assert emulated == serial, "give it an emulated device in SPEAKERS, tests/record/emulated_sensors.py"


def test_the_page_has_them_all() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name, one in PROTOCOLS.items():
        row = rf"^\| `{name}` \| {re.escape(one.title)} \| .* \| {', '.join(map(str, one.bauds))} \|"
        assert re.search(row, page, re.M), f"give {name} a row in docs/sensors.md with its title and baud rates"


def test_the_pages_layouts_are_right() -> None:
    text = PAGE.read_text(encoding="utf-8")
    files = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    options = re.findall(r'--columns "([^"]+)"((?: --unit \S+)*)', text)
    assert files
    assert options
    for one in files:
        layout_from_toml(one)
    for columns, units in options:
        layout_from_options(columns, dict(map(pair, units.split()[1::2])))
