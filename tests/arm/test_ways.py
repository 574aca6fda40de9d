"""Which way the arm takes: straight, otherwise held, as the hand went; and what is said where none is free."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from pbd.arm.candidates import solutions
from pbd.arm.collision import check_motion
from pbd.arm.follow import line
from pbd.arm.passage import Passage
from pbd.arm.scene import CollisionScene, Hit
from pbd.arm.sequence import solve_sequence
from pbd.arm.timing import Move, time_moves
from pbd.arm.ways import _Choice, choose_ways
from pbd.arm.wish import DEMO, LINE, STRAIGHT, Ways, Wish
from pbd.data import Obstacle
from pbd.errors import PbdWarning, PlanError
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of

ARM = arm_of("panda")
HOME = ARM.robot.home
T_HOME = ARM.forward(HOME)


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no way is free, not hundreds need be tried to know that here."""
    monkeypatch.setattr("pbd.arm.sequence.MOST_REFUSALS", 12)


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    """The tool as at home, shifted in base."""
    return Pose(T_HOME.p + np.array([x, y, z]), T_HOME.wxyz)


def ball(x: float, y: float, z: float, diameter: float = 0.04) -> Obstacle:
    return Obstacle("the ball", "sphere", (diameter,), Pose(T_HOME.p + np.array([x, y, z]), np.array([1.0, 0, 0, 0])))


def over(*corners: Pose) -> Sequence[Pose]:
    """A hand that went from corner to corner."""
    poses: list[Pose] = [corners[0]]
    for a, b in pairwise(corners):
        poses += line(a, b)[1:]
    return poses


def chosen(poses: Sequence[Pose], obstacles: Sequence[Obstacle] = (), **wish: object) -> tuple[Ways, CollisionScene]:
    scene = CollisionScene(ARM, None, obstacles)
    passage = Passage(ARM, scene, poses, [None] * len(poses))
    return choose_ways(ARM, Wish(poses, HOME, **wish), passage), scene  # type: ignore[arg-type]


def motion(ways: Ways, scene: CollisionScene, approach: bool = True) -> object:
    """What the whole motion touches."""
    moves = [Move(way.q, curved=way.kind != STRAIGHT) for way in ways.ways]
    back = None if ways.back is None else Move(ways.back)
    start = HOME if approach else ways.q[0]
    timed = time_moves(ARM, start, moves, [0.2] * len(moves), [None] * len(moves), retreat=back)
    return check_motion(scene, timed.trajectory)


LEFT, RIGHT = moved(y=-0.2, z=-0.1), moved(y=0.2, z=-0.1)


def test_where_nothing_is_in_the_way_all_is_straight() -> None:
    ways, scene = chosen((LEFT, RIGHT), q_back=HOME)
    assert [way.kind for way in ways.ways] == [STRAIGHT, STRAIGHT]
    assert motion(ways, scene) is None
    np.testing.assert_array_equal(ways.ways[1].q, ways.q[1:])
    assert ways.ways[1].off_line_m > 0.001
    assert ways.back is not None
    np.testing.assert_array_equal(ways.back[-1], HOME)


def middle(ways: Ways) -> Array:
    """Where the tool is in the middle of a straight move, less where it is at home."""
    return ARM.forward(0.5 * (ways.q[0] + ways.q[1])).p - T_HOME.p


def test_a_straight_move_that_is_barred_goes_as_the_hand_went() -> None:
    free, _ = chosen((LEFT, RIGHT))
    obstacle = ball(*middle(free))
    ways, scene = chosen(
        (LEFT, RIGHT), [obstacle], hand=lambda: [over(LEFT, moved(y=-0.2, z=0.15), moved(y=0.2, z=0.15), RIGHT)]
    )
    assert ways.ways[1].kind in (STRAIGHT, DEMO)
    assert motion(ways, scene) is None
    if ways.ways[1].kind == DEMO:
        assert ways.ways[1].avoided is not None
        assert ways.ways[1].avoided.second == "the ball"
        tool = np.array([ARM.forward(q).p for q in ways.ways[1].q])
        assert tool[:, 2].max() > T_HOME.p[2] + 0.14


def walled(gap: Array) -> list[Obstacle]:
    """A wall between left and right, so high that no straight move passes it however the arm is held."""
    return [Obstacle("the wall", "box", (0.3, 0.01, 0.3), Pose(T_HOME.p + gap, np.array([1.0, 0, 0, 0])))]


WALL = walled(np.array([0.1, 0.0, -0.05]))
OVER = over(LEFT, moved(y=-0.2, z=0.2), moved(y=0.2, z=0.2), RIGHT)


def test_over_a_wall_as_the_hand_went() -> None:
    ways, scene = chosen((LEFT, RIGHT), WALL, approach=False, hand=lambda: [OVER])
    assert ways.ways[1].kind == DEMO
    assert ways.ways[1].avoided is not None
    assert motion(ways, scene, approach=False) is None


def test_where_the_hand_itself_went_through_it_is_refused_with_what_came_closest() -> None:
    lower = over(LEFT, moved(y=-0.2, z=-0.12), moved(y=0.2, z=-0.12), RIGHT)
    with pytest.raises(PlanError) as caught:
        chosen((LEFT, RIGHT), WALL, approach=False, hand=lambda: [lower])
    message, fields = caught.value.message, caught.value.fields
    assert message.startswith("no collision-free motion from keyframe 0 to keyframe 1. Straight in joint space")
    assert ". Demonstrated path" in message
    assert " would touch the wall, " in message
    assert " deep" in message
    assert " (closest): " in message
    assert "\n" not in message
    assert fields["keyframe"] == 1
    assert fields["bodies"][1] == "the wall"  # type: ignore[index]
    assert fields["closest"] in (STRAIGHT, DEMO)
    assert 0.0 < float(str(fields["value"])) < 0.3


def test_without_a_hands_path_a_line_is_tried() -> None:
    with pytest.raises(PlanError, match=r"Straight in joint space.*: .*\. Straight line of the tool.*: "):
        chosen((LEFT, RIGHT), WALL, approach=False)


@pytest.mark.parametrize("kind", [LINE, DEMO])
def test_a_path_that_was_asked_for_isnt_replaced(kind: str) -> None:
    lower = over(LEFT, moved(y=-0.2, z=-0.12), moved(y=0.2, z=-0.12), RIGHT)
    with pytest.raises(PlanError, match=r"motion from keyframe 0 to keyframe 1\. .* would touch the wall"):
        chosen((LEFT, RIGHT), WALL, approach=False, kind=kind, hand=lambda: [lower])


def test_what_is_in_the_way_is_named_where_no_joints_lead_on_because_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the joints that suit the keyframes best the line doesn't lead on, from none that do is it free."""
    follow_one = _Choice._follow

    def broken(self: _Choice, i: int, q: Array) -> Array | None:
        return follow_one(self, i, q) if self.passage is None else None

    monkeypatch.setattr(_Choice, "_follow", broken)
    with pytest.raises(
        PlanError, match=r"keyframe 1\. .*Straight line of the tool.*: .* would touch the wall, "
    ) as caught:
        chosen((LEFT, RIGHT), WALL, approach=False, kind=LINE)
    assert caught.value.fields["bodies"][1] == "the wall"  # type: ignore[index]


def test_a_keyframe_in_the_wall_is_named() -> None:
    with pytest.raises(
        PlanError, match=r"^no collision-free arm pose at keyframe 1: .* would touch the ball, .* deep"
    ) as caught:
        chosen((LEFT, RIGHT), [ball(0.0, 0.2, -0.1, 0.1)])
    assert caught.value.fields["keyframe"] == 1


def test_lines_where_a_straight_move_leaves_them_too_far() -> None:
    free, _ = chosen((LEFT, RIGHT, moved(y=0.21, z=-0.1)))
    off = [way.off_line_m for way in free.ways]
    assert off[1] > 0.01 > off[2]
    ways, _ = chosen((LEFT, RIGHT, moved(y=0.21, z=-0.1)), tolerance_m=0.01)
    assert [way.kind for way in ways.ways] == [STRAIGHT, LINE, STRAIGHT]
    tool = np.array([ARM.forward(q).p for q in ways.ways[1].q])
    np.testing.assert_allclose(tool[:, [0, 2]], np.tile(LEFT.p[[0, 2]], (len(tool), 1)), atol=1e-7)


def test_where_the_last_keyframe_has_no_free_way_back_the_motion_ends_there() -> None:
    """Something stands at home: that bars the way back and nothing else."""
    poses, between = (moved(y=0.3, z=-0.1), moved(y=0.35, z=-0.1)), [ball(0.0, 0.0, 0.0, 0.12)]
    with pytest.warns(PbdWarning, match=r"no collision-free way back from the last keyframe was found .*the ball"):
        ways, _ = chosen(poses, between, q_back=HOME, approach=False)
    assert ways.back is None
    assert len(ways.ways) == 2


def test_the_approach_comes_along_the_tools_axis_where_it_can_not_come_straight() -> None:
    """A post beside the first keyframe: straight the arm would sweep through it, from above it passes."""
    free, _ = chosen((moved(y=-0.25, z=-0.25), moved(y=-0.25, z=-0.2)))
    tool = [ARM.forward(HOME + share * (free.q[0] - HOME)).p - T_HOME.p for share in (0.9, 0.85, 0.8)]
    post = Obstacle(
        "the post", "box", (0.02, 0.02, 0.02), Pose(T_HOME.p + tool[0] + (0, 0, -0.025), np.array([1.0, 0, 0, 0]))
    )
    ways, scene = chosen((moved(y=-0.25, z=-0.25), moved(y=-0.25, z=-0.2)), [post])
    assert motion(ways, scene) is None
    if len(ways.ways[0].q) == 2:
        before, at = (ARM.forward(q) for q in ways.ways[0].q)
        back = at.inverse().act(before.p)
        np.testing.assert_allclose(back[:2], 0.0, atol=1e-7)
        assert back[2] < -0.07


def test_an_approach_that_is_barred_is_refused() -> None:
    cage = [
        Obstacle(
            "the plate", "box", (0.6, 0.6, 0.01), Pose(T_HOME.p + np.array([0, 0, -0.15]), np.array([1.0, 0, 0, 0]))
        )
    ]
    with pytest.raises(PlanError, match=r"^no collision-free (motion to|arm pose at) keyframe 0[.:] ") as caught:
        chosen((moved(z=-0.2), moved(z=-0.25)), cage)
    assert caught.value.fields["keyframe"] == 0


def test_a_path_that_the_arm_can_not_follow_is_told() -> None:
    """Through the arm's own base, where no tool can be."""
    ur5 = arm_of("ur5")
    home = ur5.forward(ur5.robot.home)
    there = Pose(home.p * (-1.0, -1.0, 1.0), home.wxyz)
    with pytest.raises(
        PlanError, match=r"the arm can't follow the straight line from keyframe 0 to keyframe 1: "
    ) as caught:
        choose_ways(ur5, Wish((home, there), ur5.robot.home, kind=LINE), None)
    assert caught.value.fields["keyframe"] == 1


def test_joints_are_sought_anew_where_those_of_the_keyframes_do_not_lead_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The keyframes' own joints are of different ways to hold the arm: the line between is followed all the same."""
    solve, asked, ur5 = solve_sequence, list[int](), arm_of("ur5")
    home = ur5.forward(ur5.robot.home)
    ends = [Pose(home.p + np.array([0.0, y, -0.1]), home.wxyz) for y in (-0.1, 0.1)]
    others = solutions(ur5, ends[1], ur5.robot.home[None], 80)

    def mixed(arm: object, poses: Sequence[Pose], q_start: Array, **more: object) -> Array:
        q = solve(ur5, poses, q_start, **more)  # type: ignore[arg-type]
        asked.append(len(poses))
        if len(asked) == 1:
            q[1] = max(others, key=lambda other: float(np.abs(other - q[1]).max()))
        return q

    monkeypatch.setattr("pbd.arm.ways.solve_sequence", mixed)
    ways = choose_ways(ur5, Wish(ends, ur5.robot.home, kind=LINE), None)
    assert len(asked) == 2
    assert asked[1] > 10
    assert np.abs(np.diff(ways.ways[1].q, axis=0)).max() < 0.2
    np.testing.assert_allclose(ur5.forward(ways.q[1]).p, ends[1].p, atol=1e-5)


def test_joints_are_sought_anew_where_the_path_touches_something_from_those(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the joints that suit the keyframes best a link would touch something on the line; from others it doesn't."""
    hit_along, asked = Passage.hit_along, list[int]()

    def once(self: Passage, i: int, q: Array) -> object:
        asked.append(i)
        post = Hit("panda_link5", "the post", -0.01, np.zeros(3))
        return post if len(asked) == 1 else hit_along(self, i, q)

    monkeypatch.setattr(Passage, "hit_along", once)
    ways, scene = chosen((LEFT, RIGHT), kind=LINE)
    assert asked == [1, 1]
    assert ways.ways[1].kind == LINE
    assert motion(ways, scene) is None
    monkeypatch.setattr(Passage, "hit_along", lambda self, i, q: Hit("panda_link5", "the post", -0.01, np.zeros(3)))
    with pytest.raises(PlanError, match=r"Straight line of the tool: panda_link5 would touch the post, 1.0 cm deep; "):
        chosen((LEFT, RIGHT), kind=LINE)
