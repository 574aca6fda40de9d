"""MCAP with standard ROS 2 messages, for Foxglove, Rerun and rosbag2: the arm's motion and the hand's recording.

Both begin at the bag's start. rosbags, which comes with pbd-robot[ros], writes it; ROS is not needed.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from pbd.data import Recording, Robot, Samples
from pbd.errors import require_package
from pbd.files.exporters.export_request import ExportRequest
from pbd.files.exporters.ros2_json import DERIVATIVES, finger_message, goal_message, samples
from pbd.io.toml import instant_of
from pbd.pose import Array, Pose, quat_continuous, quat_to_xyzw

__all__ = ["check", "read", "samples", "write"]

TRAJECTORY_TYPE = "trajectory_msgs/msg/JointTrajectory"
TOOL, NAV, SENSOR = "pbd_tool", "nav", "sensor"
"""Names of the frames that are not links of the URDF."""

UNDATED_NS = 10**9
"""Start of the bag, ns, if the recording has no date. In ROS, zero means "now"."""


def check(robot: Robot) -> None:
    """Refuse if rosbags is missing (PbdError)."""
    require_package("rosbags.rosbag2", "ros", "mcap")


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the bag."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            _Bag(request, writer).fill(points)
        next(bag.glob("*.mcap")).replace(path)


def read(path: Path) -> Samples:
    """Read the arm's JointTrajectory from a file of `write`; the gripper's opening is NaN: it has its own message."""
    from rosbags.rosbag2 import Reader

    with TemporaryDirectory() as folder:
        link = Path(folder) / "bag.mcap"  # rosbags requires this suffix
        link.symlink_to(path.absolute())
        with Reader(link) as bag:
            goal = [each for each in bag.connections if each.topic == "/joint_trajectory"]
            _, _, data = next(bag.messages(goal))
    points = _types().deserialize_cdr(data, goal[0].msgtype).points
    t = np.array([each.time_from_start.sec + 1e-9 * each.time_from_start.nanosec for each in points])
    q, qd, qdd = (np.array([getattr(each, name) for each in points]) for name in DERIVATIVES)
    return Samples(t, q, qd, qdd, np.full(len(t), np.nan))


class _Bag:
    """Writes the messages of one bag. Each message is given as dicts, lists and numbers."""

    def __init__(self, request: ExportRequest, writer: Any) -> None:
        self.request, self.source, self.writer = request, request.source, writer
        self.store = _types()
        self.topics: dict[str, Any] = {}
        self.turns: dict[str, Array] = {}
        demo = None if (tracking := self.source.hand.tracking) is None else tracking.demo
        self.start_ns = _start_ns(None if demo is None else demo.recording.info.created)
        # A fused path has the mean pace of its takes, at which no sensor recorded.
        self.recording = None if demo is None or demo.takes else demo.recording

    def fill(self, points: Samples) -> None:
        request, robot, hand = self.request, self.request.robot, self.source.hand
        states = request.trajectory.sample(request.rate_hz or 100.0)
        self.put("/robot_description", None, "std_msgs/msg/String", {"data": robot.urdf.read_text(encoding="utf-8")})
        goal = goal_message(robot.joints, points.t, (points.q, points.qd, points.qdd))
        self.put("/joint_trajectory", None, TRAJECTORY_TYPE, goal)
        if robot.gripper is not None and robot.gripper.joints:
            self.put("/gripper_trajectory", None, TRAJECTORY_TYPE, finger_message(request.trajectory, robot.gripper))
        moving = self.put_links(states)
        keyframes = request.trajectory.keyframe_t, *self.source.tool(request.trajectory.keyframe_q)
        self.put_path("/keyframes/path", robot.base, *keyframes, each="/keyframes")
        self.put_path("/tool/path", robot.base, states.t, *self.source.tool(states.q))
        poses = hand.t, hand.p_nav_sensor, hand.wxyz_nav_sensor
        self.put_path("/hand/path", NAV, *poses, each="/hand/pose")
        for at, *pose in zip(*poses, strict=True):
            self.put_transforms("/tf", float(at), [(NAV, SENSOR, Pose(*pose))])
        fixed = [(robot.base, NAV, self.source.T_base_nav), (robot.body, TOOL, robot.T_body_tool)]
        fixed += [(parent, link, at) for link, (parent, at) in self.links(states, 0).items() if link not in moving]
        self.put_transforms("/tf_static", None, fixed)
        if self.recording is not None:
            self.put_recording(self.recording)

    def links(self, states: Samples, i: int) -> dict[str, tuple[str, Pose]]:
        return self.source.links(states.q[i], float(states.gripper[i]))

    def put_links(self, states: Samples) -> set[str]:
        """Write /joint_states, and /tf of the moving links; return their names."""
        first, robot = self.links(states, 0), self.request.robot
        other = self.source.links(states.q[0] + 0.1, float(states.gripper[0] < 0.5))  # all joints moved
        moving = {link for link, (_, pose) in first.items() if max(pose.distance(other[link][1])) > 1e-6}
        names, q, qd = [*robot.joints], states.q, states.qd
        if (gripper := robot.gripper) is not None and gripper.joints:
            names += gripper.joints
            fingers = gripper.positions(states.gripper)
            q, qd = np.hstack((q, fingers)), np.hstack((qd, np.gradient(fingers, states.t, axis=0)))
        for i, at in enumerate(states.t.tolist()):
            state = {"header": self.header(robot.base, at), "name": names, "position": q[i], "velocity": qd[i]}
            self.put("/joint_states", at, "sensor_msgs/msg/JointState", state | {"effort": []})
            poses = [(parent, link, pose) for link, (parent, pose) in self.links(states, i).items() if link in moving]
            self.put_transforms("/tf", at, poses)
        return moving

    def put_recording(self, recording: Recording) -> None:
        """Write the sensor's samples, without those that are not finite."""
        unknown, known = np.append(-1.0, np.zeros(8)), np.zeros(9)
        gyr = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
        constant = {
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            "orientation_covariance": unknown,
            "angular_velocity_covariance": unknown if recording.gyr is None else known,
            "linear_acceleration_covariance": known,
        }
        for i in np.flatnonzero(np.isfinite(recording.acc).all(axis=1) & np.isfinite(gyr).all(axis=1)).tolist():
            at = float(recording.t[i])
            read = {"angular_velocity": _xyz(gyr[i]), "linear_acceleration": _xyz(recording.acc[i])}
            self.put("/imu", at, "sensor_msgs/msg/Imu", {"header": self.header(SENSOR, at), **constant, **read})
        mag = np.empty((0, 3)) if recording.mag is None else recording.mag
        for i in np.flatnonzero(np.isfinite(mag).all(axis=1)).tolist():
            at, tesla = float(recording.t[i]), _xyz(1e-6 * mag[i])
            field = {"header": self.header(SENSOR, at), "magnetic_field": tesla, "magnetic_field_covariance": known}
            self.put("/magnetic_field", at, "sensor_msgs/msg/MagneticField", field)

    def put_path(self, topic: str, frame: str, t: Array, p: Array, wxyz: Array, each: str = "") -> None:
        """Write times (n,), positions (n, 3) and wxyz (n, 4) as one Path, and each pose to the topic `each`."""
        stamped = [
            {"header": self.header(frame, float(at)), "pose": {"position": _xyz(place), "orientation": _xyzw(turn)}}
            for at, place, turn in zip(t, p, quat_continuous(wxyz), strict=True)
        ]
        self.put(topic, None, "nav_msgs/msg/Path", {"header": self.header(frame, None), "poses": stamped})
        if each:
            for at, pose in zip(t, stamped, strict=True):
                self.put(each, float(at), "geometry_msgs/msg/PoseStamped", pose)

    def put_transforms(self, topic: str, at: float | None, poses: Sequence[tuple[str, str, Pose]]) -> None:
        """Write poses: parent, child, the child's pose in the parent. Each child turns on from its last rotation."""
        for _, child, pose in poses:
            self.turns[child] = quat_continuous(np.array((self.turns.get(child, pose.wxyz), pose.wxyz)))[1]
        transforms = [
            {
                "header": self.header(parent, at),
                "child_frame_id": child,
                "transform": {"translation": _xyz(pose.p), "rotation": _xyzw(self.turns[child])},
            }
            for parent, child, pose in poses
        ]
        self.put(topic, at, "tf2_msgs/msg/TFMessage", {"transforms": transforms})

    def put(self, topic: str, at: float | None, kind: str, message: Mapping[str, Any]) -> None:
        """Write a message; `at`: s from the bag's start; None: the topic's only one, which late subscribers get too."""
        if topic not in self.topics:
            qos = _latched() if at is None else ()
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store, offered_qos_profiles=qos)
        data = self.store.serialize_cdr(_with_attributes(message), kind)
        self.writer.write(self.topics[topic], self.start_ns + round(1e9 * (at or 0.0)), data)

    def header(self, frame: str, at: float | None) -> dict[str, Any]:
        sec, nanosec = divmod(self.start_ns + round(1e9 * (at or 0.0)), 10**9)
        return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _with_attributes(value: Any) -> Any:
    """Make of a message's dicts objects, and of its lists of numbers arrays, as rosbags takes them."""
    if isinstance(value, Mapping):
        return SimpleNamespace(**{name: _with_attributes(each) for name, each in value.items()})
    if isinstance(value, list) and not any(isinstance(each, str | Mapping) for each in value[:1]):
        return np.array(value, dtype=np.float64)
    return [_with_attributes(each) for each in value] if isinstance(value, list) else value


@cache
def _types() -> Any:
    """Return the message types. rosbags compiles a type when it is first used, so they are kept."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _start_ns(created: str | None) -> int:
    """Return the bag's start, ns, from a date in ISO 8601."""
    if created is None:
        return UNDATED_NS
    ns = 1000 * round(1e6 * instant_of(created).timestamp())
    return ns if UNDATED_NS <= ns <= (2**31 - 10**6) * 10**9 else UNDATED_NS  # ROS counts seconds in 32 bits


def _xyz(v: Array) -> dict[str, float]:
    return dict(zip("xyz", v.tolist(), strict=True))


def _xyzw(wxyz: Array) -> dict[str, float]:
    return dict(zip("xyzw", quat_to_xyzw(wxyz).tolist(), strict=True))


def _latched() -> tuple[Any]:
    """Return the quality of service of a topic whose last message late subscribers get."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(2**31 - 1, 2**32 - 1)
    kept = QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL
    return (Qos(*kept, never, never, QosLiveliness.AUTOMATIC, never, False),)
