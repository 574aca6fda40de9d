"""Tables: units and CSV; keyframes saved and edited."""

import contextlib
import csv
import fcntl
import io
import itertools
import json
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.cli import main
from pbd.data import Keyframe
from pbd.files.robot import load_robot
from pbd.pose import Pose
from pbd.view.terminal_tables import joints_table, keyframes_table, make_table, print_table
from pbd.view.units import ANGLES, LENGTHS, Units, parse_units


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated demonstration."""
    folder = tmp_path_factory.mktemp("tables") / "tea"
    assert main(["simulate", "pick-and-place-stops", str(folder)]) == 0
    return folder


@pytest.fixture(autouse=True)
def tea(simulated: Path, elsewhere: Path) -> Path:
    """A folder with it."""
    shutil.copytree(simulated, "demos/tea")
    return elsewhere / "demos" / "tea"


def rows_of(capsys: pytest.CaptureFixture[str], *command: str) -> list[dict[str, str]]:
    capsys.readouterr()
    assert main([*command, "--csv"]) == 0
    return list(csv.DictReader(capsys.readouterr().out.splitlines()))


def in_terminal(columns: int, *command: str) -> str:
    """The output of a command in a terminal of that width."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    settings = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    pbd = subprocess.Popen(
        [sys.executable, "-m", "pbd", *command],
        stdout=theirs,
        stderr=subprocess.DEVNULL,
        env=settings | {"TERM": "xterm", "NO_COLOR": "1"},
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # the other end is closed
        while chunk := os.read(ours, 65536):
            shown += chunk
    os.close(ours)
    assert pbd.wait() == 0
    return re.sub(r"\x1b\[[0-9;]*m", "", shown.decode()).replace("\r\n", "\n")


def keyframes_of(capsys: pytest.CaptureFixture[str], *options: str) -> list[dict[str, Any]]:
    capsys.readouterr()
    assert main(["keyframes", "tea", "--json", *options]) == 0
    found = json.loads(capsys.readouterr().out)["keyframes"]
    assert isinstance(found, list)
    return found


def test_csv_has_the_figures_of_json_in_the_units_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    exact = keyframes_of(capsys)
    for units in (Units(), Units("cm"), Units("mm", "rad")):
        rows = rows_of(capsys, "keyframes", "tea", "--units", f"{units.length},{units.angle}")
        assert len(rows) == len(exact)
        factor, _ = LENGTHS[units.length]
        for row, keyframe in zip(rows, exact, strict=True):
            told = [row[f"{axis} ({units.length})"] for axis in "xyz"]
            assert [float(x) for x in told] == pytest.approx([factor * x for x in keyframe["position_m"]], rel=5e-9)
            longest = len("-0.000123456789")  # no rounding errors such as 3.8449999999999998
            assert max(map(len, row.values())) <= longest
            assert f"yaw ({units.angle_sign})" in row


def test_every_table_is_csv_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert {row["what happens"] for row in rows_of(capsys, "segments", "tea")} >= {"No hand motion occurs"}
    assert "panda" in {row["name"] for row in rows_of(capsys, "robots")}
    joints = rows_of(capsys, "keyframes", "tea", "--robot", "panda")[0]
    assert list(joints).count("#") == 1
    assert "panda_joint7 (°)" in joints


def test_the_tools_uncertainty_is_in_the_csv_and_in_the_units_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    command = ("keyframes", "tea", "--calibration", "default")
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["keyframes"][-1]
    row = rows_of(capsys, *command, "--units", "cm,rad")[-1]
    for axis, sigma in zip("xyz", found["base_sigma_m"], strict=True):
        assert float(row[f"tool σ {axis} (cm)"]) == pytest.approx(100.0 * sigma)
    assert float(row["tool σ (rad)"]) == pytest.approx(np.radians(max(found["base_sigma_deg"])))
    by_source = np.sqrt(np.mean(np.square(found["base_sigma_parts_m"]["tracking"])))
    assert float(row["σ by tracking (cm)"]) == pytest.approx(100.0 * by_source)
    assert row["σ by mount (cm)"] == ""  # it was never calibrated
    assert main([*command, "--units", "cm,rad"]) == 0
    assert "tool σ x (cm)" in capsys.readouterr().out


def test_units_are_parsed() -> None:
    assert parse_units("cm,deg") == Units("cm", "deg")
    assert parse_units("rad") == Units("m", "rad")
    assert parse_units(" mm , rad ") == Units("mm", "rad")
    assert parse_units("cm", Units(time="ms")) == Units("cm", "deg", "ms")
    assert set(ANGLES) == {"deg", "rad"}
    for wrong in ("km", "", "m,inch"):
        with pytest.raises(ValueError, match=r"unknown unit '.*'; lengths m cm mm, angles deg rad, times s ms"):
            parse_units(wrong)
    for wrong in ("cm,mm", "deg,deg", "s,ms"):
        with pytest.raises(ValueError, match=r"are both units of .*; give one"):
            parse_units(wrong)


@pytest.mark.parametrize("words", ["segments --units cm", "demos --units m,s", "touch tea --robot panda --units deg"])
def test_a_unit_that_no_column_has_is_refused(capsys: pytest.CaptureFixture[str], words: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(words.split())
    assert "nothing here has a unit of " in capsys.readouterr().err


def test_units_of_every_table(capsys: pytest.CaptureFixture[str]) -> None:
    in_ms = rows_of(capsys, "segments", "tea")
    in_s = rows_of(capsys, "segments", "tea", "--units", "s")
    assert [float(row["time (s)"]) for row in in_s] == pytest.approx(
        [1e-3 * float(row["time (ms)"]) for row in in_ms], abs=0.0051
    )
    in_m, in_mm = rows_of(capsys, "robots", "panda"), rows_of(capsys, "robots", "panda", "--units", "mm")
    assert [float(row["reach (mm)"]) for row in in_mm] == pytest.approx(
        [1e3 * float(row["reach (m)"]) for row in in_m], abs=10.0
    )
    assert "dwell (ms)" in rows_of(capsys, "keyframes", "tea", "--units", "ms")[0]


def test_a_sliding_joint_is_a_length() -> None:
    rows = [{"index": 0, "base_position_m": (0.1, 0.2, 0.3), "joints": (0.25, np.pi)}]
    table = joints_table(("rail", "wrist"), rows, Units(length="cm"), (True, False))
    shown = {str(column.header): list(column.cells) for column in table.columns[4:]}
    assert shown == {"rail (cm)": ["25.0"], "wrist (°)": ["180.0"]}


def test_signs_are_spelled_where_the_output_lacks_them() -> None:
    written = io.BytesIO()
    with io.TextIOWrapper(written, "ascii") as stream:
        print_table(make_table("roll (°)", "σ (mm)", rows=[("1.0", "2.0")]), stream)
        stream.flush()
        assert written.getvalue().decode().splitlines() == [
            "roll (deg)   sigma (mm)",
            "-----------------------",
            "       1.0          2.0",
        ]


def test_saved_keyframes_are_used_edited_and_found_anew(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = keyframes_of(capsys)
    assert main(["keyframes", "tea", "--save"]) == 0
    file = tea / "keyframes.toml"
    text = file.read_text(encoding="utf-8")
    tables = text.split("\n[[keyframe]]")
    file.write_text("\n[[keyframe]]".join([*tables[:3], *tables[4:]]), encoding="utf-8")  # the third is dropped

    edited = keyframes_of(capsys)
    assert [row["t_s"] for row in edited] == pytest.approx([row["t_s"] for row in (*found[:2], *found[3:])], abs=1e-3)
    assert main(["keyframes", "tea", "--save"]) == 1
    assert "may have been edited; --force replaces it" in capsys.readouterr().err
    assert main(["keyframes", "tea", "--save", "--force"]) == 0
    assert file.read_text(encoding="utf-8") == text


def test_force_does_not_warn_of_the_keyframes_that_it_replaces(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keyframes", "tea", "--save"]) == 0
    file = tea / "keyframes.toml"
    file.write_text(file.read_text(encoding="utf-8").replace('= "closes"\n', '= "opens"\n'), encoding="utf-8")
    for force, warned in ([], True), (["--save", "--force"], False):
        capsys.readouterr()
        assert main(["keyframes", "tea", *force]) == 0
        assert ("the grip opens at keyframe" in capsys.readouterr().err) == warned


def test_force_overwrites_a_file_that_cannot_be_read(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tea / "keyframes.toml"
    file.write_text("format = ", encoding="utf-8")
    assert main(["keyframes", "tea", "--save", "--force"]) == 0
    assert "its touch-ups, if there are any, are not used" in capsys.readouterr().err
    assert (tea / "keyframes.toml.before").read_text(encoding="utf-8") == "format = "
    assert len(keyframes_of(capsys)) > 2


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (("--dwell", "100"), True),
        (("--dwell", "0.5"), False),  # as saved
        (("--dwell", "0.2"), False),
        (("--time", "demo"), True),
        ((), False),
    ],
)
def test_an_option_that_changes_no_saved_stay_is_told(
    tea: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, ...], said: bool
) -> None:
    assert main(["keyframes", "tea", "--save"]) == 0
    capsys.readouterr()
    assert main(["replay", "tea", "--robot", "panda", "--html", "tea.html", *option, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    warned = "changes no stay: demos/tea/keyframes.toml says how long each is; edit its dwell_s"
    assert any(each.endswith(warned) for each in result["warnings"]) == said
    assert len(result["made_from"]["options"]) == bool(option)  # what the file makes of --dwell is not told


def test_saving_and_editing_nothing_changes_no_motion(tmp_path: Path) -> None:
    """Poses are written to a tenth of a millimetre, so the motion may differ by as much."""
    motions = []
    for file in ("found.csv", "saved.csv"):
        assert main(["export", "tea", "--robot", "panda", "--format", "csv", "-o", file]) == 0
        motions.append(np.loadtxt(tmp_path / file, delimiter=",", skiprows=1))
        assert main(["keyframes", "tea", "--save", "--force"]) == 0
    found, saved = motions
    assert saved[-1, 0] == pytest.approx(found[-1, 0], abs=0.02)
    joints = slice(1, 8)
    there = np.column_stack([np.interp(found[:, 0], saved[:, 0], q) for q in saved[:, joints].T])
    np.testing.assert_allclose(there, found[:, joints], atol=0.01)


def test_with_the_hands_time_the_hands_own_dwells_are_saved(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = keyframes_of(capsys)
    assert main(["keyframes", "tea", "--save", "--time", "demo"]) == 0
    saved = keyframes_of(capsys)
    assert [row["dwell_s"] for row in saved] == pytest.approx([row["dwell_s"] for row in found], abs=6e-4)
    assert max(row["dwell_s"] for row in found) > 0.5
    assert main(["export", "tea", "--robot", "panda", "--format", "csv", "-o", "m.csv", "--time", "demo"]) == 0
    assert "changes no stay" not in capsys.readouterr().err


@pytest.mark.usefixtures("elsewhere")
def test_what_is_known_of_the_stops_after_keyframes_are_saved_is_said_not_to_move_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["simulate", "pour", "back"]) == 0  # closed = true
    capsys.readouterr()
    unmoved = "warning: what demo.toml says of places and heights does not move the keyframes of keyframes.toml"
    for options, used in ([], True), (["--save"], True), ([], False), (["--save", "--force"], True):
        assert main(["keyframes", "back", *options]) == 0
        err = capsys.readouterr().err
        assert ("using: the hand returned to its start" in err) == used
        assert unmoved not in err  # what is saved heeds it
    toml = Path("demos/back/demo.toml")
    closed = toml.read_text()
    toml.write_text(closed.replace("closed = true", "closed = false", 1))
    assert main(["keyframes", "back", "--save", "--force"]) == 0
    toml.write_text(closed)
    assert main(["keyframes", "back"]) == 0
    assert unmoved in capsys.readouterr().err


def test_nothing_is_saved_into_what_is_bundled_or_no_folder(tea: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keyframes", "pouring", "--save"]) == 1
    assert "is bundled, so nothing is saved there; copy it" in capsys.readouterr().err
    assert main(["keyframes", str(tea / "imu.csv"), "--save"]) == 1
    assert "is no demonstration folder, so nothing is saved there; `pbd import` it first" in capsys.readouterr().err


@pytest.mark.parametrize(("robot", "prefix"), [("panda", "panda_"), ("ur5", "")])
def test_what_all_joints_names_begin_with_is_said_once(
    capsys: pytest.CaptureFixture[str], robot: str, prefix: str
) -> None:
    (row, *_) = rows_of(capsys, "keyframes", "tea", "--robot", robot)
    names = load_robot(robot).joints
    assert {f"{name} (°)" for name in names} <= set(row)  # programs get them whole
    assert main(["keyframes", "tea", "--robot", robot]) == 0
    shown = capsys.readouterr().out
    assert (f"\nthe joints' names begin with {prefix}\n" in shown) == bool(prefix)
    (header,) = (line for line in shown.splitlines() if "tool x (m)" in line)
    assert header.split()[-2 * len(names) :: 2] == [name.removeprefix(prefix) for name in names]


@pytest.mark.parametrize("command", [("keyframes", "tea"), ("demos",)])
def test_a_common_table_fits_into_80_columns(capsys: pytest.CaptureFixture[str], command: tuple[str, ...]) -> None:
    assert main(list(command)) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    shown = in_terminal(80, *command).splitlines()
    assert max(map(len, shown)) <= 80
    assert [line.split() for line in shown[-len(rows) :]] == rows


def test_no_number_is_cut_in_a_narrow_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Columns that do not fit go below, each part with the row's number."""
    assert main(["keyframes", "tea", "--robot", "panda"]) == 0
    piped = capsys.readouterr().out
    shown = in_terminal(60, "keyframes", "tea", "--robot", "panda")
    assert max(map(len, shown.splitlines())) <= 60
    assert "…" not in shown
    assert set(re.findall(r"-?\d+\.\d+", piped)) <= set(shown.split())


def test_a_long_name_leaves_room_for_the_other_columns(tea: Path) -> None:
    """The name is folded; dates and words stay whole."""
    name = "-".join(["a-name-of-seventy-nine-letters"] * 3)[:79]
    tea.rename(tea.with_name(name))
    for width in (40, 60, 80):
        lines = in_terminal(width, "demos").splitlines()
        assert max(map(len, lines)) <= width
        assert any(re.search(r"\d{4}-\d\d-\d\d \d\d:\d\d", line) for line in lines)
        assert any("simulated" in line for line in lines)
        folded = itertools.dropwhile(
            lambda word: not word.startswith("a-name"), (line.split()[0] for line in lines if line.strip())
        )
        assert "".join(folded).startswith(name)


def test_a_stop_that_the_tracker_doubts_says_how_sure_it_is() -> None:
    keyframe = Keyframe(1.0, 0.5, Pose.identity(), np.eye(6))
    plain, doubted = ([replace(keyframe, weight=weight)] for weight in (0.9, 0.6))
    assert "a stop?" not in [column.header for column in keyframes_table(plain, Units(), None).columns]
    (column,) = [column for column in keyframes_table(doubted, Units(), None).columns if column.header == "a stop?"]
    assert list(column.cells) == ["60 %"]
