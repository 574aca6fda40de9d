"""Which faults each rule of repair and alarm survives: python tests/benchmarks/repair_ablation.py [--only WORD].

One rule at a time is taken out, and a sixth of the fault matrix is run again (tests/tracking/fault_matrix.py; what no
sensor can tell is left out). A rule earns its place where, without it, more cases end silently wrong, fewer are right,
or wrong ones are warned of that were refused.
"""

import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd import track_recording
from pbd.cli.console import print_json
from pbd.data import Recording, Stop
from pbd.tracking import estimate, first_rest, residual_tests
from pbd.tracking.repair import channel_faults, gaps, gyro_consistency, repair_recording
from pbd.tracking.repair.saturation import declip
from pbd.tracking.smoother import factors, large_errors, smooth
from tests.benchmarks.ablation import LARGE, TINY, Change, changed
from tests.benchmarks.faults import NICE
from tests.benchmarks.report import arguments, print_machine
from tests.tracking.fault_matrix import SILENT_WRONG, Case, cases, outcome


def nothing(*_: Any, **_options: Any) -> None:
    """Look at nothing, and refuse nothing."""


def no_line(*_: Any) -> Iterator[str]:
    """Warn of nothing."""
    return iter(())


def as_it_is(recording: Any, *_: Any) -> Any:
    """Repair nothing."""
    return recording


def in_a_stop(_: Recording, gap: gaps.Gap, stops: Sequence[Stop]) -> bool:
    """Whether a gap is in a stop, however the sensor moves beside the gap."""
    return any(stop.start <= gap.before and gap.after < stop.stop for stop in stops)


WITHOUT: dict[str, tuple[Change, ...]] = {
    "nothing": (),
    "stuck axes": ((channel_faults, "stuck_axes", no_line),),
    "wild samples": ((repair_recording, "without_wild", as_it_is),),
    "blocks in order": ((repair_recording, "in_order", as_it_is),),
    "blocks doubled": ((repair_recording, "refuse_doubled", nothing),),
    "freezes": ((repair_recording, "frozen_rows", lambda recording, _: np.zeros(len(recording), dtype=bool)),),
    "gaps refused": ((track_recording, "refuse_gaps", nothing),),
    "rest beside a gap": ((gaps, "is_in_rest", in_a_stop),),
    "signs by the device": ((gyro_consistency, "refuse_flipped_signs", nothing),),
    "axes and unit of the gyro": ((gyro_consistency, "find_axis_error", nothing),),
    "unit of the accelerometer": ((first_rest, "_refuse_wrong_units", nothing),),
    "clipped peaks": ((track_recording, "find_clips", lambda _: ()),),
    "doubt of clipped peaks": ((track_recording, "declip", lambda *clipped: (declip(*clipped)[0], ())),),
    "gravity at rest widens priors": tuple(
        (module, "acc_sigma_factor", lambda *_: 1.0) for module in (factors, estimate)
    ),
    "rest that is no stop": ((track_recording, "refuse_doubted_rest", nothing),),
    "what is no stop, left out": ((smooth, "stop_weights", lambda problem, _: np.ones(len(problem.stops))),),
    "a large lag": ((large_errors, "REMOVED_LAG", LARGE),),
    "a common scale": ((smooth, "WIDE_SCALE_SIGMA", TINY),),
    "upside down": ((track_recording, "warn_upside_down", nothing),),
    "open ends": ((track_recording, "_warn_of_open_ends", nothing),),
    "alarm: sensor": ((residual_tests, "_sensor_alarms", no_line),),
    "alarm: moves": ((residual_tests, "_move_alarms", no_line),),
    "alarm: stops": ((residual_tests, "_stop_alarms", no_line),),
    "alarm: field": ((residual_tests, "_field_alarms", no_line),),
}
"""Rule taken out -> what is put in its place."""


def verdict(job: tuple[str, Case]) -> str:
    """What becomes of a case without a rule."""
    rule, case = job
    with changed(WITHOUT[rule]):
        return outcome(case).verdict


def main() -> None:
    """Run the matrix with each rule taken out, and print a row for each."""
    parser = arguments(str(__doc__))
    parser.add_argument("--only", default="", help="rules whose name has this in it")
    args = parser.parse_args()
    matrix = [case for case in cases(2) if case.untellable is None][:: 48 if args.quick else 6]
    rules = [rule for rule in WITHOUT if args.only in rule or rule == "nothing"]
    rows: dict[str, dict[str, int]] = {}
    before: list[str] = []
    if not args.json:
        print_machine()
        print("| taken out | silently wrong | warned of, wrong | right | refused | silently wrong without it |")
        print("|---|---|---|---|---|---|")
    with ProcessPoolExecutor(initializer=os.nice, initargs=(NICE,)) as pool:
        for rule in rules:
            found = list(pool.map(verdict, [(rule, case) for case in matrix], chunksize=16))
            rows[rule] = row_of(found)
            before = before or found
            new = Counter(
                case.fault.name
                for case, was, now in zip(matrix, before, found, strict=True)
                if now == SILENT_WRONG != was
            )
            if not args.json:
                named = ", ".join(f"{name} ({count})" for name, count in new.most_common(4))
                print(f"| {rule} | " + " | ".join(map(str, rows[rule].values())) + f" | {named} |", flush=True)
    if args.json:
        print_json(rows)


def row_of(verdicts: list[str]) -> dict[str, int]:
    """How many cases came to what."""
    found = Counter(verdicts)
    right = found["warned_right"] + found["silent_right"]
    return {
        "silent_wrong": found[SILENT_WRONG],
        "warned_wrong": found["warned_wrong"],
        "right": right,
        "refused": found["refused"],
    }


if __name__ == "__main__":
    main()
