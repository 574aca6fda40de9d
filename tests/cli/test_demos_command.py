"""`pbd demos`: which demonstrations there are."""

from pathlib import Path

import pytest

from pbd.files.demo import load_demo
from tests.cli.run_command import Capture, run, run_json

pytestmark = pytest.mark.usefixtures("elsewhere")


def test_own_ones_come_first_and_the_newest_is_the_default(capsys: Capture) -> None:
    assert run(capsys, "simulate", "pick-and-place-stops", "older")[0] == 0
    toml = Path("demos/older/demo.toml")
    toml.write_text(toml.read_text().replace('created = "20', 'created = "19'))
    assert run(capsys, "simulate", "pick-and-place-stops", "newer")[0] == 0
    rows = run_json(capsys, "demos")["demos"]
    assert [row["name"] for row in rows[:2]] == ["newer", "older"]
    assert {row["name"] for row in rows if row["bundled"]} == {"pouring", "paper-test1", "paper-test2"}
    assert [row["name"] for row in rows if row["default"]] == ["newer"]
    assert rows[0]["folder"] == "demos/newer"


def test_without_own_ones_pouring_is_the_default(capsys: Capture) -> None:
    code, out, _ = run(capsys, "demos")
    assert code == 0
    (line,) = (line for line in out.splitlines() if "the default" in line)
    assert line.startswith("pouring")


def test_one_that_cannot_be_read_is_warned_of_and_the_others_are_listed(capsys: Capture) -> None:
    Path("demos/broken").mkdir(parents=True)
    Path("demos/broken/demo.toml").write_text("format = 1\nname = 3\n")
    code, out, err = run(capsys, "demos")
    assert code == 0
    assert "pouring" in out
    assert "demos/broken/demo.toml:2" in err


def test_a_command_without_a_name_takes_none_that_failed_or_was_set_aside(capsys: Capture) -> None:
    assert "no demonstration named: using 'pouring'\n" in run(capsys, "segments")[2]
    assert run(capsys, "simulate", "pick-and-place-stops", "tea")[0] == 0
    for name, failed in (("tea.before", ""), ("short", "failed = true\n")):
        assert run(capsys, "simulate", "pick-and-place-stops", name)[0] == 0
        toml = Path("demos", name, "demo.toml")
        toml.write_text(failed + toml.read_text().replace('created = "20', 'created = "21'))
    notes = load_demo("tea").notes
    told = f"no demonstration named: using 'tea' ({notes}); the newer 'short' can't be replayed\n"
    assert told in run(capsys, "segments")[2]
    rows = {row["name"]: row for row in run_json(capsys, "demos")["demos"]}
    assert [name for name, row in rows.items() if row["failed"]] == ["short"]
    assert [name for name, row in rows.items() if row["aside"]] == ["tea.before"]
