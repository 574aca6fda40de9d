"""Measure a sensor's white noise at rest, although the hand that holds it sways and trembles."""

import numpy as np

from pbd.data import Recording
from pbd.data.recording import resolution_of
from pbd.pose import Array
from pbd.tracking.first_rest import REST_S
from pbd.tracking.moving_windows import rows_of_mean, white_noise_variance

BAND_HZ = np.arange(2.5, 4.6, 0.5)
"""Hz: a hand sways below this band and trembles above it (`tremor_hz`). What is in the band is the sensor's noise."""


def steps_of(recording: Recording) -> tuple[float, float]:
    """The step of the gyro's readings, rad/s, and of the accelerometer's, m/s2; infinity: no reading differs."""
    gyr, acc = (np.inf if values is None else resolution_of(values) for values in (recording.gyr, recording.acc))
    return gyr, acc


def white_noise(values: Array, energy: float, step: float, rate_hz: float) -> tuple[float, float]:
    """White noise per sample and axis, and the rounding error that stays constant while the reading does.

    Args:
        values: (n, 3), one sensor's readings at rest.
        energy: variance of their `moving_means`, summed over the axes.
        step: smallest difference between readings.
        rate_hz: the sampling rate.
    """
    rms = np.sqrt(energy / white_energy(1.0, rate_hz))
    white, held = _rounding(step, rms)
    return max(white, min(rms, _white_noise_bound(values, rate_hz))), held


def _white_noise_bound(values: Array, rate_hz: float) -> float:
    """The most white noise, per sample and axis, in a rest (n, 3); infinity if it is too short or sampled too slowly.

    White noise is at all frequencies; a hand's sway and tremor are not. A Hann window keeps them from leaking into the
    band. The bound is two sigma above what is found there: of a second, one sigma is a quarter (five frequencies on
    three axes, and neighbouring frequencies are correlated).
    """
    n = len(values)
    if rate_hz < 2.0 * BAND_HZ[-1] or n < round(REST_S * rate_hz):
        return np.inf
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    waves = window * np.exp(-2.0j * np.pi * np.outer(BAND_HZ, np.arange(n) / rate_hz))
    power = np.abs(waves @ (values - values.mean(axis=0))) ** 2
    return 1.5 * float(np.sqrt(power.mean() / (window @ window)))


def white_energy(rms: float, rate_hz: float) -> float:
    """Variance of the `moving_means` of white noise with `rms` per sample and axis, summed over three axes."""
    return 3.0 * rms**2 * white_noise_variance(rows_of_mean(rate_hz))


def _rounding(step: float, rms: float) -> tuple[float, float]:
    """White part of a rounding error, rms per axis, and the part that stays constant while the reading does.

    Noise larger than the step makes the rounding error white (dither). Of smaller noise, of `rms` per axis, a share
    exp(-2 pi^2 rms^2 / step^2) of the error is constant in a rest and differs between rests. It adds to the bias, and
    to its random walk per sqrt(s).

    Source: B. Widrow, I. Kollar, Quantization noise, Cambridge 2008, 9.
    """
    if not 1e-12 < step < np.inf:  # a smaller step is floating-point rounding
        return 0.0, 0.0
    rounding = step / np.sqrt(12.0)
    return rounding, rounding * float(np.exp(-2.0 * (np.pi * rms / step) ** 2))
