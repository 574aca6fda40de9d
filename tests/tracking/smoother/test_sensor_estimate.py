"""The estimated sensor errors are true within their sigma; a warning if they are more than chance."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

from pbd.cli import main
from pbd.data import ErrorEstimate, Recording, SensorEstimate
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.simulation.simulate import SENSOR_MODELS, random_task
from tests.not_none import not_none
from tests.scenarios import simulate

GYR_BIAS, ACC_BIAS = np.radians((0.4, -0.8, 0.3)), np.array((0.03, -0.02, 0.025))
GYR_MATRIX = 1e-3 * np.array(((6.0, 2.0, -3.0), (1.0, -5.0, 2.0), (3.0, -2.0, 4.0)))
ACC_MATRIX = 1e-3 * np.array(((4.0, 0.0, 0.0), (-3.0, 2.0, 0.0), (3.0, 2.0, -4.0)))
LAG_S = 0.002


MODERN = SENSOR_MODELS["modern"]
assert MODERN.gyr is not None
NOISY = replace(
    MODERN,
    acc=replace(MODERN.acc, bias=0.0, scale=0.0, misalignment=0.0),
    gyr=replace(MODERN.gyr, bias=0.0, scale=0.0, misalignment=0.0),
)
"""A sensor with noise and walking biases, but no constant errors."""


def off(recording: Recording) -> Recording:
    """The readings of a sensor of unknown class with these errors."""
    late = np.column_stack([np.interp(recording.t - LAG_S, recording.t, axis) for axis in not_none(recording.gyr).T])
    return replace(
        recording,
        acc=recording.acc @ (np.eye(3) + ACC_MATRIX).T + ACC_BIAS,
        gyr=late @ (np.eye(3) + GYR_MATRIX).T + GYR_BIAS,
        info=replace(recording.info, sensor="unknown"),
    )


def found_of(recording: Recording) -> SensorEstimate:
    found = track(recording).sensor
    return not_none(found)


def sigmas_off(one: ErrorEstimate, true: np.ndarray | float) -> float:
    return float(np.abs((one.value - true) / one.sigma).max())


def test_known_errors_are_found_within_three_sigma_and_some_are_learned() -> None:
    for seed in range(3):
        found = found_of(off(simulate(random_task(seed, moves=12, max_turn=1.8), NOISY, seed).recording))
        for one, true in (
            (found.gyr_bias, GYR_BIAS),
            (found.gyr_matrix, GYR_MATRIX),
            (found.acc_bias, ACC_BIAS),
            (found.acc_matrix, ACC_MATRIX),
            (found.lag, LAG_S),
        ):
            assert sigmas_off(one, true) < 3.0
        assert np.abs(found.gyr_matrix.value - GYR_MATRIX).max() < 0.5 * np.abs(GYR_MATRIX).max()
        assert (np.diagonal(found.gyr_matrix.sigma) < 0.5 * np.diagonal(found.gyr_matrix.prior)).all()


def test_what_was_taken_out_before_is_counted() -> None:
    """A large lag and a large common scale error are removed from the samples first, and are still reported."""
    recording = simulate(random_task(1, moves=12, max_turn=1.8), "modern", 1).recording
    assert recording.gyr is not None
    late = np.column_stack([np.interp(recording.t - 0.02, recording.t, axis) for axis in recording.gyr.T])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)
        assert abs(float(found_of(replace(recording, gyr=late)).lag.value) - 0.02) < 0.001
        high = found_of(replace(recording, gyr=1.1 * recording.gyr)).gyr_matrix.value
    assert np.abs(np.diagonal(high) - 0.1).max() < 0.01


def test_it_is_shown_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keyframes", "pouring", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["sensor_errors"]
    assert set(shown) == {"gyro_bias_deg_s", "gyro_matrix_percent", "acc_bias_m_s2", "acc_matrix_percent", "lag_ms"}
    assert abs(shown["lag_ms"]["value"]) < 3.0 * shown["lag_ms"]["sigma"]  # it is simulated without
    assert main(["keyframes", "pouring", "--json", "--method", "paper"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["sensor_errors"] is None
    assert result["keyframes"][0]["sigma_deg"] == [None] * 3
    assert main(["keyframes", "pouring", "--method", "paper", "--robot", "panda", "--tolerance", "0.01"]) == 2


def test_chance_is_what_was_learned() -> None:
    """By chance an estimate deviates by the prior's sigma, less the sigma that remains."""
    rng = np.random.default_rng(0)
    prior, noise, n = 2.0, 1.5, 20_000
    true = prior * rng.normal(size=n)
    gain = prior**2 / (prior**2 + noise**2)
    sigma = np.full(n, np.sqrt(1.0 - gain) * prior)
    one = ErrorEstimate(gain * (true + noise * rng.normal(size=n)), sigma, np.zeros(n), np.full(n, prior))
    assert abs(float(one.surprise.std()) - 1.0) < 0.02
    assert not ErrorEstimate(
        one.value, 0.9 * one.prior, np.zeros(n), one.prior
    ).surprise.any()  # next to nothing was learned
