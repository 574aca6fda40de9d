"""Condition a take's marginal on what a person knows of its stops (`closed`, places, contacts)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import Calibration, Place, Stop
from pbd.errors import collected_warnings, naming
from pbd.fusion.marginals import Marginal, conditioned
from pbd.fusion.takes import Take
from pbd.pose import Array, Pose, quat_from_matrix, quat_multiply
from pbd.tracking.apply_constraints import fits_of, measurement_of
from pbd.tracking.stop_constraints import claims_of


def condition_on_known_stops(
    take: Take, marginal: Marginal, Q: Array, lever: Array, calibration: Calibration | None, refuse: bool
) -> Marginal:
    """Return a take's marginal, conditioned on what its demo.toml says of its stops.

    Points given in base are not used here; the fused path uses them (`points_in_base`).

    Args:
        take, marginal: a take and its marginal, not conditioned yet.
        Q, lever: (2, 3, 3) and (3,) m, the sensor's rotation (in the dock, and away from it) and shift in the hand,
            relative to the first take.
        calibration: its mount is that of the first take.
        refuse: raise an error where a claim contradicts the take. Not for first guesses of Q and lever.

    Raises:
        TrackingError: what is known contradicts the take, or names no stop.
    """
    tracking, mount = take.path.tracking, calibration or Calibration("unknown")
    assert tracking is not None
    known = tracking.demo.known
    known = replace(known, places=tuple(place for place in known.places if place.p_base_tool is None))
    T_sensor_tool = Pose(mount.T_sensor_tool.p - lever, mount.T_sensor_tool.wxyz)
    away = (np.arange(len(take.path.t)) >= take.path.stops[0].stop).astype(int)
    wxyz = quat_multiply(take.path.wxyz_nav_sensor, quat_from_matrix(Q)[away])
    # claims_of warns of a single contact with a table of unknown height. Here such a contact just says nothing.
    with collected_warnings(), naming(take.name):
        mounted = replace(mount, T_sensor_tool=T_sensor_tool)
        claims = claims_of(replace(take.path, wxyz_nav_sensor=wxyz), known, mounted)
        if not claims:
            return marginal
        G, noise, misfit = measurement_of(claims, marginal.p, mount)
        G = G.reshape(-1, len(misfit))
        if refuse:
            fits_of(take.path, claims, misfit, G.T @ marginal.cov_poses @ G + noise)
    return conditioned(marginal, G, noise, misfit)


def points_in_base(
    takes: Sequence[Take], own: Sequence[Sequence[int | None]], stops: Sequence[Stop], t: Array
) -> tuple[Place, ...]:
    """Return the places in base that takes know, each at the time of its keyframe in the fused path.

    Each keyframe counts once, because the dock's error is the same in all takes.

    Args:
        takes, own: those in the estimate; of each, its own keyframe at each of the task's keyframes, or None.
        stops, t: the fused path's stops, and its times (n,) s.
    """
    found: dict[int, Place] = {}
    for take, indices in zip(takes, own, strict=True):
        assert take.path.tracking is not None
        middles = np.array([keyframe.t for keyframe in take.keyframes])
        for place in take.path.tracking.demo.places:
            for when in place.t if place.p_base_tool is not None else ():
                nearest = int(np.argmin(np.abs(middles - when)))
                if nearest in indices:
                    j = indices.index(nearest)
                    found.setdefault(j, replace(place, t=(stops[j].middle_s(t),)))
    return tuple(found.values())
