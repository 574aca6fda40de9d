"""The choice of a motion: straight, with other configurations, by line, by the hand's path, by detour; refusals."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pbd.arm import choose_motion as motion_module
from pbd.arm import ladder_checks
from pbd.arm.choose_motion import choose_motion
from pbd.arm.collision.clearance import CLOSE_M, MARGIN_M
from pbd.arm.collision.scene import CollisionScene, GraspState, Hit
from pbd.arm.detour import _subdivided, bend_detour
from pbd.arm.ik import cartesian
from pbd.arm.ik.cartesian import line
from pbd.arm.ladder_building import build_ladder
from pbd.arm.ladder_checks import APPROACH_M
from pbd.arm.ladder_graph import Barred, Ladder, joint_travel
from pbd.arm.ladder_state import MoveState
from pbd.arm.model import load_model
from pbd.arm.motion_request import DEMO, DETOUR, LINE, STRAIGHT, Motion, MotionRequest
from pbd.arm.refusal import CANNOT_FOLLOW, COLLISION, UNREACHABLE, Refusal, refuse_move
from pbd.arm.timing.time_moves import Move, time_moves
from pbd.arm.tool_deviation import off_line, tool_deviations
from pbd.data import Obstacle
from pbd.errors import PbdWarning
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of
from tests.arm.collision_oracles import first_hit
from tests.benchmarks.scenes import made, travel
from tests.not_none import not_none

ARM = arm_of("panda")
HOME = ARM.robot.home
T_HOME = ARM.forward(HOME)
TURN = np.array([1.0, 0.0, 0.0, 0.0])


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    """Return home's tool pose, shifted in base, m."""
    return Pose(T_HOME.p + np.array([x, y, z]), T_HOME.wxyz)


def ball(x: float, y: float, z: float, diameter: float = 0.04) -> Obstacle:
    return Obstacle("the ball", "sphere", (diameter,), moved(x, y, z))


def box(name: str, size: tuple[float, ...], x: float, y: float, z: float) -> Obstacle:
    return Obstacle(name, "box", size, Pose(moved(x, y, z).p, TURN))


def over(*corners: Pose) -> Sequence[Pose]:
    """Return the path of a hand from corner to corner."""
    poses: list[Pose] = [corners[0]]
    for a, b in pairwise(corners):
        poses += line(a, b)[1:]
    return poses


def asked(
    poses: Sequence[Pose], obstacles: Sequence[Obstacle] = (), **request: object
) -> tuple[Motion | Refusal, CollisionScene]:
    scene = CollisionScene(ARM, None, obstacles)
    return choose_motion(ARM, MotionRequest(poses, HOME, **request), scene), scene  # type: ignore[arg-type]


def chosen(poses: Sequence[Pose], obstacles: Sequence[Obstacle] = (), **request: object) -> Motion:
    """Return a motion; assert that all of it, once timed, is free, and that it reaches the poses."""
    found, scene = asked(poses, obstacles, **request)
    assert isinstance(found, Motion)
    moves = [Move(segment.q, segment.curved) for segment in found.segments]
    back = None if found.retreat is None else Move(found.retreat.q, found.retreat.curved)
    start = HOME if request.get("approach", True) else found.q[0]
    trajectory, _ = time_moves(ARM, start, moves, [0.2] * len(moves), [None] * len(moves), retreat=back)
    assert first_hit(scene, trajectory) is None
    for pose, q in zip(poses, found.q, strict=True):
        assert max(pose.distance(ARM.forward(q))) < 1e-5
    return found


def refused(poses: Sequence[Pose], obstacles: Sequence[Obstacle] = (), **request: object) -> Refusal:
    found, _ = asked(poses, obstacles, **request)
    assert isinstance(found, Refusal)
    assert "\n" not in found.error.message
    assert found.error.exit_code == 3
    return found


def kinds(motion: Motion) -> list[str]:
    return [segment.kind for segment in motion.segments]


def places(q: Array) -> Array:
    return np.array([ARM.forward(each).p for each in q]) - T_HOME.p


LEFT, RIGHT = moved(y=-0.2, z=-0.1), moved(y=0.2, z=-0.1)
WALL = [box("the wall", (1.2, 0.01, 0.7), 0.41, 0.0, -0.25)]
"""A wall between left and right, from the arm's base outward; the hand can pass over it."""
PLATE = [box("the plate", (1.2, 0.01, 1.8), 0.41, 0.0, 0.3)]
"""A wall from the arm's base outward, higher than the arm reaches."""
OVER = over(LEFT, moved(y=-0.2, z=0.2), moved(y=0.2, z=0.2), RIGHT)
LOWER = over(LEFT, moved(y=-0.2, z=-0.12), moved(y=0.2, z=-0.12), RIGHT)


def test_without_obstacles_all_moves_are_straight() -> None:
    motion = chosen((LEFT, RIGHT), q_retreat=HOME)
    assert kinds(motion) == [STRAIGHT, STRAIGHT]
    np.testing.assert_array_equal(motion.segments[1].q, motion.q[1:])
    assert motion.segments[1].off_line_m > 0.001
    np.testing.assert_array_equal(not_none(motion.retreat).q[-1], HOME)


def test_a_barred_move_is_avoided_by_another_configuration() -> None:
    """A ball is where the elbow would pass in the middle of the move; the hand's path is not needed."""
    free = chosen((LEFT, RIGHT), approach=False)
    ARM.forward(0.5 * (free.q[0] + free.q[1]))
    elbow = ARM.data.oMi[4].translation - T_HOME.p
    motion = chosen(
        (LEFT, RIGHT), [ball(elbow[0], elbow[1] + 0.1, elbow[2], 0.05)], approach=False, hand_paths=lambda: [OVER]
    )
    assert kinds(motion) == [STRAIGHT, STRAIGHT]
    assert np.abs(motion.q - free.q).max() > 0.05


def test_the_hands_path_leads_over_a_wall() -> None:
    motion = chosen((LEFT, RIGHT), WALL, approach=False, hand_paths=lambda: [OVER])
    assert kinds(motion) == [STRAIGHT, DEMO]
    avoided = not_none(motion.segments[1].avoided)
    assert avoided.second == "the wall"
    assert places(motion.segments[1].q)[:, 2].max() > 0.19


def test_only_barred_moves_are_mended() -> None:
    """Three of the moves cross the wall: only these follow the hand's path, the others stay straight."""
    beside = [moved(x=0.02, y=-0.2, z=-0.1), moved(x=0.02, y=0.2, z=-0.1)]
    poses = (LEFT, beside[0], RIGHT, beside[1], LEFT, beside[0], RIGHT)
    paths = [over(a, moved(y=a.p[1] - T_HOME.p[1], z=0.2), moved(y=b.p[1] - T_HOME.p[1], z=0.2), b)
             for a, b in pairwise(poses)]  # fmt: skip
    motion = chosen(poses, WALL, approach=False, hand_paths=lambda: paths)
    assert kinds(motion) == [STRAIGHT, STRAIGHT, DEMO, STRAIGHT, DEMO, STRAIGHT, DEMO]


def test_the_checks_for_each_keyframe_do_not_grow_with_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """With several windows of the ladder; collision checks are counted."""
    monkeypatch.setattr(motion_module, "WINDOW", 12)
    monkeypatch.setattr(motion_module, "OVERLAP", 4)
    counted, is_free = list[GraspState](), CollisionScene.is_free

    def count(self: CollisionScene, q: Array, grasp: GraspState) -> bool:
        counted.append(grasp)
        return is_free(self, q, grasp)

    monkeypatch.setattr(CollisionScene, "is_free", count)
    checks = []
    for many in (1, 2):
        poses = [moved(x=0.002 * i, y=(-0.2, 0.2)[i % 2], z=-0.1) for i in range(15)] * many
        counted.clear()
        motion = chosen(poses, approach=False)
        assert kinds(motion) == [STRAIGHT] * len(poses)
        checks.append(len(counted) / len(poses))
    assert checks[1] < 1.3 * checks[0]


def test_a_window_is_released_where_what_is_final_bars_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines that are split near the beginning of short windows; no remedy may change a part that is final."""
    released, release = list[int](), Ladder.release

    def count(self: Ladder) -> None:
        released.append(self.first)
        release(self)

    monkeypatch.setattr(Ladder, "release", count)
    monkeypatch.setattr(motion_module, "WINDOW", 4)
    monkeypatch.setattr(motion_module, "OVERLAP", 2)
    rng, q, poses = np.random.default_rng(20), HOME, list[Pose]()
    for _ in range(6):
        q = np.clip(q + rng.normal(0.0, 0.5, len(q)), ARM.limits.lower + 0.05, ARM.limits.upper - 0.05)
        poses.append(ARM.forward(q))
    motion = choose_motion(ARM, MotionRequest(poses, HOME, kind=LINE), None)
    assert isinstance(motion, Motion)
    assert kinds(motion) == [STRAIGHT, *5 * [LINE]]
    assert len(released) == 1
    for (before, after), segment in zip(pairwise(poses), motion.segments[1:], strict=True):
        p = np.array([ARM.forward(each).p for each in segment.q])
        assert off_line(np.vstack((before.p, p, after.p))) < 1e-4


@pytest.fixture(scope="module")
def around() -> tuple[Motion, list[object]]:
    """The detour around the plate, and the paths for which joints were solved."""
    followed = list[object]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ladder_checks, "follow", lambda *args: followed.append(args))
        with pytest.warns(PbdWarning, match="goes around the plate"):
            motion = chosen((LEFT, RIGHT), PLATE, approach=False)
    return motion, followed


def test_a_path_on_which_the_tool_touches_is_not_followed(around: tuple[Motion, list[object]]) -> None:
    """The tool's hit follows from its poses alone, so no joints are solved along the line."""
    motion, followed = around
    assert kinds(motion) == [STRAIGHT, DETOUR]
    assert not followed
    scene = CollisionScene(ARM, None, PLATE)
    line_of_tool = line(LEFT, RIGHT)
    hit = not_none(scene.tool_hit(line_of_tool, GraspState()))
    assert hit.second == "the plate"
    assert scene.tool_hit(line_of_tool[:5], GraspState()) is None


def test_a_refusal_names_all_paths_that_were_tried() -> None:
    refusal = refused((LEFT, RIGHT), PLATE, approach=False, hand_paths=lambda: [LOWER], detour=False)
    message, fields = refusal.error.message, refusal.error.fields
    assert refusal.why == COLLISION
    start, _, told = message.partition(" pairs of arm poses. ")
    assert start.startswith("no collision-free motion from keyframe 0 to keyframe 1 among ")
    assert int(start.split()[-1]) > 50
    straight, _, path = told.partition(". Demonstrated path")
    assert straight.startswith("Straight in joint space")
    assert path.endswith(" deep; move the dock or the obstacle")
    assert straight.count(" would touch the plate, ") == path.count(" would touch the plate, ") == 1
    assert told.count(" (closest): ") == 1
    assert fields["keyframe"] == 1
    assert fields["bodies"][1] == "the plate"
    assert fields["closest"] in (STRAIGHT, DEMO)
    assert 0.0 < float(str(fields["value"])) < 0.3


def test_without_a_hands_path_a_line_is_tried() -> None:
    message = refused((LEFT, RIGHT), PLATE, approach=False, detour=False).error.message
    assert ". Straight in joint space" in message
    assert ". Straight line of the tool" in message


def test_a_detour_is_the_same_each_time_and_is_warned_of(around: tuple[Motion, list[object]]) -> None:
    """Neither other configurations nor a line avoid the plate; earlier plans do not change the result."""
    with pytest.warns(PbdWarning, match="^between keyframes 0 and 1 the arm goes around the plate: --no-detour"):
        again = chosen((LEFT, RIGHT), PLATE, approach=False)
    assert kinds(again) == [STRAIGHT, DETOUR]
    assert again.segments[1].q.tobytes() == around[0].segments[1].q.tobytes()


def test_a_known_detour_is_bent_to_joints_nearby_without_getting_longer(around: tuple[Motion, list[object]]) -> None:
    found, _ = around
    way = np.vstack((found.q[0], found.segments[1].q))
    scene = CollisionScene(ARM, None, PLATE)
    start, goal = way[-1] + 0.02, way[0] - 0.02
    assert bend_detour(scene, GraspState(), start, goal, []) is None
    back = not_none(bend_detour(scene, GraspState(), start, goal, [way]))
    assert (back[[0, -1]] == (start, goal)).all()
    assert scene.is_free(back, GraspState())
    assert np.abs(np.diff(back, axis=0)).sum() < 1.1 * np.abs(np.diff(way, axis=0)).sum()
    ends, most = back[[0, -1]].max(axis=0), back.max(axis=0)
    assert (most > ends + 0.01).any()
    limits = replace(ARM.limits, upper=np.where(most > ends + 0.01, 0.5 * (ends + most), ARM.limits.upper))
    tight = CollisionScene(load_model(replace(ARM.robot, limits=limits)), None, PLATE)
    assert bend_detour(tight, GraspState(), start, goal, [way]) is None


def test_no_known_detour_is_bent_where_the_straight_move_is_free(around: tuple[Motion, list[object]]) -> None:
    way = np.vstack((around[0].q[0], around[0].segments[1].q))
    found = not_none(bend_detour(CollisionScene(ARM), GraspState(), way[0], way[-1], [way]))
    assert found.tolist() == way[[0, -1]].tolist()


def test_a_known_detour_that_is_wider_than_it_need_be_is_brought_nearer_to_the_straight_move(
    around: tuple[Motion, list[object]],
) -> None:
    way = np.vstack((around[0].q[0], around[0].segments[1].q))
    scene, straight = CollisionScene(ARM, None, PLATE), np.linspace(way[0], way[-1], len(way))
    wide = straight + 1.5 * (way - straight)
    found = not_none(bend_detour(scene, GraspState(), way[0], way[-1], [wide]))
    share = np.linalg.norm(found - straight) / np.linalg.norm(wide - straight)
    assert share < 1.0
    assert found == pytest.approx(straight + share * (wide - straight))


def test_between_two_points_of_a_divided_polyline_no_joint_moves_farther_than_asked() -> None:
    corners = np.array([[0.0, 0.0], [0.3, -0.1], [0.31, 1.0]])
    divided = _subdivided(corners, 0.05)
    assert np.abs(np.diff(divided, axis=0)).max() == pytest.approx(0.05)
    scale = np.ones(2)
    assert joint_travel(divided, scale) == pytest.approx(joint_travel(corners, scale))


def test_no_detours_are_searched_for_beside_known_ones_where_too_many_pairs_were_barred(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, request = CollisionScene(ARM, None, PLATE), MotionRequest((LEFT, RIGHT), HOME, approach=False)
    ladder = build_ladder(ARM, (LEFT, RIGHT), HOME, None, 12)
    assert isinstance(ladder, Ladder)
    search = motion_module._Search(ARM, request, scene, ladder)
    search._detour(1)
    path = search.ladder.search(search.is_free, search.cost)
    (_, move), layer = search.at(2), search.ladder.layers[2]
    assert not isinstance(path, Barred)
    layer.barred_moves, remedies = layer.mend_after, [*move.remedies]
    monkeypatch.setattr(search, "_find_detour", pytest.fail)
    assert search._mend(2, True) is None
    assert search.ladder.search(search.is_free, search.cost) == path
    assert move.remedies == remedies
    layer.cost[path[2]] = np.inf  # say that the known detour ends at a configuration that is not free
    search.ladder.add(2, layer.q[:0], layer.cost[:0])
    assert isinstance(search.ladder.search(search.is_free, search.cost), Barred)


@pytest.mark.parametrize(("mended_by", "tried"), [("drop", [3]), ("none", [3, 2, 1])])
def test_once_a_remedy_changed_the_number_of_layers_the_others_wait_for_the_next_search(
    monkeypatch: pytest.MonkeyPatch, mended_by: str, tried: list[int]
) -> None:
    ladder = build_ladder(ARM, (LEFT, RIGHT, LEFT, RIGHT), HOME, None, 12)
    assert isinstance(ladder, Ladder)
    search = motion_module._Search(ARM, MotionRequest((LEFT, RIGHT, LEFT, RIGHT), HOME), None, ladder)
    asked = []

    def mend(place: int, has_free_state: bool) -> None:
        asked.append(place)
        if mended_by == "drop":
            search.ladder.drop(place, place + 1)

    monkeypatch.setattr(search, "_mend", mend)
    search._mend_all(Barred((1, 2, 3), (True, True, True)))
    assert asked == tried


@pytest.mark.parametrize(("kind", "told"), [(STRAIGHT, True), (LINE, False)])
def test_without_ompl_a_move_that_a_detour_may_replace_says_that_none_was_searched_for(
    monkeypatch: pytest.MonkeyPatch, kind: str, told: bool
) -> None:
    for module in (ladder_checks, motion_module):
        monkeypatch.setattr(module, "CAN_DETOUR", False)
    message = refused((LEFT, RIGHT), PLATE, approach=False, kind=kind).error.message
    assert (", and no detour was searched for: the package ompl is not installed. " in message) == told


def test_a_refusal_gives_the_number_of_checks_of_detours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the last search, with the smaller margin."""
    monkeypatch.setattr(ladder_checks, "DETOUR_CHECKS", 50 / ladder_checks.CLOSE_CHECKS_SHARE)
    monkeypatch.setattr(ladder_checks, "DETOUR_CHECKS_PER_KEYFRAME", 0)
    message = refused((LEFT, RIGHT), PLATE, approach=False).error.message
    checks = int(message.partition(" pairs of arm poses, and no detour found in ")[2].split(" checks. Straight")[0])
    assert 50 <= checks < 60


@pytest.mark.filterwarnings("ignore:the only motion found keeps a clearance of 0.5 mm")
def test_a_barred_move_may_need_other_configurations_at_the_keyframe_before() -> None:
    _, obstacles, poses = made("panda", "clutter", 6)
    assert isinstance(asked(poses, obstacles, detour=False)[0], Motion)


@pytest.mark.filterwarnings("ignore:[a-z0-9 ]* the arm goes around the lintel")
def test_a_detour_from_any_configuration_to_any_other_is_made_where_the_nearest_pairs_have_none() -> None:
    _, obstacles, poses = made("panda", "gap", 9)
    motion = chosen(poses, obstacles, q_retreat=HOME)
    assert kinds(motion) == [STRAIGHT, DETOUR]
    assert not_none(motion.retreat).kind == DETOUR


def test_a_detour_may_turn_a_joint_by_the_larger_angle() -> None:
    """The shorter turn of the base leads nowhere: the nearest configurations have no detour."""
    arm, obstacles, poses = made("ur5", "bin", 4)
    scene = CollisionScene(arm, None, obstacles)
    motion = choose_motion(arm, MotionRequest(poses, arm.robot.home, q_retreat=arm.robot.home), scene)
    assert isinstance(motion, Motion)
    assert motion.retreat is not None
    assert motion.q[1, 0] - motion.q[0, 0] < np.pi


@pytest.mark.parametrize("higher_m", [1e-3, 3e-3])
def test_the_smaller_margin_is_used_with_a_warning_if_nothing_else_is_free(higher_m: float) -> None:
    """A plate just below the fingers: closer than MARGIN_M, then closer than CLOSE_M."""
    q, (low, high) = chosen((LEFT, RIGHT), approach=False).q[0], (-0.1, 0.0)

    def plate(z: float) -> list[Obstacle]:
        x, y, below = LEFT.p - T_HOME.p
        return [box("the plate", (0.3, 0.3, 0.02), x, y, below + z)]

    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if CollisionScene(ARM, None, plate(middle)).hit(q) is None else (low, middle)
    if higher_m > MARGIN_M - CLOSE_M:
        refused((LEFT, RIGHT), plate(low + higher_m), approach=False)
        return
    with pytest.warns(
        PbdWarning, match=r"^the only motion found keeps a clearance of 0.5 mm instead of 2.5 mm, for example between "
    ):
        found, _ = asked((LEFT, RIGHT), plate(low + higher_m), approach=False)
    assert isinstance(found, Motion)
    barred = refused((LEFT, RIGHT), [*plate(low + higher_m), *WALL], approach=False, detour=False)
    assert barred.error.fields["keyframe"] == 1  # by the wall, not by the plate that is only near keyframe 0


def test_a_detour_is_searched_for_before_distant_configurations() -> None:
    """Among the first 36 straight moves one is free, but it is twice as long as the detour."""
    arm, obstacles, poses = made("ur5", "shelf", 7000)
    scene = CollisionScene(arm, None, obstacles)
    with pytest.warns(PbdWarning, match="goes around"):
        found = choose_motion(arm, MotionRequest(poses, arm.robot.home, q_retreat=arm.robot.home), scene)
    assert isinstance(found, Motion)
    assert travel(found) < 8.0


@pytest.mark.filterwarnings("ignore:from 1 to 2 ")
def test_a_line_is_made_instead_of_a_wide_move_where_nothing_is_in_the_way() -> None:
    arm = arm_of("ur5")
    at = (-1.4, -1.0, 2.4, -1.0, -1.0, -1.7), (0.6, -2.9, 2.0, -2.0, -0.7, -1.7), (-1.2, -1.4, 1.8, -0.9, -1.8, -0.6)
    poses = [arm.forward(arm.robot.home), *(arm.forward(np.array(q)) for q in at)]
    found = choose_motion(arm, MotionRequest(poses, arm.robot.home, approach=False), None)
    assert isinstance(found, Motion)
    assert kinds(found) == [STRAIGHT, STRAIGHT, LINE, STRAIGHT]
    assert found.segments[2].wide is not None
    way = poses[2].p - poses[1].p
    beside = [np.cross(arm.forward(q).p - poses[1].p, way / np.linalg.norm(way)) for q in found.segments[2].q]
    assert np.linalg.norm(beside, axis=1).max() < 1e-3


def test_a_joint_that_a_direct_move_would_lead_beyond_its_limit_starts_a_whole_turn_away() -> None:
    """An ur10 turns its tool by 450 degrees, and goes out of its way nowhere."""
    arm = arm_of("ur10")
    home = arm.forward(arm.robot.home)
    turns = [Pose.from_rpy(np.zeros(3), (0.0, 0.0, 0.5 * np.pi * i)) for i in range(6)]
    poses = [Pose(home.p - np.array([0.0, 0.0, 0.1]), (turn @ home).wxyz) for turn in turns]
    found = choose_motion(arm, MotionRequest(poses, arm.robot.home), None)
    assert isinstance(found, Motion)
    assert all(segment.wide is None for segment in found.segments)


@pytest.mark.filterwarnings("ignore:between keyframes 0 and 1 the arm goes around the wall")
@pytest.mark.parametrize(("size", "around"), [((0.3, 0.03, 0.4), True), ((0.6, 0.03, 0.6), False)])
def test_a_detour_is_made_instead_of_a_wide_move_if_it_is_shorter(size: tuple[float, ...], around: bool) -> None:
    """An ur5 has to pass a wall. Straight it can do so only with its elbow flipped: the tool leaves its line widely."""
    arm = arm_of("ur5")
    home = arm.forward(arm.robot.home)
    poses = [Pose.from_rpy(np.zeros(3), (0.0, 0.0, turn)) @ home for turn in (-0.5, 0.5)]
    wall = Obstacle("the wall", "box", size, Pose.from_rpy(home.p, (0.0, 0.0, float(np.arctan2(*home.p[1::-1])))))
    straight, either = (
        choose_motion(
            arm, MotionRequest(poses, arm.robot.home, approach=False, detour=detour), CollisionScene(arm, None, [wall])
        )
        for detour in (False, True)
    )
    assert isinstance(straight, Motion)
    assert straight.segments[1].wide is not None
    assert isinstance(either, Motion)
    assert either.segments[1].kind == (DETOUR if around else STRAIGHT)
    assert (travel(either) < travel(straight)) == around


@pytest.mark.parametrize("wide_cost", [ladder_checks.WIDE_COST, 0.0])
def test_a_move_between_configurations_half_a_turn_apart_is_tried_last(wide_cost: float) -> None:
    """Where whole turns are free, many pairs of configurations differ by them, and no short line joins those.

    Where the ladder has charged them, a straight move is not charged again for the tool's deviation.
    """
    arm = arm_of("ur5")
    home = arm.forward(arm.robot.home)
    poses = [home, Pose(home.p + np.array([0.05, 0.0, 0.0]), home.wxyz)]
    search = motion_module._Search(
        arm, MotionRequest(poses, arm.robot.home), None, build_ladder(arm, poses, arm.robot.home, None, 12, wide_cost)
    )
    before, layer = search.ladder.layers[1], search.ladder.layers[2]
    q_before, q = (each.reshape(-1, 6) for each in np.broadcast_arrays(before.q[:, None], layer.q))
    charged = layer.length.ravel() - np.linalg.norm(q - q_before, axis=1) + search.wide_costs([2] * len(q), q_before, q)
    wide = np.array([each.wide for each in tool_deviations(arm, q_before, q)])
    np.testing.assert_allclose(charged, charged.min() + ladder_checks.WIDE_COST * wide)
    search._follow_path(2, LINE)
    before, layer = search.ladder.layers[1], search.ladder.layers[2]
    step = before.q[:, None] - layer.q
    extra, far = layer.length - np.linalg.norm(step, axis=2), np.abs(step).max(axis=2) > np.pi
    assert extra[far].min() == pytest.approx(extra[~far].max() + wide_cost)


@pytest.mark.parametrize("end", ["approach", "back"])
def test_a_detour_from_home_and_back(end: str) -> None:
    """A wall stands between home and all keyframes, too high for straight moves."""
    poses = (moved(y=0.45, z=-0.2), moved(y=0.5, z=-0.2))
    wall = box("the wall", (0.8, 0.02, 1.1), 0.15, 0.22, -0.1)
    request = {"q_retreat": HOME, "approach": False} if end == "back" else {}
    with pytest.warns(PbdWarning, match="the arm goes around the wall"):
        found = chosen(poses, [wall], **request)
    detour = found.segments[0] if end == "approach" else found.retreat
    assert not_none(detour).kind == DETOUR


@pytest.mark.parametrize("kind", [LINE, DEMO])
def test_a_requested_path_is_not_replaced(kind: str) -> None:
    message = refused((LEFT, RIGHT), PLATE, approach=False, kind=kind, hand_paths=lambda: [LOWER]).error.message
    assert "motion from keyframe 0 to keyframe 1 among " in message
    assert " would touch the plate" in message
    assert "Straight in joint space" not in message


def test_a_path_that_cannot_be_followed_is_said_beside_what_was_hit() -> None:
    hit = Hit("the arm", "the plate", -0.01, np.zeros(3))
    refusal = refuse_move(1, MoveState(LINE, [], {STRAIGHT: hit}, barred_pairs=2), LINE, {"the plate"})
    assert refusal.error.message.startswith(
        "no collision-free motion from keyframe 0 to keyframe 1 among 2 pairs of arm"
    )
    assert ". Straight line of the tool: the arm can't follow it; move the dock or" in refusal.error.message


def test_the_hit_of_a_path_that_was_not_followed_is_found_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    """The path can be followed only without the scene; its hit is then found afterwards."""
    follow = cartesian.follow

    def broken(arm: object, poses: Sequence[Pose], *ends: Array) -> Array | None:
        return follow(ARM, poses, *ends) if alone else None

    alone = list[bool]()
    choose = motion_module.choose_motion

    def unwatched(arm: object, request: MotionRequest, queries: object) -> Motion | Refusal:
        alone.append(True)
        return choose(ARM, request, None)

    monkeypatch.setattr(ladder_checks, "follow", broken)
    monkeypatch.setattr(motion_module, "choose_motion", unwatched)
    refusal = refused((LEFT, RIGHT), PLATE, approach=False, kind=LINE)
    assert refusal.why == COLLISION
    assert "Straight line of the tool: panda_" in refusal.error.message


def test_a_keyframe_in_the_wall_is_named() -> None:
    refusal = refused((LEFT, RIGHT), [ball(0.0, 0.2, -0.1, 0.1)])
    start, _, told = refusal.error.message.partition(": ")
    assert start.startswith("no collision-free arm pose at keyframe 1 among ")
    assert int(start.split()[-2]) > 10
    assert " would touch the ball, " in told
    assert refusal.error.fields["keyframe"] == 1


def test_a_keyframe_out_of_reach() -> None:
    refusal = refused((LEFT, moved(x=2.0)))
    assert (refusal.why, refusal.error.fields["keyframe"]) == (UNREACHABLE, 1)


def test_moves_beyond_the_tolerance_become_lines() -> None:
    poses = (LEFT, RIGHT, moved(y=0.21, z=-0.1))
    off = [segment.off_line_m for segment in chosen(poses).segments]
    assert off[1] > 0.01 > off[2]
    motion = chosen(poses, tolerance_m=0.01)
    assert kinds(motion) == [STRAIGHT, LINE, STRAIGHT]
    np.testing.assert_allclose(np.ptp(places(motion.segments[1].q)[:, [0, 2]], axis=0), 0.0, atol=1e-7)


def test_without_a_free_retreat_the_motion_ends_at_the_last_keyframe() -> None:
    """An obstacle at home bars only the retreat."""
    poses = (moved(y=0.3, z=-0.1), moved(y=0.35, z=-0.1))
    with pytest.warns(PbdWarning, match=r"no collision-free way back from the last keyframe was found .*the ball"):
        motion = chosen(poses, [ball(0.0, 0.0, 0.0, 0.12)], q_retreat=HOME, approach=False)
    assert motion.retreat is None
    assert kinds(motion) == [STRAIGHT, STRAIGHT]


@pytest.mark.parametrize("end", ["approach", "back"])
def test_approach_and_retreat_may_use_the_tools_axis(end: str) -> None:
    """A ball is where the fingertips would pass shortly before they arrive."""
    low, apart = moved(y=-0.3, z=-0.3), moved(y=-0.35, z=-0.3)
    poses = (low, apart) if end == "approach" else (apart, low)
    free = chosen(poses, q_retreat=HOME)
    q = free.q[poses.index(low)]
    there = places((HOME + 0.8 * (q - HOME))[None])[0]
    found = chosen(poses, [ball(*there)], q_retreat=HOME)
    assert found.retreat is not None
    np.testing.assert_array_equal(found.retreat.q[-1], HOME)
    q = found.segments[0].q if end == "approach" else found.retreat.q
    assert len(q) == 2
    away = places(q[:1])[0] - places(found.q)[poses.index(low)]
    np.testing.assert_allclose(away[:2], 0.0, atol=1e-4)  # home's tool points down but for a hair
    assert min(abs(away[2] - distance) for distance in APPROACH_M) < 1e-4


def test_an_approach_that_is_barred_is_refused() -> None:
    refusal = refused((moved(z=-0.2), moved(z=-0.25)), [box("the plate", (0.6, 0.6, 0.01), 0.0, 0.0, -0.15)])
    assert refusal.error.fields["keyframe"] == 0


def test_a_path_that_the_arm_can_not_follow_is_refused() -> None:
    """The line goes through the arm's own base."""
    ur5 = arm_of("ur5")
    home = ur5.forward(ur5.robot.home)
    there = Pose(home.p * (-1.0, -1.0, 1.0), home.wxyz)
    refusal = choose_motion(ur5, MotionRequest((home, there), ur5.robot.home, kind=LINE), None)
    assert isinstance(refusal, Refusal)
    assert refusal.why == CANNOT_FOLLOW
    assert refusal.error.message.startswith("the arm can't follow the straight line from keyframe 0 to keyframe 1: ")


def test_a_path_is_split_if_no_pair_of_configurations_at_its_ends_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pair of configurations is connected along the entire path; those of every few poses are."""
    follow, ends = cartesian.follow, list[int]()

    def short(arm: object, poses: Sequence[Pose], *q: Array) -> Array | None:
        ends.append(len(poses))
        return follow(ARM, poses, *q) if len(poses) < 9 else None

    monkeypatch.setattr(ladder_checks, "follow", short)
    motion = chosen((LEFT, RIGHT), approach=False, kind=LINE)
    assert ends[0] == len(line(LEFT, RIGHT)) > max(ends[-10:])
    assert len(motion.segments[1].q) == ends[0] - 1
    assert np.abs(np.diff(motion.segments[1].q, axis=0)).max() < 0.2
    np.testing.assert_allclose(np.ptp(places(motion.segments[1].q)[:, [0, 2]], axis=0), 0.0, atol=1e-6)


@pytest.mark.parametrize("kind", [LINE, DEMO])
def test_a_path_that_no_configuration_follows_is_named_with_what_it_would_touch(kind: str) -> None:
    """If every way along it was barred before the whole was checked, the arm follows it as if nothing stood there."""
    request = MotionRequest((LEFT, RIGHT), HOME, kind=kind, hand_paths=lambda: [LOWER])
    for obstacles, touched in ((PLATE, "the plate"), ([], None)):
        ladder = build_ladder(ARM, request.T_base_tool, HOME, None, 12, 0.0)
        assert isinstance(ladder, Ladder)
        search = motion_module._Search(ARM, request, CollisionScene(ARM, None, obstacles), ladder)
        assert search.moves[1].kind == kind
        hit = search._hit_on_path(1)
        assert (hit and hit.second) == touched
        assert search._refuse(1).why == (COLLISION if touched else CANNOT_FOLLOW)
