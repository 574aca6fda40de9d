"""The programs of docs/exports.md that drive arms, run against stand-ins.

The stand-ins have the parameters of ur-rtde 1.6.5, franky-control 2.0.0 and xarm-python-sdk 1.18.4, by hand: their
signatures were compared with the packages', which are too large for the tests.
"""

import json
import sys
import time
from datetime import timedelta
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Self

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from pbd.data import JointTrajectory
from pbd.files.exporters import export
from pbd.files.robot import load_robot
from pbd.pose import Array
from tests.docs_pages import ROOT, blocks
from tests.files.planned_motions import planned

RATES = {"ur5": 125.0, "panda": 100.0, "xarm7": 100.0}
PROGRAMS = {"ur5": "rtde_control", "panda": "franky", "xarm7": "xarm.wrapper"}


class Stand:
    """An arm that records the commands it gets."""

    def __init__(self, q: Array) -> None:
        self.q, self.told = q, list[Any]()
        self.calls: list[str] = []


def stand_ins(stand: Stand) -> dict[str, ModuleType]:
    class RTDEControlInterface:
        def __init__(
            self, hostname: str, frequency: float = -1.0, flags: int = 1, ur_cap_port: int = 50002, rt_priority: int = 0
        ) -> None: ...

        def initPeriod(self) -> timedelta:
            return timedelta()

        def waitPeriod(self, arg0: timedelta) -> None: ...

        def servoJ(self, arg0: list[float], arg1: float, arg2: float, arg3: float, arg4: float, arg5: float) -> bool:
            assert (arg1, arg2, arg3, arg4, arg5) == (0.0, 0.0, 0.008, 0.1, 300.0)
            stand.told.append(arg0)
            return True

        def servoStop(self, a: float = 10.0) -> bool:
            stand.calls.append("servoStop")
            return True

        def stopScript(self) -> None:
            stand.calls.append("stopScript")

    class RTDEReceiveInterface:
        def __init__(self, hostname: str, frequency: float = -1.0) -> None: ...

        def getActualQ(self) -> list[float]:
            return list(stand.q)

    class Robot:
        def __init__(self, fci_hostname: str) -> None: ...

        @property
        def current_joint_positions(self) -> Array:
            return stand.q

    class JointImpedanceTracker:
        def __init__(self, robot: Robot, *, stiffness: Array | None = None, period: float | None = None) -> None:
            assert period == 0.01

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *error: object) -> None:
            stand.calls.append("exit")

        def tick(self) -> float | None:
            return 0.01

        def set_target(self, q: Array, dq: Array | None = None, tau_ff: Array | None = None) -> None:
            stand.told.append(q)

    class XArmAPI:
        def __init__(self, port: str | None = None, is_radian: bool = False, do_not_open: bool = False) -> None:
            assert is_radian

        def motion_enable(self, enable: bool = True, servo_id: int | None = None) -> None: ...

        def get_servo_angle(
            self, servo_id: int | None = None, is_radian: bool | None = None, is_real: bool = False
        ) -> tuple[int, list[float]]:
            return 0, list(stand.q)

        def set_mode(self, mode: int = 0, detection_param: int = 0) -> None:
            stand.calls.append(f"mode {mode}")

        def set_state(self, state: int = 0) -> None: ...

        def set_servo_angle_j(
            self,
            angles: list[float],
            speed: float | None = None,
            mvacc: float | None = None,
            mvtime: float | None = None,
            is_radian: bool | None = None,
        ) -> int:
            assert stand.calls[-1] == "mode 1"
            stand.told.append(angles)
            return 0

        def disconnect(self) -> None:
            stand.calls.append("disconnect")

    modules = {}
    for name, things in {
        "rtde_control": (RTDEControlInterface,),
        "rtde_receive": (RTDEReceiveInterface,),
        "franky": (Robot, JointImpedanceTracker),
        "xarm": (),
        "xarm.wrapper": (XArmAPI,),
    }.items():
        modules[name] = ModuleType(name)
        for thing in things:
            setattr(modules[name], thing.__name__, thing)
    return modules


@pytest.mark.parametrize(("robot_name", "program"), PROGRAMS.items())
def test_the_arm_is_told_every_row(
    robot_name: str, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = load_robot(robot_name)
    k = len(robot.joints)
    pieces = np.zeros((1, 4, k))
    pieces[0, 0], pieces[0, 2], pieces[0, 3] = robot.home, 0.03, -0.02  # 0.01 rad in 1 s, from rest to rest
    ends = np.array([0.0, 1.0])
    q = robot.home + np.outer([0.0, 0.01], np.ones(k))
    motion = JointTrajectory(robot.joints, ends, pieces, ends, np.array([1.0, 0.0]), ends, q)
    monkeypatch.chdir(tmp_path)
    export(motion, robot, "npz", Path("motion.npz"), RATES[robot_name])
    stand = Stand(robot.home)
    for name, module in stand_ins(stand).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    openings: list[float] = []
    text = next(block for block in blocks(ROOT / "docs" / "exports.md", "py") if f"from {program} import" in block)
    exec(compile(text, program, "exec"), {"grip": openings.append})
    rows = motion.sample(RATES[robot_name]).q
    held = len(stand.told) - len(rows)
    np.testing.assert_array_equal(stand.told, np.pad(rows, ((0, held), (0, 0)), "edge"))
    if program == "rtde_control":  # its servoJ is 0.1 s late
        assert held >= 0.2 * RATES[robot_name]
    assert openings[0] == motion.gripper[0]
    assert openings[-1] == motion.gripper[-1]
    assert stand.calls[-1] in ("stopScript", "exit", "disconnect")


@pytest.mark.parametrize(("robot_name", "program"), PROGRAMS.items())
def test_an_arm_that_stands_elsewhere_is_not_moved(
    robot_name: str, program: str, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    k = len(load_robot(robot_name).joints)
    t = np.array([0.0, 1.0 / RATES[robot_name]])
    np.savez("motion.npz", q=np.zeros((2, k)), dq=np.zeros((2, k)), t=t, gripper=np.ones(2))
    stand = Stand(np.full(k, 0.1))
    for name, module in stand_ins(stand).items():
        monkeypatch.setitem(sys.modules, name, module)
    text = next(block for block in blocks(ROOT / "docs" / "exports.md", "py") if f"from {program} import" in block)
    with pytest.raises(AssertionError, match="the arm stands elsewhere"):
        exec(compile(text, program, "exec"), {"grip": print})
    assert stand.told == []


def test_ros_2_is_sent_the_arms_goal_and_the_fingers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The messages' fields are checked against ROS 2's definitions, from rosbags."""
    plan, robot, source = planned("panda")
    monkeypatch.chdir(tmp_path)
    export(plan.trajectory, robot, "ros2-json", Path("pouring.json"), source=source)
    store = get_typestore(Stores.ROS2_JAZZY)

    def message(kind: str) -> type:
        def make(self: Any, **given: Any) -> None:
            assert given.keys() <= store.types[kind].__dataclass_fields__.keys()
            self.__dict__ |= {"points": []} | given

        return type(kind.rpartition("/")[2], (), {"__init__": make})

    modules: dict[str, dict[str, Any]] = {
        "builtin_interfaces.msg": {"Duration": message("builtin_interfaces/msg/Duration")},
        "trajectory_msgs.msg": {
            name: message(f"trajectory_msgs/msg/{name}") for name in ("JointTrajectory", "JointTrajectoryPoint")
        },
        "control_msgs.action": {"FollowJointTrajectory": SimpleNamespace(Goal=SimpleNamespace)},
    }
    for module, things in modules.items():
        monkeypatch.setitem(sys.modules, module.partition(".")[0], ModuleType(module.partition(".")[0]))
        monkeypatch.setitem(sys.modules, module, ModuleType(module))
        sys.modules[module].__dict__.update(things)
    sent: dict[str, Any] = {}
    clients = {
        name: SimpleNamespace(send_goal_async=lambda goal, name=name: sent.update({name: goal.trajectory}))
        for name in ("arm", "fingers")
    }
    text = next(block for block in blocks(ROOT / "docs" / "exports.md", "py") if "FollowJointTrajectory" in block)
    exec(compile(text, "ros2", "exec"), {"json": json, **clients})
    assert robot.gripper is not None
    for name, joints in (("arm", robot.joints), ("fingers", robot.gripper.joints[:1])):
        assert sent[name].joint_names == list(joints)
        t = seconds(sent[name])
        assert t[-1] == pytest.approx(plan.trajectory.duration, abs=1e-9)
        np.testing.assert_array_less(0.0, np.diff(t))
    positions = [point.positions for point in sent["arm"].points]
    np.testing.assert_allclose(positions, plan.trajectory.at(seconds(sent["arm"])).q, atol=1e-8)


def seconds(trajectory: Any) -> Array:
    since = (point.time_from_start for point in trajectory.points)
    return np.array([at.sec + 1e-9 * at.nanosec for at in since])
