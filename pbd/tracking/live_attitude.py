"""The sensor's attitude, one sample at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbd.pose import Array, quat_about_z, quat_canonical, quat_from_rpy, quat_multiply
from pbd.tracking.live_samples import Sample
from pbd.tracking.orientation import TAU_ACC_S, heading
from pbd.tracking.rest import Rest


class LiveAttitude:
    """Online VQF, begun at rest; the device's own attitude where there is no gyro.

    As in `estimate_attitude` VQF is fed the turn from the middle of one sample to the middle of the next. That needs
    the sample after; here the angle's cubic is laid through the edges of the last three samples instead. What the one
    way says more than the other in one step it says less in the next, so no error grows from it.

    What offline VQF has and this has not: it runs over the recording backwards too, so that at each instant it knows
    tilt and heading from both sides. Online, tilt errs by about .4 degrees while moving, offline by .24 (BROAD 14).

    Source: D. Laidig, T. Seel, VQF, Information Fusion 91 (2023), doi 10.1016/j.inffus.2022.10.014.
    """

    def __init__(self, samples: Sequence[Sample], interval: float, rest: Rest, has_gyro: bool) -> None:
        """Begin at the samples of the first rest; where no magnetometer is among them, nav's heading is taken there."""
        self._interval = interval
        self._vqf = None
        self.heading: Array | None = None
        self._t, self._earlier, self._before = samples[0].t - interval, samples[0].gyr, samples[0].gyr
        with_mag = sum(sample.mag is not None for sample in samples)
        self._nine_axes = with_mag > 0
        if has_gyro:
            from vqf import VQF

            # A magnetometer is often read less often than the gyro.
            mag_interval = interval * len(samples) / max(with_mag, 1)
            self._vqf = VQF(interval, magTs=mag_interval, tauAcc=TAU_ACC_S)
            # Over its first time constant VQF weighs all samples alike, and a first move as heavily as the rest before
            # it: its tilt then errs by far more than later on. So it is given a longer rest than there was.
            before = round(TAU_ACC_S / interval)
            mean_acc = np.mean([sample.acc for sample in samples], axis=0)
            self._vqf.updateBatch(np.tile(rest.gyro_bias, (before, 1)), np.tile(mean_acc, (before, 1)))
        self.wxyz_at_rest = np.array([self.update(sample) for sample in samples])
        if has_gyro and not self._nine_axes:
            self.heading = quat_about_z(-heading(self.wxyz_at_rest))
            self.wxyz_at_rest = quat_canonical(quat_multiply(self.heading, self.wxyz_at_rest))

    def update(self, sample: Sample) -> Array:
        """Return wxyz_nav_sensor (4,) at the sample's middle."""
        if self._vqf is None:
            return quat_from_rpy(np.asarray(sample.device_rpy, dtype=np.float64))
        turn = turn_between_middles(sample.t - self._t, self._earlier, self._before, sample.gyr)
        self._t, self._earlier, self._before = sample.t, self._before, sample.gyr
        self._vqf.update(turn / self._interval, sample.acc, sample.mag if self._nine_axes else None)
        if self._nine_axes:
            return quat_canonical(self._vqf.getQuat9D())
        wxyz = self._vqf.getQuat6D()
        return quat_canonical(wxyz if self.heading is None else quat_multiply(self.heading, wxyz))


def turn_between_middles(dt: float, earlier: Array, before: Array, own: Array) -> Array:
    """Rotation vector (..., 3) rad from the middle of the sample `before` to the middle of `own`, of gyr in rad/s.

    The three are means over intervals of `dt`, so their sums are exact at the edges; through the four edges goes a
    cubic, here taken from 1.5 to 2.5 intervals. The cross product is coning (P. Savage, JGCD 21, 1998).
    """
    turn: Array = dt * (6.0 * before + 3.0 * own - earlier) / 8.0 + dt**2 / 12.0 * np.cross(before, own)
    return turn
