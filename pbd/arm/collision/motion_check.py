"""Check a motion in time for contacts, continuously; and the messages about them.

In a free motion no two checked bodies touch at any instant (clearance.py says why), and all measured distances are at
least the margin.
"""

import json
from dataclasses import dataclass, replace

import numpy as np

from pbd.arm.collision.allowed_collisions import NEARLY_ALWAYS, sample_coordinates
from pbd.arm.collision.clearance import Clearance
from pbd.arm.collision.scene import CollisionScene, Hit
from pbd.arm.path_sampling import sample_trajectory
from pbd.data import JointTrajectory
from pbd.data.world import TABLE, TABLE_HEIGHT, ObjectPhase, gripped_spans
from pbd.errors import PlanError, listed
from pbd.pose import Pose

CHANGE_HOME, MOVE_ARM = "change home in the robot's TOML", "move the arm"
"""How an arm that touches something where it stands comes to stand elsewhere."""

_STILL_RAD = 1e-6  # the arm counts as standing at joints that differ by less
_MERGED_S = 0.1  # contacts of one pair closer in time than this are merged


@dataclass(frozen=True, eq=False)
class MotionHit:
    """A hit of a motion.

    Attributes:
        hit: the contact at its deepest instant.
        t, parted_t: s, first and last instant of contact.
        keyframe: index of the keyframe at which, or on the way to which, they touch; n on the retreat.
        at_keyframe: whether they touch at the keyframe itself.
    """

    hit: Hit
    t: float
    parted_t: float
    keyframe: int
    at_keyframe: bool


def all_hits(scene: CollisionScene, trajectory: JointTrajectory) -> tuple[MotionHit, ...]:
    """Return all hits of a motion, sorted by their beginning; short gaps in a contact are closed (_MERGED_S).

    The trajectory's gripper opening decides where the fingers are, and when the object is carried.
    """
    found: list[MotionHit] = []
    spans = [(scene.object_clearance(each), each.start, each.end) for each in object_phases_of(scene, trajectory)]
    for clearance, start, end in ((scene.always, -np.inf, np.inf), *spans):
        path = sample_trajectory(trajectory, clearance.rates, clearance.step_m, start, end)
        for met in clearance.contacts(path):
            hit = scene.as_hit(clearance, met.pair, path.x[met.deepest], met.distance)
            t, parted_t = float(path.t[met.first]), float(path.t[met.last])
            found.append(MotionHit(hit, t, parted_t, *_keyframe(trajectory, t, parted_t)))
    hits: list[MotionHit] = []
    for later in sorted(found, key=lambda each: (each.t, each.hit.distance)):
        i = next((i for i, earlier in enumerate(hits) if _same_contact(earlier, later)), None)
        if i is None:
            hits.append(later)
        else:
            deeper = min(hits[i].hit, later.hit, key=lambda each: each.distance)
            hits[i] = replace(hits[i], hit=deeper, parted_t=max(hits[i].parted_t, later.parted_t))
    return tuple(hits)


def _same_contact(earlier: MotionHit, later: MotionHit) -> bool:
    same_bodies = (earlier.hit.first, earlier.hit.second) == (later.hit.first, later.hit.second)
    return same_bodies and later.t <= earlier.parted_t + _MERGED_S


def object_phases_of(scene: CollisionScene, trajectory: JointTrajectory) -> tuple[ObjectPhase, ...]:
    """Return where the grasped object is during a motion."""

    def tool(t: float) -> Pose:  # an object that is never released may rest at the last keyframe
        return scene.arm.forward(trajectory.at(np.array([min(t, *trajectory.keyframe_t[-1:])])).q[0])

    return scene.phases(gripped_spans(trajectory.gripper_t, trajectory.gripper_opening), tool)


def refuse_home(scene: CollisionScene) -> None:
    """Refuse a home at which the robot, without an object, touches something.

    Raises:
        PlanError: with the fields bodies, value (depth, m), p_base (m), home (rad).
    """
    home = scene.arm.robot.home
    hit = scene.hit(home)
    if hit is not None:
        what = f"home of {scene.arm.robot.name}: {hit}; {where_it_stands(scene, hit, CHANGE_HOME)}"
        raise PlanError(what, home=tuple(home.tolist()), **hit.fields)


def where_it_stands(scene: CollisionScene, hit: Hit, move: str) -> str:
    """Say what to do about a hit where the arm stands; `move` says how it comes to stand elsewhere."""
    other = hit.second
    if other == TABLE:
        return f"correct {TABLE_HEIGHT}, or {move}"
    if other not in scene.obstacles:
        return f"{_by_design(scene, hit)}{move}"
    always = scene.always
    rows = [row for row in range(len(always.pairs)) if always.names(row) == (hit.first, other)]
    these = Clearance(scene.arm, always.bodies, always.pairs[rows])
    if these.always_touching(sample_coordinates(scene.arm), NEARLY_ALWAYS):
        return f"so it would in nearly every configuration: correct {other} in the calibration"
    return f"move {other}, or {move}"


def _by_design(scene: CollisionScene, hit: Hit) -> str:
    """Say how to let two links of the arm touch, since the shapes of some overlap by design or for joints at 0."""
    if not {hit.first, hit.second} <= scene.links:
        return ""
    pair = json.dumps([hit.first, hit.second])
    advice = f"if these links touch by design, add {pair} to may_touch in its [arm]; else "
    if still := scene.arm.unmoved_between(hit.first, hit.second):
        stands = f"nothing moves {listed(still)}, so it is taken to stand at 0"
        return f"{stands}: if that is wrong, make it a fixed joint where it stands; {advice}"
    return advice


def collision_error(scene: CollisionScene, trajectory: JointTrajectory, found: MotionHit) -> PlanError:
    """Describe a hit in one line; fields: keyframe, t (s), bodies, value (depth, m), p_base (m)."""
    text = str(found.hit)
    if found.t == 0.0:  # the arm already stands there
        text = text.replace("would touch", "touches").replace("would come", "comes")
    return PlanError(
        f"{_when(trajectory, found)} (t = {found.t:.1f} s): {text}; {_advice(scene, trajectory, found)}",
        keyframe=found.keyframe,
        t=found.t,
        **found.hit.fields,
    )


def _keyframe(trajectory: JointTrajectory, start: float, end: float) -> tuple[int, bool]:
    """Return the keyframe at which the arm stands at some time from `start` to `end`, s, and True.

    If there is none, return the next keyframe, and False.
    """
    times = trajectory.keyframe_t
    following = int(np.searchsorted(times, start))
    if following < len(times) and times[following] <= end:
        return following, True
    if following > 0:
        q = trajectory.at(np.array([start])).q[0]
        if np.abs(q - trajectory.keyframe_q[following - 1]).max() < _STILL_RAD:
            return following - 1, True  # the arm has not left it yet
    return following, False


def _at_start(trajectory: JointTrajectory, found: MotionHit) -> bool:
    """Whether the arm touches something where it already stands, before it moves to keyframe 0."""
    return bool(found.t == 0.0 < trajectory.keyframe_t[0])


def _when(trajectory: JointTrajectory, found: MotionHit) -> str:
    if _at_start(trajectory, found):
        return "at the start of the motion"
    if found.at_keyframe:
        return f"at keyframe {found.keyframe}"
    if found.keyframe == 0:
        return "on the way to keyframe 0"
    if found.keyframe == len(trajectory.keyframe_t):
        return f"after keyframe {found.keyframe - 1}"
    return f"between keyframes {found.keyframe - 1} and {found.keyframe}"


def _advice(scene: CollisionScene, trajectory: JointTrajectory, found: MotionHit) -> str:
    other = found.hit.second
    if _at_start(trajectory, found):
        at_home = np.abs(trajectory.at(np.zeros(1)).q[0] - scene.arm.robot.home).max() < _STILL_RAD
        return where_it_stands(scene, found.hit, CHANGE_HOME if at_home else MOVE_ARM)
    if other == TABLE:
        return "raise the keyframe, or raise the dock and with it the whole motion"
    if other in scene.obstacles:
        return f"move the dock or {other}, or demonstrate a path around it"
    return "move the dock, or hold the sensor at another angle there"
