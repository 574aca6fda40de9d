"""Parts of a calibration are written, and the rest stays as a person wrote it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.data.world import REACH_M
from pbd.errors import CalibrationError
from pbd.files.calibration import read_calibration
from pbd.files.calibration_edit import calibration_file, pose_values, update_calibration
from pbd.files.find_by_name import bundled
from pbd.pose import Pose
from tests.not_none import not_none

BENCH = """\
# my bench
format = 1
name = "bench"    # by the window
table_height = 0.75

# measured with a ruler
[dock]
position = [0.4, 0.1, 0.2]   # to the corner
rpy_deg = [0.0, 0.0, 90.0]
any_attitude = true
# about the shelf
[[obstacle]]
name = "shelf"               # oak
shape = "box"
size = [0.3, 0.2, 0.02]
position = [0.6, 0.4, 0.3]
"""
EXACT = np.zeros((6, 6))
POSE = Pose.from_rpy((0.1, -0.2, 0.3), (0.1, 0.2, 0.3))


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(BENCH, encoding="utf-8")
    return path


def test_other_parts_stay_as_they_are(bench: Path) -> None:
    update_calibration(bench, {"dock": pose_values(POSE, "in base", EXACT)})
    written = bench.read_text(encoding="utf-8").splitlines()
    assert written[6:9] == [
        "[dock]",
        "position = [0.1, -0.2, 0.3]   # to the corner",
        "rpy_deg = [5.7296, 11.4592, 17.1887]",
    ]
    assert written[:6] + written[9:] == BENCH.splitlines()[:6] + BENCH.splitlines()[9:]


def test_new_keys_come_before_the_comment_on_the_next_table(bench: Path) -> None:
    cov = np.diag(np.square([1e-3, 2e-3, 3e-3, 0.0, 0.0, 0.01]))
    update_calibration(bench, {"dock": pose_values(POSE, "in base", cov)})
    text = bench.read_text(encoding="utf-8")
    assert text.index("any_attitude") < text.index("sigma_m") < text.index("# about the shelf")
    assert "sigma_m = [0.001, 0.002, 0.003] # one sigma of the position" in text
    found = read_calibration(bench).cov_base
    assert_allclose(not_none(found), cov, rtol=1e-3)


def test_every_part_is_read_again(bench: Path) -> None:
    cov = np.diag([1e-6] * 6) + 1e-7
    update_calibration(
        bench,
        {
            "mount": pose_values(POSE, "in sensor axes", cov) | {"fit": ({"rms_mm": 1.5}, "")},
            "sensor": {"name": ("mine", ""), "gravity": (9.81, "m/s2")},
            "sensor.acc": {"bias": ([0.1, 0.2, 0.3], "m/s2"), "matrix": ([1.0, 0, 0, 0, 1.02, 0, 0, 0, 1.0], "")},
        },
        scale=1.25,
    )
    calibration = read_calibration(bench)
    assert calibration.T_sensor_tool.distance(POSE)[0] < 1e-5
    assert calibration.T_sensor_tool.distance(POSE)[1] < 1e-5
    assert_allclose(not_none(calibration.cov_sensor_tool), cov)
    assert calibration.residuals == {"mount.rms_mm": 1.5}
    assert calibration.scale == 1.25
    assert calibration.sensor is not None
    assert (calibration.sensor.sensor, calibration.sensor.gyr) == ("mine", None)
    assert_allclose(not_none(calibration.sensor.acc).correct(np.array([0.1, 1.2, 0.3])), (0.0, 1.02, 0.0))
    assert [obstacle.name for obstacle in calibration.obstacles] == ["shelf"]


def test_nav_replaces_the_dock_in_its_place(bench: Path) -> None:
    update_calibration(bench, {"nav": pose_values(POSE, "in base", EXACT) | {"any_attitude": (None, "")}})
    text = bench.read_text(encoding="utf-8")
    assert text.index("# measured with a ruler") < text.index("[nav]") < text.index("# about the shelf")
    calibration = read_calibration(bench)
    assert calibration.T_base_dock is None
    assert calibration.T_base_nav is not None


def test_only_a_new_file_gets_the_robots(tmp_path: Path) -> None:
    path = tmp_path / "calibration" / "new.toml"
    update_calibration(path, {"dock": pose_values(POSE, "in base", EXACT)}, robots=("panda",))
    calibration = read_calibration(path)
    assert (calibration.name, calibration.robots) == ("new", ("panda",))
    update_calibration(path, {"dock": pose_values(POSE, "in base", EXACT)}, robots=("ur5",))
    assert read_calibration(path).robots == ("panda",)  # a person may have changed them


def test_a_bundled_calibration_is_copied_and_not_changed(elsewhere: Path) -> None:
    before = (bundled("calibration") / "default.toml").read_bytes()
    update_calibration(calibration_file("default"), {"mount": pose_values(POSE, "in sensor axes", EXACT)})
    assert (bundled("calibration") / "default.toml").read_bytes() == before
    assert "# Height of the table's top" in Path("calibration/default.toml").read_text(encoding="utf-8")
    assert read_calibration(Path("calibration/default.toml")).T_base_dock is not None


@pytest.mark.parametrize("text", [BENCH.replace("format = 1", "format = 2"), BENCH.replace("0.75", '"high"'), "x ="])
def test_a_file_that_cannot_be_read_stays(bench: Path, text: str) -> None:
    bench.write_text(text, encoding="utf-8")
    with pytest.raises(CalibrationError):
        update_calibration(bench, {"dock": pose_values(POSE, "in base", EXACT)})
    assert bench.read_text(encoding="utf-8") == text
    assert [path.name for path in bench.parent.iterdir()] == ["bench.toml"]


def test_an_invalid_result_is_not_written(bench: Path) -> None:
    with pytest.raises(CalibrationError, match="position has 99 m, beyond any arm's reach"):
        update_calibration(bench, {"dock": {"position": ([99.0, 0.0, 0.0], "")}})
    assert bench.read_text(encoding="utf-8") == BENCH
    assert [path.name for path in bench.parent.iterdir()] == ["bench.toml"]


@pytest.mark.parametrize("name", ["", "..", ".toml", "~", "a/..", "../x", "a/../../x", "a b", "a b.toml", " a", "a\tb"])
def test_names_that_are_refused(name: str) -> None:
    with pytest.raises(CalibrationError, match="can't be a calibration's name"):
        calibration_file(name)


def test_a_path_that_ends_in_toml_is_not_told_to_end_so() -> None:
    with pytest.raises(CalibrationError, match=r"; give a word without spaces$"):
        calibration_file("a/b c.toml")


def test_the_path_of_a_name() -> None:
    assert calibration_file("bench") == Path("calibration/bench.toml")
    assert calibration_file("bench.toml") == Path("calibration/bench.toml")
    assert calibration_file("there/bench.toml") == Path("there/bench.toml")
    assert calibration_file("../bench.toml") == Path("../bench.toml")
    assert calibration_file("my files/bench.toml") == Path("my files/bench.toml")


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.sampled_from(["dock", "mount", "sensor.acc", "sensor.gyr"]), min_size=1, max_size=4),
    st.lists(st.floats(-REACH_M, REACH_M), min_size=3, max_size=3),
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
)
def test_any_edits_leave_what_a_person_wrote(
    bench: Path, parts: list[str], p: list[float], rpy_deg: list[float]
) -> None:
    """Every comment and every line of the obstacle stays, and the last values are read."""
    bench.write_text(BENCH, encoding="utf-8")
    pose = Pose.from_rpy(p, np.radians(rpy_deg))
    for part in parts:
        if part.startswith("sensor"):
            update_calibration(bench, {"sensor": {"name": ("mine", "")}, part: {"bias": (p, "")}})
        else:
            update_calibration(bench, {part: pose_values(pose, "somewhere", np.eye(6))})
    text = bench.read_text(encoding="utf-8")
    assert text.startswith(BENCH[: BENCH.index("[dock]")])
    assert BENCH[BENCH.index("# about the shelf") :].rstrip() in text
    calibration = read_calibration(bench)
    if "mount" in parts:
        assert calibration.T_sensor_tool.distance(pose)[0] < 2e-5
    assert (calibration.sensor is not None) == any(part.startswith("sensor") for part in parts)


def test_an_indented_comment_keeps_its_indentation(bench: Path) -> None:
    bench.write_text(BENCH.replace("[dock]", "  [dock]").replace("# about", "  # about"), encoding="utf-8")
    update_calibration(bench, {"dock": {"any_attitude": (False, "")}})
    assert "\n  # about the shelf\n" in bench.read_text(encoding="utf-8")
