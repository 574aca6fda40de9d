"""A worse sensor than any preset, and the errors that a simulated device has."""

from dataclasses import replace

import numpy as np

from pbd.data import GRAVITY
from pbd.pose import Array
from pbd.simulation.sensor_model import SENSOR_MODELS, SensorModel

_MG = 1e-3 * GRAVITY
WT901 = SENSOR_MODELS["wt901"]
assert WT901.mag is not None
BAD = replace(
    WT901,
    name="bad wt901",
    acc=replace(WT901.acc, bias=50.0 * _MG, scale=0.02, misalignment=np.radians(1.0)),
    mag=replace(WT901.mag, bias=20.0, scale=0.1, misalignment=np.radians(3.0)),
)
"""One sigma over devices: 50 mg, 2 %, 1 degree; hard iron 20 uT, soft iron 10 %."""


def device(model: SensorModel, seed: int) -> dict[str, tuple[Array, Array]]:
    """Return the errors that `simulate` draws for a device: gain (3, 3) and bias (3,) of each triad."""
    drawn = {}
    streams = np.random.default_rng(seed).spawn(5)[1:4]
    for name, triad, rng in zip(("acc", "gyr", "mag"), (model.acc, model.gyr, model.mag), streams, strict=True):
        assert triad is not None
        gain = np.eye(3) + np.diag(triad.scale * rng.normal(size=3))
        gain += triad.misalignment * rng.normal(size=(3, 3)) * (1.0 - np.eye(3))
        drawn[name] = (gain, triad.bias * rng.normal(size=3))
    return drawn


def symmetric(gain: Array) -> Array:
    """Return the symmetric matrix that inverts a gain up to a rotation: (gain gain^T)^(-1/2)."""
    values, axes = np.linalg.eigh(gain @ gain.T)
    return np.asarray((axes / np.sqrt(values)) @ axes.T)
