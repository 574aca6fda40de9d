"""Damage by the sensor, its wires, its files or the hand, applied to a demonstration with its truth.

Truth and recording have the same rows. A damage that changes the rows changes both.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Demonstration, Recording, Truth
from pbd.pose import (
    Array,
    lengths,
    quat_exp,
    quat_from_rpy,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_slerp,
    quat_to_rpy,
)
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.tasks import Task
from tests.scenarios import with_channel, with_rows

Rows = NDArray[np.intp]
Damage = Callable[[Demonstration, np.random.Generator], Demonstration]
Change = Callable[[Task, np.random.Generator], Task]

AXES = "xyz"

STILL_M_S, STILL_RAD_S, REST_S = 1e-3, np.radians(0.5), 0.25
"""The true hand rests if it is slower than STILL_M_S (m/s) and STILL_RAD_S (rad/s) for REST_S (s)."""


# --- where the hand rests and moves ---


def truth_of(demo: Demonstration) -> Truth:
    assert demo.truth is not None
    return demo.truth


def resting(truth: Truth) -> NDArray[np.bool_]:
    """The rows (n,) at which the hand rests, for any duration."""
    dt = np.diff(truth.t)
    gone = lengths(np.diff(truth.p_nav_sensor, axis=0)) < STILL_M_S * dt
    turn = quat_log(quat_multiply(quat_inverse(truth.wxyz_nav_sensor[:-1]), truth.wxyz_nav_sensor[1:]))
    still = gone & (lengths(turn) < STILL_RAD_S * dt)
    return np.concatenate((still, [False])) | np.concatenate(([False], still))


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def rests(truth: Truth) -> list[tuple[int, int]]:
    """Half-open ranges of rows in which the hand rests long enough to be a stop."""
    return [(a, b) for a, b in runs(resting(truth)) if truth.t[b - 1] - truth.t[a] > REST_S]


def row_in_move(demo: Demonstration, rng: np.random.Generator) -> int:
    return int(rng.choice(np.flatnonzero(~resting(truth_of(demo)))))


def row_anywhere(demo: Demonstration, rng: np.random.Generator) -> int:
    """A random row after the first second."""
    return int(rng.integers(round(demo.recording.rate_hz), len(demo.recording) - 3))


def samples(demo: Demonstration, seconds: float) -> int:
    return max(1, round(seconds * demo.recording.rate_hz))


# --- channels ---


def with_values(demo: Demonstration, channel: str, change: Callable[[Array], Array]) -> Demonstration:
    """Change one channel; a sensor without it is unchanged."""
    values = getattr(demo.recording, channel)
    if values is None:
        return demo
    return replace(demo, recording=with_channel(demo.recording, channel, change(np.array(values))))


def set_rows(values: Array, rows: slice, to: Array | float) -> Array:
    values[rows] = to
    return values


def scaled(channel: str, factor: float, axis: int | None = None) -> Damage:
    gain = np.full(3, factor) if axis is None else np.where(np.arange(3) == axis, factor, 1.0)
    return lambda demo, rng: with_values(demo, channel, lambda values: values * gain)


def swapped(channel: str, a: int, b: int) -> Damage:
    order = np.arange(3)
    order[[a, b]] = b, a
    return lambda demo, rng: with_values(demo, channel, lambda values: values[:, order])


def stuck(channel: str, axis: int, from_start: bool) -> Damage:
    """An axis repeats one value: 0 from the start, or its last value from a random row in a move on."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row = 0 if from_start else row_in_move(demo, rng)

        def change(values: Array) -> Array:
            values[row:, axis] = 0.0 if from_start else values[row, axis]
            return values

        return with_values(demo, channel, change)

    return damage


def clipped(channel: str, limit: float) -> Damage:
    return lambda demo, rng: with_values(demo, channel, lambda values: np.clip(values, -limit, limit))


def wrapped(channel: str, limit: float) -> Damage:
    """An integer overflow: readings above +limit continue at -limit."""
    return lambda demo, rng: with_values(demo, channel, lambda v: (v + limit) % (2.0 * limit) - limit)


def frozen(channels: tuple[str, ...], seconds: float) -> Damage:
    """Channels repeat one sample for a while, from a random row in a move on."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row = row_in_move(demo, rng)
        held = slice(row, row + samples(demo, seconds))
        for channel in channels:
            demo = with_values(demo, channel, lambda values: set_rows(values, held, values[row]))
        return demo

    return damage


def spiked(channel: str, size: float, rows: int, count: int) -> Damage:
    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        for _ in range(count):
            row, axis, sign = row_anywhere(demo, rng), int(rng.integers(3)), rng.choice((-1.0, 1.0))

            def change(values: Array, row: int = row, axis: int = axis, sign: float = sign) -> Array:
                values[row : row + rows, axis] += sign * size
                return values

            demo = with_values(demo, channel, change)
        return demo

    return damage


def stepped(channel: str, size: float) -> Damage:
    """A bias in a random direction begins at a random row and stays."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row, way = row_anywhere(demo, rng), rng.normal(size=3)
        step = size * way / np.linalg.norm(way)
        return with_values(demo, channel, lambda values: values + (np.arange(len(values)) >= row)[:, None] * step)

    return damage


def noisy(channel: str, rms: float, seconds: float) -> Damage:
    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row = row_anywhere(demo, rng)
        rows = slice(row, min(row + samples(demo, seconds), len(demo.recording)))
        noise = rng.normal(scale=rms, size=(rows.stop - rows.start, 3))
        return with_values(demo, channel, lambda values: set_rows(values, rows, values[rows] + noise))

    return damage


def vibrating(
    acc: float, gyr: float, frequency: tuple[float, float], averaged: bool, on_off: tuple[float, float] | None = None
) -> Damage:
    """A machine near by: a sine sampled at instants, or averaged over the sampling interval.

    It runs from start to end, or is switched on and off at intervals (shortest and longest, s); it takes 0.1 s to
    speed up.
    """

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        f, t = rng.uniform(*frequency), demo.recording.t
        loss = np.sinc(f / demo.recording.rate_hz) if averaged else np.float64(1.0)
        if on_off is not None:
            switched = t[0] + np.cumsum(rng.uniform(*on_off, size=1 + int(t[-1] / on_off[0])))
            k = np.searchsorted(switched, t)
            since = t - np.append(t[0] - 1.0, switched)[k]
            loss = loss * np.clip(np.where(k % 2, 1.0 - 10.0 * since, 10.0 * since), 0.0, 1.0)
        for channel, size in (("acc", acc), ("gyr", gyr)):
            way, phase = rng.normal(size=3), rng.uniform(0.0, 2.0 * np.pi)
            wave = size * (loss * np.sin(2.0 * np.pi * f * t + phase))[:, None] * way / np.linalg.norm(way)
            demo = with_values(demo, channel, lambda values, wave=wave: values + wave)  # type: ignore[misc]
        return demo

    return damage


def knocked(size: float, limit: float = np.inf) -> Damage:
    """Once a second something taps the hand, which rings at 20 to 60 Hz and is back within 0.2 s.

    A tap accelerates the hand by up to `size` m/s2. Samples are means, of a sensor whose range is `limit` m/s2.
    """

    def ring(s: Array, hz: float, fades_s: float) -> Array:
        """The hand's way, s seconds after a tap."""
        after = np.maximum(s, 0.0)
        way: Array = -np.expm1(-((after / 0.004) ** 2)) * np.exp(-after / fades_s) * np.sin(2.0 * np.pi * hz * after)
        return way

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t, interval, fine = demo.recording.t, 1.0 / demo.recording.rate_hz, 1e-4
        pushed, every = np.zeros_like(demo.recording.acc), np.arange(-0.01, 0.3, fine)
        for start in np.cumsum(rng.exponential(1.0, size=int(t[-1]))) + 2.0:
            hz, fades_s, way = rng.uniform(20.0, 60.0), rng.uniform(0.01, 0.03), rng.normal(size=3)
            hardest = np.abs(np.diff(ring(every, hz, fades_s), 2)).max() / fine**2
            ends = np.add.outer(t - start, 0.5 * interval * np.array([-1.0, 1.0]))
            v = (ring(ends + 0.5 * fine, hz, fades_s) - ring(ends - 0.5 * fine, hz, fades_s)) / fine
            pushed += np.outer(np.diff(v)[:, 0] / interval * size / hardest, way / np.linalg.norm(way))
        return with_values(demo, "acc", lambda acc: np.clip(acc + pushed, -limit, limit))

    return damage


def magnet_passing(size: float, seconds: float) -> Damage:
    """A magnet comes and goes; size in uT."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t, way = demo.recording.t, rng.normal(size=3)
        bump = np.exp(-0.5 * ((t - rng.uniform(t[0], t[-1])) / (0.3 * seconds)) ** 2)
        return with_values(demo, "mag", lambda mag: mag + size * bump[:, None] * way / np.linalg.norm(way))

    return damage


def hard_iron(size: float) -> Damage:
    """A magnet in the hand; size in uT."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        way = rng.normal(size=3)
        return with_values(demo, "mag", lambda mag: mag + size * way / np.linalg.norm(way))

    return damage


# --- rows and times ---


def with_rows_of(demo: Demonstration, rows: Rows) -> Demonstration:
    """Some of the rows, in a given order, with the time stamps of an unbroken recording."""
    truth, n = truth_of(demo), len(rows)
    t = np.arange(n) / demo.recording.rate_hz if n > len(demo.recording) else demo.recording.t[:n]
    return replace(
        demo,
        recording=replace(with_rows(demo.recording, rows), t=t),
        truth=Truth(t, truth.p_nav_sensor[rows], truth.wxyz_nav_sensor[rows]),
    )


def burst_lost(seconds: float) -> Damage:
    """Samples of a move are lost, and the time stamps do not show it."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row = row_in_move(demo, rng)
        return with_rows_of(demo, np.delete(np.arange(len(demo.recording)), slice(row, row + samples(demo, seconds))))

    return damage


def burst_doubled(seconds: float) -> Damage:
    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        row, n = row_in_move(demo, rng), len(demo.recording)
        again = np.arange(row, min(row + samples(demo, seconds), n))
        return with_rows_of(demo, np.concatenate((np.arange(again[-1] + 1), again, np.arange(again[-1] + 1, n))))

    return damage


def singles_lost(share: float) -> Damage:
    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        return with_rows_of(demo, np.flatnonzero(rng.random(len(demo.recording)) >= share))

    return damage


def singles_doubled(share: float) -> Damage:
    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        return with_rows_of(
            demo, np.repeat(np.arange(len(demo.recording)), 1 + (rng.random(len(demo.recording)) < share))
        )

    return damage


def blocks_reordered(seconds: float) -> Damage:
    """Two packets come in the wrong order. The truth keeps the right one."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        n, size = len(demo.recording), samples(demo, seconds)
        row = min(row_in_move(demo, rng), n - 2 * size)
        rows = np.arange(n)
        rows[row : row + 2 * size] = np.roll(rows[row : row + 2 * size], size)
        return replace(demo, recording=replace(with_rows(demo.recording, rows), t=demo.recording.t))

    return damage


def clock(factor: float, nominal: bool) -> Damage:
    """A clock runs `factor` times too fast; with `nominal`, as if the sensor had been set to another rate."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        truth, info = truth_of(demo), demo.recording.info
        t, rate_hz = demo.recording.t * factor, demo.recording.rate_hz / factor
        return replace(
            demo,
            recording=replace(demo.recording, t=t, info=replace(info, rate_hz=rate_hz if nominal else None)),
            truth=Truth(t, truth.p_nav_sensor, truth.wxyz_nav_sensor),
        )

    return damage


def milliseconds(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
    return clock(1e3, False)(demo, rng)


def joined(where: str) -> Damage:
    """A recording that breaks off, joined with another take from the dock: the same motion with other noise."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        truth, n = truth_of(demo), len(demo.recording)
        cut = row_in_move(demo, rng)
        if where != "in a move":
            spans = rests(truth)
            first = truth.wxyz_nav_sensor[spans[0][0]]
            turn = [lengths(quat_log(quat_multiply(quat_inverse(first), truth.wxyz_nav_sensor[a]))) for a, _ in spans]
            k = int(np.argmax(turn)) if where == "at a tilted rest" else 1
            cut = sum(spans[k]) // 2
        both = with_rows_of(demo, np.concatenate((np.arange(cut), np.arange(n))))

        def another(values: Array) -> Array:
            noise = rng.normal(scale=np.diff(values[: samples(demo, 1.0)], axis=0).std(), size=(n, 3))
            return set_rows(values, slice(cut, None), values[cut:] + noise)

        for channel in ("acc", "gyr", "mag"):
            both = with_values(both, channel, another)
        return both

    return damage


def gyro_late(seconds: float) -> Damage:
    """The gyro is late, by its filter's delay."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t = demo.recording.t
        return with_values(
            demo, "gyr", lambda gyr: np.column_stack([np.interp(t - seconds, t, axis) for axis in gyr.T])
        )

    return damage


def low_passed(channel: str, cutoff_hz: float) -> Damage:
    """A channel passes a first-order low-pass, as in the chip."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        keep = float(np.exp(-2.0 * np.pi * cutoff_hz / demo.recording.rate_hz))

        def change(values: Array) -> Array:
            for row in range(1, len(values)):
                values[row] = keep * values[row - 1] + (1.0 - keep) * values[row]
            return values

        return with_values(demo, channel, change)

    return damage


def arriving(mean_s: float) -> Damage:
    """A program stamps the samples when it gets them: random delays of this mean, one after the other."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t, info = demo.recording.t, replace(demo.recording.info, rate_hz=None)
        arrived: Array = np.maximum.accumulate(t + rng.exponential(mean_s, len(t)))
        return replace(demo, recording=replace(demo.recording, t=arrived - arrived[0], info=info))

    return damage


def polled(times: int) -> Damage:
    """A program reads the last sample this many times as often as there is a new one."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        truth = truth_of(demo)
        rows = np.repeat(np.arange(len(truth.t)), times)
        t = np.arange(len(rows)) / (times * demo.recording.rate_hz)
        at = np.clip(np.searchsorted(truth.t, t, side="right") - 1, 0, len(truth.t) - 2)
        share = np.clip((t - truth.t[at]) / (truth.t[at + 1] - truth.t[at]), 0.0, 1.0)
        p = truth.p_nav_sensor
        true = Truth(
            t,
            p[at] + share[:, None] * (p[at + 1] - p[at]),
            quat_slerp(truth.wxyz_nav_sensor[at], truth.wxyz_nav_sensor[at + 1], share),
        )
        info = replace(demo.recording.info, rate_hz=None)
        return replace(demo, recording=replace(with_rows(demo.recording, rows), t=t, info=info), truth=true)

    return damage


# --- what the hand does ---


def carried(demo: Demonstration, v: Array) -> Demonstration:
    """Add a motion of the hand with velocity v (n, 3) m/s in nav, at the middle of each sample."""
    t, truth = demo.recording.t, truth_of(demo)
    edges = np.concatenate((v[:1], 0.5 * (v[1:] + v[:-1]), v[-1:]))
    a = np.diff(edges, axis=0) * demo.recording.rate_hz
    felt = quat_rotate(quat_inverse(truth.wxyz_nav_sensor), a)
    p = truth.p_nav_sensor + np.concatenate(
        (np.zeros((1, 3)), np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0))
    )
    moved = with_values(demo, "acc", lambda acc: acc + felt)
    return replace(moved, truth=Truth(t, p, truth.wxyz_nav_sensor))


def turned(demo: Demonstration, by: Array) -> Demonstration:
    """Turn the sensor in the hand by rotation vectors (n, 3) rad in its own axes, all about one axis."""
    recording, truth = demo.recording, truth_of(demo)
    S = quat_exp(by)
    rate = np.gradient(by, recording.t, axis=0)
    changes: dict[str, Any] = {"acc": quat_rotate(quat_inverse(S), recording.acc)}
    if recording.gyr is not None:
        changes["gyr"] = quat_rotate(quat_inverse(S), recording.gyr) + rate
    if recording.mag is not None:
        changes["mag"] = quat_rotate(quat_inverse(S), recording.mag)
    if recording.device_rpy is not None:
        changes["device_rpy"] = quat_to_rpy(quat_multiply(quat_from_rpy(recording.device_rpy), S))
    wxyz = quat_multiply(truth.wxyz_nav_sensor, S)
    return replace(demo, recording=replace(recording, **changes), truth=Truth(truth.t, truth.p_nav_sensor, wxyz))


def with_sine_tremor(size_m: float, size_rad: float) -> Damage:
    """Tremor of 8 to 12 Hz from start to end, too small to change where the hand stops."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t, f, truth = demo.recording.t, rng.uniform(8.0, 12.0), demo.truth
        way, axis = rng.normal(size=(2, 3))
        wave = 2.0 * np.pi * f * size_m * np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28))
        demo = carried(demo, wave[:, None] * way / np.linalg.norm(way))
        wobble = size_rad * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28))
        return replace(turned(demo, wobble[:, None] * axis / np.linalg.norm(axis)), truth=truth)

    return damage


def slipping(angle: float, seconds: float) -> Change:
    """The sensor turns in the hand once, in a rest that is not the first."""

    def change(task: Task, rng: np.random.Generator) -> Task:
        k = int(rng.integers(1, len(task.waypoints)))
        axis, rests = rng.normal(size=3), task.waypoints[k]
        x, y, z = (angle * axis / np.linalg.norm(axis)).tolist()
        half = 0.5 * rests.rest_s
        parts = (replace(rests, rest_s=half), Waypoint(rests.p, (x, y, z), seconds, half))
        return replace(task, waypoints=(*task.waypoints[:k], *parts, *task.waypoints[k + 1 :]))

    return change


def gliding(speed: float, ramp_s: float, share: float = 0.8) -> Damage:
    """In a rest that is not the first the hand moves at constant speed, level; it starts and stops within the rest."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        t, spans = demo.recording.t, rests(truth_of(demo))
        start, stop = spans[int(rng.integers(1, len(spans)))]
        heading, lasts = rng.uniform(0.0, 2.0 * np.pi), t[stop - 1] - t[start]
        edge = 0.5 * (1.0 - share) * lasts
        ramp = min(ramp_s, 0.3 * lasts)
        way = np.array((np.cos(heading), np.sin(heading), 0.0))
        from_edge = np.minimum(t - t[start] - edge, t[stop - 1] - edge - t) / ramp
        s = np.clip(from_edge, 0.0, 1.0)
        return carried(demo, speed * (s * s * (3.0 - 2.0 * s))[:, None] * way)

    return damage


def drifting(speed: float) -> Damage:
    """The hand is in a car with constant speed from start to end."""

    def damage(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
        return carried(demo, np.tile((speed, 0.0, 0.0), (len(demo.recording), 1)))

    return damage


def as_it_is(demo: Demonstration, rng: np.random.Generator) -> Demonstration:
    return demo


def without_north(recording: Recording) -> Recording:
    """Without the magnetometer and the device's own angles."""
    return replace(recording, mag=None, device_rpy=None)
