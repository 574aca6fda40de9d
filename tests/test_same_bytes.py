"""Results do not depend on what a process computed before."""

from pathlib import Path

import pytest

from pbd.arm.ik.solver import solve
from pbd.arm.model import load_model
from pbd.cli import main
from tests.arm.bundled import NAMES, arm_of
from tests.arm.conftest import random_joints


def exported(demo: str, robot: str, folder: Path) -> bytes:
    place = folder / f"{len(list(folder.iterdir()))}.csv"
    assert main(["export", demo, "--robot", robot, "-o", str(place)]) == 0
    return place.read_bytes()


def test_a_plan_has_the_same_bytes_whatever_was_planned_and_solved_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two plans in either order, then again after poses of more arms than the sixteen that a cache holds."""
    asked = ("paper-test2", "panda"), ("paper-test2", "so101")
    first = [exported(*each, tmp_path) for each in asked]
    assert [exported(*each, tmp_path) for each in reversed(asked)] == first[::-1]
    for name in 2 * NAMES:
        arm = load_model(arm_of(name).robot)
        solve(arm, arm.forward(random_joints(arm.robot, 1, seed=1)[0]))
    assert [exported(*each, tmp_path) for each in asked] == first
