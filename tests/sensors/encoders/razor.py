"""Writes the Razor AHRS firmware's lines, from what its sources say of axes, signs and units."""

from collections.abc import Sequence

COUNT_DEG_S = 0.06957


def frame(acc: Sequence[float], gyr: Sequence[float], mag: Sequence[float]) -> bytes:
    """Of specific force (g), turn rate (deg/s) and field (any unit) in axes x forward, y left, z up."""
    gravity = (-256.0 * acc[0], 256.0 * acc[1], 256.0 * acc[2])  # x forward, y right, z down; against specific force
    counts = (gyr[0] / COUNT_DEG_S, -gyr[1] / COUNT_DEG_S, -gyr[2] / COUNT_DEG_S)
    field = (mag[0], -mag[1], -mag[2])
    return b"".join(
        "#{}-C={:.2f},{:.2f},{:.2f}\r\n".format(letter, *three).encode()
        for letter, three in (("A", gravity), ("M", field), ("G", counts))
    )
