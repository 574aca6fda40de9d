"""Each format for each kind of arm, read back as its receivers do and interpolated; what exceeds a limit is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.audit.audit import audit_received
from pbd.data import Calibration, Obstacle, Samples
from pbd.errors import PbdWarning, PlanError
from pbd.files.exporters import FORMATS, SERVOJ_HZ, csv, export, urscript
from pbd.files.exporters.controller_interpolation import interpolate, limit_shares
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Pose
from tests.arm.bundled import arm_of
from tests.files.planned_motions import planned
from tests.files.urscript import Controller

RATES = {"csv": 100.0, "npz": 200.0, "tum": 20.0, "mcap": 10.0, "glb": 10.0}
RULES = {
    "csv": "hold",
    "npz": "hold",
    "lerobot": "hold",
    "urscript": "trapezoid",
    "ros2-json": "cubic",
    "mcap": "quintic",
}


@pytest.mark.filterwarnings("ignore:a controller that fills the gaps")
@pytest.mark.parametrize("name", ["so101", "ur5"])
def test_every_format(tmp_path: Path, name: str) -> None:
    plan, robot, source = planned(name, "paper-test2")  # the shortest
    for format_name in FORMATS:
        if format_name == "urscript" and not name.startswith("ur"):
            continue
        rate_hz, place = RATES.get(format_name), tmp_path / format_name
        done = export(plan.trajectory, robot, format_name, place, rate_hz, source=source)
        assert place.exists()
        assert (RULES[format_name] in done.receiver) if format_name in RULES else not done.receiver
        shares = [share for shares in done.receiver.values() for share in shares]
        assert max((share.value for share in shares), default=1.0) <= 1.0
    if name.startswith("ur"):
        for rate_hz in SERVOJ_HZ:
            done = export(plan.trajectory, robot, "urscript", tmp_path / "dense", rate_hz, dense=True, source=source)
            assert max(share.value for share in done.receiver["hold"]) <= 1.0


def test_urscript_is_read_back_as_the_controller_runs_it(tmp_path: Path) -> None:
    plan, robot, source = planned("ur5")
    for rate_hz in (None, 125.0):
        export(plan.trajectory, robot, "urscript", tmp_path / "p", rate_hz, dense=rate_hz is not None, source=source)
        controller, points = Controller(plan.trajectory.q[0]), urscript.read(tmp_path / "p")
        controller.run((tmp_path / "p").read_text())
        at = np.array([t for t, _ in controller.servoed] or [move[1] for move in controller.moves])
        q = np.array([q for _, q in controller.servoed] or [move[3] for move in controller.moves])
        late = 0.0 if rate_hz is None else 0.2  # stays last whole periods here
        assert all(np.abs(points.q - each).max(axis=1).min() < 1e-9 for each in q[::7])
        assert points.t[-1] == pytest.approx(controller.t, abs=1e-9 + late)
        if rate_hz is None:
            assert_allclose(np.interp(at, points.t, points.q[:, 0]), q[:, 0], atol=1e-9)
            calls = [t for t, name in controller.calls if name.startswith("gripper")]
            assert_allclose(points.t[np.flatnonzero(np.diff(points.gripper))], calls, atol=1e-9)


def broken(monkeypatch: pytest.MonkeyPatch, change: Callable[[ExportRequest, Samples], Samples]) -> None:
    """Make csv write other points than it was given."""
    good = csv.write

    def write(request: ExportRequest, points: Samples, path: Path) -> None:
        good(request, change(request, points), path)

    monkeypatch.setattr(csv, "write", write)


def jolted(_: ExportRequest, points: Samples) -> Samples:
    q = points.q.copy()
    q[400, 2] += 3e-3
    return replace(points, q=q)


def turned(_: ExportRequest, points: Samples) -> Samples:
    return replace(points, q=points.q + 0.02 * np.eye(points.q.shape[1])[0])


def unfinished(_: ExportRequest, points: Samples) -> Samples:
    return replace(points, qdd=np.full_like(points.qdd, np.nan))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (jolted, r"takes each sample at its time would reach 1\.\d+ times panda_joint3's velocity limit"),
        (turned, r"keyframe 0 would be missed by \d+\.\d mm and \d\.\d\d degrees; give a lower --speed$"),
        (unfinished, "the csv file can't be read back"),
    ],
)
def test_a_file_that_is_not_the_motion_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[ExportRequest, Samples], Samples], said: str
) -> None:
    plan, robot, source = planned("panda")
    broken(monkeypatch, change)
    with pytest.raises(PlanError, match=said):
        export(plan.trajectory, robot, "csv", tmp_path / "m.csv", source=source)
    assert list(tmp_path.iterdir()) == []


def test_the_last_digit_of_the_times_is_no_jerk() -> None:
    """A joint at a constant 1 rad/s, after 15 s, at 30 kHz."""
    since = np.arange(1000) / 3e4
    q = np.tile(since[:, None], 6)
    points = Samples(15.0 + since, q, np.ones_like(q), np.zeros_like(q), np.ones_like(since))
    *_, jerk = limit_shares(points, "quintic", arm_of("ur5").robot.limits)
    assert jerk.value <= 0.0


def test_a_higher_rate_and_the_proposed_margin_work(tmp_path: Path) -> None:
    plan, robot, source = planned("panda")
    tight = replace(robot, limits=replace(robot.limits, jerk=plan.report.jerk * robot.limits.jerk))
    for format_name, arm, rate_hz, said in (
        (
            "csv",
            robot,
            11.0,
            r"keyframe 4 would be missed by \d\.\d mm and \d\.\d\d degrees; give a higher --rate, or a l",
        ),
        (
            "ros2-json",
            tight,
            None,
            r"by quintics would reach 1\.00000\d\d times .* jerk limit, at .*; give --margin 1$",
        ),
    ):
        with pytest.raises(PlanError, match=said):
            export(plan.trajectory, arm, format_name, tmp_path / "m", rate_hz, source=source)
    looser = replace(tight, limits=replace(tight.limits, jerk=1.001 * tight.limits.jerk))
    export(plan.trajectory, looser, "ros2-json", tmp_path / "m", source=source)
    with pytest.warns(PbdWarning, match="by cubics"):
        export(plan.trajectory, robot, "csv", tmp_path / "m", 20.0, source=source)


def test_a_received_motion_that_touches_something_is_refused() -> None:
    """A pearl is in the tool's way between two of ten rows a second."""
    plan, robot, source = planned("panda")
    rows = plan.trajectory.sample(10.0)
    path = replace(
        plan.trajectory,
        knots=rows.t,
        coefficients=interpolate(rows, "hold")[:, :4],
        keyframe_t=np.zeros(1),
        keyframe_q=rows.q[:1],
    )
    source.audit(path)
    p, _ = source.tool(path.at(np.array([3.05])).q)
    pearl = Obstacle("the pearl", "sphere", (0.02,), Pose(p[0], np.eye(4)[0]))
    with pytest.raises(PlanError, match=r"between the exported points .* would touch the pearl at 2\.\d\d s$"):
        audit_received(path, robot, (replace(plan.calibration, obstacles=(pearl,)), None))


def test_a_tool_that_a_finger_carries_is_where_the_opening_puts_it() -> None:
    """No keyframe is missed. That finger is then no longer part of the gripper, and touches the other one."""
    plan, robot, _ = planned("panda")
    with pytest.raises(PlanError, match=r"panda_leftfinger would touch panda_rightfinger"):
        audit_received(plan.trajectory, replace(robot, body="panda_leftfinger"), (plan.calibration, None))


@pytest.mark.parametrize(("missed_m", "refused"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_keyframe_may_be_missed_by_a_millimetre(missed_m: float, refused: bool) -> None:
    """The arm's first joint is off by an angle that moves the tool this far."""
    plan, robot, _ = planned("panda", "paper-test2")
    path, world = plan.trajectory, (Calibration("bench", T_base_dock=Pose.identity()), None)
    p = arm_of("panda").forward(path.keyframe_q[1]).p
    turned = np.array(path.keyframe_q)
    turned[1, 0] += missed_m / np.hypot(p[0], p[1])
    if refused:
        with pytest.raises(PlanError, match=r"keyframe 1 would be missed by 1\.1 mm"):
            audit_received(replace(path, keyframe_q=turned), robot, world)
    else:
        audit_received(replace(path, keyframe_q=turned), robot, world)
