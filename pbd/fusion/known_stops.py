"""What a person knows of a take's stops (`closed`, places, contacts), told to its marginal."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import Calibration, Place, Stop
from pbd.errors import PbdWarning, TrackingError
from pbd.fusion.marginals import Marginal, conditioned
from pbd.fusion.takes import Take
from pbd.pose import Array, Pose, quat_from_matrix, quat_multiply
from pbd.tracking.apply_constraints import fits_of, measurement_of
from pbd.tracking.stop_constraints import claims_of


def told(
    take: Take, marginal: Marginal, Q: Array, lever: Array, calibration: Calibration | None, refuse: bool
) -> Marginal:
    """A marginal with what the take's demo.toml knows; points of base are for the fused path (`points_of_base`).

    Args:
        take: as tracked.
        marginal: of it, without that.
        Q: (3, 3), lever: (3,) m: how its sensor sits in the hand against the first take's.
        calibration: whose mount is the first take's.
        refuse: raise where a claim contradicts the take; not for the first guess of Q and lever.

    Raises:
        TrackingError: what is known contradicts the take, or names no stop.
    """
    tracking, mount = take.path.tracking, calibration or Calibration("unknown")
    assert tracking is not None
    known = tracking.demo.known
    known = replace(known, places=tuple(place for place in known.places if place.p_base_tool is None))
    tool = Pose(mount.T_sensor_tool.p - lever, mount.T_sensor_tool.wxyz)
    wxyz = quat_multiply(take.path.wxyz_nav_sensor, quat_from_matrix(Q))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)  # of a single contact with the table: it says nothing here
        try:
            claims = claims_of(replace(take.path, wxyz_nav_sensor=wxyz), known, replace(mount, T_sensor_tool=tool))
            if not claims:
                return marginal
            G, noise, misfit = measurement_of(claims, marginal.p, mount)
            G = G.reshape(-1, len(misfit))
            if refuse:
                fits_of(take.path, claims, misfit, G.T @ marginal.of_poses @ G + noise)
        except TrackingError as error:
            raise TrackingError(f"{take.name}: {error.message}", **error.fields) from None
    return conditioned(marginal, G, noise, misfit)


def points_of_base(
    takes: Sequence[Take], own: Sequence[Sequence[int | None]], stops: Sequence[Stop], t: Array
) -> tuple[Place, ...]:
    """Where takes know a keyframe to be in base, at the fused path's time: once each, as the dock errs in all alike.

    Args:
        takes: those that are used.
        own: of each its keyframe for each of the task's.
        stops: of the fused path, at t (n,) s.
    """
    found: dict[int, Place] = {}
    for take, mine in zip(takes, own, strict=True):
        assert take.path.tracking is not None
        middles = np.array([keyframe.t for keyframe in take.keyframes])
        for place in take.path.tracking.demo.places:
            for when in place.t if place.p_base_tool is not None else ():
                nearest = int(np.argmin(np.abs(middles - when)))
                if nearest in mine:
                    j = mine.index(nearest)
                    middle = 0.5 * float(t[stops[j].start] + t[stops[j].stop - 1])
                    found.setdefault(j, replace(place, t=(middle,)))
    return tuple(found.values())
