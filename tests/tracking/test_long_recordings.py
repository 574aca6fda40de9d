"""What makes tracking linear in time gives what the slow forms give, which are written out here."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.data import GRAVITY, GripEvent, Stop
from pbd.pose import Array, quat_exp, quat_rotate
from pbd.tracking.conditioning import Gap
from pbd.tracking.integration import EVEN_DRIFT, integral_of_means
from pbd.tracking.keyframes import _grip_at_stops
from pbd.tracking.known import _josephs_form
from pbd.tracking.restoring import _arch, clip_covariance, settle_velocities
from pbd.tracking.saturation import Clip
from pbd.tracking.steady import median, squares, window_moments, window_sums
from pbd.tracking.stops import (
    COAST_GAIN,
    COAST_S,
    COAST_SHARE,
    COAST_SPEED,
    COASTING_STOPS,
    SHOWN_S,
    SLOW_COAST_S,
    _drop_coasting,
    _nearest,
)
from pbd.tracking.uncertainty import UNSEEN_HAND, unseen_covariance
from tests.tracking.stops_at import covariances

numbers = st.floats(-1e3, 1e3)
vectors = st.integers(1, 60).flatmap(lambda n: arrays(np.float64, (n, 3), elements=numbers))


@given(vectors)
def test_medians_and_squares_are_numpys_to_the_bit(values: Array) -> None:
    assert np.array_equal(median(values), np.median(values, axis=0))
    assert np.array_equal(squares(values), (values**2).sum(axis=1))


@given(vectors, st.integers(1, 20))
def test_window_sums_are_the_sums_over_each_window(values: Array, n: int) -> None:
    n = min(n, len(values))
    slowly = np.array([values[i : i + n].sum(axis=0) for i in range(len(values) - n + 1)])
    assert window_sums(values, n) == pytest.approx(slowly, abs=1e-9)
    variance, mean = window_moments(values, n)
    assert mean == pytest.approx(slowly / n, abs=1e-9)
    spread = np.array([values[i : i + n].var(axis=0).sum() for i in range(len(values) - n + 1)])
    assert variance == pytest.approx(spread, abs=1e-6)


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9), st.booleans()), min_size=1, max_size=30))
def test_the_nearest_long_run_is_found_among_all(steps: list[tuple[int, int, bool]]) -> None:
    """Runs in order and apart; some are long, whichever; of a long one the nearest is itself."""
    found, at = [], 0
    for gap, length, is_long in steps:
        found.append((slice(at + gap, at + gap + length), is_long))
        at += gap + length
    long = [run for run, is_long in found if is_long]
    for run, _ in found if long else ():
        slowly = min(long, key=lambda other: max(other.start - run.stop, run.start - other.stop))
        assert long[_nearest(run, long)] == slowly


def without_coasting(stops: list[Stop], t: Array, a_nav: Array) -> tuple[Stop, ...]:
    """Every move anew, every time."""

    def shown(stop: Stop) -> Array:
        return np.asarray(a_nav[stop.start : stop.stop].mean(axis=0))

    def left_over(before: Stop, after: Stop, off: Array) -> tuple[float, float, float]:
        move = slice(before.stop - 1, after.start + 1)
        duration = float(t[after.start] - t[before.stop - 1])
        speed = float(np.linalg.norm(integral_of_means(t[move], a_nav[move] - off)[-1]))
        return speed, speed / duration, float(np.linalg.norm(a_nav[move] - off, axis=1).mean() * duration)

    def coasts(stops: list[Stop]) -> bool:
        ends = 0.5 * (shown(stops[0]) + shown(stops[-1]))
        own = [s.dwell_s / (s.dwell_s + SHOWN_S) * (shown(s) - ends) + ends for s in (stops[1], stops[-2])]
        moves = [
            left_over(stops[0], stops[1], 0.5 * (shown(stops[0]) + own[0])),
            left_over(stops[-2], stops[-1], 0.5 * (shown(stops[-1]) + own[1])),
        ]
        fast = [speed > COAST_SPEED and speed > COAST_GAIN * gained for speed, _, gained in moves]
        return all(fast) and left_over(stops[0], stops[-1], ends)[1] < COAST_SHARE * min(rate for _, rate, _ in moves)

    kept, k = list(stops), 1
    while k < len(kept) - 1:
        for n in range(1, COASTING_STOPS + 1):
            group = kept[k - 1 : k + n + 1]
            short = len(group) == n + 2 and all(stop.dwell_s < COAST_S for stop in group[1:-1])
            if short and coasts(group):
                del kept[k : k + n]
                break
        else:
            k += 1
    for stop in sorted(kept[1:-1], key=lambda stop: (stop.dwell_s, stop.start)):
        k = kept.index(stop)
        if stop.dwell_s < SLOW_COAST_S and 0 < k < len(kept) - 1 and coasts(kept[k - 1 : k + 2]):
            kept.remove(stop)
    return tuple(kept)


def swaying(lengths: list[tuple[int, int]], pushes: Array) -> tuple[list[Stop], Array, Array]:
    """Stops of so many rows after moves of so many, at 100 Hz; in each move the hand is pushed by one of `pushes`."""
    stops, at, a_nav = [], 0, []
    for (move, rest), push in zip(lengths, pushes, strict=True):
        a_nav += [np.tile((push, 0.3 * push, 0.0), (move, 1)), np.zeros((rest, 3))]
        stops.append(Stop(at + move, at + move + rest, 0.01 * (rest - 1)))
        at += move + rest
    return stops, 0.01 * np.arange(at, dtype=np.float64), np.concatenate(a_nav)


lengths = st.lists(st.tuples(st.integers(2, 20), st.integers(2, 170)), min_size=2, max_size=25)


@settings(deadline=None)
@given(lengths, st.integers(0, 2**32 - 1))
def test_the_same_stops_are_dropped_as_coasting(lengths: list[tuple[int, int]], seed: int) -> None:
    pushes = np.random.default_rng(seed).choice((-1.0, -0.5, 0.0, 0.5, 1.0), size=len(lengths))
    stops, t, a_nav = swaying(lengths, pushes)
    assert _drop_coasting(stops, t, a_nav) == without_coasting(stops, t, a_nav)


def test_some_stops_are_dropped_as_coasting() -> None:
    """There and back in two pushes: what lies between is no stop."""
    stops, t, a_nav = swaying([(10, 90), (10, 10), (10, 90)], np.array([0.0, 1.0, -1.0]))
    assert _drop_coasting(stops, t, a_nav) == (stops[0], stops[2])


# --- clipped samples, gaps, grips and claims: each belongs to one stop or move, which is looked up, not looked for ---

seeds = st.integers(0, 2**32 - 1)


def moved(rng: np.random.Generator) -> tuple[list[Stop], Array, Array, Array]:
    """Stops, time, and any motion acceleration and attitude."""
    lengths = [(int(move), int(rest)) for move, rest in rng.integers(1, 20, (int(rng.integers(1, 9)), 2))]
    stops, t, a_nav = swaying(lengths, rng.normal(size=len(lengths)))
    return stops, t, a_nav + rng.normal(size=a_nav.shape), quat_exp(rng.normal(size=a_nav.shape))


def any_clips(rng: np.random.Generator, n: int) -> list[Clip]:
    """In moves, in stops, and from the one into the other."""
    starts = np.sort(rng.integers(0, n - 1, int(rng.integers(0, 12)))).tolist()
    return [
        Clip(
            str(rng.choice(["acc", "gyr"])),
            int(rng.integers(3)),
            float(rng.choice([-1.0, 1.0])),
            start,
            int(rng.integers(start + 1, min(start + 6, n) + 1)),
            sigma=float(rng.uniform(0.01, 0.5)),
        )
        for start in starts
    ]


def middle(clip: Clip) -> int:
    return (clip.start + clip.stop) // 2


def axis_nav(clip: Clip, wxyz: Array) -> Array:
    return quat_rotate(wxyz[middle(clip)], clip.sign * np.eye(3)[clip.axis])


def each_clip_in_each_move(
    t: Array, a_nav: Array, wxyz: Array, p: Array, stops: list[Stop], clips: list[Clip]
) -> Array:
    added = np.zeros((len(stops), 6, 6))
    z = np.array((0.0, 0.0, 1.0))
    for clip in clips:
        axis = clip.sigma * axis_nav(clip, wxyz)
        for k, (before, after) in enumerate(pairwise(stops), start=1):
            first, last = before.stop - 1, after.start
            off = np.zeros(3)
            if first <= clip.start < last:
                at, rows = min(middle(clip), last) - first, slice(first, last + 1)
                whole, left = t[last] - t[first], t[last] - t[first + at]
                off = (left - 0.5 * whole) * axis
                if clip.sensor == "gyr":
                    velocity = integral_of_means(t[rows], np.cross(axis, a_nav[rows] + GRAVITY * z))
                    position = integral_of_means(t[rows], velocity)
                    off = (
                        position[-1] - position[at] - left * velocity[at] - 0.5 * whole * (velocity[-1] - velocity[at])
                    )
            elif clip.sensor == "gyr" and clip.start < first:
                off = np.cross(axis[2] * z, p[last] - p[first])
            added[k, :3, :3] += np.outer(off, off)
            if clip.sensor == "gyr" and clip.start < last:
                added[k, 5, 5] += axis[2] ** 2
    added[:, :3, :3] = np.cumsum(added[:, :3, :3], axis=0)
    return added


@settings(deadline=None)
@given(seeds)
def test_what_clips_add_to_the_covariance_is_that_of_each_clip_in_each_move(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stops, t, a_nav, wxyz = moved(rng)
    clips, p = any_clips(rng, len(t)), rng.normal(size=a_nav.shape)
    slowly = each_clip_in_each_move(t, a_nav, wxyz, p, stops, clips)
    assert clip_covariance(t, a_nav, wxyz, p, stops, clips) == pytest.approx(slowly, rel=1e-9, abs=1e-15)


@settings(deadline=None)
@given(seeds)
def test_velocities_are_settled_as_by_dense_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stops, t, a_nav, wxyz = moved(rng)
    clips = any_clips(rng, len(t))
    settled, told = settle_velocities(t, a_nav, wxyz, stops, clips)
    expected, corrected = clips.copy(), a_nav.copy()
    for before, after in pairwise(stops):
        first, last = before.stop - 1, after.start
        of_move = [i for i, clip in enumerate(clips) if clip.sensor == "acc" and first < clip.start < last]
        closure = integral_of_means(t[first : last + 1], corrected[first : last + 1])[-1]
        axes = np.array([axis_nav(clips[i], wxyz) for i in of_move]).reshape(-1, 3)
        drift = EVEN_DRIFT**2 * (t[last] - t[first])
        cov = np.linalg.inv(axes @ axes.T / drift + np.diag([clips[i].sigma ** -2.0 for i in of_move]))
        for i, gain, variance in zip(of_move, -cov @ axes @ closure / drift, np.diagonal(cov), strict=True):
            expected[i] = replace(clips[i], lost=float(gain), sigma=float(np.sqrt(variance)))
            rows = slice(clips[i].start, clips[i].stop)
            corrected[rows] += gain / 0.01 * np.outer(_arch(clips[i]), axis_nav(clips[i], wxyz))
    assert [clip.lost for clip in told] == pytest.approx([clip.lost for clip in expected], rel=1e-6, abs=1e-9)
    assert [clip.sigma for clip in told] == pytest.approx([clip.sigma for clip in expected], rel=1e-6)
    assert settled == pytest.approx(corrected, abs=1e-6)


@given(seeds)
def test_a_gap_widens_all_stops_from_the_one_that_holds_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stops, t, _, _ = moved(rng)
    ends = np.sort(rng.integers(0, len(t), (int(rng.integers(0, 12)), 2)), axis=1).tolist()
    gaps = tuple(Gap(before, after, float(rng.uniform(0.05, 1.0))) for before, after in ends)
    slowly = np.zeros(len(stops))
    for gap in gaps:
        for k, stop in enumerate(stops):
            if stop.start <= gap.before and gap.after < stop.stop:
                slowly[k:] += (UNSEEN_HAND * gap.missing_s) ** 2
    expected = slowly[:, None, None] * np.eye(3)
    assert unseen_covariance(gaps, tuple(stops)) == pytest.approx(expected, abs=1e-15)


@given(seeds)
def test_a_grip_belongs_to_the_nearest_of_all_stops(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stops, t, _, _ = moved(rng)
    events = tuple(GripEvent(float(at), bool(rng.integers(2))) for at in rng.uniform(-0.2, t[-1] + 0.2, 9))
    slowly = {}
    for event in events:
        away = [max(float(t[stop.start]) - event.t, event.t - float(t[stop.stop - 1]), 0.0) for stop in stops]
        slowly[int(np.argmin(away))] = event.closed
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert _grip_at_stops(events, t, tuple(stops)) == slowly
        assert _grip_at_stops(events, t, ()) == {}


@settings(deadline=None)
@given(seeds)
def test_moves_that_all_claims_see_alike_may_be_summed_up(seed: int) -> None:
    """Joseph's form, move by move, for any gain."""
    rng = np.random.default_rng(seed)
    k, m = (int(number) for number in rng.integers(1, 9, 2))
    G = np.repeat(rng.normal(size=(m, k, 3)), 1 + rng.integers(0, 4, k), axis=1)
    k = G.shape[1]
    moves, R = covariances(rng, k, 1.0), covariances(rng, 1, 1.0)[0][:1, :1] * np.eye(m)
    gain = rng.normal(size=(k, 3, m))
    slowly = []
    for stop in range(k):
        A = -np.einsum("am,mkb->kab", gain[stop], G)
        A[: stop + 1] += np.eye(3)
        slowly.append((A @ moves @ A.transpose(0, 2, 1)).sum(axis=0) + gain[stop] @ R @ gain[stop].T)
    assert _josephs_form(moves, gain, G, R) == pytest.approx(np.array(slowly), rel=1e-9, abs=1e-9)
