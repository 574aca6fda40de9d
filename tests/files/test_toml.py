"""What holds of every TOML file: strict keys and types, and each fault told with its line."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pbd.errors import CalibrationError, PbdError
from pbd.files.calibration import read_calibration
from pbd.files.joint_state import read_joints
from pbd.files.keyframes import read_keyframes
from pbd.files.robot import read_robot
from pbd.io.toml import Section, read_toml

TEXT = """\
name = "x"
flag = true
inner = { deep = { wrong = 1 } }
[table]
number = 1.5
  [table.below]
  name = 7
[[row]]
t = 1
[[row]]
t = 2
"""


@pytest.fixture
def top(tmp_path: Path) -> Section:
    path = tmp_path / "file.toml"
    path.write_text(TEXT, encoding="utf-8")
    return read_toml(path, CalibrationError)


def ask_all(top: Section) -> None:
    top.text("name")
    top.flag("flag")
    top.section("inner").section("deep").number("wrong")
    table = top.section("table")
    table.number("number")
    table.section("below").number("name")
    assert [row.number("t") for row in top.tables("row")] == [1, 2]


def test_keys_that_are_read_are_known(top: Section) -> None:
    ask_all(top)
    assert top.tables("nothing") == []
    assert "nothing" not in top
    top.refuse_unread()


def test_each_key_that_is_not_read_is_refused_with_its_line(tmp_path: Path) -> None:
    lines = TEXT.splitlines()
    for number, line in enumerate(lines, start=1):
        if "{" in line:
            continue
        path = tmp_path / f"{number}.toml"
        path.write_text("\n".join([*lines[:number], "extra = 1", *lines[number:]]), encoding="utf-8")
        top = read_toml(path, CalibrationError)
        ask_all(top)
        with pytest.raises(
            CalibrationError, match=r"extra is unknown; the keys here are .*; remove or rename it"
        ) as caught:
            top.refuse_unread()
        assert caught.value.fields["line"] == number + 1
        assert caught.value.fields["key"] == "extra"


def test_a_key_of_the_whole_file_below_a_table_is_moved_to_the_top(tmp_path: Path) -> None:
    """Whoever adds a line at the end of a file adds it to the last table."""
    path = tmp_path / "file.toml"
    path.write_text('name = "x"\n[[row]]\nt = 1\nflag = true\n', encoding="utf-8")
    top = read_toml(path, CalibrationError)
    top.text("name")
    top.flag("flag", False)
    top.tables("row")[0].number("t")
    with pytest.raises(CalibrationError, match=r":4: \[row\] flag is about the whole file; move it above the first \["):
        top.refuse_unread()


def test_a_key_is_found_in_its_own_table(top: Section) -> None:
    """There is a `name` at the top level too; `wrong` is on the line of its outer table."""
    with pytest.raises(CalibrationError, match=r"file\.toml:7: \[table\.below\] name must be a non-empty string"):
        top.section("table").section("below").text("name")
    with pytest.raises(CalibrationError, match=r"file\.toml:3: \[inner\.deep\] wrong must be a non-empty string"):
        top.section("inner").section("deep").text("wrong")


@pytest.mark.parametrize(
    ("call", "key", "message"),
    [
        ("text", "flag", ":2: flag must be a non-empty string, got True; correct it"),
        ("texts", "name", ":1: name must be a list of strings, got 'x'; correct it"),
        ("flag", "name", ":1: name must be true or false, got 'x'; correct it"),
        ("number", "flag", ":2: flag must be a finite number, got True; correct it"),
        ("section", "name", ":1: name must be a table; correct it"),
        ("tables", "name", ":1: name must be [[name]] tables; correct it"),
        ("text", "nowhere", "file.toml: nowhere is missing; add it"),
        ("number", "flga", "file.toml: flga is missing (there is 'flag'); add it"),
    ],
)
def test_the_wrong_type(top: Section, call: str, key: str, message: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        getattr(top, call)(key)
    assert caught.value.message.endswith(message)


@pytest.mark.parametrize(
    ("text", "next_step"),
    [
        ("[0,4, 0,15, 0,25]", "write decimal points, not commas: 0.5"),
        ("[0.4, 0.15, 0,25]", "write decimal points, not commas: 0.5"),
        ("[0.4, 0.15, 0, 25]", "correct it"),
    ],
)
def test_a_list_with_decimal_commas(tmp_path: Path, text: str, next_step: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(f"p = {text}", encoding="utf-8")
    with pytest.raises(CalibrationError, match=rf"p must have 3 numbers, got \d; {next_step}$"):
        read_toml(path, CalibrationError).numbers("p", 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = 0", ":1: format must be 1, the only format that this version reads; correct it"),
        (
            "format = 2",
            ":1: format must be 1, the only format that this version reads; it was written by a newer pbd: update pbd",
        ),
        ("", ": format is missing; add it"),
    ],
)
@pytest.mark.parametrize("read", [read_calibration, read_robot, read_keyframes])
def test_every_file_has_a_format(tmp_path: Path, read: Callable[[Path], object], text: str, message: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PbdError) as caught:
        read(path)
    assert caught.value.message == f"{path}{message}"


def test_the_keys_of_a_table_of_figures_may_have_any_names(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text('fit = { rms_mm = 1.5, points = 4 }\nbad = { word = "x" }\n', encoding="utf-8")
    top = read_toml(path, CalibrationError)
    assert top.named_numbers("fit") == {"rms_mm": 1.5, "points": 4.0}
    with pytest.raises(CalibrationError, match="bad must be a table of finite numbers"):
        top.named_numbers("bad")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\nb = ", ":2: not valid TOML: Invalid value (at end of document); correct it"),
        (
            "a = True",
            ":1: not valid TOML: Invalid value (at line 1, column 5); correct it: a value is a number, true, false, ",
        ),
        (
            "a = 1\nb = -0,5 # m",
            ":2: not valid TOML: Expected newline or end of document after a statement (at line 2, column 7); write "
            "decimal points, not commas: 0.5",
        ),
        (
            "a = 1\n[[b]]\nc = 1\nc = 2",
            ":4: not valid TOML: Cannot overwrite a value (at end of document); [[b]] has this key twice: remove one, "
            "or move it above the first [table] if it is about the whole file",
        ),
        (
            "a = 1\na = 2",
            ":2: not valid TOML: Cannot overwrite a value (at end of document); this key is there twice: remove one",
        ),
        (
            "a = 1\nb = 9" + "9" * 5000,
            ": not valid TOML: nested too deeply, or a number with thousands of digits; correct",
        ),
        (
            "a = 1\nb = " + "[" * 9000,
            ": not valid TOML: nested too deeply, or a number with thousands of digits; correct",
        ),
        ("a = 1\n" + "b." * 400_000 + "b = 1", ":2: a line of more than 20000 characters; break it"),
    ],
    ids=["syntax", "capital", "comma", "twice in a table", "twice", "digits", "lists", "dots"],
)
def test_what_would_break_tomllib_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CalibrationError) as caught:
        read_toml(path, CalibrationError)
    assert caught.value.message.startswith(f"{path}{message}")


@pytest.mark.parametrize(
    ("call", "value", "message"),
    [
        ("number", "0x" + "f" * 5000, "must be from -1e+09 to 1e+09, got a number with thousands of digits"),
        ("number", "1e308", "must be from -1e+09 to 1e+09, got 1e+308"),
        ("number", "-1e10", "must be from -1e+09 to 1e+09, got -10000000000.0"),
        ("number", "nan", "must be a finite number, got nan"),
        ("text", '""', "must be a non-empty string, got ''"),
        ("numbers", "[5.0, nan]", "must be a list of 2 finite numbers, got [5.0, nan]"),
        ("numbers", "[5.0, true]", "must be a list of 2 finite numbers, got [5.0, True]"),
        ("numbers", "[5.0]", "must have 2 numbers, got 1"),
    ],
)
def test_values_that_are_refused(tmp_path: Path, call: str, value: str, message: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(f"a = {value}", encoding="utf-8")
    with pytest.raises(CalibrationError) as caught:
        getattr(read_toml(path, CalibrationError), call)("a", *[2] * (call == "numbers"))
    assert caught.value.message == f"{path}:1: a {message}; correct it"


def test_spaces_cost_time_in_proportion(tmp_path: Path) -> None:
    """A pattern that tries each way to share them out takes seconds for these."""
    (path := tmp_path / "file.toml").write_text(f"a = 1\n{' ' * 1600}\n", encoding="utf-8")
    (message := tmp_path / "message").write_text(f"name:\n- x{' ' * 60_000}y\n", encoding="utf-8")
    began = time.process_time()
    with pytest.raises(CalibrationError, match="a is unknown"):
        read_toml(path, CalibrationError).refuse_unread()
    with pytest.raises(PbdError, match="lists of one length"):
        read_joints(str(message), ("elbow",))
    assert time.process_time() - began < 1.0
