"""Repeatability of the magnetic heading between the stops of a demonstration."""

from dataclasses import dataclass

import numpy as np

from pbd.data import HandPath
from pbd.pose import Array, quat_rotate

DISTURBED_HEADING = np.radians(3.0)
"""Largest variation, rad rms over the stops, of a compass' heading. If it varies more, a dock gives a better one."""


@dataclass(frozen=True)
class FieldSpread:
    """Variation of the magnetic field from stop to stop, rms about its mean.

    Attributes:
        heading: rad.
        strength: share.
        tan_dip: vertical part of the mean field over its horizontal part: error of the heading per error of the tilt.
    """

    heading: float
    strength: float
    tan_dip: float

    @property
    def disturbed(self) -> bool:
        """Whether its heading is unreliable: it, or a tenth of the field's strength, varies too much."""
        return self.heading > DISTURBED_HEADING or self.strength > 0.10


def field_spread(mag: Array, wxyz_nav_sensor: Array) -> FieldSpread:
    """Compare the field at the stops, rotated into nav.

    From stop to stop the attitude comes from the gyro. So the variation shows an uneven field in the room, or remaining
    errors of hard and soft iron or of tilt.

    Args:
        mag: (k, 3) in any unit, the means over the stops.
        wxyz_nav_sensor: (k, 4) at the stops.
    """
    field = quat_rotate(wxyz_nav_sensor, mag)
    strength = np.linalg.norm(field, axis=1)
    level = np.hypot(field[:, 0], field[:, 1])
    east, north = (field[:, 0] / level).mean(), (field[:, 1] / level).mean()
    turned = np.arctan2(field[:, 1] * east - field[:, 0] * north, field[:, 0] * east + field[:, 1] * north)
    tan_dip = abs(float(field[:, 2].mean())) / float(level.mean())
    return FieldSpread(float(np.sqrt(np.mean(turned**2))), float(strength.std() / strength.mean()), tan_dip)


def field_at_start(path: HandPath, mag: Array) -> tuple[float, float]:
    """Return the horizontal and the upward part of the magnetic field (n, 3) at the path's first stop, in its unit."""
    rows = slice(path.stops[0].start, path.stops[0].stop)
    x, y, z = quat_rotate(path.wxyz_nav_sensor[rows], mag[rows]).mean(axis=0)
    return float(np.hypot(x, y)), float(z)
