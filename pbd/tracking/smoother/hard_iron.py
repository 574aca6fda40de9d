"""Find the part of the magnetic field that turns with the sensor: a magnet or iron beside it (hard iron)."""

import numpy as np

from pbd.pose import Array
from pbd.tracking.moving_windows import squares
from pbd.tracking.noise import OUTLIER_SIGMAS
from pbd.tracking.smoother.factors import robust_weights
from pbd.tracking.smoother.knots import Problem, mean_around
from pbd.tracking.smoother.preintegration import BLOCK_S
from pbd.tracking.smoother.state import State


def find_hard_iron(problem: Problem, mag: Array, x: State) -> Array | None:
    """Find the field's part that turns with the sensor. None: it is small, or may be the room's.

    At each knot the field (of `mag`, (n, 3) in any unit) in nav is R b + m: b turns with the sensor, m is the earth's.
    Knots whose field is far off, as beside a magnet, lose their weight.

    Returns:
        b (3,) in the unit of `mag`.
    """
    noise = problem.noise
    R = np.asarray(x.E @ problem.C, dtype=np.float64)
    field = mean_around(mag, problem.rows, round(0.5 * BLOCK_S / problem.frame.dt))
    field_nav = (R @ field[:, :, None])[:, :, 0]
    A = np.concatenate((R, np.broadcast_to(np.eye(3), R.shape)), axis=2)
    weight = problem.duration
    for _ in range(5):
        weighted = weight[:, None, None] * A
        information = np.tensordot(weighted, A, axes=((0, 1), (0, 1)))
        both = np.linalg.lstsq(information, np.tensordot(weighted, field_nav, axes=((0, 1), (0, 1))))[0]
        iron, earth = np.split(np.asarray(both, dtype=np.float64), 2)
        off = squares(field_nav - A @ both) / (noise.field_change**2 * (earth @ earth))
        weight = problem.duration * robust_weights(off)
    # A room's field varies by as much as it turns the heading. Where the sensor turns little, the earth's field is
    # uncertain too: without iron it is the mean.
    density = noise.compass_heading * max(np.hypot(*earth[:2]), np.hypot(*field_nav.mean(axis=0)[:2]))
    own, mixed, rest = information[:3, :3], information[:3, 3:], information[3:, 3:]
    known = own - mixed @ np.linalg.pinv(rest) @ mixed.T
    sure = iron @ known @ iron > 3.0 * (OUTLIER_SIGMAS * density) ** 2
    large = iron @ iron > noise.field_change**2 * (earth @ earth)
    most_fit = weight.sum() > 0.5 * problem.duration.sum()
    return iron if sure and large and most_fit else None
