"""The data classes: read-only arrays, refused shapes, repr; trajectories against numpy's polynomials."""

import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import FrozenInstanceError, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose, assert_array_equal

import pbd
from pbd.arm.motion_request import Segment
from pbd.data import (
    TOOL_DOWN,
    Calibration,
    Demonstration,
    GripEvent,
    Gripper,
    HandPath,
    JointLimits,
    JointTrajectory,
    Keyframe,
    LinearErrors,
    Recording,
    RecordingInfo,
    Robot,
    Samples,
    SensorErrors,
    Stop,
    TouchUp,
    Tracking,
    Truth,
)
from pbd.data.covariance import PoseCovariance
from pbd.errors import UsageError, WrongTypeError, WrongValueError, amount, in_degrees
from pbd.pose import Array, Pose

N, K = 5, 2
ONES = np.ones(K)
LIMITS = JointLimits(-ONES, 2.0 * ONES, ONES, ONES, ONES, source="")


def robot(home: Array) -> Robot:
    return Robot("", "", Path(), None, (), "", "", TOOL_DOWN, ("a", "b"), home, None, LIMITS)


VALUES: dict[str, tuple[Callable[..., Any], dict[str, tuple[int, ...]]]] = {
    "Recording": (Recording, {"t": (N,), "acc": (N, 3), "gyr": (N, 3), "mag": (N, 3), "device_rpy": (N, 3)}),
    "Truth": (Truth, {"t": (N,), "p_nav_sensor": (N, 3), "wxyz_nav_sensor": (N, 4)}),
    "HandPath": (
        partial(
            HandPath, stops=(Stop(0, 1, 0.1), Stop(3, 5, 0.2)), covariance=PoseCovariance.chained(np.zeros((2, 6, 6)))
        ),
        {
            "t": (N,),
            "p_nav_sensor": (N, 3),
            "v_nav_sensor": (N, 3),
            "wxyz_nav_sensor": (N, 4),
            "closure": (1, 3),
        },
    ),
    "Keyframe": (
        partial(Keyframe, 0.0, 0.5, Pose.identity()),
        {"cov": (6, 6), "nudge_base_m": (3,), "nudge_tool_m": (3,)},
    ),
    "TouchUp": (partial(TouchUp, 1.0), {"by_nav_m": (3,)}),
    "Gripper": (partial(Gripper, ("a", "b"), stroke_s=1.0), {"open": (K,), "closed": (K,)}),
    "JointLimits": (
        partial(JointLimits, source=""),
        {"lower": (K,), "upper": (K,), "velocity": (K,), "acceleration": (K,), "jerk": (K,)},
    ),
    "Robot": (robot, {"home": (K,)}),
    "Samples": (Samples, {"t": (N,), "q": (N, K), "qd": (N, K), "qdd": (N, K), "gripper": (N,)}),
    "JointTrajectory": (
        partial(JointTrajectory, ("a", "b")),
        {
            "knots": (N + 1,),
            "coefficients": (N, 4, K),
            "gripper_t": (3,),
            "gripper_opening": (3,),
            "keyframe_t": (2,),
            "keyframe_q": (2, K),
        },
    ),
}
REFUSE_NAN = {
    "JointLimits": ("lower", "velocity", "acceleration", "jerk"),
    "Keyframe": ("cov", "nudge_base_m", "nudge_tool_m"),
    "Robot": ("home",),
}
EACH_ARRAY = [(name, field) for name, (_, shapes) in VALUES.items() for field in shapes]


def sources(name: str) -> dict[str, Array]:
    """Arrays for the fields: knots increase, lower limits are below upper ones, and a covariance is symmetric."""
    shapes = VALUES[name][1]
    arrays = {
        field: np.arange(float(np.prod(shape))).reshape(shape) + i for i, (field, shape) in enumerate(shapes.items())
    }
    return arrays | {field: array + array.T for field, array in arrays.items() if field == "cov"}


@pytest.mark.parametrize("name", VALUES)
def test_all_arrays_are_listed_here(name: str) -> None:
    make, shapes = VALUES[name]
    value = make(**sources(name))
    assert {field.name for field in fields(value) if isinstance(getattr(value, field.name), np.ndarray)} == set(shapes)


@pytest.mark.parametrize(("name", "field"), EACH_ARRAY)
def test_frozen_for_real(name: str, field: str) -> None:
    make, arrays = VALUES[name][0], sources(name)
    value = make(**arrays)
    before = arrays[field].copy()
    arrays[field][...] = 9.0
    assert_array_equal(getattr(value, field), before)  # what is done to the source doesn't leak in
    for each in (value, deepcopy(value), pickle.loads(pickle.dumps(value))):
        with pytest.raises(ValueError, match="read-only"):
            getattr(each, field)[...] = 9.0
    with pytest.raises(FrozenInstanceError):
        setattr(value, field, arrays[field])


def test_a_moves_joints_are_read_only() -> None:
    assert not pickle.loads(pickle.dumps(Segment("straight", np.zeros((1, K))))).q.flags.writeable


@pytest.mark.parametrize(("name", "field"), EACH_ARRAY)
def test_another_shape_is_refused(name: str, field: str) -> None:
    make, arrays = VALUES[name][0], sources(name)
    right = arrays[field]
    for wrong in (right[..., None], np.concatenate((right, right[:1])), right[..., 0]):
        with pytest.raises((ValueError, TypeError)):
            make(**arrays | {field: wrong})


def test_one_of_a_unit_is_singular_as_it_is_shown() -> None:
    assert [amount(n, "sample") for n in (0, 1, 2)] == ["0 samples", "1 sample", "2 samples"]
    assert [in_degrees(np.radians(deg)) for deg in (0.4, 0.6, -1.4, 1.6)] == [
        "0 degrees",
        "1 degree",
        "-1 degree",
        "2 degrees",
    ]
    assert [amount(1.0, "degree", form) for form in (".1f", ".3g")] == ["1.0 degrees", "1 degree"]


def test_a_refusal_names_the_field_and_both_shapes() -> None:
    with pytest.raises(WrongTypeError, match=r"^Recording\.acc must have shape \(5, 3\), got \(5, 2\)$"):
        Recording(t=np.zeros(5), acc=np.zeros((5, 2)))


def test_a_demonstration_can_be_copied_and_sent_to_another_process() -> None:
    demo = pbd.load_demo("pouring")
    for copy in (deepcopy(demo), pickle.loads(pickle.dumps(demo))):
        assert np.array_equal(copy.recording.acc, demo.recording.acc)


def test_so_can_a_robot_and_its_dock() -> None:
    panda = pbd.load_robot("panda")
    for copy in (deepcopy(panda), pickle.loads(pickle.dumps(panda))):
        assert copy.limits.sources == panda.limits.sources
        assert copy.dock is not None
        with pytest.raises(TypeError):
            copy.dock.residuals["position_m"] = 9.0  # type: ignore[index]


def test_what_a_device_lacks_is_none() -> None:
    recording = Recording(t=np.zeros(3), acc=np.zeros((3, 3)))
    assert (recording.gyr, recording.mag, recording.device_rpy) == (None, None, None)
    assert len(recording) == 3


def test_the_rate_is_that_of_the_median_interval() -> None:
    """A gap does not change the rate."""
    assert Recording(t=np.array([0.0, 0.01, 0.02, 5.0]), acc=np.zeros((4, 3))).rate_hz == pytest.approx(100.0)


def test_a_calibration_has_no_dock_beside_a_registration() -> None:
    Calibration("x")  # enough to track with
    with pytest.raises(ValueError, match="at most one of T_base_dock and T_base_nav"):
        Calibration("x", T_base_dock=Pose.identity(), T_base_nav=Pose.identity())


def test_residuals_are_frozen_too() -> None:
    source = {"position_m": 0.001}
    calibration = Calibration("x", T_base_dock=Pose.identity(), residuals=source)
    source["position_m"] = 9.0
    assert calibration.residuals == {"position_m": 0.001}
    with pytest.raises(TypeError):
        calibration.residuals["position_m"] = 9.0  # type: ignore[index]


# --- JointTrajectory --------------------------------------------------------------------------------------------------


def trajectory(seed: int, durations: list[float]) -> JointTrajectory:
    """A trajectory of random pieces that do not join: only the polynomials are tested."""
    rng = np.random.default_rng(seed)
    return JointTrajectory(
        joint_names=("a", "b"),
        knots=np.concatenate(([0.0], np.cumsum(durations))),
        coefficients=rng.normal(size=(len(durations), 4, K)),
        gripper_t=np.array([0.2, 0.4]),
        gripper_opening=np.array([1.0, 0.0]),
        keyframe_t=np.zeros(0),
        keyframe_q=np.zeros((0, K)),
    )


pieces = st.lists(st.floats(0.01, 2.0), min_size=1, max_size=4)
trajectories = st.builds(trajectory, st.integers(0, 99), pieces)


@given(trajectories, st.floats(0.0, 1.0, exclude_max=True))
def test_at_is_the_piece_that_begins_or_holds_there(motion: JointTrajectory, share: float) -> None:
    for t in (share * motion.duration, *motion.knots[:-1]):
        piece = max(i for i, knot in enumerate(motion.knots[:-1]) if knot <= t)
        samples = motion.at(np.array([t]))
        for joint in range(K):
            q = Polynomial(motion.coefficients[piece, :, joint])
            s = t - motion.knots[piece]
            assert_allclose(samples.q[0, joint], q(s), atol=1e-12)
            assert_allclose(samples.qd[0, joint], q.deriv()(s), atol=1e-12)
            assert_allclose(samples.qdd[0, joint], q.deriv(2)(s), atol=1e-12)


@given(trajectories, st.floats(0.0, 10.0))
def test_the_ends_are_held(motion: JointTrajectory, beyond: float) -> None:
    q_end = [Polynomial(c)(motion.knots[-1] - motion.knots[-2]) for c in motion.coefficients[-1].T]
    after = motion.at(np.array([motion.duration + beyond]))
    assert_allclose(after.q[0], q_end, atol=1e-12)
    assert_array_equal((after.qd, after.qdd), 0.0)
    before = motion.at(np.array([-beyond - 1e-9]))
    assert_array_equal(before.q, motion.at(np.array([0.0])).q)
    assert_array_equal((before.qd, before.qdd), 0.0)


def test_a_single_instant_gives_one_row() -> None:
    motion = trajectory(0, [1.0])
    assert_array_equal(motion.at(0.5).q, motion.at(np.array([0.5])).q)


def test_an_instant_that_is_no_number_is_refused() -> None:
    with pytest.raises(UsageError, match="an instant of the trajectory is NaN"):
        trajectory(0, [1.0]).at([0.1, np.nan])


def test_the_gripper_goes_straight_and_is_held() -> None:
    samples = trajectory(0, [1.0]).at(np.array([-1.0, 0.0, 0.2, 0.25, 0.3, 0.4, 1.0, 9.0]))
    assert_allclose(samples.gripper, [1.0, 1.0, 1.0, 0.75, 0.5, 0.0, 0.0, 0.0])


durations = st.floats(0.01, 2.0) | st.integers(10, 2000).map(lambda ms: float(np.nextafter(ms / 1000, 9.0)))


@given(st.builds(lambda duration: trajectory(0, [duration]), durations), st.floats(10.0, 1000.0) | st.just(1000.0))
def test_samples_reach_the_end_and_stop_there(motion: JointTrajectory, rate_hz: float) -> None:
    samples = motion.sample(rate_hz)
    assert_allclose(samples.t * rate_hz, np.arange(len(samples.t)), rtol=1e-12)
    assert samples.t[-2] < motion.duration <= samples.t[-1]
    assert_array_equal((samples.qd[-1], samples.qdd[-1]), 0.0)  # exactly: controllers refuse a final velocity
    assert_allclose(samples.q[-1], motion.at(np.array([motion.duration])).q[0], atol=0.0)


def test_a_trajectory_is_at_hand_at_1_khz() -> None:
    motion = trajectory(3, [0.1, 0.2])
    samples = motion.sample(1000.0)
    for name in ("t", "q", "qd", "qdd", "gripper"):
        assert_array_equal(getattr(motion, name), getattr(samples, name))


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("spoilt", [False, True])
def test_a_value_says_what_it_is_in_one_short_line(name: str, spoilt: bool) -> None:
    """Also with long arrays and with NaN: a debugger prints any value."""
    make, arrays = VALUES[name][0], sources(name)
    if spoilt and name in REFUSE_NAN:
        for field in REFUSE_NAN[name]:
            with pytest.raises(WrongValueError, match=rf"^{name}\.{field} must be "):
                make(**arrays | {field: np.nan * arrays[field]})
        return
    said = repr(make(**{field: np.nan * array if spoilt else array for field, array in arrays.items()}))
    assert "\n" not in said
    assert len(said) < 200


def test_a_person_sees_how_much_there_is() -> None:
    t = np.arange(2281) / 100.0
    grip = (GripEvent(1.0, True), GripEvent(2.0, False))
    info = RecordingInfo(name="tea")
    recording = Recording(t, np.zeros((2281, 3)), mag=np.zeros((2281, 3)), grip=grip, info=info)
    assert repr(recording) == "<Recording 'tea': 2281 samples, 22.8 s at 100 Hz, acc, mag, 2 grips>"
    assert repr(Demonstration(recording)) == "<Demonstration 'tea': 2281 samples, 22.8 s at 100 Hz>"
    assert repr(replace(recording, t=t[:1], acc=np.zeros((1, 3)), mag=None, grip=())) == (
        "<Recording 'tea': 1 sample, acc>"
    )
    keyframe = Keyframe(3.2, 0.84, Pose(np.array((0.1, -0.2, -1e-9)), np.eye(4)[0]), 1.6e-5 * np.eye(6), grip=True)
    assert repr(keyframe) == ("<Keyframe: at 3.20 s for 0.84 s, (0.100, -0.200, -0.000) m, sigma 4.0 mm, grip closes>")
    assert repr(Demonstration(recording, keyframes=(keyframe,))).endswith(" at 100 Hz, 1 edited keyframe>")
    triad = LinearErrors(np.array((0.01, -2.0, 3e-7)), np.eye(3), np.zeros(3))
    assert repr(triad) == "<LinearErrors: bias (0.01, -2, 3e-07)>"
    assert repr(SensorErrors("witmotion", gyr=triad, mag=triad)) == "<SensorErrors 'witmotion': gyr, mag>"
    calibration = Calibration("bench", T_base_dock=Pose.identity(), table_height=0.0)
    assert repr(calibration) == "<Calibration 'bench': dock, table>"
    assert repr(PoseCovariance.chained(np.zeros((11, 6, 6)))) == "<PoseCovariance: 11 poses>"
    tracking = Tracking(Demonstration(recording), "paper", calibration, recording, np.zeros((2281, 3)), 9.81, (0, 99))
    assert repr(tracking) == "<Tracking 'tea': paper, gravity 9.810 m/s2, calibrated by 'bench'>"
    assert "calibrated" not in repr(replace(tracking, calibration=None))


def test_a_path_has_a_covariance_of_all_its_stops() -> None:
    with pytest.raises(ValueError, match=r"HandPath\.covariance must be of 2 poses, got 1"):
        VALUES["HandPath"][0](**sources("HandPath"), covariance=PoseCovariance.chained(np.zeros((1, 6, 6))))


def test_a_negative_variance_in_m2_is_refused_beside_large_ones_in_rad2() -> None:
    with pytest.raises(WrongValueError, match="with variances of 0 or above"):
        Keyframe(0.0, 1.0, Pose.identity(), np.diag((-9e-8, 1e-6, 1e-6, 1e-2, 1e-2, 1e-2)))
