"""What comes of each damage of the fault matrix, as it was when the files beside this one were written.

tests/benchmarks/faults.py has all cases; here each damage is drawn once. To write a file NAME.txt anew, once a change
of it is meant: python -m tests.tracking.test_faults NAME > tests/tracking/NAME.txt
"""

import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.data import Demonstration
from pbd.errors import PbdError
from pbd.tracking.online.events import DataFlaw, StopBegan, StopEnded
from pbd.tracking.online.tracker import LiveTracker
from tests.tracking import damage
from tests.tracking.fault_matrix import (
    FIRST_SEED,
    REFUSED,
    SENSORS,
    SILENT_RIGHT,
    SILENT_WRONG,
    TASKS,
    Case,
    Fault,
    Outcome,
    cases,
    faults,
    last_of,
    outcome,
)

HEADER = """\
# case: verdict; number of stops; of the last keyframe: position mm, turn since the first deg, and the sigma of each
# what is said of it, without its numbers"""

WITHIN_SIGMAS = 0.005
"""Most that a figure may differ, as a share of its sigma: no two machines round alike."""

MOST_SILENT = 2
"""Most cases that may be silently wrong: under 1 % of all."""

LEAST_RIGHT = 46
"""Least cases that are right without a warning, a fifth of all: else too much is refused."""

UNITS = np.tile(np.repeat((1e3, np.degrees(1.0)), 3), 2)
"""mm and deg in an `Outcome.last`."""


def drawn() -> list[Case]:
    """Each damage once, with a task, a sensor and a seed of chance."""
    draw, found = np.random.default_rng(14), []
    for fault in faults():
        task, sensor = str(draw.choice(TASKS)), str(draw.choice(SENSORS))
        has_north = fault.name in ("magnet", "hard iron")
        found.append(Case(fault, task, sensor, FIRST_SEED + (0 if has_north else int(draw.integers(2)))))
    return found


CASES = drawn()
KINDS = {case.fault.name: case for case in reversed(CASES)}
"""The first case of each kind, which the live tracker is tried on."""


def live(case: Case) -> Outcome:
    """Feed the live tracker with a case."""
    recording = case.demonstration().recording
    try:
        events = LiveTracker(recording.info.sensor).feed(
            recording.t, recording.acc, recording.gyr, recording.mag, recording.device_rpy
        )
    except PbdError as refusal:
        return Outcome(REFUSED, said=refusal.message)
    said = "; ".join(dict.fromkeys(without_numbers(event.message) for event in events if isinstance(event, DataFlaw)))
    keyframes = [event.keyframe for event in events if isinstance(event, StopBegan | StopEnded)]
    if not keyframes:
        return Outcome("waits", said=said)
    stops = sum(isinstance(event, StopBegan) for event in events)
    return Outcome(
        "tracked",
        said=said,
        stops=stops,
        last=last_of(keyframes[0].T_nav_sensor, keyframes[-1].T_nav_sensor, keyframes[-1].cov),
    )


def without_numbers(said: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "#", said)


def written(case: Case, found: Outcome) -> str:
    """A case as two lines of a file."""
    figures = " ".join(f"{figure:.3f}" for figure in UNITS[: len(found.last)] * found.last)
    return f"{case.name}: {found.verdict}; {found.stops}; {figures}\n{without_numbers(found.said)}"


def read(file: Path) -> dict[str, tuple[str, str, str, str]]:
    """A file: {case: (verdict, stops, figures, what is said)}."""
    lines = file.read_text(encoding="utf-8").splitlines()[HEADER.count("\n") + 1 :]
    found = {}
    for figures, said in zip(lines[::2], lines[1::2], strict=True):
        name, _, rest = figures.partition(": ")
        verdict, stops, numbers = rest.split("; ")
        found[name] = verdict, stops, numbers, said
    return found


def without(channel: str) -> damage.Damage:
    def drop(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        channels: dict[str, Any] = {channel: None}
        return replace(demo, recording=replace(demo.recording, **channels))

    return drop


def sound(channel: str, sensors: Sequence[str], *tasks: str) -> list[Case]:
    """Tasks without damage, by sensors without a channel."""
    fault = Fault("no", channel, without(channel))
    return [Case(fault, task, sensor, FIRST_SEED) for task in tasks for sensor in sensors]


RUNS: dict[str, tuple[list[Case], Callable[[Case], Outcome]]] = {
    "faults": (CASES, outcome),
    "live_faults": (list(KINDS.values()), live),
    "no_gyro": (sound("gyr", ("os5000", "wt901"), "pour", "pick-and-place-stops"), outcome),
    "paper": (
        [case for channel in ("mag", "device_rpy") for case in sound(channel, SENSORS, "pick-and-place-stops")],
        partial(outcome, method="paper"),
    ),
}
"""Name of the file: its cases, and what is done with them."""

WRITTEN = {name: read(file) for name in RUNS if (file := Path(__file__).with_name(f"{name}.txt")).is_file()}


def assert_as_before(case: Case, found: Outcome, before: tuple[str, str, str, str]) -> None:
    verdict, stops, numbers, said = before
    assert (found.verdict, str(found.stops), without_numbers(found.said)) == (verdict, stops, said), case.name
    if found.last:
        figures = np.array(numbers.split(), dtype=float)
        allowed = WITHIN_SIGMAS * np.tile(figures[6:], 2) + 0.001  # a digit more is not written
        assert (np.abs(UNITS * found.last - figures) < allowed).all(), case.name


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_what_comes_of_a_damage_is_as_it_was(kind: str) -> None:
    for case in CASES:
        if case.fault.name == kind:
            assert_as_before(case, outcome(case), WRITTEN["faults"][case.name])


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_what_comes_of_it_live_is_as_it_was(kind: str) -> None:
    case = KINDS[kind]
    assert_as_before(case, live(case), WRITTEN["live_faults"][case.name])


@pytest.mark.parametrize("name", ["no_gyro", "paper"])
def test_without_a_gyro_and_by_the_papers_method_it_finds_what_it_found(name: str) -> None:
    cases, tracked = RUNS[name]
    for case in cases:
        assert_as_before(case, tracked(case), WRITTEN[name][case.name])


def test_damage_is_refused_or_told_or_does_no_harm() -> None:
    found = Counter(WRITTEN["faults"][case.name][0] for case in CASES if not case.untellable)
    assert found[SILENT_WRONG] <= MOST_SILENT
    assert found[SILENT_RIGHT] >= LEAST_RIGHT
    assert found[REFUSED] < found.total() // 2


def test_nothing_is_said_of_sound_recordings() -> None:
    sound = [case for case in cases(2) if case.fault.name == "clean"]
    assert [found.said for case in sound if (found := outcome(case)).verdict != SILENT_RIGHT] == []


def test_a_late_gyro_loses_no_rest_where_the_estimate_settles_slowly() -> None:
    late = Fault("lag", "30 ms", damage.gyro_late(0.03))
    assert outcome(Case(late, "tipping", "wt901", 13)).lost == 0


if __name__ == "__main__":
    cases_of, outcome_of = RUNS[sys.argv[1]]
    print(HEADER, *(written(case, outcome_of(case)) for case in cases_of), sep="\n")
