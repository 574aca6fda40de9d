"""Fusing simulated takes: accuracy, the path, the devices, outliers, known stops, a moved object."""

import re
import warnings
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pbd
from pbd.data import Calibration, Contact, Demonstration, GripEvent, HandPath, LinearErrors, Place
from pbd.errors import CalibrationError, RecordingError, TrackingError, collected_warnings
from pbd.fusion.fused_calibration import _composed, device_errors
from pbd.fusion.grips import differing_grips, fused_grips
from pbd.fusion.known_stops import condition_on_known_stops
from pbd.fusion.marginals import SHARED_PART, estimate_with_device, marginal_of
from pbd.fusion.matching import Alignment, Keyframes, Registration
from pbd.fusion.mean_path import TakePath, average_paths
from pbd.fusion.tables import fusion_table
from pbd.fusion.takes import _devices_of, refuse_other_tasks, tracked_take
from pbd.pipeline import fused_demo, track
from pbd.pose import Pose, quat_exp, quat_multiply, quat_to_matrix
from pbd.simulation.sensor_model import SENSOR_MODELS
from pbd.simulation.simulate import simulate
from pbd.tracking.keyframes import find_keyframes
from pbd.view.units import Units
from tests.benchmarks.fuse import Scenario, _through, hand_poses, one_device, takes_of
from tests.benchmarks.fuse import _shape as shape_errors
from tests.fusion.made_up_takes import observations, rotations, truth
from tests.not_none import not_none

pytestmark = pytest.mark.usefixtures("cached_results")

SEED = 3


@pytest.fixture(scope="module")
def takes() -> list[Demonstration]:
    return takes_of(Scenario("wt901", 4), SEED)[0]


@pytest.fixture(scope="module")
def path(takes: list[Demonstration]) -> HandPath:
    return pbd.fuse(takes)


def median_error(path: HandPath) -> float:
    """Return the median error of the keyframes, m."""
    true, _ = hand_poses(takes_of(Scenario("wt901", 1), SEED)[1])
    p = path.p_nav_sensor[[stop.start for stop in path.stops]]
    return float(np.median(np.linalg.norm(shape_errors(p, true), axis=1)))


def test_four_takes_are_more_accurate_and_certain_than_each(path: HandPath, takes: list[Demonstration]) -> None:
    alone = [track(take.recording) for take in takes]
    assert median_error(path) < 0.7 * float(np.mean([median_error(one) for one in alone]))
    assert np.trace(path.cov[-1, :3, :3]) < 0.5 * min(np.trace(one.cov[-1, :3, :3]) for one in alone)


def test_the_table_has_the_largest_sigma_of_a_position(path: HandPath) -> None:
    """Those of the rotation, in rad, are larger."""
    shown = [float(str(cell)) for cell in fusion_table(path, Units()).columns[5].cells]
    np.testing.assert_allclose(shown, [1e3 * np.sqrt(np.diagonal(cov)[:3].max()) for cov in path.cov], atol=0.06)


def test_four_takes_do_not_tell_a_careful_keyframe_from_a_careless_one(path: HandPath) -> None:
    """The hand scatters by 0.5 mm at each; by four takes alone it would seem 0.1 mm at one and 1.1 mm at another."""
    assert path.fusion is not None
    assert 0.25e-3 < path.fusion.scatter[1:].min() < path.fusion.scatter[1:].max() < 1e-3


def test_a_take_is_estimated_with_given_errors_of_its_device(takes: list[Demonstration]) -> None:
    solution = tracked_take(takes[0], None, False).solution
    own = np.concatenate((solution.state.shared[SHARED_PART], solution.state.acc_bias[0]))
    other = own + 0.01 * np.sqrt(np.diagonal(np.linalg.inv(marginal_of(solution, (0,)).prior)))
    found = estimate_with_device(solution, other)
    np.testing.assert_allclose(np.concatenate((found.shared[SHARED_PART], found.acc_bias[0])), other, rtol=1e-12)
    again = estimate_with_device(replace(solution, state=found), other)
    np.testing.assert_allclose(again.p, found.p, atol=5e-5)  # m: the iteration stops at a step of 1e-4 rad


def test_the_path_is_continuous_and_rests_at_its_keyframes(path: HandPath) -> None:
    assert len(not_none(path.tracking).recording) == len(path.t)
    middles = [0.5 * (path.t[stop.start] + path.t[stop.stop - 1]) for stop in path.stops]
    assert [keyframe.t for keyframe in find_keyframes(path)] == pytest.approx(middles)
    steps = np.diff(path.p_nav_sensor, axis=0) - 0.5 * np.diff(path.t)[:, None] * (
        path.v_nav_sensor[1:] + path.v_nav_sensor[:-1]
    )
    assert np.abs(steps).max() < 1e-3
    assert np.linalg.norm(np.diff(path.p_nav_sensor, axis=0), axis=1).max() < 0.015
    np.testing.assert_allclose(path.p_nav_sensor[0], 0.0, atol=1e-12)
    for stop in path.stops:
        assert not path.v_nav_sensor[stop.start : stop.stop].any()


def test_a_move_of_which_each_take_has_one_end_is_refused() -> None:
    t, still = np.arange(4.0), np.tile((1.0, 0.0, 0.0, 0.0), (4, 1))
    ends = np.array(((0.0, 1.0), (2.0, 3.0)))
    one, other = (
        TakePath(t, np.zeros((4, 3)), still, np.where(has, ends, np.nan), np.ones(2)) for has in np.eye(2)[..., None]
    )
    with pytest.raises(TrackingError, match="has both keyframe 0 and 1"):
        average_paths((one, other), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), 0.1)


def test_an_attitude_and_its_opposite_quaternion_have_the_same_mean() -> None:
    """Near half a turn, which of the two a take has is chance."""
    t, wxyz = np.arange(40.0), quat_exp(np.linspace(0.0, 1.0, 40)[:, None] * (0.0, 0.0, 0.3))
    ends, places = np.array(((0.0, 10.0), (30.0, 39.0))), np.zeros((40, 3))
    takes = [TakePath(t, places, sign * wxyz, ends, np.ones(2)) for sign in (1.0, -1.0)]
    at = quat_to_matrix(wxyz[[0, -1]])
    one, both = (average_paths(these, np.zeros((2, 3)), at, 0.1) for these in (takes[:1], takes))
    np.testing.assert_allclose(both.wxyz, one.wxyz, atol=1e-12)


def test_takes_of_sensors_with_different_names_are_of_different_devices() -> None:
    """Alike as their errors seem: in a short take they hardly show."""
    one, other = observations(truth(2), np.full(1, 0.002), 0.001).marginals
    assert _devices_of((one, other), ("wt901", "wt901")) == (0, 0)
    assert _devices_of((one, other), ("wt901", "modern")) == (0, 1)


def test_keyframes_but_the_dock_have_the_learned_tolerances(path: HandPath) -> None:
    """The dock's was smaller than the sigma of a dock, so that each task was said to fail."""
    dock, *others = find_keyframes(path)
    assert dock.tolerance_m is None
    assert dock.tolerance_rad is None
    for k, keyframe in enumerate(others, 1):
        np.testing.assert_allclose(not_none(keyframe.tolerance_m), 2.0 * not_none(path.fusion).scatter[k])


def test_the_devices_errors_are_found(path: HandPath) -> None:
    """Corrected by them, gravity has the same norm in every orientation."""
    errors, _ = device_errors(path)
    up = np.random.default_rng(0).normal(size=(50, 3))
    gravity = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    device = replace(one_device(SENSOR_MODELS["wt901"], SEED).acc, noise=0.0, bias_walk=0.0, step=0.0)
    read = device.measure(gravity, np.ones(50), np.random.default_rng(0))
    assert np.ptp(np.linalg.norm(read, axis=1)) > 0.2
    assert np.ptp(np.linalg.norm(not_none(errors.acc).correct(read), axis=1)) < 0.03


def test_errors_that_are_found_add_to_those_of_an_earlier_calibration() -> None:
    rng = np.random.default_rng(0)
    first, second = (
        LinearErrors(rng.normal(size=3), np.eye(3) + 0.1 * rng.normal(size=(3, 3)), rng.uniform(size=3))
        for _ in range(2)
    )
    read = rng.normal(size=(5, 3))
    both = _composed(first, second)
    np.testing.assert_allclose(both.correct(read), second.correct(first.correct(read)))
    np.testing.assert_array_equal(both.bias_sigma, second.bias_sigma)
    assert _composed(None, second) is second


def test_no_errors_of_a_device_without_a_gyro_are_given(path: HandPath) -> None:
    with pytest.raises(CalibrationError, match="it has no gyro; leave out --save-calibration"):
        device_errors(replace(path, sensor=None))


def test_another_device_with_the_same_sensor_name_is_told_apart(takes: list[Demonstration]) -> None:
    own, _ = takes_of(Scenario("wt901", 1), SEED)
    assert own[0].recording.info.sensor == takes[0].recording.info.sensor
    another = takes_of(Scenario("wt901", 3), SEED, device=17)[0][2]  # a hand that misses otherwise than in the two
    fused = pbd.fuse([*takes[:2], renamed(another, "other")])
    assert [take.device for take in not_none(fused.fusion).takes] == [0, 0, 1]
    assert device_errors(fused)[1]["takes"] == 2


def renamed(demo: Demonstration, name: str) -> Demonstration:
    return replace(demo, recording=replace(demo.recording, info=replace(demo.recording.info, name=name)))


def test_takes_that_can_not_be_fused_are_refused(takes: list[Demonstration]) -> None:
    with pytest.raises(RecordingError, match="needs two takes of a task or more, got 1"):
        pbd.fuse(takes[:1])
    with pytest.raises(RecordingError, match="'again' is the same recording as 'take 1'; name each take once"):
        pbd.fuse([takes[0], renamed(takes[0], "again")])
    other = renamed(takes_of(Scenario("wt901", 1), SEED + 1)[0][0], "other")
    with pytest.raises(TrackingError, match=r"take 1 .* and other .* are of different tasks"):
        pbd.fuse([takes[0], other])
    with pytest.raises(TrackingError, match="fused by the default method only"):
        track(replace(takes[0], takes=tuple(takes)), method="paper")


@pytest.mark.parametrize(("alike", "others", "refused"), [(1, 0, True), (2, 1, False), (2, 2, True), (3, 2, False)])
def test_more_than_half_of_the_takes_are_of_one_task(alike: int, others: int, refused: bool) -> None:
    made: Any = [SimpleNamespace(name=f"take {k}", knots=(0,)) for k in range(alike + others + (alike < 2))]
    none = Keyframes(np.empty((0, 3)), np.empty((0, 3, 3)), (), np.empty(0))
    same = dict.fromkeys(range(alike), Registration(0.0, np.zeros(3), np.eye(3)))
    with pytest.raises(TrackingError, match=r"take 0 .* are of different tasks") if refused else nullcontext():
        refuse_other_tasks(made, Alignment(none, (), same, tuple(range(alike, len(made)))))


def test_an_outlier_take_is_named_and_left_out(takes: list[Demonstration]) -> None:
    far = renamed(takes_of(Scenario("wt901", 1, scatter_m=0.025), SEED)[0][0], "far")
    with pytest.warns(match="far is left out: it is far from the other takes"):
        fused = pbd.fuse([far, *takes[1:]])
    assert len(fused.stops) == 7


def test_takes_of_which_half_are_far_from_the_others_are_refused(
    takes: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each estimate finds another outlier."""
    monkeypatch.setattr("pbd.fusion.fuse.outlying_take", lambda *_: 0)
    with pytest.raises(TrackingError, match=r"half of the takes don't agree with the others \(take 1, take 2\);"):
        pbd.fuse(takes)


def test_what_is_wrong_with_a_take_is_said_with_its_name(takes: list[Demonstration]) -> None:
    recording = takes[1].recording
    with pytest.raises(RecordingError, match=r"^take 2: at rest the accelerometer reads"):
        tracked_take(replace(takes[1], recording=replace(recording, acc=10.0 * recording.acc)), None, False)
    lost = np.where(np.arange(len(recording))[:, None] == 70, np.nan, recording.acc)
    with pytest.warns(match=r"^take 2: 1 sample"):
        tracked_take(replace(takes[1], recording=replace(recording, acc=lost)), None, False)


def with_grips(*takes: tuple[bool | None, ...]) -> Any:
    """Return takes of which only the names and the keyframes' grips are known."""
    grips = [[SimpleNamespace(grip=grip) for grip in take] for take in takes]
    return [SimpleNamespace(name=f"take {k}", keyframes=take) for k, take in enumerate(grips)]


@pytest.mark.parametrize(
    ("grips", "says"),
    [
        ((None, True, None, False), "stays closed at the end, but it opens"),
        ((None, None, None, True), "stays open at the end, but it closes"),
    ],
)
def test_a_grip_that_moves_at_a_stop_that_is_left_out_is_said(grips: tuple[bool | None, ...], says: str) -> None:
    """Each take moves it at a stop of its own, which no other has. It is not said if only half of the takes do."""
    kept, made = [dict.fromkeys(range(3), j) for j in range(3)], with_grips(grips, grips, grips)
    (said,) = differing_grips(kept, made)
    assert said.startswith(f"the grip {says} in most takes, at a stop that is left out;")
    assert differing_grips([*kept, dict.fromkeys(range(3), 3)], made) == []
    assert differing_grips([{0: j, 1: j} for j in range(3)], with_grips(grips, (*grips[:3], None))) == []


def test_a_tie_moves_no_grip_that_no_take_moves_there() -> None:
    """A take closed it earlier; or three of seven did, and one opens it where only these and a fourth have a stop."""
    earlier = with_grips((None,) * 3, (None,) * 2, (True, None))
    assert fused_grips([{0: 0, 1: 0, 2: 0}, {0: 1, 1: 1}, {0: 2, 2: 1}], earlier) == [None] * 3
    three = with_grips((True, False), *[(True, None)] * 2, *[(None, None)] * 4)
    assert fused_grips([dict.fromkeys(range(7), 0), dict.fromkeys(range(4), 1)], three) == [None] * 2


def test_takes_whose_grips_differ_are_named_in_their_order() -> None:
    """Another one than the first may be the reference."""
    (said,) = differing_grips([{1: 0, 0: 0}], with_grips((True,), (None,)))
    assert said.startswith("at keyframe 0 the grip closes in take 0 but does not move in take 1: fused, it closes;")


def test_stops_that_only_one_of_two_takes_has_are_reported(takes: list[Demonstration]) -> None:
    with pytest.warns(match="only take 1 has stops 5 6, and they are left out; one more take"):
        assert len(pbd.fuse([takes[0], shortened(takes[1], 5)]).stops) == 5


def test_stops_that_half_of_four_takes_have_are_reported(takes: list[Demonstration]) -> None:
    with pytest.warns(match="only take 1 and take 3 have stops 5 6 of take 1, and they are left out; one more take"):
        fused = pbd.fuse([takes[0], shortened(takes[1], 5), takes[2], shortened(takes[3], 5)])
    assert len(fused.stops) == 5


def test_of_three_takes_the_majority_decides_which_stops_belong_to_the_task(takes: list[Demonstration]) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert len(pbd.fuse([takes[0], *(shortened(take, 5) for take in takes[1:3])]).stops) == 5
    assert not [str(each.message) for each in told if "one more take" in str(each.message)]


@pytest.mark.parametrize("late_s", [0.0, 1.0])
def test_edited_keyframes_with_the_times_of_other_takes_are_said(
    path: HandPath, takes: list[Demonstration], late_s: float
) -> None:
    """Where slower takes were added since keyframes.toml was saved, --path demo would go other ways in silence."""
    edited = [replace(each, t=each.t + (late_s if 0 < k < 6 else 0.0)) for k, each in enumerate(find_keyframes(path))]
    with collected_warnings() as warnings:
        track(replace(fused_demo(takes), keyframes=tuple(edited)))
    assert [line.partition(";")[0] for line in warnings] == [
        "keyframe 1 of keyframes.toml is in a move of the fused takes" for _ in range(late_s > 0.0)
    ]


def test_the_grip_is_that_of_most_takes(takes: list[Demonstration]) -> None:
    """Not that of the first one, who forgot to mark it here, nor what only the third marks."""
    shown = [{}, {1: True, 3: False}, {1: True, 3: False, 4: True}]
    says = "at keyframe 1 the grip does not move in take 1 but closes in take 2, take 3: fused, it closes"
    with collected_warnings() as warnings:
        fused = pbd.fuse([gripping(*each) for each in zip(takes, shown, strict=False)])
    assert len(warnings) == 3
    assert warnings[0].startswith(says)
    assert [keyframe.grip for keyframe in find_keyframes(fused)] == [None, True, None, False, None, None, None]


@pytest.mark.parametrize(
    ("shown", "fused"),
    [
        pytest.param([{1: True, 4: False}, {2: True, 4: False}], {1: True, 4: False}, id="two takes"),
        pytest.param([{1: True, 4: False}, {2: True, 5: False}, {3: True, 4: False}], {2: True, 4: False}, id="three"),
        pytest.param([{0: True, 4: False}, {}], {0: True, 4: False}, id="one forgot"),
    ],
)
def test_a_grip_marked_at_different_stops_is_kept_once(
    takes: list[Demonstration], shown: list[dict[int, bool]], fused: dict[int, bool]
) -> None:
    """No take's grip is lost or doubled, and what is said is what the keyframes do."""
    with collected_warnings() as warnings:
        found = find_keyframes(pbd.fuse([gripping(*each) for each in zip(takes, shown, strict=False)]))
    does = {True: "closes", False: "opens", None: "does not move"}
    assert {k: keyframe.grip for k, keyframe in enumerate(found) if keyframe.grip is not None} == fused
    said = [line for line in warnings if line.startswith("at keyframe")]
    assert len(said) == len({k for each in shown for k in each if not all(k in other for other in shown)})
    assert all(f"fused, it {does[found[int(line.split()[2])].grip]}" in line for line in said)
    assert not any("left out" in line for line in warnings)


def gripping(take: Demonstration, grips: dict[int, bool]) -> Demonstration:
    """Return a take with grips at its stops."""
    keyframes = find_keyframes(track(take.recording))
    events = tuple(GripEvent(keyframes[k].t, closed) for k, closed in grips.items())
    return replace(take, recording=replace(take.recording, grip=events))


def test_a_keyframe_whose_attitude_is_off_is_said_so(takes: list[Demonstration], path: HandPath) -> None:
    assert path.fusion is not None
    assert np.degrees(np.nanmax([take.off_rad for take in path.fusion.takes])) < 8.0  # the hand's tilt has 1 degree
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    p, A = hand_poses(task)
    A[3] = quat_multiply(quat_exp((0.0, 0.0, np.radians(40.0))), A[3])
    turned = simulate(_through(task, p, A, np.ones(7)), one_device(SENSOR_MODELS["wt901"], SEED), 1)
    with pytest.warns(match=r"turned is not believed at keyframe 3: it is \d mm and (3\d|4\d) degrees from the other"):
        fused = pbd.fuse([*takes[:3], renamed(turned, "turned")])
    assert np.degrees(not_none(fused.fusion).takes[3].off_rad[3]) == pytest.approx(40.0, abs=6.0)


@pytest.mark.parametrize(("degrees", "warned"), [(20.0, True), (3.0, False)])
def test_a_sensor_that_is_turned_in_the_hand_after_the_dock_is_warned_of(
    takes: list[Demonstration], degrees: float, warned: bool
) -> None:
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    p, A = hand_poses(task)
    A[1:] = quat_multiply(A[1:], quat_exp((np.radians(degrees), 0.0, 0.0)))
    turned = simulate(_through(task, p, A, np.ones(7)), one_device(SENSOR_MODELS["wt901"], SEED), 1)
    with collected_warnings() as lines:
        pbd.fuse([*takes[:3], renamed(turned, "turned")])
    assert any(line.startswith("in turned the sensor seems to be turned in the hand") for line in lines) == warned


def test_a_hand_that_is_careless_at_one_keyframe_is_believed_and_less_certain_there() -> None:
    """By the scatter of all keyframes, takes were left out there, and the others seemed as certain as elsewhere."""
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    (p, A), model = hand_poses(task), one_device(SENSOR_MODELS["wt901"], SEED)
    miss = 0.001 * np.random.default_rng(1).normal(size=(4, 7, 3)) * np.array((0, 1, 1, 8, 1, 1, 1))[:, None]
    shown = [simulate(_through(task, p + by, A, np.ones(7)), model, k) for k, by in enumerate(miss)]
    with collected_warnings() as lines:
        fused = pbd.fuse([renamed(demo, f"tea{k}") for k, demo in enumerate(shown)])
    assert not [line for line in lines if "not believed" in line]
    sigma = np.sqrt(np.trace(fused.cov[:, :3, :3], axis1=1, axis2=2))
    assert sigma[3] > 1.5 * sigma[[2, 4]].max()


def test_takes_docked_otherwise_than_the_hand_holds_the_sensor_are_told_so(takes: list[Demonstration]) -> None:
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    p, A = hand_poses(task)
    A[1:] = quat_multiply(A[1:], quat_exp((0.0, 0.0, 0.5 * np.pi)))
    other = simulate(_through(task, p, A, np.ones(7)), one_device(SENSOR_MODELS["wt901"], SEED), 1)
    with pytest.raises(TrackingError, match=r"take 1 and other match, but for the dock: .* turn it in the dock too"):
        pbd.fuse([takes[0], renamed(other, "other")])


def test_two_tasks_that_match_by_chance_are_warned_of(takes: list[Demonstration], path: HandPath) -> None:
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    p, A = hand_poses(task)
    p[1:] += np.random.default_rng(1).normal(0.0, 0.09, p[1:].shape)
    other = simulate(_through(task, p, A, np.ones(7)), one_device(SENSOR_MODELS["wt901"], SEED), 1)
    with pytest.warns(match=r"the keyframes scatter by 3\d mm from take to take, more than a hand's"):
        pbd.fuse([takes[0], renamed(other, "other")])
    assert not_none(path.fusion).overall[0] < 0.01


@pytest.mark.parametrize(("shift", "warned"), [(0.05, True), (0.003, False)])
def test_keyframes_that_a_long_lever_explains_are_warned_of(shift: float, warned: bool) -> None:
    """Something stood elsewhere in the first take, and just there the hand was turned about the vertical."""
    task = takes_of(Scenario("wt901", 1), SEED)[1]
    p = 0.01 * np.array(((0, 0, 0), (0, 0, 10), (18, 5, 10), (18, 5, 2), (18, 5, 12), (5, 15, 10), (0, 0, 0)))
    A = np.tile(hand_poses(task)[1][0], (7, 1))
    A[2:5] = quat_multiply(quat_exp((0.0, 0.0, np.radians(20.0))), A[0])
    first, model, several = p.copy(), one_device(SENSOR_MODELS["wt901"], SEED), []
    first[2:5, 1] += shift
    for k, at in enumerate((first, p, p), 1):
        several.append(renamed(simulate(_through(task, at, A, np.ones(7)), model, k), f"tea{k}"))
    with collected_warnings() as lines:
        fused = pbd.fuse(several)
    found = fused.p_nav_sensor[[stop.start for stop in fused.stops]]
    assert np.linalg.norm(shape_errors(found, first), axis=1).max() < 0.01
    what = r"in tea2 and tea3 the sensor seems to sit 1\d cm from its place in the hand in tea1; if nobody moved it, "
    assert any(re.match(what, line) for line in lines) == warned


def test_a_single_stop_is_reported_in_the_singular(takes: list[Demonstration]) -> None:
    first, second = (shortened(take, stops) for take, stops in zip(takes, (2, 1), strict=False))
    with pytest.warns(match="only take 1 has stop 1, and it is left out; one more take would show whether it belongs"):
        fused = pbd.fuse([first, second])
    assert repr(fused.fusion) == "<Fusion: 2 takes, 1 keyframe>"


def shortened(take: Demonstration, stops: int) -> Demonstration:
    """Return a take cut off after its first `stops` stops."""
    whole, end = take.recording, track(take.recording).stops[stops - 1].stop
    cut = replace(whole, t=whole.t[:end], acc=whole.acc[:end], gyr=not_none(whole.gyr)[:end], mag=None, device_rpy=None)
    return replace(take, recording=cut, truth=None)


def test_known_stops_of_takes_are_used(path: HandPath, takes: list[Demonstration]) -> None:
    true, wxyz = hand_poses(takes_of(Scenario("wt901", 1), SEED)[1])
    middles = [[keyframe.t for keyframe in find_keyframes(track(take.recording))] for take in takes]
    height = float(true[5, 2] - true[0, 2])

    def with_height(z: float) -> list[Demonstration]:
        contacts = [Contact(t[5], height=z, sigma_m=5e-4) for t in middles]
        return [replace(take, contacts=(contact,)) for take, contact in zip(takes, contacts, strict=True)]

    surer = pbd.fuse(with_height(height))
    assert surer.cov[5, 2, 2] < 0.5 * path.cov[5, 2, 2]
    with pytest.raises(TrackingError, match=r"take 1: demo.toml says that .* above its first rest, but it is .* off"):
        pbd.fuse(with_height(height + 0.1)[:2])
    dock = Pose(np.array((0.4, 0.0, 0.2)), wxyz[0])
    x, y, z = (dock.p + true[3] - true[0]).tolist()
    known = replace(takes[1], places=(Place((middles[1][3],), p_base_tool=(x, y, z)),))
    fused = pbd.fuse([takes[0], known], Calibration("bench", T_base_dock=dock))
    assert [claim.stop for claim in fused.claims] == [3]
    left_out = replace(takes[0], places=(Place((middles[0][6],), p_base_tool=(x, y, z)),))
    with pytest.warns(match="only take 1 has stops 5 6, and they are left out"):
        fused = pbd.fuse([left_out, shortened(takes[1], 5)], Calibration("bench", T_base_dock=dock))
    assert not fused.claims


@pytest.mark.parametrize("kind", ["height", "place"])
def test_a_known_stop_that_contradicts_a_take_is_refused_only_where_it_is_asked(
    takes: list[Demonstration], kind: str
) -> None:
    """With the first guess of how the sensor sits in the hand, a true height may seem to contradict."""
    middles = [keyframe.t for keyframe in find_keyframes(track(takes[0].recording))]
    known: Any = {"contacts": (Contact(middles[5], height=1.0, sigma_m=5e-4),)}
    if kind == "place":
        known = {"places": (Place((middles[2], middles[5])),)}
    take = tracked_take(replace(takes[0], **known), None, False)
    condition = partial(condition_on_known_stops, take, take.marginal, np.tile(np.eye(3), (2, 1, 1)), np.zeros(3), None)
    condition(refuse=False)
    with pytest.raises(TrackingError, match=r"take 1: demo.toml says that .* but it is .* off"):
        condition(refuse=True)


def test_what_is_known_of_a_stop_holds_for_the_first_takes_place_in_the_hand(takes: list[Demonstration]) -> None:
    keyframes = find_keyframes(track(takes[0].recording))
    known = (Contact(keyframes[5].t, height=0.0, sigma_m=1e-5),)
    take, lever = tracked_take(replace(takes[0], contacts=known), None, False), np.array((0.3, -0.2, 0.1))
    Q = rotations(np.array(((0.0, 0.0, 0.0), (0.3, 0.0, 0.0))))  # in the dock, and away from it
    marginal = condition_on_known_stops(take, take.marginal, Q, lever, None, refuse=False)
    first = marginal.p - marginal.R @ Q[[0, *[1] * (len(keyframes) - 1)]] @ lever
    assert first[5, 2] - first[0, 2] == pytest.approx(0.0, abs=0.01)


def test_keyframes_that_move_with_an_object_are_found(path: HandPath) -> None:
    assert not_none(path.fusion).thing is None
    fused = not_none(pbd.fuse(takes_of(Scenario("wt901", 3, thing=(3, 4)), SEED)[0]).fusion)
    assert fused.thing is not None
    assert (fused.thing.first, fused.thing.last) == (3, 4)
    assert fused.thing.moved_m["take 1"] == 0.0
    assert fused.thing.moved_m["take 2"] > 0.02
    assert np.nanmax(np.abs([take.off for take in fused.takes])) < 0.01
