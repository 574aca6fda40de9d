"""Constraints at stops: against dense least squares, and properties that must hold."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import Calibration, Contact, HandPath, Known, Place
from pbd.data.covariance import PoseCovariance
from pbd.errors import TrackingError
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_multiply, quat_rotate
from pbd.simulation.simulate import random_task
from pbd.simulation.tasks import Task
from pbd.tracking.apply_constraints import apply_constraints
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.stop_constraints import PLACE_SIGMA_M
from tests.scenarios import pour, simulate, truth_at
from tests.tracking.hand_paths import DT, MOVE, REST, at_stops, covariances, hand_path, mid


def least_squares(path: HandPath, known: Known) -> tuple[Array, Array]:
    """The stops (k, 3) and their covariances (k, 3, 3) by dense least squares. Each visit has its own noise; each place
    and the table are unknowns."""
    k, places = len(path.stops), len(known.places)
    table = 3 * (k - 1 + places)
    moves = np.diff(path.cov[:, :3, :3], axis=0)
    rows: list[Array] = []
    right: list[Array] = []

    def stop_at(t: float) -> int:
        return round((t - mid(0)) / (DT * (REST + MOVE)))

    def add(parts: dict[int, float], value: Array, whiten: Array, axes: Array) -> None:
        """whiten @ axes @ (sum of factor times the unknown that begins at that column) = whiten @ value."""
        row = np.zeros((len(axes), table + 1))
        for column, factor in parts.items():
            width = min(3, table + 1 - column)
            if column >= 0:  # the first stop is the origin
                row[:, column : column + width] += factor * axes[:, -width:]
        rows.append(whiten @ row)
        right.append(whiten @ value)

    def stop(index: int) -> int:
        return 3 * (index - 1)

    def visit(sigma: float | None, d: int) -> Array:
        whiten: Array = np.eye(d) / (np.sqrt(0.5) * (sigma or PLACE_SIGMA_M))
        return whiten

    x, up = at_stops(path), np.eye(3)[2:]
    for i, Q in enumerate(moves):
        whiten = np.linalg.inv(np.linalg.cholesky(Q))
        add({stop(i + 1): 1.0, stop(i): -1.0}, x[i + 1] - x[i], whiten, np.eye(3))
    if known.closed:
        add({stop(k - 1): 1.0}, np.zeros(3), np.eye(3) / PLACE_SIGMA_M, np.eye(3))
    for i, place in enumerate(known.places):
        for t in place.t:
            own = {stop(stop_at(t)): 1.0, 3 * (k - 1 + i): -1.0}
            add(own, np.zeros(3), visit(place.sigma_m, 3), np.eye(3))
    for contact in known.contacts:
        here = stop(stop_at(contact.t))
        if contact.height is not None:
            add({here: 1.0}, np.array([contact.height]), visit(contact.sigma_m, 1) * np.sqrt(0.5), up)
        elif contact.as_at is not None:
            pair = {here: 1.0, stop(stop_at(contact.as_at)): -1.0}
            add(pair, np.zeros(1), visit(contact.sigma_m, 1) * np.sqrt(0.5), up)
        else:
            add({here: 1.0, table: -1.0}, np.zeros(1), visit(contact.sigma_m, 1), up)
    J, y = np.vstack(rows), np.concatenate(right)
    used = np.abs(J).sum(axis=0) > 0.0
    solution = np.zeros(table + 1)
    solution[used] = np.linalg.lstsq(J[:, used], y, rcond=None)[0]
    q = np.linalg.pinv(J[:, used], rcond=1e-12)
    full = np.zeros((table + 1, table + 1))
    full[np.ix_(used, used)] = q @ q.T
    cov = [full[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(k - 1)]
    positions = solution[: 3 * (k - 1)].reshape(-1, 3)
    return np.vstack((np.zeros(3), positions)), np.array([np.zeros((3, 3)), *cov])


def everything(k: int) -> Known:
    """A claim of each kind about k >= 6 stops."""
    return Known(
        closed=True,
        places=(Place((mid(1), mid(3), mid(k - 2))), Place((mid(2), mid(4)), sigma_m=0.001)),
        contacts=(
            Contact(mid(1)),
            Contact(mid(5)),
            Contact(mid(2), sigma_m=0.002),
            Contact(mid(4), height=0.1),
            Contact(mid(5), as_at=mid(3), sigma_m=0.01),
        ),
    )


def agreeing(rng: np.random.Generator, k: int) -> Array:
    """Stops (k, 3) that fulfil `everything`."""
    p = rng.uniform(-0.3, 0.3, (k, 3))
    p[[1, 2, 3, 4, 5, k - 2], 2] = 0.1
    p[0], p[3], p[k - 2], p[4], p[k - 1] = 0.0, p[1], p[1], p[2], 0.0
    return p


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(7, 10), st.floats(-4.0, -0.5))
def test_as_dense_least_squares(seed: int, k: int, log_sigma: float) -> None:
    rng = np.random.default_rng(seed)
    moves = covariances(rng, k - 1, 10.0**log_sigma)
    drift = 0.5 * np.linalg.cholesky(moves) @ rng.normal(size=(k - 1, 3, 1))
    p_stop = agreeing(rng, k)
    p_stop[1:] += np.cumsum(drift[..., 0], axis=0)
    path = hand_path(p_stop, moves)
    conditioned = apply_constraints(path, everything(k))
    positions, cov = least_squares(path, everything(k))
    assert at_stops(conditioned) == pytest.approx(positions, abs=1e-7)
    assert conditioned.cov[:, :3, :3] == pytest.approx(cov, rel=1e-4, abs=1e-10)
    assert (np.linalg.eigvalsh(conditioned.cov[:, :3, :3]) > -1e-20).all()
    assert np.array_equal(conditioned.closure, path.closure)


@pytest.mark.parametrize("sigma_m", [1e-9, 1e-3, 1e3])
@pytest.mark.parametrize("move_sigma", [1e-9, 1e-3, 1e3])
def test_tiny_and_huge_sigmas_do_no_harm(move_sigma: float, sigma_m: float) -> None:
    """Two independent estimates of one position have half the harmonic mean of their variances, whatever these are."""
    p_stop = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.1 * min(move_sigma, sigma_m), 0.0, 0.0]])
    path = hand_path(p_stop, np.tile(0.5 * move_sigma**2 * np.eye(3), (2, 1, 1)))
    cov = apply_constraints(path, Known(places=(Place((mid(0), mid(2)), sigma_m=sigma_m),))).cov[2, :3, :3]
    expected = 1.0 / (move_sigma**-2 + sigma_m**-2)
    assert cov == pytest.approx(expected * np.eye(3), rel=1e-6, abs=1e-6 * expected)


def test_turning_the_world_turns_the_result() -> None:
    rng = np.random.default_rng(3)
    moves = covariances(rng, 6, 0.02)
    p_stop, wxyz = agreeing(rng, 7) + rng.normal(scale=0.001, size=(7, 3)), quat_exp(rng.normal(size=(7, 3)))
    p_stop[0] = 0.0
    turn = quat_about_z(1.1)
    R = quat_rotate(turn, np.eye(3)).T
    plain = apply_constraints(hand_path(p_stop, moves, wxyz), everything(7))
    turned = apply_constraints(
        hand_path(quat_rotate(turn, p_stop), R @ moves @ R.T, quat_multiply(turn, wxyz)), everything(7)
    )
    assert turned.p_nav_sensor == pytest.approx(quat_rotate(turn, plain.p_nav_sensor), abs=1e-12)
    assert turned.v_nav_sensor == pytest.approx(quat_rotate(turn, plain.v_nav_sensor), abs=1e-12)
    assert turned.cov[:, :3, :3] == pytest.approx(R @ plain.cov[:, :3, :3] @ R.T, abs=1e-15)


def test_what_is_true_already_changes_nothing_but_sigma() -> None:
    rng = np.random.default_rng(1)
    path = hand_path(agreeing(rng, 7), covariances(rng, 6, 0.05))
    conditioned = apply_constraints(path, everything(7))
    assert conditioned.p_nav_sensor == pytest.approx(path.p_nav_sensor, abs=1e-12)
    assert conditioned.v_nav_sensor == pytest.approx(path.v_nav_sensor, abs=1e-12)
    shrunk = np.linalg.eigvalsh(path.cov[:, :3, :3] - conditioned.cov[:, :3, :3])
    assert shrunk.min() > -1e-15
    assert np.sqrt(np.diagonal(conditioned.cov[-1, :3, :3])).max() < PLACE_SIGMA_M
    assert max(fit.off_m for fit in conditioned.claims) < 1e-12


def test_without_a_claim_the_path_is_the_same() -> None:
    path = hand_path(np.zeros((3, 3)), np.tile(1e-4 * np.eye(3), (2, 1, 1)))
    assert apply_constraints(path, Known()) is path
    alone = hand_path(np.zeros((1, 3)), np.zeros((0, 3, 3)))
    assert apply_constraints(alone, Known(closed=True)) is alone


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_each_move_takes_its_share_by_its_own_uncertainty(share: float) -> None:
    """Moves that the claim does not concern take no share."""
    variances = np.array([4.0, share, 1.0 - share, 4.0]) * 0.02**2
    p_stop = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.3, 0.2, 0.0], [0.1, 0.03, 0.0], [0.0, 0.0, 0.4]])
    path = hand_path(p_stop, variances[:, None, None] * np.eye(3))
    shift = at_stops(apply_constraints(path, Known(places=(Place((mid(1), mid(3))),)))) - p_stop
    taken = np.diff(shift, axis=0)[:, 1]
    whole = -0.03 * 0.02**2 / (0.02**2 + PLACE_SIGMA_M**2)
    assert taken == pytest.approx([0.0, share * whole, (1.0 - share) * whole, 0.0], abs=1e-15)


def test_the_path_follows_its_stops_and_velocity_stays_the_derivative_of_position() -> None:
    rng = np.random.default_rng(2)
    p_stop = np.cumsum(np.vstack((np.zeros(3), 0.01 * rng.normal(size=(4, 3)))), axis=0)
    path = hand_path(p_stop, covariances(rng, 4, 0.03))
    conditioned = apply_constraints(path, Known(closed=True))
    shift, faster = conditioned.p_nav_sensor - path.p_nav_sensor, conditioned.v_nav_sensor - path.v_nav_sensor
    for stop in path.stops:
        assert np.ptp(shift[stop.start : stop.stop], axis=0) == pytest.approx(0.0, abs=1e-15)
        assert np.array_equal(faster[stop.start : stop.stop], np.zeros((REST, 3)))
    for before, after in zip(path.stops, path.stops[1:], strict=False):
        move = slice(before.stop - 1, after.start + 1)
        # A cubic: Simpson's rule over its three-point stretches is exact, and so is the whole.
        length, v = 2.0 * DT, faster[move]
        steps = length / 6.0 * (v[:-2] + 4.0 * v[1:-1] + v[2:])
        assert steps == pytest.approx(shift[move][2:] - shift[move][:-2], abs=1e-14)
        assert np.linalg.norm(shift[after.start] - shift[before.start]) > 1e-4


def test_motion_after_the_last_stop_goes_with_it() -> None:
    whole = hand_path(
        np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.3, 0.0, 0.0]]), np.tile(1e-3 * np.eye(3), (2, 1, 1))
    )
    covariance = PoseCovariance.chained(whole.cov[:2])
    path = replace(whole, stops=whole.stops[:2], covariance=covariance, closure=whole.closure[:1])
    conditioned = apply_constraints(path, Known(closed=True))
    shift = conditioned.p_nav_sensor - path.p_nav_sensor
    assert shift[path.stops[1].start :] == pytest.approx(np.tile(shift[path.stops[1].start], (len(shift) - 30, 1)))


# --- the whole tracker ---


def test_a_task_that_returns_is_tracked_better_and_its_sigmas_know() -> None:
    before: list[float] = []
    after: list[float] = []
    scaled: list[Array] = []
    for seed in range(4):
        task = random_task(seed)
        home = replace(task.waypoints[-1], p=task.waypoints[0].p)
        demo = simulate(Task("home", (*task.waypoints[:-1], home), start_rpy=task.start_rpy), "os5000", seed)
        assert demo.closed
        assert demo.truth is not None
        for known, errors in ((None, before), (demo.known, after)):
            keyframes = find_keyframes(track(demo.recording, known=known))[1:]
            off = [keyframe.T_nav_sensor.p - truth_at(demo.truth, keyframe.t) for keyframe in keyframes]
            errors.extend(np.linalg.norm(off, axis=1))
        scaled.extend([x / np.sqrt(np.diagonal(k.cov)[:3]) for x, k in zip(off, keyframes, strict=True)])
    assert np.median(after) < 0.9 * np.median(before)
    assert (np.abs(scaled) < 2.0).mean() > 0.85


def test_a_calibration_brings_the_table() -> None:
    """The bottle of the everyday task stands 0.1 m below the dock."""
    demo = replace(pour(), contacts=(Contact(5.7), Contact(18.1)))
    dock = Pose(np.array([0.4, 0.0, 0.25]), quat_about_z(0.3))
    tool = Pose(np.array([0.0, 0.0, -0.05]), np.array([1.0, 0.0, 0.0, 0.0]))
    calibration = Calibration("c", T_base_dock=dock, T_sensor_tool=tool, table_height=0.10)
    path = track(demo.recording, known=demo.known, calibration=calibration)
    assert [fit.saying for fit in path.claims][1:] == [
        "the tool at 5.70 s (stop 2) is on the table",
        "the tool at 18.10 s (stop 8) is on the table",
    ]
    assert path.p_nav_sensor[path.stops[2].start, 2] == pytest.approx(-0.10, abs=0.003)
    with pytest.raises(TrackingError, match=r"is on the table, but it is (9|10|11)(\.\d)? cm off"):
        track(demo.recording, known=demo.known, calibration=replace(calibration, table_height=0.0))
