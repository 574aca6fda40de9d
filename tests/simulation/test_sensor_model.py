"""The sensor model: each error shows in the data, alone, at its stated size; the presets are those of their table."""

from dataclasses import replace
from math import pi, radians, sqrt

import numpy as np
import pytest

from pbd.data import GRAVITY, Recording
from pbd.errors import SensorError
from pbd.pose import Array, quat_exp, quat_from_rpy, quat_inverse, quat_log, quat_multiply
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.sensor_model import AttitudeOutput, SensorModel, Triad
from pbd.simulation.simulate import SENSOR_MODELS, World, simulate
from pbd.simulation.tasks import Task
from tests.near import assert_near
from tests.not_none import not_none

DEG, MG = pi / 180.0, 1e-3 * GRAVITY
NOWHERE = World(gravity=0.0, field=(0.0, 0.0, 0.0))
"""Where a still sensor should read nothing at all: what it reads is its errors."""


def still(seconds: float) -> Task:
    return Task("still", (Waypoint(rest_s=seconds),))


def parts(recording: Recording) -> dict[str, Array]:
    named = {"acc": recording.acc, "gyr": recording.gyr, "mag": recording.mag}
    return {name: values for name, values in named.items() if values is not None}


# The table of presets: rate; noise density, bias, range of acc (m/s2) and gyr (rad/s); scale of acc; noise of mag (uT).
TABLE = {
    "os5000": (40, (0.4 * MG, 5 * MG, 4000 * MG), (0.03 * DEG, 0.3 * DEG, 500 * DEG), 0.003, 0.3),
    "os5000-nogyro": (40, (0.4 * MG, 5 * MG, 4000 * MG), None, 0.003, 0.3),
    "wt901": (100, (0.2 * MG, 20 * MG, 16000 * MG), (0.02 * DEG, 0.2 * DEG, 2000 * DEG), 0.01, 0.2),
    "modern": (100, (0.06 * MG, 2 * MG, 16000 * MG), (0.005 * DEG, 0.05 * DEG, None), 0.001, 0.1),
    "phone": (100, (0.18 * MG, 20 * MG, 8000 * MG), (0.01 * DEG, 0.1 * DEG, 2000 * DEG), 0.005, 0.3),
    "ideal": (100, (0.0, 0.0, None), (0.0, 0.0, None), 0.0, 0.0),
}


def test_presets_are_those_of_the_table() -> None:
    assert set(SENSOR_MODELS) == set(TABLE)
    assert {name for name, model in SENSOR_MODELS.items() if model.attitude is None} == {"phone", "ideal"}


@pytest.mark.parametrize("name", TABLE)
def test_white_noise_of_presets(name: str) -> None:
    rate, acc, gyr, _, mag = TABLE[name]
    expected = {"acc": acc[0] * sqrt(rate), "mag": mag} | ({"gyr": gyr[0] * sqrt(rate)} if gyr else {})
    recording = simulate(still(200.0), name, seed=1, world=NOWHERE).recording
    assert recording.rate_hz == pytest.approx(rate)
    assert parts(recording).keys() == expected.keys()
    model = SENSOR_MODELS[name]
    for part, values in parts(recording).items():
        # differences of neighbours, as in the Allan deviation: bias and its walk drop out
        measured = np.std(np.diff(values, axis=0), axis=0) / sqrt(2.0)
        step: float = getattr(model, part).step
        assert measured == pytest.approx(sqrt(expected[part] ** 2 + step**2 / 12.0), rel=0.05, abs=1e-15)


@pytest.mark.parametrize("name", TABLE)
def test_bias_and_scale_of_presets_over_devices(name: str) -> None:
    _, acc, gyr, scale, _ = TABLE[name]
    model = SENSOR_MODELS[name]
    for triad, bias in ((model.acc, acc[1]), (model.mag, 0.0), (model.gyr, gyr[1] if gyr else 0.0)):
        if triad is None:
            continue
        exact = replace(triad, noise=0.0, bias_walk=0.0, step=0.0)
        at_zero, at_one = (
            np.array([exact.measure(true, np.ones(1), np.random.default_rng(seed))[0] for seed in range(150)])
            for true in (np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
        )
        assert at_zero.std() == pytest.approx(bias, rel=0.1)
        assert abs(at_zero.mean()) <= 4.0 * bias / sqrt(at_zero.size)
        assert (at_one - at_zero)[:, 2].std() == pytest.approx(0.0 if triad is model.mag else scale, rel=0.15)


def test_bias_walk_grows_with_the_root_of_time() -> None:
    triad, rng = Triad(bias_walk=0.1), np.random.default_rng(3)
    ends = np.array([triad.measure(np.zeros((400, 3)), np.full(400, 0.01), rng)[[99, 399]] for _ in range(300)])
    assert ends[:, 0].std() == pytest.approx(0.1 * sqrt(1.0), rel=0.1)
    assert ends[:, 1].std() == pytest.approx(0.1 * sqrt(4.0), rel=0.1)


def test_white_noise_follows_each_interval() -> None:
    interval_s = np.tile([0.01, 0.04], 20_000)
    read = Triad(noise=0.5).measure(np.zeros((40_000, 3)), interval_s, np.random.default_rng(4))
    assert read[::2].std() == pytest.approx(0.5 / sqrt(0.01), rel=0.02)
    assert read[1::2].std() == pytest.approx(0.5 / sqrt(0.04), rel=0.02)


def test_misalignment_leans_axes_and_scale_does_not() -> None:
    true = np.tile(np.eye(3), (1, 1))
    leaned = Triad(misalignment=0.01).measure(true, np.ones(3), np.random.default_rng(5)) - true
    assert np.diag(leaned) == pytest.approx(0.0)
    assert (leaned[~np.eye(3, dtype=bool)] != 0.0).all()
    scaled = Triad(scale=0.01).measure(true, np.ones(3), np.random.default_rng(5)) - true
    assert (np.diag(scaled) != 0.0).all()
    assert scaled[~np.eye(3, dtype=bool)] == pytest.approx(0.0)


def test_limit_clips_and_only_beyond_it() -> None:
    true = np.array([[-3.0, 0.5, 3.0], [1.0, -1.0, 0.0]])
    read = Triad(limit=1.0).measure(true, np.ones(2), np.random.default_rng(0))
    assert read == pytest.approx(np.array([[-1.0, 0.5, 1.0], [1.0, -1.0, 0.0]]))


def test_the_paper_s_roll_clips_a_gyro_of_500_deg_s() -> None:
    """What the task's docstring says: three samples are clipped and lose about five degrees."""
    model = SensorModel("clipping", 40.0, gyr=Triad(limit=500.0 * DEG))
    clipped = simulate("pick-and-place-stops", model).recording.gyr
    whole = simulate("pick-and-place-stops", "ideal", rate_hz=40.0).recording.gyr
    assert clipped is not None
    assert whole is not None
    assert np.flatnonzero((clipped != whole).any(axis=1)).tolist() == [188, 189, 190]
    assert np.degrees((whole - clipped).sum(axis=0) / 40.0) == pytest.approx([5.1, 0.0, 0.0], abs=0.1)


@pytest.mark.parametrize("name", [name for name in SENSOR_MODELS if name != "ideal"])
def test_presets_saturate_at_their_range(name: str) -> None:
    _, acc, gyr, _, _ = TABLE[name]
    violent = Task("violent", (Waypoint(rest_s=0.5), Waypoint((9.0, 9.0, 9.0), (60.0, 0.0, 0.0), 0.4, 0.5)))
    recording = simulate(violent, name).recording
    assert np.abs(recording.acc).max() == pytest.approx(acc[2])
    if recording.gyr is not None and gyr is not None and gyr[2] is not None:
        assert np.abs(recording.gyr).max() == pytest.approx(gyr[2])


@pytest.mark.parametrize("name", SENSOR_MODELS)
def test_outputs_are_multiples_of_their_step(name: str) -> None:
    recording, model = simulate("pour", name).recording, SENSOR_MODELS[name]
    for part, values in parts(recording).items():
        step: float = getattr(model, part).step
        if step:
            assert_near(values / step, np.round(values / step), 1e-6)


def test_jitter_moves_the_borders_of_intervals() -> None:
    model = SensorModel("jittery", 100.0, jitter_s=1e-3)
    clocked = simulate("pour", model, seed=1)
    unclocked = simulate("pour", replace(model, has_clock=False), seed=1)
    t = clocked.recording.t
    beat = np.arange(len(t)) / 100.0
    assert t[0] == 0.0
    assert (np.diff(t) > 0.0).all()
    assert (t - beat).std() == pytest.approx(1e-3 / np.sqrt(2.0), rel=0.1)  # a middle is the mean of two borders
    assert unclocked.recording.t == pytest.approx(beat)
    # the clock changes what is told, not what is felt
    assert np.array_equal(clocked.recording.acc, unclocked.recording.acc)
    assert unclocked.truth is not None
    assert np.array_equal(not_none(clocked.truth).p_nav_sensor, unclocked.truth.p_nav_sensor)
    assert np.array_equal(unclocked.truth.t, unclocked.recording.t)


def test_wild_jitter_keeps_time_increasing() -> None:
    t = simulate("pour", SensorModel("wild", 100.0, jitter_s=1.0)).recording.t
    assert (np.diff(t) > 0.0).all()


@pytest.mark.parametrize(("name", "bound_deg"), [("os5000", 0.09), ("wt901", 0.6), ("modern", 0.3)])
def test_own_attitude_is_true_at_rest(name: str, bound_deg: float) -> None:
    turned = Waypoint((0.2, 0.1, 0.0), (0.5, -0.3, 1.0), 0.5, 4.0)
    demo = simulate(Task("turn", (Waypoint(rest_s=1.0), turned)), name)
    rpy, truth = demo.recording.device_rpy, demo.truth
    assert truth is not None
    error = quat_log(quat_multiply(quat_inverse(truth.wxyz_nav_sensor), quat_from_rpy(not_none(rpy))))
    settled = (truth.t < 1.0) | (truth.t > 5.0)
    assert np.degrees(np.abs(error[settled])).max() < bound_deg


def test_own_attitude_lags_by_its_time_constant() -> None:
    roll = Task(
        "roll", (Waypoint(rest_s=1.0), Waypoint(turn=(0.5, 0.0, 0.0), move_s=1e-3, rest_s=2.0)), "", (0, 0, 3.0)
    )
    rpy = simulate(roll, replace(SENSOR_MODELS["os5000"], rate_hz=100.0)).recording.device_rpy
    assert rpy is not None
    assert rpy[130, 0] / 0.5 == pytest.approx(1.0 - np.exp(-1.0), abs=0.02)
    assert rpy[-1] == pytest.approx([0.5, 0.0, 3.0], abs=radians(0.2))
    assert rpy / radians(0.1) == pytest.approx(np.round(rpy / radians(0.1)))


def test_own_attitude_passes_through_the_lock_and_the_wrap() -> None:
    """Pitch beyond 90 degrees and a heading across 180 leave no trace in the rotation."""
    turn = np.linspace(0.0, 2.5, 300)[:, None]
    wxyz = quat_multiply(quat_exp((0.0, 0.0, 3.1)), quat_exp(turn * np.array([0.1, 1.0, 0.2])))
    rpy = AttitudeOutput().measure(wxyz, 100.0, np.random.default_rng(0))
    assert quat_log(quat_multiply(quat_inverse(wxyz), quat_from_rpy(rpy))) == pytest.approx(0.0, abs=1e-7)


def test_a_rate_must_be_above_zero() -> None:
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SensorError, match="give one above 0"):
            SensorModel("odd", rate)
