"""What the bundled demonstrations become on each bundled arm, as it was when bundled_plans.txt was written.

To write that file anew, once a change of it is meant: python -m tests.test_bundled_plans > tests/bundled_plans.txt
"""

import contextlib
import io
import json
import re
from pathlib import Path
from typing import NamedTuple

import pytest

from pbd.cli import main
from tests.arm.bundled import DEMOS, NAMES

FILE = Path(__file__).with_name("bundled_plans.txt")
HEADER = "# demonstration, arm, result; duration s, pose error um and urad, off degrees: approach axis and about it"


class Outcome(NamedTuple):
    """What `pbd replay` says.

    Attributes:
        result: "planned" without a warning, or the exit code and the reason without its numbers.
        figures: duration (s); largest error of position (um) and of rotation (urad); off_deg. None where it is refused.
    """

    result: str
    figures: tuple[float, ...]


def outcome(demo: str, robot: str) -> Outcome:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(["replay", demo, "--robot", robot, "--json"])
    if code:
        reason = err.getvalue().strip().splitlines()[-1]
        return Outcome(f"{code} {re.sub(r'[0-9.]+', '#', reason)}", ())
    # Nothing is left out and the dock isn't tilted; that the paper's roll clips the gyro is the recording's.
    warned = [line for line in err.getvalue().splitlines() if "warning: " in line and "end of the range" not in line]
    if warned:
        return Outcome(f"planned, {warned}", ())
    said = json.loads(out.getvalue())
    ik = said["ik"]
    errors = 1e6 * ik["max_position_error_m"], 1e6 * ik["max_rotation_error_rad"]
    return Outcome("planned", (said["duration_s"], *errors, *said["off_deg"]))


def written() -> dict[tuple[str, str], Outcome]:
    found = {}
    for line in FILE.read_text(encoding="utf-8").splitlines()[1:]:
        what, _, figures = line.partition(";")
        demo, robot, result = what.split(maxsplit=2)
        found[demo, robot] = Outcome(result, tuple(map(float, figures.split())))
    return found


WRITTEN = written() if FILE.is_file() else {}


@pytest.mark.usefixtures("cached_results", "unadvised")
@pytest.mark.parametrize("robot", NAMES)
@pytest.mark.parametrize("demo", DEMOS)
def test_a_bundled_plan_is_as_it_was(demo: str, robot: str) -> None:
    assert (demo, robot) in WRITTEN, "write the file anew, as the top of this one says"
    found, before = outcome(demo, robot), WRITTEN[demo, robot]
    assert found.result == before.result
    assert found.figures[:1] == pytest.approx(before.figures[:1], rel=0.01)
    assert all(now < 1.1 * then + 0.5 for now, then in zip(found.figures[1:3], before.figures[1:3], strict=True))
    assert found.figures[3:] == pytest.approx(before.figures[3:], abs=0.05)


if __name__ == "__main__":
    print(HEADER)
    for demo in DEMOS:
        for robot in NAMES:
            result, figures = outcome(demo, robot)
            print(f"{demo} {robot} {result};", *(f"{figure:.3f}" for figure in figures))
