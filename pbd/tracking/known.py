"""Condition a hand path on what is known of its stops: places visited twice, known positions, known heights.

The displacements of the moves are independent, normal, and known as well as the path's covariance says. What is
claimed is linear in them, with a small noise of its own (claims.py). So the best estimate of all of them together is
one step of a Kalman filter over the moves: each takes its share of a misfit by its own uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import erfc, sqrt

import numpy as np

from pbd.data import Calibration, ClaimFit, HandPath, Known, Stop
from pbd.errors import TrackingError
from pbd.pose import Array, Pose
from pbd.tracking.claims import Claim, claims_of

REFUSED_SIGMA = 3.0
"""A misfit as improbable as so many sigmas along one axis (0.27 %) is a contradiction."""


def condition_on(
    path: HandPath, known: Known, calibration: Calibration | None = None, T_base_nav: Pose | None = None
) -> HandPath:
    """Move the stops, and the path between them, to where they most likely are, given what is known.

    With d (m,) the claims' misfits, G (m, 3 k) how they depend on the displacement of each of the k moves, Q the moves'
    covariances and R the claims' own: the displacements change by Q G^T S^-1 d with S = G Q G^T + R. Covariances are
    Joseph's form, A Q A^T + K R K^T, which stays positive however small Q or R.

    Args:
        path: as tracked; its `cov` is that of independent moves chained one after the other, with none between
            position and rotation. So it can't be a path that is conditioned already.
        known: what is claimed.
        calibration: for the tool's lever arm, positions in base and the table's height.
        T_base_nav: nav in base, with a calibration.

    Returns:
        The path with new positions, velocities (still the derivative of position, zero in stops) and covariances, and
        how well each claim fitted. Attitudes and closures are what they were.

    Raises:
        TrackingError: a claim contradicts the data, or names no stop.
    """
    if path.claims:
        raise ValueError("the path is conditioned already; give all that is known at once")
    claims = claims_of(path, known, calibration, T_base_nav)
    if not claims:
        return path
    p_stop = path.p_nav_sensor[[stop.start for stop in path.stops]]
    moves = np.diff(path.cov[:, :3, :3], axis=0, prepend=np.zeros((1, 3, 3)))  # (k, 3, 3), that of no move first
    rows = _rows(claims)
    G, R = _dependence(claims, rows, len(path.stops)), _noise(claims, rows)
    QG = np.einsum("kab,mkb->kam", moves, G)
    S = np.einsum("mka,kan->mn", G, QG) + R
    misfit = np.concatenate([claim.value - claim.axes @ _from_other(p_stop, claim) for claim in claims])
    fits = _fits(path, claims, rows, misfit, S)

    gain = np.cumsum(QG @ np.linalg.inv(S), axis=0)  # (k, 3, m), of positions
    p, v = _carried_along(path, gain @ misfit)
    cov = path.cov.copy()
    cov[:, :3, :3] = _josephs_form(moves, gain, G, R)
    return replace(path, p_nav_sensor=p, v_nav_sensor=v, cov=cov, claims=fits)


def _josephs_form(moves: Array, gain: Array, G: Array, R: Array) -> Array:
    """Covariance (k, 3, 3) at each stop: A Q A^T of all moves and K R K^T, A being I - K G up to the stop, else -K G.

    Moves that all claims see alike are summed up first, so that a long path takes no longer than its length.
    """
    cov: Array = gain @ R @ gain.transpose(0, 2, 1)
    ends = [0, *(np.flatnonzero(np.diff(G, axis=1).any(axis=(0, 2))) + 1).tolist(), len(moves)]
    for start, end in pairwise(ends):
        before, after = np.zeros_like(moves), np.zeros_like(moves)
        before[start:end] = np.cumsum(moves[start:end], axis=0)
        before[end:] = before[end - 1]
        after[start : end - 1] = np.cumsum(moves[start + 1 : end][::-1], axis=0)[::-1]
        after[:start] = before[end - 1]
        KG = gain @ G[:, start]
        A = np.eye(3) - KG
        cov += A @ before @ A.transpose(0, 2, 1) + KG @ after @ KG.transpose(0, 2, 1)
    return cov


def _rows(claims: Sequence[Claim]) -> list[slice]:
    ends = np.cumsum([0, *(len(claim.value) for claim in claims)]).tolist()
    return [slice(start, stop) for start, stop in pairwise(ends)]


def _dependence(claims: Sequence[Claim], rows: Sequence[slice], k: int) -> Array:
    """How each claim depends on each move's displacement, (m, k, 3); row 0 of the moves is none."""
    G = np.zeros((rows[-1].stop, k, 3))
    for claim, row in zip(claims, rows, strict=True):
        other = claim.other or 0  # nav's origin is the first stop
        first, last, sign = (other, claim.stop, 1.0) if claim.stop >= other else (claim.stop, other, -1.0)
        G[row, first + 1 : last + 1] = sign * claim.axes[:, None, :]
    return G


def _noise(claims: Sequence[Claim], rows: Sequence[slice]) -> Array:
    R = np.zeros((rows[-1].stop, rows[-1].stop))
    for claim, row in zip(claims, rows, strict=True):
        R[row, row] = claim.noise
        for relative, column in zip(claims, rows, strict=True):
            if relative.group == claim.group:
                R[row, column] += claim.shared
    return R


def _from_other(p_stop: Array, claim: Claim) -> Array:
    displacement: Array = p_stop[claim.stop] - (0.0 if claim.other is None else p_stop[claim.other])
    return displacement


def _carried_along(path: HandPath, shift: Array) -> tuple[Array, Array]:
    """Position and velocity with the stops shifted by (k, 3) m.

    Along a move the shift grows as 3 s^2 - 2 s^3 of its time. That is its conditional mean where the acceleration errs
    by white noise and velocity is known at both ends: least squares of the acceleration, a cubic.
    """
    p, v = path.p_nav_sensor.copy(), path.v_nav_sensor.copy()
    for k, (stop, following) in enumerate(pairwise(path.stops)):
        p[stop.start : stop.stop] += shift[k]
        between = slice(stop.stop, following.start)
        begin, end = path.t[stop.stop - 1], path.t[following.start]
        s = ((path.t[between] - begin) / (end - begin))[:, None]
        more = shift[k + 1] - shift[k]
        p[between] += shift[k] + s**2 * (3.0 - 2.0 * s) * more
        v[between] += 6.0 * s * (1.0 - s) / (end - begin) * more
    p[path.stops[-1].start :] += shift[-1]
    return p, v


def _fits(
    path: HandPath, claims: Sequence[Claim], rows: Sequence[slice], misfit: Array, S: Array
) -> tuple[ClaimFit, ...]:
    """How well each claim fits on its own.

    Raises:
        TrackingError: one doesn't, or all together don't.
    """
    square = [float(misfit[row] @ np.linalg.solve(S[row, row], misfit[row])) for row in rows]
    excess = [value / _bound(row.stop - row.start) for value, row in zip(square, rows, strict=True)]
    worst = int(np.argmax(excess))
    if excess[worst] > 1.0:
        _refuse(path, claims[worst], misfit[rows[worst]], square[worst])

    weighted = np.linalg.solve(S, misfit)
    together = float(misfit @ weighted)
    if together > _bound(len(misfit)):
        # A claim's misfit against all the others, and its square: by how much all together falls without the claim.
        precision = np.linalg.inv(S)
        against = [np.linalg.solve(precision[row, row], weighted[row]) for row in rows]
        gained = [float(weighted[row] @ off) for row, off in zip(rows, against, strict=True)]
        worst = int(np.argmax(gained))
        _refuse(path, claims[worst], against[worst], gained[worst], " against the other claims")
    return tuple(
        ClaimFit(claim.saying, _middle(path, path.stops[claim.stop]), claim.stop, _length(misfit[row]), sqrt(value))
        for claim, row, value in zip(claims, rows, square, strict=True)
    )


def _refuse(path: HandPath, claim: Claim, misfit: Array, square: float, beside: str = "") -> None:
    off, sigmas = _length(misfit), sqrt(square)
    number = f"{sigmas:.0f}" if sigmas >= 9.95 else f"{sigmas:.1f}"
    raise TrackingError(
        f"demo.toml says that {claim.saying}, but {claim.differs.format(_cm(off))}{beside} "
        f"(sigma {_cm(off / sigmas)}, {number} sigma); remove {claim.entry}, or record again",
        t=_middle(path, path.stops[claim.stop]),
        stop=claim.stop,
        value=off,
        sigmas=sigmas,
    )


def _bound(dimension: int) -> float:
    """The chi-square that is as improbable as REFUSED_SIGMA along one axis."""
    from scipy.special import chdtri

    return float(chdtri(dimension, erfc(REFUSED_SIGMA / sqrt(2.0))))


def _middle(path: HandPath, stop: Stop) -> float:
    return 0.5 * float(path.t[stop.start] + path.t[stop.stop - 1])


def _length(vector: Array) -> float:
    return float(np.linalg.norm(vector))


def _cm(metres: float) -> str:
    return f"{100.0 * metres:.0f} cm" if metres >= 0.0995 else f"{100.0 * metres:.1f} cm"
