"""All contacts of a motion, compared with a search through its samples."""

from itertools import pairwise
from weakref import ref

import numpy as np
import pytest

from pbd.arm.collision.motion_check import all_hits, object_phases_of
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel
from pbd.data import GraspedObject, JointTrajectory
from pbd.planning.result import find_touching
from pbd.pose import Array
from tests.arm.collision.past_a_board import BOTTLE, GRIPS, PLACES, board, through


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
