import pytest

from pbd.cli.options import pair
from pbd.data import GRAVITY
from pbd.data.units import UNITS
from pbd.errors import SensorError, UsageError
from pbd.sensors.line_layout import Line, LineLayout, layout_from_options, layout_from_toml
from pbd.sensors.razor import razor_layout

TOML = """
separator = "space"
columns = "t, ax, ay, az, _"
prefix = "IMU "
wrap = 65536
[units]
acc = "0.001 g"
t = "ms"
"""


def test_options_and_toml_say_the_same() -> None:
    by_options = layout_from_options("t,ax,ay,az,_", {"acc": "0.001 g", "t": "ms"}, "space", "IMU ", 65536)
    assert by_options == layout_from_toml(TOML)
    assert by_options.lines == (Line(("t", "ax", "ay", "az", "_"), "IMU "),)
    assert by_options.separator == " "
    assert by_options.wrap_s == pytest.approx(65.536)


def test_several_lines_in_toml() -> None:
    lines = [
        f'[[line]]\nprefix = "{line.prefix}"\ncolumns = "{",".join(line.columns)}"' for line in razor_layout().lines
    ]
    units = "\n".join(f'{name} = "{unit}"' for name, unit in razor_layout().units.items())
    assert layout_from_toml("\n".join([*lines, "[units]", units])) == razor_layout()


@pytest.mark.parametrize(("quantity", "unit"), [(q, u) for q, units in UNITS.items() for u in units if u != "0.1ms"])
def test_a_number_multiplies_a_unit(quantity: str, unit: str) -> None:
    one = LineLayout((Line(("ax", "ay", "az")),), {quantity: unit}).factor(quantity)
    for text in (f"0.25{unit}", f" 2.5e-1 {unit} "):
        assert LineLayout((Line(("ax", "ay", "az")),), {quantity: text}).factor(quantity) == pytest.approx(0.25 * one)


def test_the_first_unit_is_the_projects() -> None:
    layout = layout_from_options("ax,ay,az")
    assert [layout.factor(quantity) for quantity in UNITS] == [1.0] * len(UNITS)
    assert layout_from_options("ax,ay,az", {"acc": "g"}).factor("acc") == GRAVITY


@pytest.mark.parametrize(
    ("unit", "wrap", "wrap_s"),
    [("us", None, 4294.967296), ("ms", None, 4294967.296), ("s", None, 0.0), ("us", 0.0, 0.0), ("ms", 1000.0, 1.0)],
)
def test_an_arduinos_clock_wraps_unless_told_otherwise(unit: str, wrap: float | None, wrap_s: float) -> None:
    assert layout_from_options("t,ax,ay,az", {"t": unit}, wrap=wrap).wrap_s == pytest.approx(wrap_s)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("ax,ay,az,wx", "'wx' is unknown; the names are ax"),
        ("ax,ay", "az is missing"),
        ("ax,ay,az,gx", "gy, gz is missing"),
        ("ax,ay,az,-ax", "ax is there twice"),
        ("ax,ay,az,roll,pitch", "yaw is missing"),
        ("ax,ay,az,roll,pitch,yaw,heading", "two words"),
        ("t,gx,gy,gz", "no acceleration"),
        ("", "'' is unknown"),
    ],
)
def test_columns_that_make_no_sense(columns: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        layout_from_options(columns)


@pytest.mark.parametrize("unit", ["acc=furlong", "acc=deg/s", "force=N", "acc=0g", "acc=-1g", "acc=1.2.3g", "t=1e999s"])
def test_units_that_make_no_sense(unit: str) -> None:
    with pytest.raises(UsageError, match=r"acc|unit|is no unit"):
        layout_from_options("ax,ay,az", dict([pair(unit)]))


def test_signs_belong_to_the_columns() -> None:
    with pytest.raises(UsageError, match=r"'-g' is not a unit of acc; .*; reverse signs in --columns, as -ax,-ay,-az"):
        layout_from_options("ax,ay,az", {"acc": "-g"})


@pytest.mark.parametrize("separator", ["", ",,", "1", "-", ".", "e", "\n", "é"])
def test_separators_that_make_no_sense(separator: str) -> None:
    with pytest.raises(UsageError, match="separator"):
        layout_from_options("ax,ay,az", separator=separator)


@pytest.mark.parametrize("wrap", [-1.0, float("nan"), float("inf")])
def test_wraps_that_make_no_sense(wrap: float) -> None:
    with pytest.raises(UsageError, match="wrap"):
        layout_from_options("ax,ay,az", wrap=wrap)


@pytest.mark.parametrize("prefixes", [("#A", "#A"), ("#A", "#A-C="), ("", "#A"), ("#A\n", "#B"), ("é", "#B")])
def test_prefixes_that_make_no_sense(prefixes: tuple[str, str]) -> None:
    with pytest.raises(UsageError, match="begin"):
        LineLayout((Line(("ax", "ay", "az"), prefixes[0]), Line(("gx", "gy", "gz"), prefixes[1])))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("columns = ", "not valid TOML"),
        ("", "columns is missing"),
        ('columns = "ax,ay,az"\n[[line]]\ncolumns = "ax,ay,az"', "can't both be given"),
        ('columns = ["ax"]', "columns must be a non-empty string"),
        ('columns = "ax,ay,az"\nseperator = ","', "seperator is unknown"),
        ('columns = "ax,ay,az"\n[units]\nforce = "N"', r"\[units\] force is unknown; the keys here are acc, gyr"),
        ('[[line]]\ncolumns = "ax,ay,az"\nunit = "g"', r"\[line\] unit is unknown"),
        ('columns = "ax,ay"', "az is missing"),
    ],
)
def test_files_that_make_no_sense(text: str, says: str) -> None:
    with pytest.raises(SensorError, match=f"^board.toml(:\\d+)?: .*{says}"):
        layout_from_toml(text, "board.toml")


@pytest.mark.parametrize(
    ("second", "says"),
    [(("gx",), "gy, gz is missing"), (("t",), "no column but t or _"), (("_", "_"), "no column but t or _")],
)
def test_each_line_has_whole_vectors(second: tuple[str, ...], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        LineLayout((Line(("ax", "ay", "az"), "A"), Line(second, "B")))


def test_a_layout_cant_be_changed() -> None:
    units = {"acc": "g"}
    layout = LineLayout((Line(("ax", "ay", "az")),), units)
    units["acc"] = "mg"
    assert layout.factor("acc") == GRAVITY
    with pytest.raises(TypeError):
        layout.units["acc"] = "mg"  # type: ignore[index]
