"""What each part of the choice of a motion gains: python tests/benchmarks/motion_ablation.py [--quick] [--only WORD].

One part at a time is taken out. Two sets of problems:

- scenes: the random scenes of scenes.py, with and without detours;
- plans: tracked hands (ten random tasks and the bundled demonstrations) at docks that are moved and turned at random,
  on all bundled arms, among up to four balls, with all kinds of path. Many of these can't be planned at all.

The columns: how many are solved; lost and gained against the first row; how long the motions are (joint travel in the
scenes, time in the plans) on what both solve, as a share, and the worst; seconds of process time.
"""

import sys
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm import choose_motion as choice
from pbd.arm import ladder_building, ladder_checks, ladder_mending
from pbd.arm.choose_motion import choose_motion
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.motion_request import Motion, MotionRequest
from pbd.cli.console import print_json
from pbd.data import HandPath, Obstacle
from pbd.errors import PbdError
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.planning import PlanOptions, plan_path
from pbd.pose import Pose, quat_from_rpy, quat_multiply
from pbd.simulation.simulate import random_task, simulate
from tests.arm.bundled import DEMOS, NAMES, arm_of
from tests.benchmarks import scenes
from tests.benchmarks.ablation import Change, changed
from tests.benchmarks.report import arguments, print_machine

SCENES, PLANS, FEWER = 8, 360, 7
"""Scenes of each kind for each arm; plans; `--quick` tries one in FEWER."""

PATHS = PlanOptions(), PlanOptions(tolerance_m=0.01), PlanOptions(path="line"), PlanOptions(path="demo")


def nothing(value: object) -> Callable[..., object]:
    """A function that does nothing, and returns this."""
    return lambda *_: value


def lines_for_tolerance(search: choice._Search, path: Sequence[int]) -> bool:
    """Replace no straight move for being wide, as without a tolerance."""
    return search.request.tolerance_m is not None and make_lines(search, path)


make_lines = choice._Search._make_lines

WITHOUT: dict[str, tuple[Change, ...]] = {
    "nothing": (),
    "more configurations at both ends": ((ladder_mending.Mending, "_widen", nothing(None)),),
    "via points on the tool's axis": ((ladder_checks.LinkChecks, "_via_point_on_axis", nothing(None)),),
    "layers along a path": ((ladder_mending.Mending, "_split", nothing(False)),),
    "paths before it, too": ((ladder_mending, "LOOK_BACK", 0),),
    "a line where a straight move is wide": ((choice._Search, "_make_lines", lines_for_tolerance),),
    "variants by whole turns": ((ladder_building, "VARIANTS", 1),),
    "unwinding": ((choice._Search, "_unwind", nothing(False)),),
    "wide moves cost more": ((ladder_checks, "WIDE_COST", 0.0),),
    "motion along the null space": ((ladder_building, "_move_along_null_space", nothing(None)),),
    "a smaller margin": ((CollisionScene, "closer", lambda scene: scene),),
    "detours from any to any": ((ladder_checks, "FROM_ANY_TO_ANY", ()),),
    "more than two such searches": ((ladder_checks, "FROM_ANY_TO_ANY", ladder_checks.FROM_ANY_TO_ANY[:2]),),
}
"""Part taken out -> what is put in its place."""


class Tried(NamedTuple):
    """Lengths of the motions, rad or s (None: refused), and the process time, s."""

    lengths: list[float | None]
    took_s: float


def tried(problems: Iterable[Callable[[], float | None]]) -> Tried:
    """Solve all problems."""
    start = time.process_time()
    return Tried([solve() for solve in problems], time.process_time() - start)


def travel(name: str, kind: str, seed: int, detour: bool) -> float | None:
    """Joint travel, rad, of a motion in one of the scenes of scenes.py."""
    arm, obstacles, poses = scenes.made(name, kind, seed)
    request = MotionRequest(poses, arm.robot.home, q_retreat=arm.robot.home, detour=detour)
    found = choose_motion(arm, request, CollisionScene(arm, None, obstacles))
    return scenes.travel(found) if isinstance(found, Motion) else None


def duration(paths: Sequence[HandPath], seed: int) -> float | None:
    """Duration, s, of a plan of one of the tracked hands."""
    robot, rng = arm_of(NAMES[seed % len(NAMES)]).robot, np.random.default_rng(seed)
    options = replace(PATHS[seed // len(NAMES) % len(PATHS)], scale=float(rng.choice([0.5, 1.0])))
    path = paths[int(rng.integers(len(paths)))]
    assert robot.dock is not None
    assert robot.dock.T_base_dock is not None
    at, turn = robot.dock.T_base_dock, quat_from_rpy((0.0, 0.0, rng.uniform(-0.8, 0.8)))
    moved = Pose(at.p + rng.uniform(-0.12, 0.12, 3) * (1.0, 1.0, 0.5), quat_multiply(turn, at.wxyz))
    balls = tuple(
        Obstacle(f"ball {i}", "sphere", (rng.uniform(0.04, 0.14),), replace(at, p=at.p + rng.uniform(-0.3, 0.3, 3)))
        for i in range(rng.integers(0, 5))
    )
    try:
        plan = plan_path(path, replace(robot.dock, T_base_dock=moved, obstacles=balls), robot, options)
    except PbdError:
        return None
    return plan.trajectory.duration


def compared(before: Tried, now: Tried) -> dict[str, float]:
    """A row's figures."""
    pairs = list(zip(before.lengths, now.lengths, strict=True))
    both = np.array([(old, new) for old, new in pairs if old is not None and new is not None]).reshape(-1, 2)
    return {
        "solved": sum(new is not None for _, new in pairs),
        "lost": sum(old is not None and new is None for old, new in pairs),
        "gained": sum(old is None and new is not None for old, new in pairs),
        "length": float(both[:, 1].sum() / both[:, 0].sum()),
        "worst": float((both[:, 1] / both[:, 0]).max()),
        "seconds": now.took_s,
    }


def main() -> None:
    """Solve all problems without each part, and print a row for each."""
    parser = arguments(str(__doc__))
    parser.add_argument("--only", default="", help="parts whose name has this in it")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    recordings = [simulate(random_task(seed), "modern", seed).recording for seed in range(10)]
    paths = [track(recording) for recording in (*recordings, *(load_demo(name).recording for name in DEMOS))]
    every = FEWER if args.quick else 1
    keys = [*product(scenes.ARMS, scenes.KINDS, range(SCENES), (True, False))][::every]
    in_scenes = [partial(travel, *key) for key in keys]
    of_hands = [partial(duration, paths, seed) for seed in range(0, PLANS, every)]
    before: tuple[Tried, ...] = ()
    rows: dict[str, Any] = {}
    for part in WITHOUT:
        if part != "nothing" and args.only not in part:
            continue
        with changed(WITHOUT[part]):
            found = tried(in_scenes), tried(of_hands)
        before = before or found
        rows[part] = {name: compared(*each) for name, *each in zip(("scenes", "plans"), before, found, strict=True)}
    if args.json:
        print_json(rows)
        return
    print_machine()
    columns = ("solved (lost, gained)", "length", "worst", "s")
    print(f"| taken out | {' | '.join(f'{of}: {column}' for of in ('scenes', 'plans') for column in columns)} |")
    print("|---" * (1 + 2 * len(columns)) + "|")
    for part, row in rows.items():
        figures = [
            f"{each['solved']} ({each['lost']}, {each['gained']}) | {each['length']:.3f} | {each['worst']:.2f} | "
            f"{each['seconds']:.0f}"
            for each in row.values()
        ]
        print(f"| {part} | {' | '.join(figures)} |")


if __name__ == "__main__":
    main()
