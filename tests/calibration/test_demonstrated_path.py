"""The demonstrated path: smoothed within its uncertainty, from keyframe to keyframe."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.calibration.demonstrated_path import (
    SMOOTH_M,
    demonstrated_moves,
    smoothed,
    with_ends_at,
)
from pbd.calibration.dock import nav_in_base
from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.data import Calibration, HandPath, Keyframe, Stop
from pbd.data.covariance import PoseCovariance
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_rotate
from pbd.tracking.keyframes import find_keyframes

DOCK = Calibration(name="bench", T_base_dock=Pose.from_rpy((0.4, -0.1, 0.3), (0, 0, 0.5)))


def arc(noise_m: float = 0.0, sigma_m: float = 0.003, turns: float = 0.5) -> HandPath:
    """Return the path of a hand that rests, turns on a quarter of a circle of 20 cm radius, and rests."""
    t = np.arange(0.0, 3.0, 0.01)
    share = np.clip((t - 1.0) / 1.0, 0.0, 1.0)
    angle = 0.5 * np.pi * (10 * share**3 - 15 * share**4 + 6 * share**5)
    p = 0.2 * np.column_stack((np.sin(angle), np.zeros_like(t), 1.0 - np.cos(angle)))
    moving = (t > 1.05) & (t < 1.95)
    p[moving] += noise_m * np.random.default_rng(0).normal(size=(moving.sum(), 3))
    wxyz = quat_exp(np.outer(turns * angle, (1.0, 0.0, 0.0)))
    cov = np.tile(np.diag([sigma_m**2] * 3 + [1e-4] * 3), (2, 1, 1))
    stops = (Stop(0, 101, 1.0), Stop(200, 300, 0.99))
    return HandPath(t, p, np.gradient(p, t, axis=0), wxyz, stops, np.zeros((1, 3)), PoseCovariance.chained(cov))


def moves_of(path: HandPath, keyframes: tuple[Keyframe, ...] | None = None, scale: float = 1.0) -> tuple[Array, ...]:
    keyframes = keyframes or find_keyframes(path)
    T_base_nav = nav_in_base(DOCK, keyframes[0].T_nav_sensor.wxyz)
    (move,) = demonstrated_moves(
        path, keyframes, T_base_nav, tool_poses(KeyframesInBase(keyframes, T_base_nav, DOCK, scale)), DOCK, scale
    )
    p = np.array([T_base_nav.inverse().act(pose.p) for pose in move.T_base_tool])
    return move.t, p, np.array([pose.wxyz for pose in move.T_base_tool])


def test_the_path_follows_the_hand() -> None:
    """On the circle of 20 cm about (0, 0, 0.2), at the hand's own times, with the required spacing."""
    t, p, _ = moves_of(arc())
    np.testing.assert_allclose(np.linalg.norm(p - (0.0, 0.0, 0.2), axis=1), 0.2, atol=0.003 + 1e-9)
    np.testing.assert_allclose(t[[0, -1]], [1.0, 2.0], atol=1e-9)
    assert (np.diff(t) > 0.0).all()
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).max() < 1.05 * 0.005
    half = p[np.searchsorted(t, 1.5)]
    np.testing.assert_allclose(half, 0.2 * np.array([np.sin(np.pi / 4), 0.0, 1 - np.cos(np.pi / 4)]), atol=0.01)


def test_the_path_starts_and_ends_at_the_keyframes_even_if_they_were_moved() -> None:
    path = arc()
    first, last = find_keyframes(path)
    moved = replace(
        last, T_nav_sensor=Pose(last.T_nav_sensor.p + np.array([0.02, 0.01, -0.01]), last.T_nav_sensor.wxyz)
    )
    T_base_nav = nav_in_base(DOCK, first.T_nav_sensor.wxyz)
    for keyframes in ((first, last), (first, moved)):
        (move,) = demonstrated_moves(
            path, keyframes, T_base_nav, tool_poses(KeyframesInBase(keyframes, T_base_nav, DOCK)), DOCK
        )
        for pose, wanted in zip(
            (move.T_base_tool[0], move.T_base_tool[-1]),
            tool_poses(KeyframesInBase(keyframes, T_base_nav, DOCK)),
            strict=True,
        ):
            np.testing.assert_allclose(pose.distance(wanted), 0.0, atol=1e-7)
    steps = np.linalg.norm(np.diff([pose.p for pose in move.T_base_tool], axis=0), axis=1)
    assert steps.max() < 1.1 * 0.005  # no jump at the end


def test_a_shift_of_both_ends_alike_shifts_the_whole_path_and_turns_nothing() -> None:
    share = np.linspace(0.0, 1.0, 9)
    p, wxyz, shift = np.outer(share, (0.1, 0.2, 0.0)), quat_about_z(share), np.array([0.0, 0.01, 0.02])
    ends = [Pose(p[i] + shift, wxyz[i]) for i in (0, -1)]
    shifted, turned = with_ends_at(share, p, wxyz, *ends)
    np.testing.assert_allclose(shifted, p + shift, atol=1e-15)
    np.testing.assert_allclose(turned, wxyz, atol=1e-15)


@pytest.mark.parametrize("sigma_m", [0.001, 0.004, 0.1])
def test_the_path_is_smoothed_within_its_uncertainty(sigma_m: float) -> None:
    """White noise of 0.5 mm per axis, which no hand makes, is reduced; no sample moves by more than the bound."""
    noisy, clean = arc(noise_m=5e-4, sigma_m=sigma_m), arc()
    inside = slice(100, 201)
    fitted = smoothed(np.linspace(0.0, 1.0, 101), noisy.p_nav_sensor[inside], min(sigma_m, SMOOTH_M))
    moved = np.linalg.norm(fitted - noisy.p_nav_sensor[inside], axis=1)
    assert moved.max() <= min(sigma_m, SMOOTH_M)
    rough = [np.linalg.norm(np.diff(each, 3, axis=0)) for each in (fitted, noisy.p_nav_sensor[inside])]
    assert rough[0] < (0.9 if sigma_m == 0.001 else 0.1) * rough[1]
    np.testing.assert_allclose(fitted[[0, -1]], clean.p_nav_sensor[inside][[0, -1]], atol=1e-5)


def test_turns_are_as_dense_as_shifts() -> None:
    _, _, wxyz = moves_of(arc(turns=3.0))
    turn = 2.0 * np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", wxyz[1:], wxyz[:-1])), 0.0, 1.0))
    assert turn.max() < 1.1 * np.radians(2.0)
    assert turn.sum() == pytest.approx(1.5 * np.pi, rel=0.02)  # more than half a turn, in the right direction


def test_scale_and_fixed_orientation() -> None:
    _, p, _ = moves_of(arc(), scale=0.5)
    np.testing.assert_allclose(np.linalg.norm(p - (0.0, 0.0, 0.1), axis=1), 0.1, atol=0.003)
    path = arc()
    keyframes = find_keyframes(path)
    T_base_nav = nav_in_base(DOCK, keyframes[0].T_nav_sensor.wxyz)
    T_base_tool = tool_poses(KeyframesInBase(keyframes, T_base_nav, DOCK, orientation="fixed"))
    (move,) = demonstrated_moves(path, keyframes, T_base_nav, T_base_tool, DOCK, 1.0, True)
    down = [quat_rotate(pose.wxyz, (0.0, 0.0, 1.0)) for pose in move.T_base_tool]
    np.testing.assert_allclose(down, np.tile((0.0, 0.0, -1.0), (len(down), 1)), atol=1e-9)


@pytest.mark.parametrize("samples", [0, 1, 2, 4])
def test_a_move_of_few_samples(samples: int) -> None:
    """At 10 Hz a quick move may have no samples of its own."""
    path = arc()
    kept = np.unique(
        np.concatenate((np.arange(0, 101, 10), np.linspace(100, 200, samples + 2).astype(int), np.arange(200, 300, 10)))
    )
    stops = (Stop(0, 11, 1.0), Stop(10 + samples + 1, len(kept), 0.9))
    few = HandPath(
        path.t[kept], path.p_nav_sensor[kept], path.v_nav_sensor[kept], path.wxyz_nav_sensor[kept], stops,
        np.zeros((1, 3)), path.covariance,
    )  # fmt: skip
    t, p, _ = moves_of(few)
    assert (np.diff(t) > 0.0).all()
    np.testing.assert_allclose(p[[0, -1]], [(0, 0, 0), (0.2, 0, 0.2)], atol=1e-9)


def test_a_keyframe_inserted_in_a_rest_is_reached_straight() -> None:
    """The hand made no move to it."""
    path, first = arc(), find_keyframes(arc())[0]
    start, end = (
        replace(first, t=t, T_nav_sensor=Pose(np.array(p), first.T_nav_sensor.wxyz))
        for t, p in (
            (0.4, (0.0, 0.0, 0.0)),
            (0.7, (0.0, 0.0, 0.05)),
        )
    )
    t, p, _ = moves_of(path, (start, end))
    np.testing.assert_allclose(p[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(p[[0, -1], 2], [0.0, 0.05], atol=1e-9)
    assert (np.diff(p[:, 2]) > 0.0).all()
    assert (np.diff(t) > 0.0).all()
