"""What is said of a recording that its own solution contradicts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from pbd.tracking.alarm import _of_moves


def test_many_moves_that_all_fit_badly_are_told() -> None:
    """Each at three sigmas: none stands out from the others."""
    solution: Any = SimpleNamespace(
        legs=(np.full((8, 9), 3.0), np.zeros((8, 9, 9))), problem=SimpleNamespace(t=np.arange(9.0))
    )
    (said,) = _of_moves(solution)
    assert said.startswith("no motion between the stops fits the data from 0.0 to 1.0 s, and in 7 other places: ")
