"""The ellipsoid of two sigma."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from pbd.view.ellipsoid import LEAST_SIGMA_M, two_sigma


@given(st.integers(0, 2**32 - 1), st.floats(-2.0, 0.0))
def test_its_surface_lies_at_two_sigma(seed: int, flat: float) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) @ np.diag([0.02, 0.02, 0.02 * 10**flat])
    cov, p = root @ root.T, rng.normal(size=3)
    assume(np.linalg.eigvalsh(cov).min() > LEAST_SIGMA_M**2)  # thinner ones are drawn thicker
    T = two_sigma(p, cov)
    directions = rng.normal(size=(50, 3))
    offsets = directions / np.linalg.norm(directions, axis=1, keepdims=True) @ T[:3, :3].T
    distance = np.sqrt(np.einsum("ni,ij,nj->n", offsets, np.linalg.inv(cov), offsets))
    np.testing.assert_allclose(distance, 2.0, rtol=1e-6)
    np.testing.assert_array_equal(T[:3, 3], p)


@given(st.lists(st.floats(0.0, 0.1), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_the_page_can_take_it_apart(sigma: list[float], seed: int) -> None:
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    T = two_sigma(np.zeros(3), axes @ np.diag(np.square(sigma)) @ axes.T)
    scale = np.linalg.norm(T[:3, :3], axis=0)
    np.testing.assert_allclose(np.sort(scale), 2.0 * np.sort(np.maximum(sigma, LEAST_SIGMA_M)), rtol=1e-3)
    turn = T[:3, :3] / scale  # as three.js does it
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) > 0.0
