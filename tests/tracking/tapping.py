"""Add taps on a sensor's back to its readings: a blow, and the motion of the hand that damps it."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from pbd.data import Recording

BLOW_S, SPRING_HZ, DAMPING = 0.008, 18.0, 0.35
"""s: duration of a blow, half a sine. The hand yields as a damped spring, so that the sensor returns to its place."""


def tapped(recording: Recording, blows: Iterable[tuple[float, float]], lean: float = 0.3) -> Recording:
    """Add taps of given strength (m/s2) at given times (s). As in all samples, readings are means over intervals.

    Args:
        recording: of a sensor at rest at those times.
        blows: (s, m/s2).
        lean: share of the blow along x.
    """
    fine = 1e-4
    steps = np.arange(0.0, 0.4, fine)
    force = np.where(steps < BLOW_S, np.sin(np.pi * np.minimum(steps, BLOW_S) / BLOW_S), 0.0)
    x, v, felt = 0.0, 0.0, np.empty(len(steps))
    w = 2.0 * np.pi * SPRING_HZ
    for k, push in enumerate(force):  # a mass of 1 on a damped spring
        felt[k] = push - 2.0 * DAMPING * w * v - w * w * x
        v += felt[k] * fine
        x += v * fine
    speed = np.concatenate(([0.0], np.cumsum(felt) * fine))  # of which the readings are differences
    edges = np.append(recording.t, 2.0 * recording.t[-1] - recording.t[-2]) - 0.5 / recording.rate_hz
    acc = recording.acc.copy()
    for at, peak in blows:
        gained = np.interp(edges - at, np.append(steps, 0.4), speed, left=0.0, right=0.0)
        read = peak * np.diff(gained) / np.diff(edges)
        acc[:, 2] += read
        acc[:, 0] += lean * read
    return replace(recording, acc=acc)
