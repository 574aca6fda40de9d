"""Rotations and poses against scipy, especially near singular angles."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from pbd.frozen_arrays import readonly
from pbd.pose import (
    Array,
    Pose,
    quat_about_z,
    quat_canonical,
    quat_continuous,
    quat_exp,
    quat_from_matrix,
    quat_from_rpy,
    quat_from_xyzw,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_slerp,
    quat_to_matrix,
    quat_to_rpy,
    quat_to_xyzw,
    yaw_toward,
)

NEAR_SINGULAR = (0.0, 1e-9, 1e-7, np.pi / 2, np.pi - 1e-7, np.pi - 1e-9, np.pi)

coordinates = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)
along_an_axis = st.sampled_from([*np.eye(3), *-np.eye(3)])
axes = along_an_axis | vectors.filter(lambda v: bool(np.linalg.norm(v) > 0.1)).map(lambda v: v / np.linalg.norm(v))
angles = st.sampled_from(NEAR_SINGULAR) | st.floats(0.0, np.pi)
turns = st.builds(lambda axis, angle: axis * angle, axes, angles)
rotations = turns.map(Rotation.from_rotvec)
poses = st.builds(lambda p, turn: Pose(p, quat_exp(turn)), vectors, turns)


def wxyz(rotation: Rotation) -> Array:
    return np.asarray(rotation.as_quat(scalar_first=True))


def apart(quat: Array, rotation: Rotation) -> float:
    """Angle in rad between a quaternion of pbd and a rotation of scipy."""
    return float((Rotation.from_quat(quat, scalar_first=True).inv() * rotation).magnitude())


def assert_same(a: Pose, b: Pose) -> None:
    metres, rad = a.distance(b)
    assert metres < 1e-14
    assert rad < 1e-14


# --- quaternions ------------------------------------------------------------------------------------------------------


@given(turns, st.floats(-3.0, 3.0))
def test_exp(turn: Array, factor: float) -> None:
    """Also beyond pi, where the scalar part changes its sign."""
    assert_allclose(quat_exp(factor * turn), wxyz(Rotation.from_rotvec(factor * turn)), atol=1e-15)


@given(turns)
def test_log_undoes_exp(turn: Array) -> None:
    back = quat_log(quat_exp(turn))
    if np.pi - np.linalg.norm(turn) < 1e-12:  # a half turn has two vectors
        back = back * np.sign(back @ turn)
    assert_allclose(back, turn, rtol=1e-12, atol=1e-14)


@given(rotations)
def test_exp_undoes_log(rotation: Rotation) -> None:
    turn = quat_log(-wxyz(rotation))  # of either sign
    assert np.linalg.norm(turn) <= np.pi * (1.0 + 4.0 * np.finfo(float).eps)  # three products and a root are rounded
    assert apart(quat_exp(turn), rotation) < 1e-14


@pytest.mark.parametrize("angle", [1e-6, 1e-7, 1e-9, 1e-13, 1e-160])
def test_a_small_turn_keeps_its_digits(angle: float) -> None:
    assert_allclose(quat_log(quat_exp((0.0, 0.0, angle))), (0.0, 0.0, angle), rtol=1e-14)


@given(rotations, rotations, vectors)
def test_product_inverse_and_turned_vector(a: Rotation, b: Rotation, vector: Array) -> None:
    assert apart(quat_multiply(wxyz(a), wxyz(b)), a * b) < 1e-14
    assert apart(quat_inverse(wxyz(a)), a.inv()) < 1e-14
    assert_allclose(quat_rotate(wxyz(a), vector), a.apply(vector), atol=1e-14)


def test_functions_broadcast() -> None:
    rng = np.random.default_rng(0)
    one, many = quat_exp(rng.normal(size=3)), quat_exp(rng.normal(size=(5, 3)))
    vectors = rng.normal(size=(5, 3))
    assert_allclose(quat_multiply(one, many), [quat_multiply(one, q) for q in many])
    assert_allclose(quat_rotate(one, vectors), [quat_rotate(one, v) for v in vectors])
    assert_allclose(quat_rotate(many, vectors[0]), [quat_rotate(q, vectors[0]) for q in many])
    of_quats: list[Callable[[Array], Array]] = [quat_inverse, quat_log, quat_canonical, quat_to_matrix, quat_to_rpy]
    for of_quat in of_quats:
        assert_allclose(of_quat(many), [of_quat(q) for q in many])
    for of_vector in (quat_exp, quat_from_rpy):
        assert_allclose(of_vector(vectors), [of_vector(v) for v in vectors])
    matrices = quat_to_matrix(many)
    assert_allclose(quat_from_matrix(matrices), [quat_from_matrix(m) for m in matrices])


@given(rotations, st.floats(1e-3, 1e3), st.sampled_from((-1.0, 1.0)))
def test_canonical(rotation: Rotation, norm: float, sign: float) -> None:
    quat = quat_canonical(sign * norm * wxyz(rotation))
    assert quat[0] >= 0.0
    assert abs(np.linalg.norm(quat) - 1.0) < 1e-15
    assert apart(quat, rotation) < 1e-14


@pytest.mark.parametrize("reorder", [np.asarray, quat_to_xyzw])
def test_continuous_signs(reorder: Callable[[Array], Array]) -> None:
    """Two turns about a slanted axis end where they began, after one change of sign."""
    turning = np.linspace(0.0, 4.0 * np.pi, 60)[:, None] * (0.6, 0.0, 0.8)
    stored = quat_canonical(quat_exp(turning))
    assert (np.abs(np.diff(stored, axis=0)).max(axis=1) > 1.0).sum() == 2
    assert_allclose(quat_continuous(reorder(stored)), reorder(quat_exp(turning)), atol=1e-14)


@given(rotations)
def test_matrix_there_and_back(rotation: Rotation) -> None:
    assert_allclose(quat_to_matrix(wxyz(rotation)), rotation.as_matrix(), atol=1e-15)
    quat = quat_from_matrix(rotation.as_matrix())
    assert quat[0] >= 0.0
    assert apart(quat, rotation) < 1e-14


@given(st.tuples(*[st.floats(-np.pi, np.pi)] * 3))
def test_rpy_is_about_fixed_axes(rpy: tuple[float, float, float]) -> None:
    assert apart(quat_from_rpy(rpy), Rotation.from_euler("xyz", rpy)) < 1e-14


@given(st.floats(-3.14, 3.14), st.floats(-1.5, 1.5), st.floats(-3.14, 3.14))
def test_rpy_there_and_back(roll: float, pitch: float, yaw: float) -> None:
    assert_allclose(quat_to_rpy(quat_from_rpy((roll, pitch, yaw))), (roll, pitch, yaw), atol=1e-13)


@pytest.mark.parametrize("short_of", [1e-3, 1e-5, 1e-7])
def test_rpy_near_its_pole(short_of: float) -> None:
    """At the pole roll and yaw share an axis. The rotation is recovered to half of the digits, as arcsin allows."""
    for pitch in (np.pi / 2 - short_of, short_of - np.pi / 2):
        quat = quat_from_rpy((0.3, pitch, 0.5))
        assert apart(quat_from_rpy(quat_to_rpy(quat)), Rotation.from_quat(quat, scalar_first=True)) < 1e-7


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@given(roll=st.floats(-np.pi, np.pi), yaw=st.floats(-np.pi, np.pi))
def test_rpy_at_its_pole(pitch: float, roll: float, yaw: float) -> None:
    quat = quat_from_rpy((roll, pitch, yaw))
    assert apart(quat_from_rpy(quat_to_rpy(quat)), Rotation.from_quat(quat, scalar_first=True)) < 1e-7


@given(rotations)
def test_xyzw(rotation: Rotation) -> None:
    assert_allclose(quat_to_xyzw(wxyz(rotation)), rotation.as_quat(), atol=0.0)
    assert apart(quat_from_xyzw(rotation.as_quat()), rotation) < 1e-14


@given(rotations, turns.filter(lambda turn: bool(np.linalg.norm(turn) < 3.1)), st.sampled_from((-1.0, 1.0)))
def test_slerp(start: Rotation, turn: Array, sign: float) -> None:
    """The shorter rotation, for either sign of the quaternion."""
    fraction = np.linspace(0.0, 1.0, 5)
    end = start * Rotation.from_rotvec(turn)
    ours = quat_slerp(wxyz(start), sign * wxyz(end), fraction)
    theirs = Slerp([0.0, 1.0], Rotation.concatenate([start, end]))(fraction)
    assert max(apart(q, r) for q, r in zip(ours, theirs, strict=True)) < 1e-14


@given(rotations, rotations)
def test_yaw_toward_is_the_best_yaw(measured: Rotation, wanted: Rotation) -> None:
    def left_over(yaw: Array) -> Array:
        return np.asarray((Rotation.from_euler("z", yaw[:, None]) * measured * wanted.inv()).magnitude())

    grid = left_over(np.linspace(-np.pi, np.pi, 721))
    assert left_over(np.array([yaw_toward(wxyz(measured), wxyz(wanted))]))[0] <= grid.min() + 1e-7


@given(rotations, st.floats(-3.1, 3.1))
def test_yaw_toward_undoes_a_yaw(measured: Rotation, yaw: float) -> None:
    found = yaw_toward(wxyz(measured), quat_multiply(quat_about_z(yaw), wxyz(measured)))
    assert_allclose(found, yaw, atol=1e-13)


# --- poses ------------------------------------------------------------------------------------------------------------


@given(poses, poses, poses)
def test_poses_are_a_group(a: Pose, b: Pose, c: Pose) -> None:
    assert_same((a @ b) @ c, a @ (b @ c))
    assert_same(a @ a.inverse(), Pose.identity())
    assert_same(a.inverse() @ a, Pose.identity())
    assert_same(Pose.identity() @ a, a)
    assert_same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses, poses, vectors)
def test_poses_act_as_matrices_do(a: Pose, b: Pose, point: Array) -> None:
    assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-14)
    assert_allclose(a.inverse().matrix(), np.linalg.inv(a.matrix()), atol=1e-13)
    assert_allclose(a.act(point), (a.matrix() @ [*point, 1.0])[:3], atol=1e-14)
    assert_allclose(a.act([point, -point]), [a.act(point), a.act(-point)], atol=0.0)
    assert_same(Pose.from_matrix(a.matrix()), a)


@given(poses)
def test_pose_exp_undoes_log(pose: Pose) -> None:
    assert_same(Pose.exp(pose.log()), pose)


def test_pose_from_rpy() -> None:
    pose = Pose.from_rpy((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    assert_allclose(pose.p, (1.0, 2.0, 3.0))
    assert apart(pose.wxyz, Rotation.from_euler("xyz", (0.1, 0.2, 0.3))) < 1e-15


@given(poses, vectors, turns)
def test_distance(pose: Pose, shift: Array, turn: Array) -> None:
    moved = Pose(pose.p + shift, quat_multiply(pose.wxyz, quat_exp(turn)))
    assert_allclose(pose.distance(moved), (np.linalg.norm(shift), np.linalg.norm(turn)), atol=1e-14)
    assert_allclose(moved.distance(pose), pose.distance(moved), atol=1e-14)


def test_a_pose_cannot_be_changed() -> None:
    p, quat = np.zeros(3), np.array([-2.0, 0.0, 0.0, 0.0])
    pose = Pose(p, quat)
    p[0], quat[1] = 9.0, 9.0
    assert_allclose(pose.p, 0.0)
    assert_allclose(pose.wxyz, (1.0, 0.0, 0.0, 0.0))  # unit and w >= 0, whatever came in
    for array in (pose.p, pose.wxyz, readonly([1.0])):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("p", "quat"), [(np.zeros(2), np.ones(4)), (np.zeros(3), np.ones(3)), (np.zeros((3, 1)), np.ones(4))]
)
def test_a_pose_of_another_shape_is_refused(p: Array, quat: Array) -> None:
    with pytest.raises(ValueError, match=r"takes p \(3,\) and wxyz \(4,\), got"):
        Pose(p, quat)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", [0, 6])
def test_a_pose_that_is_not_finite_is_refused(bad: float, index: int) -> None:
    values = np.ones(7)
    values[index] = bad
    with pytest.raises(ValueError, match="must be finite"):
        Pose(values[:3], values[3:])


def test_a_pose_without_a_rotation_is_refused() -> None:
    with pytest.raises(ValueError, match="nonzero quaternion"):
        Pose(np.zeros(3), np.zeros(4))
