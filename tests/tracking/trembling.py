"""Tasks by a hand that trembles in the air."""

from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from pbd.data import Demonstration
from pbd.pose import Array
from tests.scenarios import simulate

USUAL, STRONG, STRONGEST = (0.1, 0.02), (0.15, 0.03), (0.3, 0.06)
"""rms of acceleration, m/s2, and of rate, rad/s. If three axes tremble by 0.01 g at their peaks, it is 0.12 m/s2."""


def trembling(sensor: str, seed: int, rms: tuple[float, float]) -> Demonstration:
    """The everyday task by a hand that trembles once it has left the table, where it rested for 1.8 s."""
    return with_tremor(simulate("pour", sensor, seed), seed, rms, since_s=1.8)


def with_tremor(demo: Demonstration, seed: int, rms: tuple[float, float], since_s: float = -1.0) -> Demonstration:
    """The same by a hand that trembles at 6 to 12 Hz from a time on."""
    recording, rng = demo.recording, np.random.default_rng(seed)
    band = butter(2, (6.0, 12.0), btype="band", fs=recording.rate_hz, output="sos")
    begun = np.clip((recording.t - since_s) / 0.2, 0.0, 1.0)[:, None]

    def tremor(size: float) -> Array:
        noise = sosfiltfilt(band, rng.normal(size=(len(recording), 3)), axis=0)
        trembles: Array = begun * size * noise / np.sqrt((noise**2).sum(axis=1).mean())
        return trembles

    assert recording.gyr is not None
    acc, gyr = recording.acc + tremor(rms[0]), recording.gyr + tremor(rms[1])
    return replace(demo, recording=replace(recording, acc=acc, gyr=gyr))
