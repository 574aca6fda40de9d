"""The tool's covariance in base, against finite differences of its pose."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag

from pbd.calibration.dock import dock_at, place_in_base
from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import joint_tool_covariances, tool_covariances
from pbd.data import Calibration, HandPath, Keyframe, Known, Place
from pbd.data.calibration import DOCK_SIGMA_M
from pbd.errors import CalibrationError
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_exp, quat_inverse, quat_log, quat_multiply
from pbd.tracking.keyframes import keyframes_of

T_BASE_NAV = Pose(np.array([0.4, -0.1, 0.2]), quat_exp((0.0, 0.0, 0.7)))
T_SENSOR_TOOL = Pose(np.array([0.02, -0.01, 0.15]), quat_exp((3.0, 0.2, 0.1)))
FIRST = Pose(np.array([0.01, -0.02, 0.03]), quat_exp((0.2, -0.3, 0.5)))
KEYFRAME = Pose(np.array([0.2, 0.1, -0.1]), quat_exp((0.3, -0.5, 0.9)))


def covariance(seed: int, size: int = 6) -> Array:
    root = 0.004 * np.random.default_rng(seed).normal(size=(size, size))
    return np.asarray(root @ root.T)


def total_covariance(placed: KeyframesInBase) -> Array:
    return np.asarray(np.sum([*joint_tool_covariances(placed).values()], axis=0))


def moved(pose: Pose, step: Array) -> Pose:
    """Shift the position, and rotate in the outer frame."""
    return Pose(pose.p + step[:3], quat_multiply(quat_exp(step[3:]), pose.wxyz))


@pytest.mark.parametrize("orientation", ["demo", "fixed"])
@pytest.mark.parametrize("part", ["start", "mount", "tracking"])
def test_each_part_agrees_with_finite_differences(part: str, orientation: str) -> None:
    """At two keyframes; a fixed tool has its lever and its heading from the first one, whose errors count at both."""
    size = 12 if part == "tracking" else 6
    cov, none, scale = covariance(len(part), size), np.zeros((6, 6)), 1.5
    own = [cov[:6, :6], cov[6:, 6:]] if part == "tracking" else [none, none]

    def placed(step: Array) -> KeyframesInBase:
        start, mount, tracking = (step if name == part else np.zeros(12) for name in ("start", "mount", "tracking"))
        calibration = Calibration(
            "c",
            T_base_nav=T_BASE_NAV,
            cov_base=cov if part == "start" else none,
            T_sensor_tool=moved(T_SENSOR_TOOL, mount[:6]),
            cov_sensor_tool=cov if part == "mount" else None,
            scale=scale,
        )
        shown = moved(FIRST, tracking[:6]), moved(KEYFRAME, tracking[6:])
        keyframes = [Keyframe(float(k), 1.0, pose, own[k]) for k, pose in enumerate(shown)]
        return KeyframesInBase(keyframes, moved(T_BASE_NAV, start[:6]), calibration, orientation=orientation)

    columns = []
    for step in 1e-5 * np.eye(12)[:size]:
        pairs = zip(tool_poses(placed(step)), tool_poses(placed(-step)), strict=True)
        ends = [(a.p - b.p, quat_log(quat_multiply(a.wxyz, quat_inverse(b.wxyz)))) for a, b in pairs]
        columns.append(np.ravel(ends) / 2e-5)
    J, here = np.column_stack(columns), placed(np.zeros(12))
    tracked = cov if part == "tracking" else np.zeros((12, 12))
    atol = 1e-9 * np.trace(cov)
    calibrations = np.vstack((np.zeros((12, 10)), np.eye(6, 10), np.eye(3, 10, 6), np.zeros((3, 10)), np.eye(6, 10, 9)))
    errors = block_diag(tracked, np.zeros((18, 18))), calibrations
    with patch("pbd.calibration.uncertainty._joint_errors", return_value=errors):
        assert_allclose(sum(joint_tool_covariances(here).values()), J @ cov @ J.T, rtol=0.0, atol=atol)
    if part == "tracking":
        cov = block_diag(*own)  # without a path the keyframes' errors are independent
    for name, found in tool_covariances(here).items():
        expected = (J @ cov @ J.T).reshape(2, 6, 2, 6)[range(2), :, range(2)]
        assert_allclose(found, expected if name == part else np.zeros((2, 6, 6)), rtol=0.0, atol=atol)


def test_a_dock_without_a_covariance_has_the_default_sigma() -> None:
    calibration = Calibration("c", T_base_dock=Pose.identity())
    keyframe = Keyframe(0.0, 1.0, Pose.identity(), np.zeros((6, 6)))
    parts = tool_covariances(KeyframesInBase([keyframe], Pose.identity(), calibration))
    assert_allclose(np.sqrt(np.diagonal(parts["start"][0])[:3]), DOCK_SIGMA_M)


def test_a_keyframe_is_as_certain_as_its_person_says() -> None:
    """By keyframes.toml, whatever the path's own covariance at that stop is: alone, and jointly with the others."""
    path = track(load_demo("pouring"))
    found = keyframes_of(path)
    sigmas = np.linspace(1e-4, 2e-2, len(found))
    edited = [replace(each, cov=sigma**2 * np.eye(6)) for each, sigma in zip(found, sigmas, strict=True)]
    here = KeyframesInBase(edited, Pose.identity(), Calibration("c", T_base_nav=Pose.identity()), path=path)
    joint = joint_tool_covariances(here)["tracking"]
    for cov in (block_diag(*tool_covariances(here)["tracking"]), joint):
        assert_allclose(np.sqrt(np.diagonal(cov)), np.repeat(sigmas, 6), rtol=1e-9)
    assert np.linalg.eigvalsh(joint).min() > 0.0


def with_one_between(path: HandPath) -> list[Keyframe]:
    """The path's keyframes, and one in the middle of the move from 3 to 4, as an edited keyframe copied from 3."""
    found = keyframes_of(path)
    t = 0.5 * (path.rests[3][1] + path.rests[4][0])
    at = int(np.searchsorted(path.t, t))
    between = replace(found[3], t=t, T_nav_sensor=Pose(path.p_nav_sensor[at], path.wxyz_nav_sensor[at]))
    assert path.tracking is not None
    demo = replace(path.tracking.demo, keyframes=(*found[:4], between, *found[4:]))
    return list(keyframes_of(replace(path, tracking=replace(path.tracking, demo=demo))))


@pytest.mark.parametrize(("mount_sigma", "scale_sigma"), [(0.0, 0.0), (0.005, 0.0), (0.005, 0.03)])
def test_a_place_in_base_corrects_the_calibration_as_one_estimate_of_all_does(
    mount_sigma: float, scale_sigma: float
) -> None:
    """The tool at a place known to 1 mm is there to 1 mm, whatever the sigmas of dock, mount and scale are."""
    demo, sigma = load_demo("pouring"), 0.001
    alone = track(demo)
    dock = Calibration(
        "c",
        T_base_dock=Pose.from_rpy((0.4, -0.1, 0.2), (0.0, 0.0, 0.7)),
        T_sensor_tool=T_SENSOR_TOOL,
        cov_sensor_tool=np.diag([*[mount_sigma**2] * 3, 0.0, 0.0, 0.0]),
        residuals={"dock.scale_sigma": scale_sigma},
    )
    without = place_in_base(with_one_between(alone), dock, path=alone)
    before, cov = np.array([pose.p for pose in tool_poses(without)]), total_covariance(without)
    at = [2, 3]
    asked = before[at] + ((0.004, -0.003, 0.002), (0.004, -0.002, 0.001))
    places = [Place((without.keyframes[k].t,), tuple(p), sigma) for k, p in zip(at, asked.tolist(), strict=True)]
    path = track(demo, known=Known(demo.closed, tuple(places)), calibration=dock)
    placed = place_in_base(with_one_between(path), dock, path=path)
    rows = [6 * k + axis for k in at for axis in range(3)]
    gain = np.linalg.solve(cov[np.ix_(rows, rows)] + sigma**2 * np.eye(len(rows)), cov[rows]).T
    expected = before + (gain @ np.ravel(asked - before[at])).reshape(-1, 6)[:, :3]
    # The estimates differ by the products of two corrections.
    assert_allclose([pose.p for pose in tool_poses(placed)], expected, rtol=0.0, atol=1e-4)
    sigmas = np.sqrt(np.diagonal(cov - gain @ cov[rows]))
    assert_allclose(np.sqrt(np.diagonal(total_covariance(placed))), sigmas, rtol=0.05, atol=1e-9)
    for other in (replace(dock, T_base_dock=Pose.identity()), replace(dock, T_sensor_tool=Pose.identity())):
        with pytest.raises(CalibrationError, match=r"tracked with 'c': .* track it with the calibration"):
            place_in_base(keyframes_of(path), other, path=path)


def test_a_scale_that_points_showed_is_uncertain_at_a_distance() -> None:
    """By 1 % of 0.3 m, along the way from nav's origin."""
    calibration = Calibration(
        "c", T_base_nav=T_BASE_NAV, cov_base=np.zeros((6, 6)), residuals={"nav.scale_sigma": 0.01}
    )
    keyframe = Keyframe(0.0, 1.0, Pose(np.array([0.0, 0.3, 0.0]), FIRST.wxyz), np.zeros((6, 6)))
    sigma = np.sqrt(
        np.diagonal(tool_covariances(KeyframesInBase([keyframe], Pose.identity(), calibration))["start"][0])
    )
    assert_allclose(sigma, [0.0, 0.003, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_dock_at_a_known_place_is_uncertain_by_the_lever() -> None:
    """Oracle: Kalman's update of the sensor's position there by one that is known to lever's and place's sigma."""
    path, at, lever, sigma = track(load_demo("pouring"), known=Known()), 3, 0.005, 0.001
    bench = Calibration(
        "c",
        T_base_dock=Pose.from_rpy((0.4, -0.1, 0.2), (0.0, 0.0, 0.7)),
        T_sensor_tool=Pose(np.array([0.0, 0.0, 0.01]), T_SENSOR_TOOL.wxyz),
        cov_sensor_tool=lever**2 * np.eye(6),
    )
    keyframes = keyframes_of(path)
    before = dock_at(keyframes, at, bench, path)[1][:3, :3]
    tool = tool_poses(place_in_base(keyframes, bench, path=path))[at].p
    place = Place((keyframes[at].t,), tuple(tool.tolist()), sigma)
    after = dock_at(keyframes, at, bench, track(load_demo("pouring"), known=Known(places=(place,)), calibration=bench))
    expected = before - before @ np.linalg.solve(before + (lever**2 + sigma**2) * np.eye(3), before)
    assert_allclose(np.sqrt(np.diagonal(after[1])[:3]), np.sqrt(np.diagonal(expected)), rtol=0.01)
