"""Detect calibration drift: whether a sensor at rest still reads gravity and the field of its calibration."""

import numpy as np

from pbd.data import GRAVITY, SensorErrors
from pbd.errors import in_degrees
from pbd.pose import Array

NO_IRON = "; keep magnets and iron away; if that does not help"


def disagreements(
    errors: SensorErrors | None, acc: Array, gyr: Array | None = None, mag: Array | None = None
) -> tuple[str, ...]:
    """Report, a line each, the deviations of a sensor at rest that exceed their bounds.

    Warmth and a trembling hand move a calibrated sensor by up to 1.5 % of gravity and 0.5 degrees/s. A sound
    uncalibrated one is off by up to 3 % of gravity, which itself varies by 0.5 % on earth. Within a room the magnetic
    field varies by up to 10 % and 6 degrees of dip.

    Args:
        errors: the calibration's; None: without one only gravity is known.
        acc: (3,) m/s2, the mean over a rest, corrected.
        gyr: (3,) rad/s, the same.
        mag: (3,) uT, the same.
    """
    errors, calibrated = errors or SensorErrors(""), errors is not None and errors.acc is not None
    said, norm, gravity = [], float(np.linalg.norm(acc)), errors.gravity
    if abs(norm / gravity - 1.0) > (0.015 if calibrated else 0.03):
        said.append(
            f"at rest the {'calibrated ' * calibrated}accelerometer reads {norm:.2f} m/s2, but gravity is "
            f"{gravity:.2f} m/s2, {1e3 * abs(norm - gravity) / GRAVITY:.0f} mg off"
        )
    if errors.gyr is not None and gyr is not None and (rate_deg := np.degrees(np.linalg.norm(gyr))) > 0.5:
        said.append(f"at rest the gyro is {rate_deg:.1f} degrees/s off its calibrated bias")
    if mag is not None and errors.mag and errors.field is not None and errors.dip is not None:
        strength = float(np.linalg.norm(mag))
        dip = float(np.arcsin(np.clip(-(mag @ acc) / max(strength * norm, 1e-9), -1.0, 1.0)))
        if abs(strength / errors.field - 1.0) > 0.10:
            said.append(
                f"the magnetic field is {strength:.0f} uT, but was {errors.field:.0f} uT at the calibration{NO_IRON}"
            )
        elif abs(dip - errors.dip) > np.radians(6.0):
            said.append(
                f"the magnetic field dips by {in_degrees(dip)}, but by {np.degrees(errors.dip):.0f} "
                f"degrees at the calibration{NO_IRON}"
            )
    return tuple(f"{line}: calibrate this sensor" for line in said)


def gravity_at(latitude_deg: float) -> float:
    """Return gravity, m/s2, at sea level: Somigliana's formula with the constants of WGS 84 (TR8350.2, 4-1)."""
    square = float(np.sin(np.radians(latitude_deg)) ** 2)
    return 9.7803253359 * (1.0 + 0.00193185265241 * square) / float(np.sqrt(1.0 - 0.00669437999013 * square))
