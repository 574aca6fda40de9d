"""LeRobot's joint angles of the SO arms: both arms have the same zero, though their URDFs differ."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pbd.data import Robot, ServoUnits
from pbd.errors import RobotError
from pbd.files.robot import load_robot, read_robot
from pbd.pose import Array

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


def servos_of(robot: Robot) -> ServoUnits:
    assert robot.servos is not None
    return robot.servos


def shape(name: str, degrees: Array) -> tuple[Array, Array]:
    """Return each joint's position, m, and axis at LeRobot's degrees, in a base whose x axis points ahead."""
    robot = load_robot(name)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    q = np.zeros(model.nq)
    for joint, position in zip(robot.joints, servos_of(robot).to_radians(degrees), strict=True):
        q[model.joints[model.getJointId(joint)].idx_q] = position
    pin.computeJointJacobians(model, data, q)
    ids = [model.getJointId(joint) for joint in MOTORS]
    places = np.array([data.oMi[i].translation for i in ids])
    axes = np.array([data.J[3:, model.joints[i].idx_v] for i in ids])
    axes[:5] *= servos_of(robot).sign[:, None]
    ahead = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if name == "so100" else np.eye(3)
    return (places - places[1]) @ ahead.T, axes @ ahead.T


@pytest.mark.parametrize("degrees", [np.zeros(5), np.array([0.0, -30.0, 40.0, 25.0, 0.0])])
def test_both_arms_have_the_same_pose_at_the_same_degrees(degrees: Array) -> None:
    """Seen from the side: along its axis, a joint's position is arbitrary."""
    side = np.ix_(range(1, 6), (0, 2))
    np.testing.assert_allclose(shape("so100", degrees)[0][side], shape("so101", degrees)[0][side], atol=0.0015)


def test_the_joints_of_both_arms_have_the_same_axes() -> None:
    degrees = np.array([20.0, -30.0, 40.0, 25.0, -50.0])
    np.testing.assert_allclose(shape("so100", degrees)[1], shape("so101", degrees)[1], atol=1e-4)


def test_degrees_and_percent_are_converted() -> None:
    robot = load_robot("so100")
    servos = servos_of(robot)
    np.testing.assert_allclose(servos.to_degrees(robot.home)[0], -np.degrees(robot.home[0]), atol=1e-12)
    np.testing.assert_allclose(servos.to_degrees(robot.home)[1], np.degrees(robot.home[1] - 1.8))
    np.testing.assert_allclose(servos.to_radians(servos.to_degrees(robot.home)), robot.home)
    np.testing.assert_allclose(servos.to_percent(np.array([-0.174533, 1.74533])), [0.0, 100.0])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "sign = [1, 1, 1, 1, 1]",
            "sign = [1, 1, 0, 1, 1]",
            "[servos] sign must be 1 or -1 for each joint",
        ),
        ("zero = [0.0, 0.0, 0.0, 0.0, 0.0486795]", "zero = [0.0]", "[servos] zero"),
        (
            '[gripper]\njoints = ["gripper"]\n',
            "",
            "[servos] gripper needs a [gripper] with one joint; add it, or",
        ),
        ("gripper = [-0.174533, 1.74533]", "gripper = [1.0, 1.0]", "[servos] gripper is 1 both closed and open"),
    ],
)
def test_a_fault_in_servos_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = (Path(__file__).parents[2] / "robots" / "so101.toml").read_text()
    assert old in text
    (tmp_path / "mine.toml").write_text(text.replace(old, new))
    with pytest.raises(RobotError) as error:
        read_robot(tmp_path / "mine.toml")
    assert says in str(error.value)
