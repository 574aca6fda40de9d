"""Exported files, read back without code of pbd."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pbd.data import Gripper, JointLimits, JointTrajectory, Robot, Samples
from pbd.errors import PbdError, PlanError, UsageError
from pbd.files import exporters
from pbd.files.exporters import FORMATS, export, npz
from pbd.files.exporters.check_export import _deviating_motion
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array, Pose

DURATION, RATE = 0.07345678, 100.0  # the end is not on the grid

ROBOT = Robot(
    name="two",
    description="",
    urdf=Path("two.urdf"),
    srdf=None,
    package_dirs=(),
    base="base",
    body="hand",
    T_body_tool=Pose.identity(),
    joints=("shoulder", "elbow"),
    home=np.zeros(2),
    gripper=Gripper(("finger",), np.array([0.04]), np.array([0.0]), 0.02),
    limits=JointLimits(np.full(2, -2.0), np.full(2, 2.0), np.full(2, 1e9), np.full(2, 1e9), np.full(2, 1e9), "a test"),
)
"""A robot with two joints and almost no limits."""


@pytest.fixture
def motion() -> JointTrajectory:
    """From rest to rest in one cubic, q = c (3 u^2 - 2 u^3), whose acceleration at the end is not zero."""
    reach = np.array([0.5, -1.25])
    zero = np.zeros(2)
    return JointTrajectory(
        joint_names=("shoulder", "elbow"),
        knots=np.array([0.0, DURATION]),
        coefficients=np.array([[zero, zero, 3 * reach / DURATION**2, -2 * reach / DURATION**3]]),
        gripper_t=np.array([0.02, 0.04]),
        gripper_opening=np.array([1.0, 0.0]),
        keyframe_t=np.array([0.0, DURATION]),
        keyframe_q=np.array([zero, reach]),
    )


@pytest.mark.parametrize("format_name", ["csv", "ros2-json"])
def test_no_zero_has_a_sign(tmp_path: Path, format_name: str) -> None:
    """One joint stands at -0.0, one moves less than the last digit."""
    zero = np.zeros(2)
    still = JointTrajectory(
        joint_names=ROBOT.joints,
        knots=np.array([0.0, 1.0]),
        coefficients=np.array([[-zero, np.array([-0.0, -4e-10]), -zero, -zero]]),
        gripper_t=np.array([0.0, 1.0]),
        gripper_opening=np.ones(2),
        keyframe_t=np.array([0.0, 1.0]),
        keyframe_q=np.array([zero, [0.0, -4e-10]]),
    )
    path = tmp_path / "motion"
    export(still, ROBOT, format_name, path, 10.0)
    assert re.findall(r"-0\.0*(?![\d])", path.read_text()) == []


def test_another_robots_motion_and_another_formats_name_are_refused(tmp_path: Path, motion: JointTrajectory) -> None:
    other = replace(ROBOT, name="other", joints=("hip", "knee"))
    with pytest.raises(PlanError, match="this motion is not other's: its joints are shoulder, elbow; give the robot"):
        export(motion, other, "csv", tmp_path / "motion.csv")
    short = replace(ROBOT, limits=replace(ROBOT.limits, lower=np.array([-2.0, -1.2])))
    for format_name in ("csv", "keyframes"):
        with pytest.raises(PlanError, match=r"takes elbow 0.05 beyond two's limit; give the robot that it was planned"):
            export(motion, short, format_name, tmp_path / "motion")
    with pytest.raises(UsageError, match=r"motion.json looks like ros2-json, but the format is csv; name another file"):
        export(motion, ROBOT, "csv", tmp_path / "motion.json")
    assert not list(tmp_path.iterdir())


def read_csv(path: Path) -> tuple[list[str], Samples]:
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[0] == "t"
    assert header[-1] == "gripper"
    kinds, names = zip(*(column.split("_", 1) for column in header[1:-1]), strict=True)
    assert kinds == ("q",) * 2 + ("dq",) * 2 + ("ddq",) * 2
    assert names[:2] == names[2:4] == names[4:]
    values = np.array(rows, dtype=float)
    return list(names[:2]), Samples(values[:, 0], values[:, 1:3], values[:, 3:5], values[:, 5:7], values[:, 7])


def read_npz(path: Path) -> tuple[list[str], Samples]:
    with np.load(path, allow_pickle=False) as file:
        assert set(file.files) == {"joints", "t", "q", "dq", "ddq", "gripper"}
        return list(file["joints"]), Samples(file["t"], file["q"], file["dq"], file["ddq"], file["gripper"])


def read_ros2_json(path: Path) -> tuple[list[str], Samples]:
    message = json.loads(path.read_text())
    assert set(message) == {"header", "joint_names", "points", "gripper", "gripper_commands"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    points = message["points"]
    assert all(point["effort"] == [] for point in points)
    times = [point["time_from_start"] for point in points]
    assert all(0 <= time["nanosec"] < 10**9 for time in times)

    def column(name: str) -> Array:
        return np.array([point[name] for point in points])

    t = np.array([time["sec"] + 1e-9 * time["nanosec"] for time in times])
    q, qd, qdd = column("positions"), column("velocities"), column("accelerations")
    return message["joint_names"], Samples(t, q, qd, qdd, np.full(len(t), np.nan))  # the gripper has its own goal


READERS = {"csv": read_csv, "npz": read_npz, "ros2-json": read_ros2_json}


@pytest.mark.parametrize("rate_hz", [RATE, 1000.0, 1e5])
@pytest.mark.parametrize("format_name", READERS)
def test_what_is_written_is_the_trajectory(
    tmp_path: Path, motion: JointTrajectory, format_name: str, rate_hz: float
) -> None:
    path = tmp_path / "motion"
    returned = export(motion, ROBOT, format_name, path, rate_hz).samples
    names, read = READERS[format_name](path)
    assert names == ["shoulder", "elbow"]
    times = np.arange(np.ceil(DURATION * rate_hz) + 1) / rate_hz
    if format_name == "ros2-json":  # the knots, and the samples that are not too near to one
        off = max(0.25 / rate_hz, 2e-5) * (1.0 - 1e-9)
        times = np.concatenate(([0.0], times[(times >= off) & (times <= DURATION - off)], [DURATION]))
    assert len(read.t) == len(returned.t) == len(times)
    assert_allclose(read.t, times, atol=1e-9)
    assert (np.diff(read.t) > 0.0).all()
    true = motion.at(times)
    assert_allclose(read.q, true.q, atol=1e-9)
    assert_allclose(read.qd, true.qd, atol=1e-8)
    assert_allclose(read.qdd, true.qdd, atol=1e-6)
    if format_name != "ros2-json":
        assert_allclose(read.gripper, true.gripper, atol=1e-6)
    assert_array_equal(read.qd[-1], 0.0)  # exactly
    assert_array_equal(read.qdd[-1], 0.0)
    assert_allclose(read.q[-1], (0.5, -1.25), atol=1e-9)


def test_the_default_rate_is_1_khz(tmp_path: Path, motion: JointTrajectory) -> None:
    assert_array_equal(export(motion, ROBOT, "npz", tmp_path / "motion.npz").samples.t, motion.t)


def test_a_file_of_that_name_is_replaced_if_pbd_wrote_it(tmp_path: Path, motion: JointTrajectory) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("notes")
    with pytest.raises(PbdError, match=r"motion.csv is not an earlier output of pbd, so it is not overwritten"):
        export(motion, ROBOT, "csv", path)
    assert path.read_text() == "notes"
    path.write_text("t,q_shoulder,q_elbow,gripper\n")
    export(motion, ROBOT, "csv", path)
    assert path.read_text().startswith("t,q_shoulder,q_elbow,dq_")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("is_there", [True, False])
@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_file_appears_completely_or_not_at_all(
    tmp_path: Path, motion: JointTrajectory, monkeypatch: pytest.MonkeyPatch, fault: BaseException, is_there: bool
) -> None:
    path = tmp_path / "motion.npz"
    if is_there:
        export(motion, ROBOT, "npz", path)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}

    def half(request: ExportRequest, points: Samples, unfinished: Path) -> None:
        unfinished.write_bytes(b"half a fil")
        raise fault

    monkeypatch.setattr(npz, "write", half)
    with pytest.raises((PbdError, KeyboardInterrupt)) as caught:
        export(motion, ROBOT, "npz", path)
    if isinstance(fault, OSError):
        assert str(caught.value) == f"{path} can't be written (No space left on device); give another place"
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("place", ["no/such/folder/motion.csv", "a-file/motion.csv", "a-folder"])
def test_a_path_that_cannot_be_written_is_refused(tmp_path: Path, motion: JointTrajectory, place: str) -> None:
    (tmp_path / "a-file").touch()
    (tmp_path / "a-folder").mkdir()
    with pytest.raises(PbdError, match=r"can't be written: .+ give another place$|a-folder is a folder"):
        export(motion, ROBOT, "csv", tmp_path / place)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a-file", "a-folder"]


def test_an_unknown_format_lists_the_known(tmp_path: Path, motion: JointTrajectory) -> None:
    with pytest.raises(
        PbdError,
        match=r"^no format 'xml'; known are csv, npz, ros2-json, keyframes, tum, tum-hand, urscript, mcap, l",
    ):
        export(motion, ROBOT, "xml", tmp_path / "motion")


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 1e6, np.inf, np.nan])
def test_a_rate_out_of_range_is_refused(tmp_path: Path, motion: JointTrajectory, rate_hz: float) -> None:
    with pytest.raises(PbdError, match="--rate must be 10 to 100000 Hz"):
        export(motion, ROBOT, "csv", tmp_path / "motion", rate_hz)
    assert list(tmp_path.iterdir()) == []


def test_a_format_that_needs_more_than_the_motion_says_from_where(tmp_path: Path, motion: JointTrajectory) -> None:
    with pytest.raises(
        PbdError, match=r"^keyframes needs what the motion was made from: plan with pbd\.planning\.plan_p"
    ):
        export(motion, ROBOT, "keyframes", tmp_path / "k.json")
    assert not [*tmp_path.iterdir()]


def test_points_that_miss_the_planned_motion_are_refused(motion: JointTrajectory) -> None:
    request = ExportRequest("csv", motion, ROBOT, ".csv", 1000.0)
    points = request.sampled()
    assert _deviating_motion(request, points, "cubic") is None
    q = points.q.copy()
    q[5] += 1e-3
    with pytest.raises(
        PlanError, match=r"by cubics the file's points miss the planned motion by 0\.001 rad at 0\.0[01] s"
    ):
        _deviating_motion(request, replace(points, q=q), "cubic")


def test_each_format_has_its_file() -> None:
    folder = Path(exporters.__file__).parent
    files = {path.stem for path in folder.glob("*.py")} - {
        "__init__",
        "export_request",
        "check_export",
        "controller_interpolation",
    }
    assert files == {each.module for each in FORMATS.values()}


def test_a_csv_names_its_columns_whatever_the_joints_names(tmp_path: Path, motion: JointTrajectory) -> None:
    joints = ('left, upper;;;;;;;; "arm"', "elbow\tä")
    file = tmp_path / "motion.csv"
    export(replace(motion, joint_names=joints), replace(ROBOT, joints=joints), "csv", file, RATE)
    with file.open(encoding="utf-8", newline="") as lines:
        header, first, *_ = csv.reader(lines)
    assert header[1:3] == [f"q_{name}" for name in joints]
    assert len(first) == len(header)
