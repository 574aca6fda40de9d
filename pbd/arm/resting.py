"""Whether an object rests on something."""

from __future__ import annotations

import coal
import numpy as np

from pbd.arm.clearance import shape_of
from pbd.arm.hulls import Body
from pbd.arm.model import to_se3
from pbd.pose import Array, Pose

STEEP = float(np.cos(np.radians(45.0)))
"""What an object rests on holds it up at less than this angle from the vertical."""


def rests_on(thing: Body, T_universe_thing: Pose, support: Body, up: Array, within_m: float) -> bool:
    """Whether something stands under a thing: they are at most so far apart, or overlap by so much, along `up` (3,)."""
    result = coal.DistanceResult()
    poses = map(to_se3, (T_universe_thing, support.T_joint_body))
    placed = [coal.Transform3s(T.rotation, T.translation) for T in poses]
    distance = coal.distance(shape_of(thing), placed[0], shape_of(support), placed[1], coal.DistanceRequest(), result)
    # The normal leads from the first to the second.
    return bool(abs(distance) <= within_m and -result.normal @ up >= STEEP)
