"""Turn what a person knows of the stops (`Known`: places, heights, closed) into linear constraints on their poses.

Places and heights are those of the tool, at the end of a lever that turns with the sensor. `closed` is about the sensor
itself, which is back in its dock.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from pbd.data import Calibration, Contact, HandPath, Known, Place
from pbd.errors import TrackingError, warn
from pbd.pose import Array, Pose, quat_rotate, quat_to_matrix, skew
from pbd.tracking.keyframes import NEAR_STOP_S, nearest_stop
from pbd.tracking.smoother.attitude import mean_quaternion

PLACE_SIGMA_M = 0.003
"""m per axis: one sigma with which a hand returns to a place or a height, if demo.toml gives none."""

ALL_AXES, UPWARDS = np.eye(3), np.eye(3)[2:]

START_ERRORS, MOUNT_ERRORS = slice(0, 6), slice(6, 9)
"""Columns of `Claim.by_calibration`: errors of the start's pose in base (m, rad) and of the tool in sensor axes (m)."""


@dataclass(frozen=True, eq=False)
class Claim:
    """One constraint: axes @ ((p_nav_sensor + lever) at `stop` - the same at `other`) = value + noise.

    Attributes:
        saying: the claim in words.
        entry: its entry in demo.toml.
        stop, other: indices of stops; `other` None: nav's origin.
        axes: (d, 3), directions in nav.
        value: (d,) m.
        levers: two (3,) m in nav, from the sensor to the tool, at `stop` and at `other`.
        by_calibration: (d, 9), derivative of the misfit with respect to the calibration's errors.
        own_variance, shared_variance: m2 per axis, of this claim's own noise, and of the noise that all claims of its
            `group` have in common.
        group: number of the group.
        converse: the claim in words if the visit at `other` is the one that is off; "" if it can't be.
        differs: the misfit in words, with {} for its size.
    """

    saying: str
    entry: str
    stop: int
    other: int | None
    axes: Array
    value: Array
    levers: tuple[Array, Array]
    by_calibration: Array
    own_variance: float
    shared_variance: float
    group: int
    converse: str = ""
    differs: str = "it is {} off"


@dataclass(frozen=True, eq=False)
class _Tool:
    """The tool's position relative to the sensor, and nav's pose in base.

    Attributes:
        path: with k stops.
        lever: (k, 3) m in base's lengths and nav's axes, from the sensor to the tool at each stop.
        R: (k, 3, 3) nav <- sensor at each stop.
        scale: base lengths per nav length.
        T_base_nav: a point p of nav is at T_base_nav.act(scale * p) in base; None if unknown.
        table_height: m in base, or None.
    """

    path: HandPath
    lever: Array
    R: Array
    scale: float
    T_base_nav: Pose | None = None
    table_height: float | None = None

    def claim_same_point(
        self,
        saying: str,
        entry: str,
        stops: tuple[int, int],
        group: int,
        variances: tuple[float, float],
        above: float | None = None,
    ) -> Claim:
        """The tool is at the same point at two stops; with `above`, it is only known to be that much higher (m)."""
        stop, other = stops
        axes, value = (ALL_AXES, np.zeros(3)) if above is None else (UPWARDS, np.array([above / self.scale]))
        by = np.zeros((3, 9))
        by[:, MOUNT_ERRORS] = (self.R[other] - self.R[stop]) / self.scale
        levers = (self.lever[stop] / self.scale, self.lever[other] / self.scale)
        own, shared = (each / self.scale**2 for each in variances)
        return Claim(saying, entry, stop, other, axes, value, levers, axes @ by, own, shared, group)

    def claim_at_point(
        self, saying: str, entry: str, stop: int, group: int, variance: float, p_base: Array, axes_base: Array
    ) -> Claim:
        """The tool is at a known point of base, along some of base's axes."""
        assert self.T_base_nav is not None
        R_base_nav = quat_to_matrix(self.T_base_nav.wxyz)
        away = np.asarray(p_base) - self.T_base_nav.p
        by = np.zeros((3, 9))
        by[:, START_ERRORS] = np.hstack((-R_base_nav.T, R_base_nav.T @ skew(away)))
        by[:, MOUNT_ERRORS] = -self.R[stop]
        axes, nothing = axes_base @ R_base_nav, np.zeros(3)
        levers, value = (self.lever[stop] / self.scale, nothing), axes_base @ away / self.scale
        own = variance / self.scale**2
        return Claim(saying, entry, stop, None, axes, value, levers, axes @ by / self.scale, own, 0.0, group)


def claims_of(
    path: HandPath, known: Known, calibration: Calibration | None = None, T_base_nav: Pose | None = None
) -> tuple[Claim, ...]:
    """The constraints that follow from what is known. One that needs a missing calibration is left out, with a warning.

    Args:
        path, known: as tracked; what a person knows of its stops.
        calibration: gives the lever from sensor to tool (else 0), the table's height and the scale.
        T_base_nav: nav in base; without it positions in base and the table's height can't be used.

    Raises:
        TrackingError: a time is in no stop, or two times of different stops are in one.
    """
    if known == Known():
        return ()
    wxyz = np.array([mean_quaternion(path.wxyz_nav_sensor[stop.start : stop.stop]) for stop in path.stops])
    p_sensor_tool = np.zeros(3) if calibration is None else calibration.T_sensor_tool.p
    scale = 1.0 if calibration is None else calibration.scale
    tool = _Tool(path, quat_rotate(wxyz, p_sensor_tool), quat_to_matrix(wxyz), scale)
    if calibration is not None and T_base_nav is not None:
        tool = replace(tool, T_base_nav=T_base_nav, table_height=calibration.table_height)
    groups = count()
    claims = []
    if known.closed and len(path.stops) > 1:
        claims.append(_closed(path, next(groups)))
    for place in known.places:
        claims.extend(_place(tool, place, next(groups)))
    claims.extend(_contacts(tool, known.contacts, groups))
    return tuple(claims)


def _closed(path: HandPath, group: int) -> Claim:
    nothing = np.zeros(3)
    return Claim(
        "the hand returned to its start",
        "the line `closed = true` at the file's top, not one of a [[grip]]",
        *(len(path.stops) - 1, 0, ALL_AXES, nothing, (nothing, nothing), np.zeros((3, 9))),
        *(0.5 * PLACE_SIGMA_M**2, 0.5 * PLACE_SIGMA_M**2, group),
        differs="it ended {} away",
    )


def _place(tool: _Tool, place: Place, group: int) -> Iterator[Claim]:
    stops = _different_stops(tool.path, place.t, "a [[place]]")
    variance = (PLACE_SIGMA_M if place.sigma_m is None else place.sigma_m) ** 2
    if place.p_base_tool is not None and tool.T_base_nav is not None:
        at = f"is at {', '.join(f'{x:.3f}' for x in place.p_base_tool)} m in base"
        p_base = np.asarray(place.p_base_tool)
        for t, stop in zip(place.t, stops, strict=True):
            saying = f"the tool at {t:.2f} s (stop {stop}) {at}"
            entry = "that [[place]], or correct the dock (--calibration; each robot's own is elsewhere)"
            yield tool.claim_at_point(saying, entry, stop, group, variance, p_base, ALL_AXES)
        return
    if place.p_base_tool is not None:
        _warn_left_out(
            f"without a calibration it is unknown where the place at {place.t[0]:.2f} s is in the hand's frame (nav)"
        )
    first, *others = [f"at {t:.2f} s (stop {stop})" for t, stop in zip(place.t, stops, strict=True)]
    entry = "that [[place]]" if len(stops) == 2 else "that time from its [[place]]"
    variances = (0.5 * variance, 0.5 * variance)
    for at, stop in zip(others, stops[1:], strict=True):
        saying, converse = (f"the tool {one} is where it was {other}" for one, other in ((at, first), (first, at)))
        claim = tool.claim_same_point(saying, entry, (stop, stops[0]), group, variances)
        yield replace(claim, converse=converse)


def _contacts(tool: _Tool, contacts: tuple[Contact, ...], groups: Iterator[int]) -> Iterator[Claim]:
    on_table = [contact for contact in contacts if contact.as_at is None and contact.height is None]
    stops = _different_stops(tool.path, tuple(contact.t for contact in on_table), "[[contact]] with the table")
    if tool.table_height is not None:
        for contact, stop in zip(on_table, stops, strict=True):
            yield _at_table(tool, tool.table_height, contact, stop, next(groups))
    elif len(on_table) == 1:
        _warn_left_out(f"the contact at {on_table[0].t:.2f} s is the only one, and the table's height is not known")
    elif on_table:
        first, group = on_table[0], next(groups)
        at = f"on the table as at {first.t:.2f} s (stop {stops[0]})"
        for contact, stop in zip(on_table[1:], stops[1:], strict=True):
            claim = _height(tool, contact, (stop, stops[0]), at, group, shared=_variance(first))
            tool_at_first = f"the tool at {first.t:.2f} s (stop {stops[0]})"
            yield replace(claim, converse=f"{tool_at_first} is on the table as at {contact.t:.2f} s (stop {stop})")
    for contact in contacts:
        if contact.as_at is not None:
            stop, other = _different_stops(tool.path, (contact.t, contact.as_at), "a [[contact]] with its as_at_s")
            at = f"as high as at {contact.as_at:.2f} s (stop {other})"
            yield _height(tool, contact, (stop, other), at, next(groups), shared=_variance(contact))
        elif contact.height is not None:
            (stop,) = _different_stops(tool.path, (contact.t,), "a [[contact]]")
            at, shared = f"{contact.height:.3f} m above its first rest", _variance(contact)
            yield _height(tool, contact, (stop, 0), at, next(groups), shared, above=contact.height)


def _at_table(tool: _Tool, table_height: float, contact: Contact, stop: int, group: int) -> Claim:
    assert tool.T_base_nav is not None
    p_nav_sensor = tool.path.p_nav_sensor[tool.path.stops[stop].start]
    x, y, _ = tool.T_base_nav.act(tool.scale * p_nav_sensor + tool.lever[stop])
    saying, entry = (
        f"the tool at {contact.t:.2f} s (stop {stop}) is on the table",
        "that [[contact]], say as_at_s there, correct the calibration's table_height",
    )
    p_base = np.array([x, y, table_height])
    return tool.claim_at_point(saying, entry, stop, group, 2.0 * _variance(contact), p_base, UPWARDS)


def _height(
    tool: _Tool, contact: Contact, stops: tuple[int, int], at: str, group: int, shared: float, above: float = 0.0
) -> Claim:
    """The tool is `above` m higher than at the other stop."""
    saying = f"the tool at {contact.t:.2f} s (stop {stops[0]}) is {at}"
    variances = (_variance(contact), shared)
    return tool.claim_same_point(saying, "that [[contact]]", stops, group, variances, above)


def _variance(contact: Contact) -> float:
    """Variance of one visit, m2: the difference of two visits has the contact's sigma."""
    return 0.5 * (PLACE_SIGMA_M if contact.sigma_m is None else contact.sigma_m) ** 2


def _different_stops(path: HandPath, times: tuple[float, ...], what: str) -> tuple[int, ...]:
    """Index of the stop at or near each time. No two times may be in one stop."""
    found: dict[int, float] = {}
    for t in times:
        stop, away = nearest_stop(path.t, path.stops, t)
        at = f"{path.t[path.stops[stop].start]:.2f} to {path.t[path.stops[stop].stop - 1]:.2f} s"
        if away > NEAR_STOP_S:
            raise TrackingError(
                f"{what} names {t:.2f} s, but the hand does not stop there: the nearest stop, {stop}, is from {at}; "
                "give a time within a stop",
                t=t,
                value=away,
                bound=NEAR_STOP_S,
                stop=stop,
            )
        if stop in found:
            raise TrackingError(
                f"{what} names {found[stop]:.2f} and {t:.2f} s, but both are in one stop, {stop}, from {at}; "
                "give times within different stops",
                t=t,
                stop=stop,
            )
        found[stop] = t
    return tuple(found)


def _warn_left_out(why: str) -> None:
    warn(f"{why}, so it counts only with a robot or a --calibration")
