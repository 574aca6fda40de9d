"""When a grasped object is held, and where it is."""

import numpy as np
import pytest

from pbd.data import GraspedObject
from pbd.data.world import gripped_spans, object_phases
from pbd.pose import Pose, quat_rotate

BOTTLE = GraspedObject("cylinder", (0.06, 0.2))


def tool(t: float) -> Pose:
    """A tool that points down and moves along x at 0.1 m/s, 10 cm above the table, while it rolls slowly."""
    return Pose.from_rpy(np.array([0.1 * min(t, 10.0), 0.0, 0.1]), (np.pi + 0.05 * min(t, 10.0), 0.0, 0.0))


@pytest.mark.parametrize(
    ("t", "opening", "spans"),
    [
        ([0, 2, 3, 6, 7], [1, 1, 0.3, 0.3, 1], [(3, 6)]),
        ([0, 2, 2.5, 3, 6, 7, 8, 9], [1, 1, 0.6, 0.3, 0.3, 1, 1, 0.5], [(3, 6), (9, np.inf)]),
        ([0, 4, 5], [0.2, 0.2, 1], [(0, 4)]),
        ([0, 4], [1, 1], []),
    ],
)
def test_it_is_held_from_the_end_of_closing_to_the_start_of_opening(
    t: list[float], opening: list[float], spans: list[tuple[float, float]]
) -> None:
    assert gripped_spans(np.array(t), np.array(opening)) == spans


def test_it_stands_then_goes_with_the_tool_then_stands() -> None:
    before, held, after = object_phases(BOTTLE, [(3.0, 6.0)], tool, 0.0)
    assert [(each.start, each.end, each.held) for each in (before, held, after)] == [
        (-np.inf, 3.0, False),
        (3.0, 6.0, True),
        (6.0, np.inf, False),
    ]
    np.testing.assert_allclose(before.pose.p, [0.3, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(quat_rotate(before.pose.wxyz, (0, 0, 1)), [0, 0, 1], atol=1e-12)  # upright
    assert max((tool(3.0) @ held.pose).distance(before.pose)) < 1e-7
    assert max((tool(6.0) @ held.pose).distance(after.pose)) < 1e-7


def test_it_does_not_reach_into_the_table() -> None:
    assert object_phases(BOTTLE, [(3.0, 6.0)], tool, 0.04)[0].pose.p[2] == pytest.approx(0.04 + 0.1)


def test_a_gripper_that_closes_elsewhere_takes_nothing() -> None:
    once, again = (object_phases(BOTTLE, spans, tool, None) for spans in ([(3.0, 4.0)], [(3.0, 4.0), (8.0, np.inf)]))
    assert [each.end for each in once] == [each.end for each in again]
