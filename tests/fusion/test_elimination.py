"""Unknowns that are eliminated part by part: the result is that of the whole normal equations."""

import numpy as np
from scipy.linalg import block_diag

from pbd.fusion.elimination import Part, by_take, solve


def test_parts_give_what_the_whole_normal_equations_give() -> None:
    """Five takes of two devices, that alternate; a take has two unknowns of its own, a device three, all share four."""
    rng, takes, n = np.random.default_rng(0), 5, 8
    count = takes * n
    rows = np.arange(count).reshape(takes, n)
    weights = [one @ one.T for one in rng.normal(size=(takes, n, n))]
    J, r = rng.normal(size=(count, 9)), rng.normal(size=count)
    parts = [Part(slice(k * n, k * n + n), slice(0, 2), np.eye(2), rng.normal(size=2)) for k in range(takes)]
    parts += [Part(rows[d::2].ravel(), slice(2, 5), 2.0 * np.eye(3), rng.normal(size=3)) for d in range(2)]
    parts += [Part(slice(None), slice(5, 9), 3.0 * np.eye(4), rng.normal(size=4))]
    found = solve(parts, weights, J, r)

    whole, W = np.zeros((count, 0)), block_diag(*weights)
    for part in parts:
        columns = np.zeros((count, part.at.stop - part.at.start))
        columns[part.rows] = J[part.rows, part.at]
        whole = np.hstack((whole, columns))
    cov = np.linalg.inv(whole.T @ W @ whole + block_diag(*[part.information for part in parts]))
    gradient = whole.T @ W @ r + np.concatenate([part.gradient for part in parts])
    precision = W - W @ whole @ cov @ whole.T @ W
    ends = np.cumsum([len(part.gradient) for part in parts])
    np.testing.assert_allclose(np.concatenate(found.steps), -cov @ gradient)
    for end, one in zip(ends, found.covs, strict=True):
        np.testing.assert_allclose(one, cov[end - len(one) : end, end - len(one) : end], atol=1e-12)
    np.testing.assert_allclose(found.residuals, r - whole @ cov @ gradient)
    np.testing.assert_allclose(found.fall, gradient @ cov @ gradient)
    np.testing.assert_allclose(found.precision.times(r), precision @ r, atol=1e-9)
    np.testing.assert_allclose(found.precision.within_take(rows[3]), precision[24:32, 24:32], atol=1e-9)
    members = np.eye(3)[rng.integers(3, size=count)]
    np.testing.assert_allclose(found.precision.squares(members), members.T @ precision**2 @ members)
    np.testing.assert_allclose(by_take(weights, J), W @ J)
