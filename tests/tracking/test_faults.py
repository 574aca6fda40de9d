"""Forty-five random cases of the fault matrix (tests/benchmarks/faults.py has them all)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tests.tracking import damage
from tests.tracking.fault_matrix import REFUSED, SILENT_RIGHT, SILENT_WRONG, Case, Fault, cases, outcome

SAMPLE, MOST_SILENT, LEAST_RIGHT = 45, 1, 9
"""Number of cases; most that may be silently wrong (under 1 % of all are, so two of them by chance in 7 %); least
that are right without a warning, else too much is refused."""


def test_damage_is_refused_or_told_or_does_no_harm() -> None:
    tellable = [case for case in cases(2) if not case.untellable]
    sample = np.random.default_rng(14).choice(len(tellable), SAMPLE, replace=False)
    found = Counter(outcome(tellable[k]).verdict for k in sample)
    assert found[SILENT_WRONG] <= MOST_SILENT
    assert found[SILENT_RIGHT] >= LEAST_RIGHT
    assert found[REFUSED] < SAMPLE // 2


def test_nothing_is_said_of_sound_recordings() -> None:
    sound = [case for case in cases(2) if case.fault.name == "clean"]
    assert [found.said for case in sound if (found := outcome(case)).verdict != SILENT_RIGHT] == []


def test_a_late_gyro_loses_no_rest_where_the_estimate_settles_slowly() -> None:
    late = Fault("lag", "30 ms", damage.gyro_late(0.03))
    assert outcome(Case(late, "tipping", "wt901", 13)).lost == 0
