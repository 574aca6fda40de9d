"""A long search for a way through a scene that shares nothing with the planner: OMPL, pinocchio and coal alone.

Goals come from plain Newton steps from random joints. A state is checked on the original meshes (and the rod that
stands for a missing gripper), a move every RESOLUTION_RAD.
"""

import time
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from ompl import base, geometric, util

from pbd.arm.collision.geometry import shape_of
from pbd.arm.gripper import tool_rod
from pbd.arm.model import ArmModel, to_se3
from pbd.data import JointTrajectory, Obstacle
from pbd.pose import Array, Pose
from tests.arm.dense_collision_check import Dense

RESOLUTION_RAD = 0.02
GOALS, SEEDS = 16, 400
"""Ways to hold the arm at a keyframe, and random joints from which they are sought."""
NEARLY_ALWAYS, SAMPLES = 0.95, 100
"""Links that overlap in more than this share of so many random configurations touch by design."""


class DenseScene:
    """Original meshes among obstacles: every link that a joint moves with each of these, and with other links."""

    def __init__(self, arm: ArmModel, obstacles: Sequence[Obstacle]) -> None:
        self.arm, self.dense = arm, Dense(arm.robot, obstacles, every_s=5e-3)
        geometry, model = self.dense.geometry, self.dense.model
        if (rod := tool_rod(arm)) is not None:
            geometry.addGeometryObject(pin.GeometryObject(rod.name, rod.joint, to_se3(rod.T_joint_body), shape_of(rod)))
            self.dense.names.append(rod.name)
        names, joints = self.dense.names, [shape.parentJoint for shape in geometry.geometryObjects]
        fixed, last = {each.name for each in obstacles}, model.getJointId(arm.robot.joints[-1])
        hand = [joint > 0 and last in model.supports[joint] for joint in joints]
        beside = {frozenset((i, int(model.parents[i]))) for i in range(1, model.njoints)}
        for i in range(len(names)):
            for j in range(i):
                moving = joints[i] != joints[j] and not (hand[i] and hand[j])
                apart = frozenset((joints[i], joints[j])) not in beside or bool({names[i], names[j]} & fixed)
                if moving and apart:
                    geometry.addCollisionPair(pin.CollisionPair(j, i))
        self._leave_out_what_always_touches()
        self.pairs = {frozenset((names[pair.first], names[pair.second])) for pair in geometry.collisionPairs}
        self.placed, self.data = geometry.createData(), model.createData()

    def _leave_out_what_always_touches(self) -> None:
        geometry, model, limits = self.dense.geometry, self.dense.model, self.arm.limits
        placed, data, often = geometry.createData(), model.createData(), np.zeros(len(geometry.collisionPairs))
        lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
        for q in np.random.default_rng(1).uniform(lower, upper, (SAMPLES, len(lower))):
            pin.computeCollisions(model, data, geometry, placed, self.dense.configuration(q, 1.0), False)
            often += [result.isCollision() for result in placed.collisionResults]
        pairs = list(geometry.collisionPairs)
        geometry.removeAllCollisionPairs()
        for pair, count in zip(pairs, often, strict=True):
            if count <= NEARLY_ALWAYS * SAMPLES:
                geometry.addCollisionPair(pair)

    def stands(self, q: Array) -> bool:
        """Whether nothing overlaps at joints (k,), the gripper open."""
        full = self.dense.configuration(q, 1.0)
        return not pin.computeCollisions(self.dense.model, self.data, self.dense.geometry, self.placed, full, True)

    def touches(self, trajectory: JointTrajectory) -> bool:
        """Whether anything overlaps during a motion."""
        return self.dense.touch(trajectory, self.pairs, 0.0)


def goals(scene: DenseScene, pose: Pose, rng: np.random.Generator) -> list[Array]:
    """Free joints (k,) that reach a pose: Newton's method from random joints."""
    arm, found = scene.arm, list[Array]()
    lower, upper = np.maximum(arm.limits.lower, -np.pi), np.minimum(arm.limits.upper, np.pi)
    for q in rng.uniform(lower, upper, (SEEDS, len(lower))):
        for _ in range(40):
            e = pin.log6(to_se3(arm.forward(q)).actInv(to_se3(pose))).vector
            if np.linalg.norm(e) < 1e-6:
                break
            J = arm.jacobian(q)
            step = J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), e)
            q = q + step / max(1.0, float(np.abs(step).max()) / 0.5)
        inside = (q >= arm.limits.lower).all() and (q <= arm.limits.upper).all()
        if np.linalg.norm(e) < 1e-6 and inside and scene.stands(q):
            found.append(q)
            if len(found) == GOALS:
                break
    return found


def search(scene: DenseScene, poses: Sequence[Pose], search_s: float, seed: int) -> float | None:
    """Search for a way from home through all poses and back, for so long; return the least joint travel, rad, or None.

    Every round takes other ways to hold the arm at random, RRT-Connect between them, and shortens what it finds.
    """
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    end, rng = time.process_time() + search_s, np.random.default_rng(seed)
    home = scene.arm.robot.home
    held = [goals(scene, pose, rng) for pose in poses]
    if not all(held):
        return None
    best, round_s = None, 0.5
    while time.process_time() < end:
        stops = [home, *(ways[rng.integers(len(ways))] for ways in held), home]
        travel = 0.0
        for start, goal in pairwise(stops):
            way = _connect(scene, start, goal, min(round_s, end - time.process_time()))
            travel += np.inf if way is None else way
            if not travel < (best or np.inf):
                break
        best = travel if travel < (best or np.inf) else best
        round_s *= 1.2 if best is None else 1.0
    return best


def _connect(scene: DenseScene, start: Array, goal: Array, search_s: float) -> float | None:
    """Joint travel of a way between two configurations, shortened; None where none is found."""
    if search_s <= 0.0:
        return None
    limits, count = scene.arm.limits, len(start)
    space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
    for joint in range(count):
        bounds.setLow(joint, float(max(limits.lower[joint], min(start[joint], goal[joint]) - np.pi)))
        bounds.setHigh(joint, float(min(limits.upper[joint], max(start[joint], goal[joint]) + np.pi)))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: scene.stands(np.array(state[0:count])))
    setup.getSpaceInformation().setStateValidityCheckingResolution(RESOLUTION_RAD / space.getMaximumExtent())
    ends = [space.allocState() for _ in range(2)]
    for state, q in zip(ends, (start, goal), strict=True):
        state[0:count] = q.tolist()
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    until = time.process_time() + search_s
    setup.solve(base.PlannerTerminationCondition(lambda: time.process_time() > until))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    geometric.PathSimplifier(setup.getSpaceInformation()).simplify(path, search_s)
    return float(path.length())
