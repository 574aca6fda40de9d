"""What a solution shows that its model does not explain: told, each in a line.

The bounds lie above what 108 clean simulated recordings and the real ones of the benchmark show at most
(tests/benchmarks/faults.py prints the false alarms of clean recordings beside what is found of the damaged ones).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pbd.data import Stop
from pbd.data.hand import DOUBTED
from pbd.pose import lengths
from pbd.tracking.factors import ACC_MATRIX, GYR_MATRIX
from pbd.tracking.noise import acc_doubt
from pbd.tracking.preintegration import LOWER
from pbd.tracking.rest import ABOUT
from pbd.tracking.smoother import Solution
from pbd.tracking.steady import window_moments

LEG = 0.8
"""A leg's residuals, rms in sigmas of its nine: more than this no noise explains."""

PRIORS = 4.0
"""A sensor-wide error so many times as large as its class lets expect is told."""

GIVEN_UP_S = 0.5
"""As quiet as the first rest for so long, and given up by the smoother: that is told."""

DISTURBED = 0.25
"""A field that differs by this share from that at the first rest is a magnet's (rooms differ by up to 0.2)."""


def alarms(solution: Solution, stops: Sequence[Stop]) -> Iterator[str]:
    """Say what is wrong with a recording, as far as its solution shows it."""
    yield from _of_clock(solution)
    yield from _of_sensor(solution)
    yield from _of_moves(solution)
    yield from _of_stops(solution, stops)
    yield from _of_field(solution)


def _of_clock(solution: Solution) -> Iterator[str]:
    if solution.scale != 0.0:
        share = 1.0 + solution.scale
        yield (
            f"the gyro's turns are {100.0 * abs(1.0 / share - 1.0):.0f} % too {'small' if share > 1.0 else 'large'} "
            f"for how gravity turns: the gyro's scale or the time is wrong (if the time, every distance is "
            f"{share**-2:.2f} times the true one); check the rate"
        )
    if solution.lag != 0.0:
        late = "late behind" if solution.lag > 0.0 else "ahead of"
        yield (
            f"the gyro is {1e3 * abs(solution.lag):.0f} ms {late} the accelerometer; that is taken out, but set both "
            "to one filter if the sensor lets you"
        )


def _of_sensor(solution: Solution) -> Iterator[str]:
    x, device = solution.state, solution.problem.noise.device
    if solution.problem.device:
        return
    N = np.zeros((3, 3))
    N[tuple(np.transpose(LOWER))] = x.shared[ACC_MATRIX]
    M, doubt = x.shared[GYR_MATRIX].reshape(3, 3), acc_doubt(solution.problem.noise, solution.problem.rest)
    for name, matrix, prior in (("accelerometer", N, doubt * device.acc_scale), ("gyro", M, device.gyr_scale)):
        i, j = np.unravel_index(int(np.argmax(np.abs(matrix))), (3, 3))
        if abs(matrix[i, j]) > PRIORS * prior:
            error = 100.0 * abs(float(matrix[i, j]))
            what = (
                f"{'xyz'[i]} axis reads {error:.1f} % {'high' if matrix[i, j] > 0.0 else 'low'}"
                if i == j
                else f"{'xyz'[i]} axis leans {error:.1f} % towards {'xyz'[j]}"
            )
            yield f"the {name}'s {what}, far more than such a sensor should: pbd calibrate sensor"
    bias = x.acc_bias[np.argmax(np.abs(x.acc_bias).max(axis=1))]
    axis = int(np.argmax(np.abs(bias)))
    if abs(bias[axis]) > PRIORS * doubt * device.acc_bias:
        yield (
            f"the accelerometer's {'xyz'[axis]} axis is off by {bias[axis]:.2f} m/s2, far more than such a sensor "
            "should be: pbd calibrate sensor"
        )


def _of_moves(solution: Solution) -> Iterator[str]:
    problem = solution.problem
    if problem.device:
        return
    off = np.sqrt((solution.weights.legs**2).mean(axis=1))
    bad = off > LEG
    if bad.any():
        worst, t = int(np.argmax(off)), problem.t
        others = f", and in {int(bad.sum()) - 1} other places" if bad.sum() > 1 else ""
        yield (
            f"what the sensor says from {t[worst]:.1f} to {t[worst + 1]:.1f} s{others} fits no motion between the "
            "stops: samples are lost or wrong there; look at pbd plot, and record again"
        )


def _of_stops(solution: Solution, stops: Sequence[Stop]) -> Iterator[str]:
    t = solution.problem.frame.t
    for stop in stops:
        if stop.weight < DOUBTED:
            middle = 0.5 * float(t[stop.start] + t[stop.stop - 1])
            yield (
                f"the stop at {middle:.1f} s may be none ({100.0 * stop.weight:.0f} % sure): the hand seems to move on "
                "there; stop for half a second, or drop it from keyframes.toml"
            )
    frame, rest = solution.problem.frame, solution.problem.rest
    starts, ends = (np.array([getattr(stop, name) for stop in stops]) for name in ("start", "stop"))
    for start, end in solution.candidates:
        lasts = float(t[end - 1] - t[start])
        if lasts < GIVEN_UP_S or np.searchsorted(starts, end) > np.searchsorted(ends, start, side="right"):
            continue  # a stop begins before its end that does not end before it begins
        n = int(np.searchsorted(t, t[start] + GIVEN_UP_S)) - start
        if window_moments(frame.u[start:end], n)[0].min() < ABOUT * rest.acc_rms**2:
            yield (
                f"from {t[start]:.1f} s on the sensor seems to rest for {lasts:.1f} s, but not by the stops beside it: "
                "it coasts, or what it says between them is wrong; look at pbd plot"
            )


def _of_field(solution: Solution) -> Iterator[str]:
    problem, local = solution.problem, solution.local
    if problem.field is None or problem.device:
        return
    usual = np.array([0.0, np.cos(local.dip), np.sin(local.dip)])
    field = np.einsum("kij,kj->ki", solution.state.E, problem.field) / local.strength
    change = lengths(field - usual)
    disturbed = change > DISTURBED
    if disturbed.any():
        share = float(problem.share[disturbed].sum() / problem.share.sum())
        where = "there" if share < 0.5 else f"for {100.0 * share:.0f} % of the recording"
        yield (
            f"the magnetic field changes by {100.0 * change[disturbed].max():.0f} % from "
            f"{problem.t[np.argmax(disturbed)]:.1f} s on: heading is taken from the gyro {where}; keep magnets and "
            "iron away from the hand"
        )
