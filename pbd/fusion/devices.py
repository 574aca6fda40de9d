"""Which takes were made with one device: those of one name whose errors agree."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from pbd.fusion.marginals import BIAS, DEVICE, Marginal

BIAS_REPEATS = 0.002
"""Sigma of an accelerometer's bias from take to take, m/s2 (0.2 mg: a fraction of a degree of temperature)."""

ANOTHER = 5.0 * DEVICE
"""Chi-square between a take's sensor errors and a device's, above which the take is of another device. Simulated
(WT901, 64 takes), one device gives at most 13, two give 700 or more."""

LEAST_KNOWN = 1e-6
"""Smallest eigenvalue of the (scaled) information that counts as known, as a share of the largest."""


def devices_of(marginals: Sequence[Marginal], names: Sequence[Hashable]) -> tuple[int, ...]:
    """Number the devices of takes, from 0 on in their order. Takes of different names are of different devices."""
    groups: list[list[int]] = []
    for k, (marginal, name) in enumerate(zip(marginals, names, strict=True)):
        namesakes = [group for group in groups if names[group[0]] == name]
        misfits = [_misfit(marginal, [marginals[i] for i in group]) for group in namesakes]
        if min(misfits, default=np.inf) < ANOTHER:
            namesakes[int(np.argmin(misfits))].append(k)
        else:
            groups.append([k])
    return tuple(next(d for d, group in enumerate(groups) if k in group) for k in range(len(marginals)))


def _misfit(marginal: Marginal, others: Sequence[Marginal]) -> float:
    """Chi-square of what one take knows of its device, given what the others say of theirs."""
    prior = others[0].prior
    cov = np.linalg.inv(prior + sum(other.information for other in others))
    errors = cov @ (prior @ others[0].mean + sum(other.gradient for other in others))
    cov[BIAS, BIAS] += BIAS_REPEATS**2 * np.eye(3)
    known = marginal.information
    off = marginal.gradient - known @ errors
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(known), np.finfo(float).tiny))
    spread = (known + known @ cov @ known) * np.outer(scale, scale)
    return float((off * scale) @ np.linalg.pinv(spread, LEAST_KNOWN, hermitian=True) @ (off * scale))
