"""A simulated demonstration that touches points, with the true pose of its nav in base."""

from dataclasses import dataclass

import numpy as np

from pbd.data import Demonstration
from pbd.pose import Array, Pose, quat_about_z
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.simulation.sway import with_sway

PLACES = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, -0.5, 0.4), (0.5, 1.5, 0.4), (0.2, 1.3, 0.3), (1, -0.3, 0.2)]
)
"""Places in units of their spacing: neighbours are about 1 apart."""


@dataclass(frozen=True, eq=False)
class Touching:
    """A demonstration, the touched points (m, 3) m in base, and the true T_base_nav."""

    demo: Demonstration
    points: Array
    T_base_nav: Pose


def touching(
    seed: int,
    count: int = 4,
    sensor: str = "wt901",
    spacing_m: float = 0.3,
    yawed_deg: float = 0.0,
    sway_speed: float = 0.0,
    tip_m: float = 0.0,
) -> Touching:
    """Simulate a hand that starts elsewhere, moves about 1 s to each point, rests on it about 1 s, and turns a little.

    Longer moves take longer, at the same acceleration. On each point the hand is yawed by up to `yawed_deg` either way.
    It sways by `sway_speed`, m/s, and its tip misses the points by `tip_m`, one sigma per axis.
    """
    rng = np.random.default_rng(seed)
    slower = max(1.0, np.sqrt(spacing_m / 0.3))
    places = spacing_m * PLACES[:count] + rng.normal(scale=0.03, size=(count, 3))
    start = spacing_m * rng.uniform(-2.0 / 3.0, 2.0 / 3.0, 3)
    waypoints = [Waypoint(_triple(start), rest_s=2.0)]
    for place in places:
        axis = rng.normal(size=3)
        turn = np.radians(rng.uniform(0.0, 20.0)) * axis / np.linalg.norm(axis)
        if yawed_deg > 0.0:
            turn[2] += np.radians(rng.uniform(-yawed_deg, yawed_deg))
        move_s, rest_s = slower * rng.uniform(0.8, 1.5), rng.uniform(0.6, 1.2)
        waypoints.append(Waypoint(_triple(place), _triple(turn), move_s, rest_s))
    task = Task("touching", tuple(waypoints), start_rpy=(0.0, 0.0, rng.uniform(-np.pi, np.pi)))
    T_base_world = Pose(rng.uniform(-0.5, 0.5, 3), quat_about_z(rng.uniform(-np.pi, np.pi)))
    start_in_world = Pose(start, np.array([1.0, 0.0, 0.0, 0.0]))  # world's y is north, as nav's with a magnetometer
    points = T_base_world.act(places) + tip_m * rng.normal(size=places.shape)
    return Touching(simulate(with_sway(task, sway_speed, seed), sensor, seed), points, T_base_world @ start_in_world)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
