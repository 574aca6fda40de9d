"""The fault matrix: python tests/benchmarks/faults.py [--json] [--quick] [--seeds N] [--only WORD] [--wrong].

Each damage (tests/tracking/damage.py) befalls simulated demonstrations whose truth is known: 4 tasks, 3 sensors, some
seeds. A case is refused, warned and right, warned and wrong, silent and right, or silent and wrong. Wrong is a keyframe
off by over 2 cm and over 3 of its own sigmas, or by over 6 degrees and 3 sigmas, or a rest without a right stop.
What no inertial sensor can tell is counted apart (`untellable`), with the reason. `lag`: 40 tipping tasks for each
delay of the gyro, low-pass of the accelerometer and rate of polling. `sound`: recordings without damage, and how many
are suspected of a move that fits no motion, of a wrong sensor, of a rest that hardly fits, or of packets out of order.
"""

import os
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.benchmarks.report import arguments, finish
from tests.tracking.fault_matrix import (
    SENSORS,
    SILENT_WRONG,
    SOUND_TASKS,
    VERDICTS,
    Case,
    Outcome,
    cases,
    lags,
    named,
    outcome,
)

LAG_CASES, SOUND_SEEDS = 40, range(100, 125)
NICE = 10

SUSPICIONS = {
    "moves": "no motion between the stops fits",
    "sensor": "far more than such a sensor should",
    "rests": "this hardly fits",
    "order": "packets are sent out of order",
}
"""What an alarm says, by what it suspects."""


def main() -> None:
    """Spoil, track, count, print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--seeds", type=int, default=2, help="demonstrations of each task and sensor")
    parser.add_argument("--only", default="", help="faults whose name holds this word")
    parser.add_argument("--wrong", action="store_true", help="name each case that is silently wrong, on stderr")
    args = parser.parse_args()
    matrix = [case for case in cases(args.seeds) if args.only in case.name or case.fault.name == "clean"]
    lagging = [
        Case(fault, "tipping", SENSORS[seed % 3], seed)
        for fault in lags()
        for seed in range(LAG_CASES)
        if args.only in f"{fault.name} {fault.variant}"
    ]
    sound = [
        Case(named("clean", ""), task, sensor, seed)
        for seed in SOUND_SEEDS
        for task in SOUND_TASKS
        for sensor in SENSORS
    ]
    if args.quick:
        rng = np.random.default_rng(0)
        matrix = [matrix[i] for i in np.sort(rng.choice(len(matrix), min(300, len(matrix)), replace=False))]
        lagging, sound = lagging[::8], sound[::8]
    outcomes, unspoilt = run([*matrix, *lagging]), run(sound)
    if args.wrong:
        for case, found in zip([*matrix, *lagging], outcomes, strict=True):
            if found.verdict == SILENT_WRONG:
                print(
                    f"{'untellable' if case.untellable else 'tellable'}: {case.name}: {100 * found.error_m:.1f} cm, "
                    f"{np.degrees(found.error_rad):.1f} deg, {found.lost} rests lost",
                    file=sys.stderr,
                )
    suspected = {what: sum(line in each.said for each in unspoilt) for what, line in SUSPICIONS.items()}
    counted = figures(matrix, outcomes[: len(matrix)], lagging, outcomes[len(matrix) :])
    finish({**counted, "sound": {"recordings": len(sound), **suspected}}, args.json)


@dataclass(frozen=True)
class Crash:
    """Anything but a PbdError came of a case: a bug."""

    text: str


def run(matrix: Sequence[Case]) -> list[Outcome]:
    """All cases, on all cores; a bug ends it, with the names of all cases that have one."""
    with ProcessPoolExecutor(initializer=os.nice, initargs=(NICE,)) as pool:
        found = list(pool.map(_attempt, matrix, chunksize=8))
    crashes = [one.text for one in found if isinstance(one, Crash)]
    if crashes:
        sys.exit("\n".join(["tracking fails otherwise than by a PbdError:", *crashes]))
    return [one for one in found if isinstance(one, Outcome)]


def _attempt(case: Case) -> Outcome | Crash:
    try:
        return outcome(case)
    except RuntimeError as bug:
        return Crash(str(bug))


def figures(
    matrix: Sequence[Case], outcomes: Sequence[Outcome], lagging: Sequence[Case], late: Sequence[Outcome]
) -> dict[str, Any]:
    told: list[str] = []
    by_fault: dict[str, list[str]] = defaultdict(list)
    untellable: dict[str, list[str]] = defaultdict(list)
    for case, found in zip(matrix, outcomes, strict=True):
        if case.untellable:
            untellable[f"{case.fault.name} {case.fault.variant}: {case.untellable}"].append(found.verdict)
        else:
            by_fault[case.fault.name].append(found.verdict)
            told.append(found.verdict)
    return {
        "cases": len(told),
        **counts(told),
        "by_fault": {name: counts(verdicts) for name, verdicts in sorted(by_fault.items())},
        "untellable": {name: counts(verdicts) for name, verdicts in sorted(untellable.items())},
        "lag": lag_figures(lagging, late),
    }


def counts(verdicts: Sequence[str]) -> dict[str, int]:
    found = Counter(verdicts)
    return {verdict: found[verdict] for verdict in VERDICTS}


def lag_figures(lagging: Sequence[Case], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    rows: dict[str, list[Outcome]] = defaultdict(list)
    for case, found in zip(lagging, outcomes, strict=True):
        delay = case.fault.name == "lag"
        rows[case.fault.variant.removesuffix(" ms") if delay else f"{case.fault.name} {case.fault.variant}"].append(
            found
        )
    return {
        name: {
            "median_cm": 100.0 * float(np.median([one.error_m for one in found])),
            "silent_wrong": sum(one.verdict == SILENT_WRONG for one in found),
            "rests_lost": sum(one.lost for one in found),
            "refused": sum(one.verdict == "refused" for one in found),
        }
        for name, found in rows.items()
    }


if __name__ == "__main__":
    main()
