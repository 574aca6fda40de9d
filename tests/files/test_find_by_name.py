from pathlib import Path

import pytest

from pbd.errors import CalibrationError, RecordingError, RobotError
from pbd.files.calibration import load_calibration
from pbd.files.demo import load_demo
from pbd.files.find_by_name import bundled, find, names
from pbd.files.robot import load_robot


@pytest.fixture(autouse=True)
def home(elsewhere: Path) -> Path:
    """Work in an empty folder."""
    return elsewhere


def add(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def test_bundled_files_are_found_from_any_folder() -> None:
    assert find("calibration", "default", CalibrationError) == bundled("calibration") / "default.toml"
    assert find("demos", "pouring", RecordingError) == bundled("demos") / "pouring"


def test_an_empty_name_is_named() -> None:
    """A shell's variable that is not set; as a path, it would be the working folder."""
    with pytest.raises(RecordingError, match=r"^the demonstration's name is empty: give one$"):
        find("demos", "", RecordingError)


def test_a_name_may_be_a_path_object() -> None:
    assert load_demo(bundled("demos") / "pouring").recording.info.name == "pouring"
    assert load_robot(bundled("robots") / "ur5.toml").name == load_robot(Path("ur5")).name == "ur5"
    assert load_calibration(Path("default")).name == "default"


def test_the_users_own_wins() -> None:
    own = add(Path("calibration/default.toml"))
    assert find("calibration", "default", CalibrationError) == own
    assert find("calibration", "default.toml", CalibrationError) == own
    demo = add(Path("demos/pouring/demo.toml")).parent
    assert find("demos", "pouring", RecordingError) == demo


def test_a_name_wins_over_a_path() -> None:
    """A folder ./pouring does not hide the demonstration of that name, unless it is given as a path."""
    Path("pouring").mkdir()
    assert find("demos", "pouring", RecordingError) == bundled("demos") / "pouring"
    assert find("demos", "./pouring", RecordingError) == Path("pouring")


def test_a_folder_in_demos_that_is_not_a_demonstration_is_refused() -> None:
    Path("demos/tea").mkdir(parents=True)
    Path("demos/pouring").mkdir()
    with pytest.raises(RecordingError, match=r"^demos/tea is not .*no demo\.toml; .* pbd import demos/tea NAME; else"):
        load_demo("tea")
    assert find("demos", "pouring", RecordingError) == bundled("demos") / "pouring"


def test_a_path_is_taken_as_it_is(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = add(home / "elsewhere" / "mine.toml")
    assert find("calibration", str(path), CalibrationError) == path
    assert find("calibration", "elsewhere/mine.toml", CalibrationError) == Path("elsewhere/mine.toml")
    monkeypatch.setenv("HOME", str(home))
    assert find("calibration", "~/elsewhere/mine.toml", CalibrationError) == path


@pytest.fixture
def shelf(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the bundled files by one calibration and one demonstration."""
    monkeypatch.setattr("pbd.files.find_by_name.bundled", lambda kind: home / "bundled" / kind)
    add(Path("bundled/calibration/default.toml"))
    add(Path("bundled/demos/pouring/demo.toml"))


@pytest.mark.usefixtures("shelf")
def test_names_contain_the_users_and_the_bundled_ones() -> None:
    add(Path("calibration/mine.toml"))
    add(Path("calibration/default.toml"))
    add(Path("calibration/notes.txt"))
    assert names("calibration") == ["default", "mine"]
    add(Path("demos/tea/demo.toml"))
    add(Path("demos/no-demonstration/imu.csv"))
    assert names("demos") == ["pouring", "tea"]


@pytest.mark.usefixtures("shelf")
def test_an_unknown_name_lists_the_valid_ones() -> None:
    add(Path("demos/tea/demo.toml"))
    with pytest.raises(RecordingError) as caught:
        find("demos", "te", RecordingError)
    assert caught.value.message == (
        "no demonstration named 'te' in ./demos, nor a file or folder of that path; known are pouring, tea; "
        "did you mean tea?"
    )
    assert caught.value.fields == {"value": "te", "valid": ["pouring", "tea"]}


@pytest.mark.usefixtures("shelf")
def test_only_a_similar_name_is_proposed() -> None:
    with pytest.raises(RecordingError, match=r"known are pouring$"):
        find("demos", "xyz", RecordingError)
    with pytest.raises(RecordingError, match=r"; did you mean pouring\?$"):
        find("demos", "Pouring", RecordingError)


@pytest.mark.usefixtures("shelf")
def test_without_any_names_the_error_tells_the_folder() -> None:
    told = r"no robot named 'x' in .*; none is known; put one into \./robots$"
    with pytest.raises(RobotError, match=told):
        find("robots", "x", RobotError)


@pytest.mark.parametrize("name", ["~nobody-of-this-name/tea", "a" * 300])
def test_a_name_that_cannot_be_a_path_is_unknown(name: str) -> None:
    with pytest.raises(RecordingError, match="no demonstration named"):
        find("demos", name, RecordingError)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("UR5E", "; did you mean ur5e?"),
        ("UR55", "; did you mean ur5? `pbd robots` says which arms they are"),
        ("franka", "z1; `pbd robots` says which arms they are"),
    ],
)
def test_a_name_in_another_case_is_suggested_alone_and_another_arm_is_doubted(name: str, hint: str) -> None:
    add(Path("robots/ur5e.toml"))
    with pytest.raises(RobotError) as caught:
        find("robots", name, RobotError)
    assert caught.value.message.endswith(hint)
