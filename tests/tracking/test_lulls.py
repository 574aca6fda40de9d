"""A foot's stance is a lull between strides; calm beside a knock is none."""

import numpy as np
import pytest

from pbd.data import GRAVITY, Recording
from pbd.tracking.first_rest import find_rest
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, Energies, find_candidates, quiet_limits
from tests.scenarios import simulate


@pytest.mark.parametrize("rate", [40, 100, 286])
@pytest.mark.parametrize(("lasts_s", "found"), [(0.05, 0), (0.3, 2)], ids=["a knock", "a stride"])
def test_the_calmest_moments_beside_a_stride_may_be_stops_but_not_beside_a_knock(
    rate: int, lasts_s: float, found: int
) -> None:
    window = round(ENERGY_WINDOW_S * rate)
    t = np.arange(4 * rate) / rate
    rest = find_rest(simulate("pour", "modern").recording)
    energy = 0.05 * (1.0 + 0.1 * np.cos(2.0 * np.pi * t[: 1 - window]))  # of a hand on its way, never quiet
    energy[2 * rate : 2 * rate + round(lasts_s * rate) + window] = 1e3
    assert len(find_candidates(t, 1.0 / rate, Energies(energy, energy, energy, energy), rest)) == found


def test_in_a_lull_the_calmest_window_is_a_stop() -> None:
    """A foot's stance, calmest a third of a second after its begin, and never as calm as the first rest.

    It accelerates least at the begin and turns least at the end; both count as they compare with that rest.
    """
    t, window = 0.01 * np.arange(300.0), 10
    rest = find_rest(Recording(t, np.array((0.0, 0.0, GRAVITY)) + 1e-3 * np.sin(t)[:, None], np.zeros((300, 3))))
    limits = quiet_limits(rest)
    acc, gyr, away = np.full(300 - window + 1, 1e4), np.full(300 - window + 1, 1e4), np.arange(140, 180) - 173
    acc[140:180], gyr[140:180] = 60.0 + np.abs(away) + 1.5 * away, 60.0 + np.abs(away) - 1.5 * away
    assert find_candidates(t, 0.01, Energies(*2 * (limits[0] * acc, limits[1] * gyr)), rest) == [(173, 173 + window)]
