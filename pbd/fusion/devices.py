"""Decide which takes were made with one device: takes with the same sensor name whose sensor errors agree."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from pbd.fusion.marginals import DEVICE, Marginal

ANOTHER_DEVICE = 5.0 * DEVICE
"""Chi-square between the sensor errors of a take and of a device, above which the take is of another device. In
simulation (WT901, 64 takes) takes of one device gave at most 13, takes of two devices at least 700."""

LEAST_KNOWN = 1e-6
"""Smallest eigenvalue of the scaled information matrix that is used, as a share of the largest."""


def devices_of(marginals: Sequence[Marginal], names: Sequence[Hashable]) -> tuple[int, ...]:
    """Return each take's device as a number, from 0 on. Takes with different names are of different devices."""
    groups: list[list[int]] = []
    for k, (marginal, name) in enumerate(zip(marginals, names, strict=True)):
        same_name = [group for group in groups if names[group[0]] == name]
        misfits = [_misfit(marginal, [marginals[i] for i in group]) for group in same_name]
        if min(misfits, default=np.inf) < ANOTHER_DEVICE:
            same_name[int(np.argmin(misfits))].append(k)
        else:
            groups.append([k])
    return tuple(next(d for d, group in enumerate(groups) if k in group) for k in range(len(marginals)))


def _misfit(marginal: Marginal, others: Sequence[Marginal]) -> float:
    """Return chi-square of the sensor errors that a take shows, against the errors that other takes show."""
    prior = others[0].prior
    cov = np.linalg.inv(prior + sum(other.information for other in others))
    errors = cov @ (prior @ others[0].mean + sum(other.gradient for other in others))
    information = marginal.information
    off = marginal.gradient - information @ errors
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    spread = (information + information @ cov @ information) * np.outer(scale, scale)
    return float((off * scale) @ np.linalg.pinv(spread, LEAST_KNOWN, hermitian=True) @ (off * scale))
