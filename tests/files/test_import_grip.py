"""The column of a table that says whether the grip is closed."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.errors import PbdWarning, RecordingError
from pbd.files.demo import read_demo
from pbd.files.importers import import_file
from pbd.simulation.simulate import simulate

EVENTS = [(2.0, True), (5.0, False)]


def table(folder: Path, name: str, closed: str, opened: str) -> Path:
    """Write ten seconds of a hand whose grip is closed from 2 to 5 s, with an empty cell in between."""
    recording = simulate("pour", "modern", 1).recording
    assert recording.gyr is not None
    rows = [f"t,ax,ay,az,gx,gy,gz,{name}"]
    for k in range(1000):
        word = "" if k == 300 else closed if 200 <= k < 500 else opened
        values = np.concatenate((recording.acc[k], recording.gyr[k]))
        rows.append(",".join((f"{7.0 + 0.01 * k:.2f}", *map("{:.5f}".format, values), word)))
    (folder / "run.csv").write_text("\n".join(rows) + "\n")
    return folder / "run.csv"


@pytest.mark.parametrize(
    ("name", "closed", "opened", "given"),
    [
        ("gripper_closed", "1", "0", ""),
        ("grip_open", "False", "True", ""),
        ("Gripper", "closed", "open", ""),
        ("button", "1.0", "0.0", "button"),
        ("gripper", "0", "1", "-gripper"),
        ("-gripper", "1", "0", "-gripper"),
        ("gripper", "0.9", "0.1", "gripper"),
        ("gripper", "0.25", "1", "-gripper"),
    ],
)
def test_a_column_of_the_grip_becomes_its_events(
    tmp_path: Path, name: str, closed: str, opened: str, given: str
) -> None:
    file = table(tmp_path, name, closed, opened)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        recording = import_file(file, {"grip": given} if given else {}).recording
    fractions = {"0.9": "closed", "0.25": "open"}.get(closed)
    said = [f"the column '{name}' has fractions: the grip is {fractions} above 0.5"] if fractions else []
    assert [str(each.message) for each in told] == said
    assert [(round(event.t, 6), event.closed) for event in recording.grip] == EVENTS
    assert recording.info.source.unread[name] == "read as the grip: closes at 2.0 s, opens at 5.0 s"


def test_a_gripper_of_which_1_may_be_open_or_closed_is_told(tmp_path: Path) -> None:
    with pytest.warns(PbdWarning, match=r"import it with --column grip=gripper if 1 is closed, or with grip=- "):
        assert import_file(table(tmp_path, "gripper", "1", "0")).recording.grip == ()


def test_a_gripper_whose_name_has_a_space_is_quoted(tmp_path: Path) -> None:
    with pytest.warns(PbdWarning, match=r"import it with --column 'grip=gripper state' if 1 is closed, "):
        import_file(table(tmp_path, "gripper state", "1", "0"))


def test_a_gripper_of_fractions_is_told(tmp_path: Path) -> None:
    with pytest.warns(
        PbdWarning, match=r"import it with --column grip=gripper if above 0\.5 is closed, or with grip=- "
    ):
        assert import_file(table(tmp_path, "gripper", "0.9", "0.1")).recording.grip == ()


def test_a_gripper_in_another_unit_is_no_grip_that_never_closes(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"'gripper' goes from 0 to 0\.08, and does not cross 0\.5; scale it"):
        import_file(table(tmp_path, "gripper", "0.08", "0"), {"grip": "gripper"})


def test_of_two_columns_of_the_grip_none_is_taken(tmp_path: Path) -> None:
    file = table(tmp_path, "hand_closed", "1", "0")
    file.write_text("".join(f"{line},{line.rpartition(',')[2]}\n" for line in file.read_text().splitlines()))
    with pytest.raises(RecordingError, match="the column 'hand_closed' is there twice; rename one"):
        import_file(file)


def test_a_word_that_is_no_state_of_a_grip_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"run\.csv:202: 'held' in column 'mark' is no state of a grip; give one"):
        import_file(table(tmp_path, "mark", "held", "open"), {"grip": "mark"})


def test_the_command_stores_the_grip(elsewhere: Path) -> None:
    assert main(["import", str(table(elsewhere, "button", "true", "false")), "tea", "--column", "grip=button"]) == 0
    assert [(event.t, event.closed) for event in read_demo(Path("demos/tea")).recording.grip] == EVENTS


def test_a_grip_in_a_row_without_a_time_counts_from_the_next_row(tmp_path: Path) -> None:
    file = table(tmp_path, "button", "true", "false")
    file.write_text(file.read_text().replace("\n9.00,", "\n,"))
    assert [round(event.t, 6) for event in import_file(file, {"grip": "button"}).recording.grip] == [2.01, 5.0]
