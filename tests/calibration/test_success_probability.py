"""The probability of being within tolerance, against closed forms."""

import numpy as np
import pytest
from scipy.special import chdtr

from pbd.calibration.success_probability import success, success_of
from pbd.calibration.tool_poses import KeyframesInBase
from pbd.data import Calibration, Keyframe
from pbd.pose import Array, Pose


def balls(*radii_m: float) -> Array:
    return np.array([radius**2 * np.eye(3) for radius in radii_m])


ANY = np.array([np.inf])


@pytest.mark.parametrize("sigmas", [1.0, 2.0, 3.0])
def test_one_keyframe_is_chi_with_three_degrees_of_freedom(sigmas: float) -> None:
    cov = np.diag([0.002**2] * 3 + [0.01**2] * 3)
    found = success(cov, balls(0.002 * sigmas), ANY)
    assert found.of_all == pytest.approx(chdtr(3, np.square(sigmas)), abs=0.01)
    both = success(cov, balls(0.002 * sigmas), np.array([0.01 * sigmas]))
    assert both.of_all == pytest.approx(chdtr(3, np.square(sigmas)) ** 2, abs=0.01)


def test_correlated_errors_are_within_tolerance_together() -> None:
    """The product of the probabilities holds only for independent errors."""
    one: Array = np.diag([0.002**2] * 3 + [0.0] * 3)
    within = balls(0.004, 0.004), np.repeat(ANY, 2)
    apart = success(np.kron(np.eye(2), one).astype(np.float64), *within)
    together = success(np.kron(np.ones((2, 2)), one).astype(np.float64), *within)
    assert apart.of_all == pytest.approx(chdtr(3, 4.0) ** 2, abs=0.01)
    assert together.of_all == pytest.approx(chdtr(3, 4.0), abs=0.01)
    np.testing.assert_allclose(together.of_each, apart.of_each, atol=0.01)


@pytest.mark.parametrize(("within_m", "band"), [(0.001, "under 50 %"), (0.004, "50 to 90 %"), (0.01, "over 90 %")])
def test_the_probability_is_reported_in_bands(within_m: float, band: str) -> None:
    assert success(np.diag([0.002**2] * 3 + [0.0] * 3), balls(within_m), ANY).band == band


def test_own_tolerances_scale_with_the_motion() -> None:
    """At 0.3 of its size a motion has 0.3 of the tracking error, and the page draws 0.3 of the learned tolerance."""
    keyframes = [Keyframe(0.0, 1.0, Pose.identity(), 0.005**2 * np.eye(6), tolerance_m=np.full(3, 0.01))]
    exact_dock = Calibration("c", T_base_nav=Pose.identity(), cov_base=np.zeros((6, 6)))
    own, given = [], []
    for scale in (1.0, 0.3):
        placed = KeyframesInBase(keyframes, Pose.identity(), exact_dock, scale)
        own.append(success_of(placed).of_all)
        given.append(success_of(placed, 0.01).of_all)
    assert own == pytest.approx([chdtr(3, 4.0)] * 2, abs=0.01)
    assert given == pytest.approx([chdtr(3, 4.0), 1.0], abs=0.01)  # a centimetre in base is a centimetre
