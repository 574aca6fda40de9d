"""How planning grows with keyframes over a wall: python tests/benchmarks/wall.py [--json] [--quick].

Keyframes to and fro on the two sides of a wall that no straight move passes, without a hand's path. ARM.N.seconds:
process time of choosing the motion for N keyframes, without timing and audit; detours: moves of OMPL's among them.
"""

import sys
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.choose_motion import choose_motion
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import DETOUR, Motion, MotionRequest
from pbd.data import Obstacle
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of
from tests.benchmarks.report import arguments, finish

ARMS, COUNTS = ("panda", "ur5", "xarm7", "ur10"), (60, 300)


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore")
    counts = COUNTS[:1] if args.quick else COUNTS
    finish({name: {str(count): figures(arm_of(name), count) for count in counts} for name in ARMS}, args.json)


def figures(arm: ArmModel, count: int) -> dict[str, float]:
    """Choose a motion, once what is loaded for that is loaded."""
    chosen(arm, 2)
    start = time.process_time()
    found = chosen(arm, count)
    assert isinstance(found, Motion)
    return {
        "seconds": time.process_time() - start,
        "detours": sum(segment.kind == DETOUR for segment in found.segments),
    }


def chosen(arm: ArmModel, count: int) -> object:
    """A motion through keyframes on both sides of the wall in turn, from home and back."""
    home, rng = arm.forward(arm.robot.home), np.random.default_rng(1)
    reach, ahead = float(np.hypot(*home.p[:2])), float(np.arctan2(home.p[1], home.p[0]))
    top = home.p[2] - 0.02

    def at(far: float, aside: float, z: float) -> Array:
        return np.array([far * np.cos(ahead) - aside * np.sin(ahead), far * np.sin(ahead) + aside * np.cos(ahead), z])

    def keyframe(side: int) -> Pose:
        far, aside = reach * rng.uniform(0.85, 1.1), side * rng.uniform(0.12, 0.25)
        return Pose(at(far, aside, top - 0.15 + rng.uniform(-0.05, 0.05)), home.wxyz)

    poses = [keyframe((-1, 1)[i % 2]) for i in range(count)]
    placed = Pose.from_rpy(at(reach + 0.1, 0.0, 0.5 * top), (0.0, 0.0, ahead))
    wall = Obstacle("the wall", "box", (0.9 * reach, 0.02, top), placed)
    scene = CollisionScene(arm, None, [wall])
    return choose_motion(arm, MotionRequest(poses, arm.robot.home, q_retreat=arm.robot.home), scene)


if __name__ == "__main__":
    main()
