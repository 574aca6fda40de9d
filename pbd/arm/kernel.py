"""The inner loops of inverse kinematics in plain arithmetic, compiled by numba as they are imported (compiled.py).

The arm is a chain of fixed steps, each followed by a joint that turns about z of where the step leads, or slides along
it. `links` (k + 1, 4, 3) holds each step's offset (row 0, m) and rotation matrix (rows 1 to 3); `slides` (k,) says
which joints slide. Poses are in base: p (3,) m and a rotation matrix R (3, 3). Arrays whose names end in _out are
written to.

The error is e = (p - p_target, log3(R R_target^T)), m and rad in base; 1 rad counts as 1 m in |e|^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pbd.arm.descent import DAMPING, LEAST_DAMPING, MOST_DAMPING, MOST_STEPS, MOST_TURN, RIDGE, SLOW, SOLVED, STALLED
from pbd.arm.model import FloatArray
from pbd.pose import Array

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function for those below, which are kept."""
    faster: Function = njit(nogil=True)(function)
    return faster


def kept(signature: str) -> Callable[[Function], Function]:
    """Compile a function of such arguments at once, or take what was compiled before from the folder that is set."""
    keep: Callable[[Function], Function] = njit(signature, cache=True, nogil=True)
    return keep


@compiled
def forward(links: Array, slides: NDArray[np.bool_], q: Array, p_out: Array, R_out: Array, joints_out: Array) -> None:
    """Find the tool's pose, and each joint's origin and axis: joints_out (k, 2, 3)."""
    k = len(q)
    for i in range(3):
        p_out[i] = 0.0
        for j in range(3):
            R_out[i, j] = 1.0 if i == j else 0.0
    for joint in range(k + 1):
        link = links[joint]
        for i in range(3):
            a, b, c = R_out[i, 0], R_out[i, 1], R_out[i, 2]
            p_out[i] += a * link[0, 0] + b * link[0, 1] + c * link[0, 2]
            for j in range(3):
                R_out[i, j] = a * link[1, j] + b * link[2, j] + c * link[3, j]
        if joint == k:
            break
        if slides[joint]:
            for i in range(3):
                p_out[i] += R_out[i, 2] * q[joint]
        else:
            cos, sin = math.cos(q[joint]), math.sin(q[joint])
            for i in range(3):
                a, b = R_out[i, 0], R_out[i, 1]
                R_out[i, 0], R_out[i, 1] = a * cos + b * sin, b * cos - a * sin
        for i in range(3):
            joints_out[joint, 0, i], joints_out[joint, 1, i] = p_out[i], R_out[i, 2]


@compiled
def log3(R: Array, out: Array) -> None:
    """Rotation vector (3,) in rad, through the quaternion with its largest component first: exact near 0 and pi."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        root = math.sqrt(1.0 + trace)
        w = 0.5 * root
        x, y, z = (R[2, 1] - R[1, 2]) / (2 * root), (R[0, 2] - R[2, 0]) / (2 * root), (R[1, 0] - R[0, 1]) / (2 * root)
    else:
        i = 0
        if R[1, 1] > R[0, 0]:
            i = 1
        if R[2, 2] > R[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        root = math.sqrt(1.0 + R[i, i] - R[j, j] - R[k, k])
        w = (R[k, j] - R[j, k]) / (2 * root)
        sign = 1.0 if w >= 0.0 else -1.0
        out[i] = sign * 0.5 * root
        out[j] = sign * (R[j, i] + R[i, j]) / (2 * root)
        out[k] = sign * (R[k, i] + R[i, k]) / (2 * root)
        w, x, y, z = sign * w, out[0], out[1], out[2]
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@compiled
def look(
    links: Array,
    slides: NDArray[np.bool_],
    p_target: Array,
    R_target: Array,
    q: Array,
    e_out: Array,
    J_out: Array,
    work: Array,
) -> float:
    """Find e (6,) and its Jacobian J (6, k), but for log3's own derivative; return |e|^2.

    That derivative leaves J^T e as it is, since log3(R R_target^T) is its own axis, and is the identity at e = 0.
    """
    k = len(q)
    p, R, offset, joints = work[0], work[1:4], work[4:7], work[7 : 7 + 2 * k].reshape(k, 2, 3)
    forward(links, slides, q, p, R, joints)
    for i in range(3):
        for j in range(3):
            offset[i, j] = R[i, 0] * R_target[j, 0] + R[i, 1] * R_target[j, 1] + R[i, 2] * R_target[j, 2]
    log3(offset, e_out[3:])
    for i in range(3):
        e_out[i] = p[i] - p_target[i]
    for joint in range(k):
        x, y, z = joints[joint, 1, 0], joints[joint, 1, 1], joints[joint, 1, 2]
        if slides[joint]:
            J_out[0, joint], J_out[1, joint], J_out[2, joint] = x, y, z
            J_out[3, joint], J_out[4, joint], J_out[5, joint] = 0.0, 0.0, 0.0
        else:
            a, b, c = p[0] - joints[joint, 0, 0], p[1] - joints[joint, 0, 1], p[2] - joints[joint, 0, 2]
            J_out[0, joint], J_out[1, joint], J_out[2, joint] = y * c - z * b, z * a - x * c, x * b - y * a
            J_out[3, joint], J_out[4, joint], J_out[5, joint] = x, y, z
    square = 0.0
    for i in range(6):
        square += e_out[i] * e_out[i]
    return square


@compiled
def solve_damped(H: Array, gradient: Array, damping: float, L_out: Array, x_out: Array) -> None:
    """Solve (H + damping I) x = gradient by Cholesky's L L^T; H's lower half is enough."""
    k = len(gradient)
    for i in range(k):
        for j in range(i + 1):
            total = H[i, j]
            if i == j:
                total += damping
            for m in range(j):
                total -= L_out[i, m] * L_out[j, m]
            L_out[i, j] = math.sqrt(total) if i == j else total / L_out[j, j]
    for i in range(k):
        total = gradient[i]
        for m in range(i):
            total -= L_out[i, m] * x_out[m]
        x_out[i] = total / L_out[i, i]
    for i in range(k - 1, -1, -1):
        total = x_out[i]
        for m in range(i + 1, k):
            total -= L_out[m, i] * x_out[m]
        x_out[i] = total / L_out[i, i]


@compiled
def descend(
    links: Array,
    slides: NDArray[np.bool_],
    lower: Array,
    upper: Array,
    p_target: Array,
    R_target: Array,
    q_seed: Array,
    patience: int,
    q_out: Array,
) -> float:
    """Levenberg-Marquardt with active joint limits, from one seed (k,); see pbd/arm/descent.py. Return |e|^2."""
    k = len(q_seed)
    work = np.empty((7 + 2 * k, 3))
    e, e_next, J, J_next = np.empty(6), np.empty(6), np.empty((6, k)), np.empty((6, k))
    H, L, gradient, step, q, q_next = (
        np.empty((k, k)),
        np.empty((k, k)),
        np.empty(k),
        np.empty(k),
        np.empty(k),
        np.empty(k),
    )
    for i in range(k):
        q[i] = min(max(q_seed[i], lower[i]), upper[i])
    square: float = look(links, slides, p_target, R_target, q, e, J, work)
    damping, slow_steps, stuck = DAMPING, 0, False
    for _ in range(MOST_STEPS):
        if square < SOLVED or slow_steps == patience or stuck:
            break
        for i in range(k):
            total = 0.0
            for m in range(6):
                total += e[m] * J[m, i]
            # A joint at a bound that wants to go beyond it is left out of this step.
            if (q[i] == lower[i] and total > 0.0) or (q[i] == upper[i] and total < 0.0):
                total = 0.0
                for m in range(6):
                    J[m, i] = 0.0
            gradient[i] = total
        for i in range(k):
            for j in range(i + 1):
                total = 0.0
                for m in range(6):
                    total += J[m, i] * J[m, j]
                H[i, j] = total
        while True:
            solve_damped(H, gradient, damping * square + RIDGE, L, step)
            largest = 0.0
            for i in range(k):
                largest = max(largest, abs(step[i]))
            share = MOST_TURN / max(MOST_TURN, largest)
            for i in range(k):
                q_next[i] = min(max(q[i] - share * step[i], lower[i]), upper[i])
            square_next = look(links, slides, p_target, R_target, q_next, e_next, J_next, work)
            if square_next < square:
                damping = max(LEAST_DAMPING, 0.2 * damping)
                slow_steps = slow_steps + 1 if square_next > SLOW * square else 0
                stuck = square_next > STALLED * square
                q, q_next, e, e_next, J, J_next = q_next, q, e_next, e, J_next, J
                square = square_next
                break
            damping *= 10.0
            if damping * square > MOST_DAMPING:
                stuck = True
                break
    for i in range(k):
        q_out[i] = q[i]
    return square


@kept("int64(f8[:,:,::1], b1[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], int64, b1, f8[:,::1], f8[::1])")
def descend_each(
    links: Array,
    slides: NDArray[np.bool_],
    lower: Array,
    upper: Array,
    p_target: Array,
    R_target: Array,
    q_seeds: Array,
    patience: int,
    all_of_them: bool,
    q_out: Array,
    square_out: Array,
) -> int:
    """Descend from each seed (m, k), until one arrives unless `all_of_them`; return how many were followed."""
    for i in range(len(q_seeds)):
        square_out[i] = descend(links, slides, lower, upper, p_target, R_target, q_seeds[i], patience, q_out[i])
        if square_out[i] < SOLVED and not all_of_them:
            return i + 1
    return len(q_seeds)


@kept("void(f4[:,:,::1], f4[:,::1], f4[::1], int64, int64[::1])")
def nearest(
    features: FloatArray, centres: FloatArray, wanted: FloatArray, blocks: int, found_out: NDArray[np.int64]
) -> None:
    """Find the nearest of features (b, m, f), by rows, to one (f,): those of the `blocks` with the nearest centres.

    found_out (n,) takes row numbers, nearest first.
    """
    m = features.shape[1]
    width = len(wanted)
    to_centre = np.empty(len(centres))
    for i in range(len(centres)):
        total = 0.0
        for j in range(width):
            total += (centres[i, j] - wanted[j]) ** 2
        to_centre[i] = total
    rows, distance = np.empty(blocks * m, np.int64), np.empty(blocks * m)
    for n in range(blocks):
        block = int(np.argmin(to_centre))
        to_centre[block] = np.inf
        for i in range(m):
            total = 0.0
            for j in range(width):
                total += (features[block, i, j] - wanted[j]) ** 2
            rows[n * m + i], distance[n * m + i] = block * m + i, total
    for n in range(len(found_out)):
        best = np.argmin(distance)
        found_out[n], distance[best] = rows[best], np.inf
