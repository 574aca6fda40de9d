"""What a person knows of the stops, as linear measurements of the sensor's poses at them.

Places and heights are the tool's: it sits at the end of a lever that turns with the sensor. Only `closed` is the
sensor's own: it is back in its dock.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np

from pbd.data import Calibration, Contact, HandPath, Known, Place
from pbd.errors import PbdWarning, TrackingError
from pbd.pose import Array, Pose, quat_rotate, quat_to_matrix, skew
from pbd.tracking.attitude import mean_quaternion

SIGMA_M = 0.003
"""m per axis: by so much a hand that returns to a place, or sets a thing down at a height, misses it."""

NEAR_S = 0.5
"""A time further than this from any stop names none."""

ALL_AXES, UPWARDS = np.eye(3), np.eye(3)[2:]


BY_START, BY_MOUNT = slice(0, 6), slice(6, 9)
"""A calibration's errors: of the start's pose in base (m, rad), and of the tool in sensor axes (m)."""


@dataclass(frozen=True, eq=False)
class Claim:
    """axes @ (p_nav_sensor + lever at `stop` - the same at `other`) = value, but for noise.

    Attributes:
        saying: what is claimed, in words.
        differs: how it may differ, in words, with {} for by how much.
        entry: what in demo.toml says so.
        stop: index.
        other: index, or None for nav's origin.
        axes: (d, 3).
        value: (d,) m.
        levers: two (3,) m in nav, from the sensor to the tool, at `stop` and at `other`.
        by_calibration: (d, 9), how the value goes with the calibration's errors.
        noise: (d, d) m2, this claim's own.
        shared: (d, d) m2, common to all claims of one `group`.
        group: any number.
    """

    saying: str
    differs: str
    entry: str
    stop: int
    other: int | None
    axes: Array
    value: Array
    levers: tuple[Array, Array]
    by_calibration: Array
    noise: Array
    shared: Array
    group: int


@dataclass(frozen=True, eq=False)
class _Base:
    """The robot's base: base = T_base_nav.act(scale * nav). `table_height` in m, or None."""

    T_base_nav: Pose
    scale: float
    table_height: float | None

    def by_start(self, p_base: Array) -> Array:
        """How a point of nav, given in base, goes with the start's pose in base: (3, 6), in nav."""
        R_nav_base = quat_to_matrix(self.T_base_nav.wxyz).T
        away = skew(np.asarray(p_base) - self.T_base_nav.p)
        return np.hstack((-R_nav_base, R_nav_base @ away)) / self.scale


@dataclass(frozen=True, eq=False)
class _Tool:
    """Where the tool is beside the sensor: at each stop the lever (k, 3) m and the attitude (k, 3, 3), in nav."""

    path: HandPath
    lever: Array
    R: Array

    def levers(self, stop: int, other: int | None, scale: float = 1.0) -> tuple[Array, Array]:
        """At a stop, and at another or nav's origin, in the hand's own scale."""
        return self.lever[stop] / scale, np.zeros(3) if other is None else self.lever[other] / scale

    def by_errors(self, stop: int, other: int | None, scale: float = 1.0) -> Array:
        """How the value of a claim goes with the calibration's errors, of the mount alone: (3, 9)."""
        by = np.zeros((3, 9))
        by[:, BY_MOUNT] = ((0.0 if other is None else self.R[other]) - self.R[stop]) / scale
        return by


def claims_of(
    path: HandPath, known: Known, calibration: Calibration | None = None, T_base_nav: Pose | None = None
) -> tuple[Claim, ...]:
    """Say what is known as measurements. What can't be used without a calibration is left out, with a warning.

    Args:
        path: with its stops.
        known: what is claimed.
        calibration: the lever from sensor to tool, the table's height, the scale; without one there is no lever.
        T_base_nav: nav in base; without it positions in base and the table's height are unknown.

    Raises:
        TrackingError: a time that is in no stop; two times that should be two stops and are one.
    """
    wxyz = np.array([mean_quaternion(path.wxyz_nav_sensor[stop.start : stop.stop]) for stop in path.stops])
    p_sensor_tool = np.zeros(3) if calibration is None else calibration.T_sensor_tool.p
    tool = _Tool(path, quat_rotate(wxyz, p_sensor_tool), quat_to_matrix(wxyz))
    base = None
    if calibration is not None and T_base_nav is not None:
        base = _Base(T_base_nav, calibration.scale, calibration.table_height)
    groups = count()
    claims = []
    if known.closed and len(path.stops) > 1:
        claims.append(_closed(path, next(groups)))
    for place in known.places:
        claims.extend(_place(tool, base, place, next(groups)))
    claims.extend(_contacts(tool, base, known.contacts, groups))
    return tuple(claims)


def _closed(path: HandPath, group: int) -> Claim:
    half = 0.5 * SIGMA_M**2 * np.eye(3)
    return Claim(
        "the hand returned to its start",
        "it ended {} away",
        "the line `closed = true` at the file's top, not one of a [[grip]]",
        len(path.stops) - 1,
        0,
        ALL_AXES,
        np.zeros(3),
        (np.zeros(3), np.zeros(3)),
        np.zeros((3, 9)),
        half,
        half,
        group,
    )


def _place(tool: _Tool, base: _Base | None, place: Place, group: int) -> Iterator[Claim]:
    stops = _different_stops(tool.path, place.t, "a [[place]]")
    sigma = SIGMA_M if place.sigma_m is None else place.sigma_m
    if place.p_base_tool is not None and base is not None:
        yield from _known_place(tool, base, place, place.p_base_tool, stops, sigma, group)
        return
    if place.p_base_tool is not None:
        _left_out(
            f"without a calibration it is unknown where the place at {place.t[0]:.2f} s is in the hand's frame (nav)"
        )
    half = 0.5 * sigma**2 * np.eye(3)
    for t, stop in zip(place.t[1:], stops[1:], strict=True):
        yield Claim(
            f"the tool at {t:.2f} s (stop {stop}) is where it was at {place.t[0]:.2f} s (stop {stops[0]})",
            "it is {} off",
            "that [[place]]",
            stop,
            stops[0],
            ALL_AXES,
            np.zeros(3),
            tool.levers(stop, stops[0]),
            tool.by_errors(stop, stops[0]),
            half,
            half,
            group,
        )


def _known_place(
    tool: _Tool,
    base: _Base,
    place: Place,
    p_base_tool: tuple[float, float, float],
    stops: tuple[int, ...],
    sigma: float,
    group: int,
) -> Iterator[Claim]:
    """T_base_nav.act(scale * p_nav_sensor + lever) = p_base_tool, solved for p_nav_sensor."""
    from_origin = base.T_base_nav.inverse().act(p_base_tool)
    for t, stop in zip(place.t, stops, strict=True):
        by_calibration = tool.by_errors(stop, None, base.scale)
        by_calibration[:, BY_START] = base.by_start(np.asarray(p_base_tool))
        yield Claim(
            f"the tool at {t:.2f} s (stop {stop}) is at {', '.join(f'{x:.3f}' for x in p_base_tool)} m in base",
            "it is {} off",
            "that [[place]]",
            stop,
            None,
            ALL_AXES,
            from_origin / base.scale,
            tool.levers(stop, None, base.scale),
            by_calibration,
            sigma**2 * np.eye(3) / base.scale**2,
            np.zeros((3, 3)),
            group,
        )


def _contacts(tool: _Tool, base: _Base | None, contacts: tuple[Contact, ...], groups: Iterator[int]) -> Iterator[Claim]:
    on_table = [contact for contact in contacts if contact.as_at is None and contact.height is None]
    stops = _different_stops(tool.path, tuple(contact.t for contact in on_table), "[[contact]] with the table")
    table = list(zip(on_table, stops, strict=True))
    if base is not None and base.table_height is not None:
        for contact, stop in table:
            yield _at_table(tool, base, base.table_height, contact, stop, next(groups))
    elif len(table) == 1:
        _left_out(f"the contact at {on_table[0].t:.2f} s is the only one, and the table's height is not known")
    elif table:
        (first, first_stop), group = table[0], next(groups)
        at = f"on the table as at {first.t:.2f} s (stop {first_stop})"
        for contact, stop in table[1:]:
            yield _height(tool, contact, (stop, first_stop), at, 0.0, _variance(first), group)
    for contact in contacts:
        if contact.as_at is not None:
            pair = _different_stops(tool.path, (contact.t, contact.as_at), "a [[contact]] with its as_at_s")
            at = f"as high as at {contact.as_at:.2f} s (stop {pair[1]})"
            yield _height(tool, contact, pair, at, 0.0, _variance(contact), next(groups))
        elif contact.height is not None:
            (stop,) = _different_stops(tool.path, (contact.t,), "a [[contact]]")
            at = f"{contact.height:.3f} m above its first rest"
            yield _height(tool, contact, (stop, 0), at, contact.height, _variance(contact), next(groups))


def _at_table(tool: _Tool, base: _Base, table_height: float, contact: Contact, stop: int, group: int) -> Claim:
    up = quat_to_matrix(base.T_base_nav.wxyz)[2:]  # base's z axis in nav
    by_calibration = tool.by_errors(stop, None, base.scale)
    p_nav_sensor = tool.path.p_nav_sensor[tool.path.stops[stop].start]
    p_base_tool = base.T_base_nav.act(base.scale * p_nav_sensor + tool.lever[stop])
    by_calibration[:, BY_START] = base.by_start(p_base_tool)
    return Claim(
        f"the tool at {contact.t:.2f} s (stop {stop}) is on the table",
        "it is {} off",
        "that [[contact]], or say as_at_s there",
        stop,
        None,
        up,
        (table_height - base.T_base_nav.p[2:]) / base.scale,
        tool.levers(stop, None, base.scale),
        up @ by_calibration,
        2.0 * _variance(contact) / base.scale**2,
        np.zeros((1, 1)),
        group,
    )


def _height(
    tool: _Tool, contact: Contact, pair: tuple[int, ...], at: str, above: float, shared: Array, group: int
) -> Claim:
    """The tool is so much `above` where it is at the other stop of the pair."""
    stop, other = pair
    return Claim(
        f"the tool at {contact.t:.2f} s (stop {stop}) is {at}",
        "it is {} off",
        "that [[contact]]",
        stop,
        other,
        UPWARDS,
        np.array([above]),
        tool.levers(stop, other),
        UPWARDS @ tool.by_errors(stop, other),
        _variance(contact),
        shared,
        group,
    )


def _variance(contact: Contact) -> Array:
    """Of one visit, (1, 1) m2: two of them differ by sigma."""
    sigma = SIGMA_M if contact.sigma_m is None else contact.sigma_m
    return np.array([[0.5 * sigma**2]])


def _different_stops(path: HandPath, times: tuple[float, ...], what: str) -> tuple[int, ...]:
    """Index of the stop at (or nearest to) each time; no two may be in one stop."""
    found: dict[int, float] = {}
    begins, ends = path.t[[stop.start for stop in path.stops]], path.t[[stop.stop - 1 for stop in path.stops]]
    for t in times:
        away = np.maximum(np.maximum(begins - t, t - ends), 0.0)
        stop = int(np.argmin(away))
        at = f"{path.t[path.stops[stop].start]:.2f} to {path.t[path.stops[stop].stop - 1]:.2f} s"
        if away[stop] > NEAR_S:
            raise TrackingError(
                f"{what} names {t:.2f} s, but the hand does not stop there: the nearest stop, {stop}, is from {at}; "
                "give a time within a stop",
                t=t,
                value=float(away[stop]),
                bound=NEAR_S,
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


def _left_out(why: str) -> None:
    warnings.warn(f"{why}, so it is left out; name a --calibration", PbdWarning, stacklevel=3)
