"""The bundled arms and demonstrations, each loaded once."""

import warnings
from functools import cache
from pathlib import Path

from pbd import planning
from pbd.arm.model import ArmModel
from pbd.data import HandPath, Keyframe
from pbd.files import robot
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.tracking.keyframes import find_keyframes

FOLDER = Path(__file__).parents[2] / "robots"
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))
KINDS = ("so101", "ur5", "panda", "kinova")
"""One arm of each kind: five, six and seven joints, and one with joints that turn without end."""
FIVE_JOINTS = ("so100", "so101")
DEMOS = ("pouring", "paper-test1", "paper-test2")


@cache
def arm_of(name: str) -> ArmModel:
    """The arm that the commands use in the same process too (see tests/result_cache.py)."""
    return planning.arm_of(robot.read_robot(FOLDER / f"{name}.toml"))


@cache
def path_of(name: str) -> HandPath:
    demo = load_demo(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of tracking do not concern the robot
        return track(demo.recording, "default", demo.known)


@cache
def keyframes_of(name: str) -> tuple[Keyframe, ...]:
    return find_keyframes(path_of(name))
