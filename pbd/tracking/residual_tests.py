"""Warnings about what the smoother's model does not explain, one line each.

tests/benchmarks/faults.py prints how often clean recordings are suspected, and how many damaged ones are found.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from pbd.data import SensorEstimate, Stop
from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.pose import lengths
from pbd.tracking.first_rest import QUIET_RATIO, REST_S
from pbd.tracking.moving_windows import moving_mean_variance, rows_of_mean, squares
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise
from pbd.tracking.smoother.doubtful_stops import MOVING_WEIGHT, SHORTEST_DIVIDED_S
from pbd.tracking.smoother.factors import robust_weights
from pbd.tracking.smoother.large_errors import REMOVED_LAG
from pbd.tracking.smoother.smooth import Solution

FALSE_ALARM_CHANCE = 0.05
"""Chance that a test suspects a sound recording, with noise as modelled. Real noise is smaller, so fewer are."""

LEG_RMS = 0.8
"""Largest rms of a leg's nine residuals, in sigmas. In sound recordings it is at most 0.73."""

FIELD_CHANGE = OUTLIER_SIGMAS * Noise.field_change
"""Relative change of the magnetic field since the first rest above which a magnet is near. Rooms vary by up to 0.2."""


def alarms(solution: Solution, stops: Sequence[Stop], sensor: SensorEstimate | None) -> Iterator[str]:
    """Yield a warning for each fault that the solution of a recording shows."""
    if sensor is not None:  # the device's own attitude is too coarse for these tests
        yield from _sensor_alarms(solution, sensor)
        yield from _move_alarms(solution)
        yield from _drift_alarms(solution)
        yield from _field_alarms(solution)
        if not solution.converged:
            yield (
                "the estimate did not settle, so keyframes late in the recording may be off by more than their sigma; "
                "record a shorter demonstration, or with a magnetometer"
            )
    yield from _stop_alarms(solution, stops)


def _sensor_alarms(solution: Solution, found: SensorEstimate) -> Iterator[str]:
    from statistics import NormalDist

    each = (found.lag, found.gyr_matrix, found.acc_matrix, found.acc_bias)
    bound = -NormalDist().inv_cdf(0.5 * FALSE_ALARM_CHANCE / sum(one.value.size for one in each))
    late = 1e3 * float(found.lag.value)
    if abs(found.lag.value) > REMOVED_LAG or abs(found.lag.surprise) > bound:
        yield (
            f"the gyro is {abs(late):.0f} ms {'late behind' if late > 0.0 else 'ahead of'} the accelerometer; this is "
            "corrected, but give both the same filter if the sensor allows it"
        )
    if solution.removed.scale != 0.0:
        share = 1.0 + solution.removed.scale
        yield (
            f"the gyro's turns are {100.0 * abs(1.0 / share - 1.0):.0f} % too {'small' if share > 1.0 else 'large'} "
            f"for how gravity turns: the gyro's scale or the time is wrong (if the time, every distance is "
            f"{share**-2:.2f} times the true one); check the rate"
        )
    clock = ""  # a wrong clock scales the gyro's turns, and may look like an error of the accelerometer as well
    for name, one in zip(("gyro", "accelerometer", "accelerometer"), each[1:], strict=True):
        surprise = np.abs(one.surprise)
        worst = np.unravel_index(int(np.argmax(surprise)), surprise.shape)
        if surprise[worst] < bound or (name == "gyro" and solution.removed.scale != 0.0):
            continue
        value, axes = float(one.value[worst]), ["xyz"[axis] for axis in worst]
        if len(axes) == 1:
            what = f"is off by {value:.2f} m/s2"
        elif axes[0] != axes[1]:
            what = f"leans {100.0 * abs(value):.1f} % towards {axes[1]}"
        else:
            what = f"reads {100.0 * abs(value):.1f} % {'high' if value > 0.0 else 'low'}"
            if name == "gyro":
                clock = f"the clock may be {'fast' if value > 0.0 else 'slow'} (check the rate), or "
        yield f"the {name}'s {axes[0]} axis {what}, far more than such a sensor should: {clock}pbd calibrate sensor"


def _move_alarms(solution: Solution) -> Iterator[str]:
    """Legs whose residuals are too large for the noise: chi-square test with Satterthwaite's degrees of freedom."""
    assert solution.leg_residuals is not None
    residuals, spread = solution.leg_residuals
    # 2 % of the noise for linearisation: else a leg that fits almost exactly (a gyro that reads zero) is suspected.
    left, total = 1.02 * np.eye(9) - spread, squares(residuals)
    mean, square = np.trace(left, axis1=1, axis2=2), (left**2).sum(axis=(1, 2))
    # By chance, at least 0.7 % of chi-squares exceed their mean by two standard deviations. Among seven legs that is no
    # alarm. So sound recordings need no scipy.special, which takes 0.15 s to load.
    if len(total) > 6 and (total <= np.minimum(mean + np.sqrt(8.0 * square), 9.0 * LEG_RMS**2)).all():
        return
    from scipy.special import chdtrc

    chance = chdtrc(mean**2 / square, total * mean / square)
    bad = (chance * len(chance) < FALSE_ALARM_CHANCE) | (total > 9.0 * LEG_RMS**2)
    if bad.any():
        worst, t = int(np.argmin(chance)), solution.problem.t
        others = f", and in {int(bad.sum()) - 1} other places" if bad.sum() > 1 else ""
        yield (
            f"no motion between the stops fits the data from {t[worst]:.1f} to {t[worst + 1]:.1f} s{others}: "
            "samples are lost or wrong there; look at pbd plot, and record again"
        )


def _drift_alarms(solution: Solution) -> Iterator[str]:
    """Rests in which a bias drifts more than its random walk explains: chi-square test."""
    assert solution.leg_drifts is not None
    problem, count = solution.problem, len(solution.problem.stops)
    in_stop, t = problem.stop_of[:-1][problem.same_stop], problem.frame.t
    suspected = set[int]()
    for each in solution.leg_drifts[:, :, problem.same_stop]:
        drift, expected = (np.bincount(in_stop, values, count) for values in each)
        expected = np.maximum(expected, 3.0)  # any rest may have, by chance, one change on three axes
        for k in np.flatnonzero(drift > expected + np.sqrt(2.0 * expected)).tolist():  # else chance explains it
            from scipy.special import chdtrc

            if count * chdtrc(expected[k], drift[k]) < FALSE_ALARM_CHANCE:
                suspected.add(k)
    for k in sorted(suspected):
        start, end = problem.stops[k]
        yield (
            f"the sensor seems to rest from {t[start]:.1f} to {t[end - 1]:.1f} s, but its readings drift like those of "
            "a hand that moves slowly: if it moved there, record again, and move faster"
        )


def _stop_alarms(solution: Solution, stops: Sequence[Stop]) -> Iterator[str]:
    t = solution.problem.frame.t
    for stop in stops:
        if stop.weight < DOUBTED_WEIGHT:
            middle = stop.middle_s(t)
            yield (
                f"the stop at {middle:.1f} s may be no stop ({100.0 * stop.weight:.0f} % sure): the hand seems to move "
                "on there; stop for half a second, or drop it from keyframes.toml"
            )
    problem = solution.problem
    frame, rest = problem.frame, problem.rest
    rests = [(k, *span) for k, span in enumerate(problem.stops) if t[span[1] - 1] - t[span[0]] > REST_S]
    for k, start, end in rests:
        weight = float(np.median(solution.still_weight[problem.stop_of == k]))
        if weight < MOVING_WEIGHT:  # else chance explains it
            from scipy.special import chdtri

            # Slow sway moves all knots of a rest as it moves one.
            if weight < robust_weights(np.array(chdtri(3.0, FALSE_ALARM_CHANCE / len(rests)))):
                yield (
                    f"the sensor seems to rest from {t[start]:.1f} to {t[end - 1]:.1f} s, but this hardly fits the "
                    "motion before and after: one of the channels is wrong; look at pbd plot, and record again"
                )
    starts, ends = (np.array([getattr(stop, name) for stop in stops]) for name in ("start", "stop"))
    for start, end in solution.candidates:
        lasts = float(t[end - 1] - t[start])
        if lasts < SHORTEST_DIVIDED_S or np.searchsorted(starts, end) > np.searchsorted(ends, start, side="right"):
            continue  # a stop overlaps it
        n = int(np.searchsorted(t, t[start] + SHORTEST_DIVIDED_S)) - start
        k = rows_of_mean(n / SHORTEST_DIVIDED_S)
        if moving_mean_variance(frame.u[start:end], n, k).min() < QUIET_RATIO * rest.acc_var:
            yield (
                f"from {t[start]:.1f} s on the sensor seems to rest for {lasts:.1f} s, but the stops beside it "
                "contradict this: it coasts, or the data between them are wrong; look at pbd plot"
            )


def _field_alarms(solution: Solution) -> Iterator[str]:
    if solution.removed.hard_iron.any():
        yield (
            "part of the magnetic field turns with the sensor, as that of iron or a magnet beside it; this is "
            "corrected, but pbd calibrate sensor finds it better"
        )
    problem, fixed = solution.problem, solution.fixed
    if problem.field is None:
        return
    level = np.cos(fixed.dip)
    usual = np.array([level * np.sin(fixed.azimuth), level * np.cos(fixed.azimuth), np.sin(fixed.dip)])
    field = np.einsum("kij,kj->ki", solution.state.E, problem.field) / fixed.strength
    change = lengths(field - usual)
    disturbed = change > FIELD_CHANGE
    if disturbed.any():
        share = float(problem.duration[disturbed].sum() / problem.duration.sum())
        where = "there" if share < 0.5 else f"for {100.0 * share:.0f} % of the recording"
        yield (
            f"the magnetic field changes by {100.0 * change[disturbed].max():.0f} % from "
            f"{problem.t[np.argmax(disturbed)]:.1f} s on: heading is taken from the gyro {where}; keep magnets and "
            "iron away from the hand"
        )
