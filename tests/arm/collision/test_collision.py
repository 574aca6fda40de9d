"""Motions: contacts anywhere on the way are found, all or the first, described and timed."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np
import pytest

from pbd.arm.collision.clearance import MARGIN_M, Clearance, ContactSpan, JointPath
from pbd.arm.collision.geometry import link_bodies
from pbd.arm.collision.motion_check import all_hits, collision_error, object_phases_of, refuse_home
from pbd.arm.collision.scene import CollisionScene, GraspState
from pbd.arm.model import ArmModel, load_model
from pbd.arm.path_sampling import sample_trajectory
from pbd.data import GraspedObject, JointTrajectory, Obstacle, Robot
from pbd.data.world import TABLE, ObjectPhase
from pbd.errors import PlanError
from pbd.planning.result import find_touching
from pbd.pose import Array, Pose, quat_from_rpy
from tests.arm.collision_oracles import first_hit, placements, points_of
from tests.arm.conftest import random_joints
from tests.arm.straight_moves import solve_path, time_keyframes
from tests.not_none import not_none

BOTTLE = GraspedObject("cylinder", (0.06, 0.2))


DOWN = quat_from_rpy((np.pi, 0.0, 0.0))


def through(
    arm: ArmModel, places: Sequence[tuple[float, float, float]], grips: Sequence[bool | None]
) -> JointTrajectory:
    """Return a motion from home through places, with the tool pointing down."""
    q = solve_path(arm, [Pose(np.array(place), DOWN) for place in places], arm.robot.home)
    return time_keyframes(arm, q, [0.2] * len(places), grips, arm.robot.home)


PLACES = [(0.5, -0.2, 0.35), (0.5, -0.2, 0.15), (0.5, -0.2, 0.35), (0.5, 0.2, 0.35), (0.5, 0.2, 0.15), (0.5, 0.2, 0.35)]


GRIPS = [None, True, None, None, False, None]


def board(low: float, high: float, thick: float = 0.02) -> Obstacle:
    """Return a board across the middle of the path, from one height to another, m."""
    middle = (0.6, 0.0, (low + high) / 2)
    return Obstacle("the board", "box", (0.3, thick, high - low), Pose.from_rpy(middle, (0, 0, 0)))


def refuse_collision(scene: CollisionScene, trajectory: JointTrajectory) -> None:
    found = first_hit(scene, trajectory)
    if found is not None:
        raise collision_error(scene, trajectory, found)


def test_a_free_motion_is_free(arm: ArmModel) -> None:
    scene = CollisionScene(arm, 0.0, [board(0.0, 0.15)], BOTTLE)
    trajectory = through(arm, PLACES, GRIPS)
    assert first_hit(scene, trajectory) is None
    refuse_collision(scene, trajectory)
    refuse_home(scene)


def test_the_bottle_meets_what_the_hand_does_not(arm: ArmModel) -> None:
    """On the way the bottle's lower end is at 0.2 m, the fingertips are at 0.34 m."""
    trajectory = through(arm, PLACES, GRIPS)
    assert first_hit(CollisionScene(arm, 0.0, [board(0.0, 0.25)]), trajectory) is None
    found = not_none(first_hit(CollisionScene(arm, 0.0, [board(0.0, 0.25)], BOTTLE), trajectory))
    assert (found.hit.first, found.hit.second) == ("the cylinder", "the board")
    assert found.hit.depth > 0.01
    assert (found.keyframe, found.at_keyframe) == (3, False)
    assert trajectory.keyframe_t[2] < found.t <= found.parted_t < trajectory.keyframe_t[3]


def test_a_released_object_is_an_obstacle(arm: ArmModel) -> None:
    """A rod is put down. A motion that was free before then touches it, with a link that is not the gripper."""
    rod = GraspedObject("cylinder", (0.02, 0.3))
    here, there = (0.5, -0.2, 0.15), (0.5, 0.2, 0.15)
    q = solve_path(arm, [Pose(np.array(place), DOWN) for place in (here, there)], arm.robot.home)
    bare, scene = CollisionScene(arm), CollisionScene(arm, grasped=rod)
    put_down = ObjectPhase(0.0, 1.0, False, Pose.from_rpy(there, (0, 0, 0)))
    for through_it in random_joints(arm.robot, 3000, seed=0):
        if bare.hit(through_it) is None and scene.hit(through_it, GraspState(1.0, put_down)) is not None:
            last = time_keyframes(arm, np.array([*q, through_it]), [0.2] * 3, [True, False, None], arm.robot.home)
            if first_hit(bare, last) is None:
                break
    else:
        raise AssertionError("no such configuration")
    first = time_keyframes(arm, np.array([through_it, *q]), [0.2] * 3, [None, True, False], arm.robot.home)
    found = not_none(first_hit(scene, last))
    assert found.hit.second == "the cylinder"
    assert found.t > last.keyframe_t[1]
    assert [phase.held for phase in object_phases_of(scene, last)] == [False, True, False]
    earlier = first_hit(scene, first)
    assert earlier is None or earlier.t > first.keyframe_t[0]


def test_a_contact_with_the_table_is_allowed_only_where_the_object_rests(arm: ArmModel) -> None:
    scene = CollisionScene(arm, 0.0, [], BOTTLE)
    low = [(x, y, z - 0.01 if i == 4 else z) for i, (x, y, z) in enumerate(PLACES)]  # put down a centimetre too deep
    assert first_hit(scene, through(arm, low, GRIPS)) is None
    dragged = [(x, y, 0.15 if 2 <= i <= 3 else z) for i, (x, y, z) in enumerate(PLACES)]
    found = not_none(first_hit(scene, through(arm, dragged, GRIPS)))
    assert (found.hit.first, found.hit.second) == ("the cylinder", TABLE)


def test_a_contact_of_opening_fingers_is_found(arm: ArmModel) -> None:
    """Only the gripper moves; the arm stands still."""
    post = Obstacle("post", "cylinder", (0.02, 0.16), Pose.from_rpy((0.5 + 0.055, 0.2, 0.08), (0, 0, 0)))
    scene = CollisionScene(arm, None, [post])
    places = [(0.5, -0.2, 0.35), (0.5, 0.2, 0.35), (0.5, 0.2, 0.15), (0.5, 0.2, 0.35)]
    opens = through(arm, places, [True, None, False, None])
    found = not_none(first_hit(scene, opens))
    assert (found.keyframe, found.hit.second) == (2, "post")
    assert "finger" in found.hit.first
    assert opens.keyframe_t[2] < found.t < opens.keyframe_t[2] + 0.8
    assert first_hit(scene, through(arm, places, [True, None, None, None])) is None


@pytest.mark.parametrize("thick", [1e-4, 1e-3])
def test_a_thin_sheet_across_a_fast_move_is_found(arm: ArmModel, thick: float) -> None:
    """A thin sheet across a move at full speed; both ends are free."""
    trajectory = through(arm, [(0.5, -0.3, 0.4), (0.5, 0.3, 0.4)], [None, None])
    found = not_none(first_hit(CollisionScene(arm, 0.0, [board(0.3, 0.6, thick)]), trajectory))
    assert found.hit.second == "the board"
    assert (found.keyframe, found.at_keyframe) == (1, False)


def dense(arm: ArmModel, scene: CollisionScene, names: set[str], trajectory: JointTrajectory) -> tuple[Array, Array]:
    """Return instants (n,) with at most 0.2 mm of motion between them, and the least distance (n,) at each, m."""
    everything = scene.always
    rows = [row for row, pair in enumerate(everything.pairs) if everything.bodies[pair[1]].name in names]
    watched = Clearance(arm, everything.bodies, everything.pairs[rows])
    path = sample_trajectory(trajectory, watched.rates, 2e-4)
    return path.t, np.array([watched.distances(x).min() for x in path.x])


def test_against_dense_sampling(arm: ArmModel) -> None:
    """Random moves past a thin board and a rod: no contact that sampling at 0.2 mm finds is missed."""
    rng, verdicts = np.random.default_rng(0), []
    for q in random_joints(arm.robot, 5, seed=1, margin=0.3):
        ends = np.array([q, q + rng.uniform(-0.1, 0.1, 7)])
        trajectory = time_keyframes(arm, ends, [0.0, 0.0], [None, None], q, approach=False)
        middle = arm.forward(ends.mean(axis=0)).p
        things = [
            Obstacle("board", "box", (0.2, 0.001, 0.2), Pose(middle + rng.normal(0, 0.1, 3), rng.normal(size=4))),
            Obstacle("rod", "cylinder", (0.004, 0.3), Pose(middle + rng.normal(0, 0.1, 3), rng.normal(size=4))),
        ]
        scene = CollisionScene(arm, None, things)
        t, distance = dense(arm, scene, {"board", "rod"}, trajectory)
        found = first_hit(scene, trajectory)
        verdicts.append(found is not None)
        if (distance < 0.0).any():
            assert found is not None
            assert found.t <= t[np.argmax(distance < 0.0)]
        if found is not None and found.hit.second in ("board", "rod"):
            at = distance[np.searchsorted(t, found.t)]
            assert at < MARGIN_M + 3e-4  # it is no false alarm
            assert found.hit.distance <= at + 3e-4  # and is told as deep as it gets
    assert any(verdicts)
    assert not all(verdicts)


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        (
            Obstacle("the board", "box", (0.25, 0.02, 0.3), Pose.from_rpy((0.68, 0.0, 0.45), (0, 0, 0))),
            r"between keyframes 0 and 1 \(t = \d\.\d s\): panda_\w+ would touch the board, \d+\.\d cm "
            r"deep; move the dock or the board, or demonstrate a path around it",
        ),
        (
            Obstacle("the lamp", "sphere", (0.2,), Pose.from_rpy((0.31, 0.0, 0.6), (0, 0, 0))),
            r"at the start of the motion \(t = 0\.0 s\): panda_\w+ touches the lamp, \d+\.\d cm deep; move the lamp,",
        ),
        (  # from the start to keyframe 0
            Obstacle("the lamp", "sphere", (0.7,), Pose.from_rpy((0.4, -0.1, 0.6), (0, 0, 0))),
            r"at the start of the motion \(t = 0\.0 s\): panda_\w+ touches the lamp, \d+\.\d cm deep; move the lamp,",
        ),
        (
            Obstacle("the lamp", "box", (0.2, 0.1, 0.1), Pose.from_rpy((0.5, -0.2, 0.295), (0, 0, 0))),
            r"at keyframe 0 \(t = \d\.\d s\): panda_\w+ would touch the lamp, \d\.\d mm deep; move the ",
        ),
    ],
)
def test_a_hit_is_described_in_one_line(arm: ArmModel, obstacle: Obstacle, message: str) -> None:
    scene, trajectory = CollisionScene(arm, None, [obstacle]), through(arm, PLACES[2:4], [None, None])
    with pytest.raises(PlanError, match=f"^{message}") as caught:
        refuse_collision(scene, trajectory)
    assert caught.value.exit_code == 3
    assert "\n" not in caught.value.message
    assert caught.value.fields.keys() == {"keyframe", "t", "bodies", "value", "p_base"}


def test_a_near_miss_is_described_by_its_distance(arm: ArmModel) -> None:
    trajectory = through(arm, PLACES[:2], [None, None])
    fingers = [body for body in link_bodies(arm) if "finger" in body.name]
    joints = placements(arm, np.append(trajectory.keyframe_q[1], 1.0))
    level = min(points_of(body, joints)[:, 2].min() for body in fingers) - 0.0015
    with pytest.raises(
        PlanError, match=r"^at keyframe 1 .*finger would come within 1\.\d mm of the table; raise the keyf"
    ):
        refuse_collision(CollisionScene(arm, level), trajectory)


def test_the_arm_against_itself_and_after_the_last_keyframe(arm: ArmModel) -> None:
    folded = arm.robot.home.copy()
    folded[[3, 5]] = -3.0, 0.0
    q = np.array([arm.robot.home + 0.1, folded])
    trajectory = time_keyframes(arm, q, [0.2, 0.2], [None, None], arm.robot.home)
    scene = CollisionScene(arm)
    with pytest.raises(
        PlanError, match=r"^at keyframe 1 .* would touch panda_\w+, .*; move the dock, or hold the sensor"
    ):
        refuse_collision(scene, trajectory)
    kept = JointTrajectory(
        trajectory.joint_names, trajectory.knots, trajectory.coefficients, trajectory.gripper_t,
        trajectory.gripper_opening, trajectory.keyframe_t[:1], trajectory.keyframe_q[:1],
    )  # fmt: skip
    with pytest.raises(PlanError, match=r"^after keyframe 0 \(t = "):
        refuse_collision(scene, kept)


def test_home_in_collision_is_refused(arm: ArmModel) -> None:
    with pytest.raises(
        PlanError, match=r"^home of panda: panda_\w+ would touch the table, .* deep; correct table_height"
    ) as caught:
        refuse_home(CollisionScene(arm, 0.6))
    assert caught.value.message.endswith(
        "; correct table_height in the calibration or in the robot's [dock], or change home in the robot's TOML"
    )
    assert caught.value.exit_code == 3


def test_what_the_arm_would_touch_wherever_it_is_no_home_avoids(arm: ArmModel) -> None:
    plinth = Obstacle("the plinth", "box", (0.4, 0.4, 0.3), Pose.from_rpy((0.0, 0.0, 0.15), (0, 0, 0)))
    with pytest.raises(
        PlanError, match=r"touch the plinth, .* in nearly every configuration: correct the plinth in the"
    ):
        refuse_home(CollisionScene(arm, None, [plinth]))


WING = """<robot name="winged"><link name="foot"/>
<link name="arm"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="wing"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="pan" type="revolute"><parent link="foot"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="hinge" type="revolute"><parent link="foot"/><child link="wing"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_a_joint_that_nothing_moves_is_named_where_it_brings_a_link_in_the_way(tmp_path: Path, panda: Robot) -> None:
    """A humanoid's other arm, which stands at 0: another home of this arm may not help."""
    (tmp_path / "winged.urdf").write_text(WING, encoding="utf-8")
    ones: Any = dict.fromkeys(("upper", "velocity", "acceleration", "jerk"), np.ones(1))
    winged = load_model(
        replace(
            panda, name="winged", urdf=tmp_path / "winged.urdf", srdf=None, base="foot", body="arm", joints=("pan",),
            home=np.zeros(1), gripper=None, limits=replace(panda.limits, lower=-np.ones(1), effort=None, **ones),
        )
    )  # fmt: skip
    assert winged.unmoved_between("arm", "wing") == ("hinge",)
    assert winged.unmoved_between("arm", "foot") == ()
    with pytest.raises(PlanError) as caught:
        refuse_home(CollisionScene(winged))
    assert caught.value.message == (
        "home of winged: arm would touch wing, 20.0 cm deep; nothing moves hinge, so it is taken to stand at 0: if "
        'that is wrong, make it a fixed joint where it stands; if these links touch by design, add ["arm", "wing"] to '
        "may_touch in its [arm]; else change home in the robot's TOML"
    )


def test_nan_is_an_error(arm: ArmModel) -> None:
    scene, q = CollisionScene(arm), arm.robot.home * np.nan
    with pytest.raises(ValueError, match="must be finite"):
        scene.hit(q)
    with pytest.raises(ValueError, match="NaN"):
        scene.check_path(np.stack((arm.robot.home, np.where(np.arange(7) == 3, np.nan, arm.robot.home))))


def sampled(scene: CollisionScene, trajectory: JointTrajectory, t: Array) -> dict[tuple[str, str], list[float]]:
    """Return the sampled instants at which two bodies touch, by their names."""
    samples, phases = trajectory.at(t), object_phases_of(scene, trajectory)
    found: dict[tuple[str, str], list[float]] = {}
    for instant, q, opening in zip(t, samples.q, samples.gripper, strict=True):
        x = np.append(q, opening)
        around = [scene.object_clearance(phase) for phase in phases if phase.start <= instant <= phase.end]
        for watch in (scene.always, *around):
            for pair, distance in watch.touching(x):
                hit = scene.as_hit(watch, pair, x, distance)
                found.setdefault((hit.first, hit.second), []).append(float(instant))
    return found


@pytest.mark.parametrize(
    ("table", "height", "grasped", "least"),
    [(0.17, 0.05, None, 2), (0.17, 0.45, None, 2), (0.12, 0.45, BOTTLE, 2)],  # the hand comes down to 0.15 m twice
)
def test_all_hits_are_those_that_a_search_finds(
    arm: ArmModel, table: float, height: float, grasped: GraspedObject | None, least: int
) -> None:
    scene = CollisionScene(arm, table, [board(0.0, height)], grasped)
    trajectory = through(arm, PLACES, GRIPS)
    hits = all_hits(scene, trajectory)
    step = 0.02
    wanted = sampled(scene, trajectory, np.arange(0.0, trajectory.duration, step))
    assert len(hits) >= least
    assert {(each.hit.first, each.hit.second) for each in hits} >= set(wanted)
    for bodies, instants in wanted.items():
        spans = [(each.t, each.parted_t) for each in hits if (each.hit.first, each.hit.second) == bodies]
        for instant in instants:
            assert any(start - step <= instant <= end + step for start, end in spans), (bodies, instant, spans)
        for start, end in spans:  # and each hit is confirmed, unless it is too short for the search
            assert end - start < 2 * step or any(start <= instant <= end for instant in instants)
    for earlier, later in pairwise(hits):
        assert earlier.t <= later.t


@pytest.mark.parametrize(("parted_s", "spans"), [(0.09, [(1.0, 3.0)]), (0.11, [(1.0, 2.0), (2.11, 3.0)])])
def test_contacts_of_a_pair_a_tenth_of_a_second_apart_are_one(
    arm: ArmModel, monkeypatch: pytest.MonkeyPatch, parted_s: float, spans: list[tuple[float, float]]
) -> None:
    """The deepest counts; a contact of another pair stays another."""
    scene, trajectory = CollisionScene(arm), through(arm, PLACES[:2], GRIPS[:2])
    path = JointPath(np.array([1.0, 2.0, 2.0 + parted_s, 3.0]), np.tile(np.append(arm.robot.home, 0.0), (4, 1)))
    contacts = [ContactSpan(0, 0, 1, 0, -0.01), ContactSpan(0, 2, 3, 2, -0.02), ContactSpan(1, 2, 3, 2, -0.03)]
    monkeypatch.setattr("pbd.arm.collision.motion_check.sample_trajectory", lambda *_: path)
    monkeypatch.setattr(scene.always, "contacts", lambda _: contacts)
    own = [each for each in all_hits(scene, trajectory) if (each.hit.first, each.hit.second) == scene.always.names(0)]
    assert [(each.t, each.parted_t) for each in own] == spans
    assert own[-1].hit.distance == -0.02


def test_the_first_hit_is_that_of_a_refusal(arm: ArmModel) -> None:
    scene = CollisionScene(arm, 0.12, [board(0.0, 0.45)], BOTTLE)
    trajectory = through(arm, PLACES, GRIPS)
    touching = find_touching(scene, trajectory)
    assert touching is not None
    first, fields = touching.hits[0], touching.error.fields
    assert first.t == min(each.t for each in touching.hits)
    assert (fields["t"], fields["bodies"]) == (first.t, (first.hit.first, first.hit.second))


def test_an_objects_clearance_goes_with_its_motion(arm: ArmModel) -> None:
    """A scene is cached, and each motion has phases of its own."""
    scene, trajectory = CollisionScene(arm, 0.12, [board(0.0, 0.45)], BOTTLE), through(arm, PLACES, GRIPS)
    phases = object_phases_of(scene, trajectory)
    kept = [ref(scene.object_clearance(phase)) for phase in phases]
    assert [each() for each in kept] == [scene.object_clearance(phase) for phase in phases]
    del phases
    assert [each() for each in kept] == [None] * len(kept)
