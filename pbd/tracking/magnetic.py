"""Heading from the magnetic field, where it is the earth's: a magnet or iron near the hand must not turn the path.

The field is looked at in a frame that the gyro and gravity alone hold level (VQF's 6-axis attitude). There it stands
still, but for the slow drift of heading that is to be taken out; where it is another than at the first rest, in
strength, dip or direction, it is disturbed, and heading is what the gyro makes of the undisturbed parts.

Heading is the mean over NEAR_S on either hand. VQF's own rejection of disturbances is made for longer recordings (it
takes 20 s to know the field; over the first half-minute it calls all of it disturbed), and on the benchmark's
undisturbed recordings its heading is no better than this mean.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from pbd.errors import PbdWarning
from pbd.pose import Array, quat_rotate

BLOCK_S = 0.25
"""The field is averaged over this long: a magnetometer is noisy, and a magnet near the hand stays for longer."""

STRENGTH, DIP, HEADING = 0.15, np.radians(10.0), np.radians(15.0)
"""By how much the field of a room may differ from that at the first rest: in strength (share), dip and heading.
The benchmark's undisturbed recordings have up to 0.12, 6 and 12 degrees."""

STEEP = np.radians(6.0)
"""Where the field is so steep that HEADING is less than this on its own direction, this is what counts: a wrong
vertical turns the little that lies level by more."""

DRIFT = np.radians(0.05)
"""rad/s: what the gyro's bias may turn the heading by."""

AROUND_S = 1.0
"""Around a disturbance found, so much is disturbed too."""

NEAR_S = 30.0
"""Heading is averaged over so long on either hand (a Gaussian's sigma). From 10 to 60 s it hardly matters."""


def magnetic_heading(t: Array, mag: Array, wxyz_level_sensor: Array, first_rest: slice) -> Array:
    """Angle about z, (n,) rad, from a level frame held by the gyro to nav (x east, y magnetic north), at each sample.

    Args:
        t: (n,) s.
        mag: (n, 3) in any unit.
        wxyz_level_sensor: (n, 4), attitude without magnetometer; its heading is arbitrary and drifts slowly.
        first_rest: samples of the first rest.

    Warns where the field is disturbed.
    """
    every = max(1, round(BLOCK_S / float(np.median(np.diff(t)))))
    starts = np.arange(0, len(t), every)
    field = quat_rotate(wxyz_level_sensor, mag)
    seen = np.flatnonzero(field.any(axis=1))  # a magnetometer may start late: then its first field is the usual one
    at_rest = seen[(seen >= first_rest.start) & (seen < first_rest.stop)]
    usual = field[at_rest if len(at_rest) else seen[: first_rest.stop - first_rest.start]].mean(axis=0)
    size = np.diff(starts, append=len(t))[:, None]
    blocks = np.add.reduceat(field, starts) / size
    at = np.add.reduceat(t, starts) / size[:, 0]

    disturbed = _disturbed(at, blocks, usual, float(t[first_rest].mean()))
    trusted = ~disturbed
    if disturbed.any():
        change = np.linalg.norm(blocks - usual, axis=1) / np.linalg.norm(usual)
        _warn(at, change, disturbed)
        around = round(AROUND_S / BLOCK_S)
        trusted = ~_spread(disturbed, around)
    if not trusted.any():
        blocks = np.vstack((blocks, usual))  # nothing else to hold on to
        trusted = np.append(trusted, True)
        at = np.append(at, at[-1])
    heading = np.unwrap(_near_mean(blocks[:, :2], trusted))
    return 0.5 * np.pi - np.interp(t, at, heading)


def _spread(flags: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    from scipy.ndimage import maximum_filter1d

    spread: NDArray[np.bool_] = maximum_filter1d(flags, 2 * reach + 1)
    return spread


def _disturbed(t: Array, field: Array, usual: Array, t_rest: float) -> NDArray[np.bool_]:
    strength = np.linalg.norm(field, axis=1) / np.linalg.norm(usual) - 1.0
    dip = np.arctan2(field[:, 2], np.hypot(field[:, 0], field[:, 1])) - np.arctan2(usual[2], np.hypot(*usual[:2]))
    turned = np.arctan2(usual[0] * field[:, 1] - usual[1] * field[:, 0], field[:, :2] @ usual[:2])
    disturbed: NDArray[np.bool_] = np.abs(strength) > STRENGTH
    disturbed |= np.abs(dip) > DIP
    heading = max(HEADING, STEEP * float(np.linalg.norm(usual) / max(np.hypot(*usual[:2]), 1e-12)))
    disturbed |= np.abs(turned) > heading + DRIFT * np.abs(t - t_rest)
    return disturbed


def _near_mean(level: Array, trusted: NDArray[np.bool_]) -> Array:
    """Direction (m,) rad of the level field (m, 2), averaged over the trusted blocks near each."""
    from scipy.ndimage import gaussian_filter1d

    unit = trusted[:, None] * level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    # Far from all trusted blocks the nearest ones count: no weight is quite zero.
    near = gaussian_filter1d(unit, NEAR_S / BLOCK_S, axis=0, mode="constant", truncate=4.0) + 1e-9 * unit.sum(axis=0)
    direction: Array = np.arctan2(near[:, 1], near[:, 0])
    return direction


def _warn(t: Array, change: Array, disturbed: NDArray[np.bool_]) -> None:
    first = int(np.argmax(disturbed))
    share = float(disturbed.mean())
    where = "there" if share < 0.5 else f"for {100.0 * share:.0f} % of the recording"
    warnings.warn(
        f"the magnetic field changes by {100.0 * change[disturbed].max():.0f} % from {t[first]:.1f} s on: heading is "
        f"taken from the gyro {where}; keep magnets and iron away from the hand",
        PbdWarning,
        stacklevel=4,
    )
