"""MCAP with ROS 2's own messages, for Foxglove, Rerun and rosbag2: the arm's motion, and the recording that it is from.

Both begin at the bag's start. Written by rosbags, which comes with pbd-robot[ros]; no ROS is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pbd.data import Recording, Robot, Samples
from pbd.errors import PbdError
from pbd.files.exporters.job import Order
from pbd.files.exporters.ros2_json import COUNTED, FILLED_BY, finger_message, samples
from pbd.pose import Array, Pose, quat_to_xyzw

__all__ = ["COUNTED", "FILLED_BY", "check", "read", "samples", "write"]

USUAL_HZ = 100.0
"""Of the arm's states; its JointTrajectory has the motion's own knots."""

LATCHED = ("/robot_description", "/tf_static", "/joint_trajectory", "/gripper_trajectory")
PATHS = ("/keyframes/path", "/tool/path", "/hand/path")
"""Topics with one message, for whoever comes later too."""

TOOL, NAV, SENSOR = "pbd_tool", "nav", "sensor"

UNDATED_NS = 10**9
"""When a bag starts whose recording has no date: zero would mean "now"."""


def check(robot: Robot) -> None:
    """Refuse where rosbags is missing (PbdError)."""
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise PbdError("mcap needs the package rosbags; install it with: pip install 'pbd-robot[ros]'") from None


def write(order: Order, points: Samples, path: Path) -> None:
    """Write the bag."""
    check(order.robot)
    from rosbags.rosbag2 import StoragePlugin, Writer

    with TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            _Bag(order, writer).fill(points)
        next(bag.glob("*.mcap")).replace(path)


def read(path: Path) -> Samples:
    """Read the arm's goal of what `write` wrote; the gripper has its own, and is not told."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    with TemporaryDirectory() as folder:
        link = Path(folder) / "bag.mcap"  # rosbags goes by the name's ending
        link.symlink_to(path.absolute())
        with Reader(link) as bag:
            goal = [each for each in bag.connections if each.topic == "/joint_trajectory"]
            _, _, data = next(bag.messages(goal))
    points = store.deserialize_cdr(data, goal[0].msgtype).points
    t = np.array([each.time_from_start.sec + 1e-9 * each.time_from_start.nanosec for each in points])
    q, qd, qdd = (
        np.array([getattr(each, name) for each in points]) for name in ("positions", "velocities", "accelerations")
    )
    return Samples(t, q, qd, qdd, np.full(len(t), np.nan))


class _Bag:
    """The messages of one bag."""

    def __init__(self, order: Order, writer: Any) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.order, self.source, self.writer = order, order.source, writer
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.topics: dict[str, Any] = {}
        tracking = self.source.hand.tracking
        self.recording = None if tracking is None else tracking.demo.recording
        created = self.recording.info.created if self.recording is not None else None
        self.start_ns = UNDATED_NS if created is None else int(datetime.fromisoformat(created).timestamp()) * 10**9

    def fill(self, points: Samples) -> None:
        order, robot, hand = self.order, self.order.robot, self.source.hand
        states = order.trajectory.sample(order.rate_hz or USUAL_HZ)
        urdf = robot.urdf.read_text(encoding="utf-8")
        self.put("/robot_description", 0.0, self.make("std_msgs/String", data=urdf))
        self.put_trajectories(points)
        moving = self.put_links(states)
        p, wxyz = self.source.tool(order.trajectory.keyframe_q)
        for at, *pose in zip(order.trajectory.keyframe_t.tolist(), p, wxyz, strict=True):
            self.put("/keyframes", at, self.stamped(robot.base, at, *pose))
        self.put("/keyframes/path", 0.0, self.path(robot.base, order.trajectory.keyframe_t, p, wxyz))
        self.put("/tool/path", 0.0, self.path(robot.base, states.t, *self.source.tool(states.q)))
        self.put("/hand/path", 0.0, self.path(NAV, hand.t, hand.p_nav_sensor, hand.wxyz_nav_sensor))
        for at, *pose in zip(hand.t.tolist(), hand.p_nav_sensor, hand.wxyz_nav_sensor, strict=True):
            self.put("/hand/pose", at, self.stamped(NAV, at, *pose))
            self.put("/tf", at, self.transforms(at, [(NAV, SENSOR, Pose(*pose))]))
        fixed = [(robot.base, NAV, self.source.T_base_nav), (robot.body, TOOL, robot.T_body_tool)]
        fixed += [(parent, link, at) for link, (parent, at) in self.links(states, 0).items() if link not in moving]
        self.put("/tf_static", 0.0, self.transforms(0.0, fixed))
        if self.recording is not None:
            self.put_recording(self.recording)

    # --- the arm ------------------------------------------------------------------------------------------------------

    def links(self, states: Samples, i: int) -> dict[str, tuple[str, Pose]]:
        return self.source.links(states.q[i], float(states.gripper[i]))

    def put_links(self, states: Samples) -> set[str]:
        """Write the joints and the links that move; name these."""
        first, robot = self.links(states, 0), self.order.robot
        elsewhere = self.source.links(states.q[0] + 0.1, float(states.gripper[0] < 0.5))
        moving = {link for link, (_, pose) in first.items() if max(pose.distance(elsewhere[link][1])) > 1e-6}
        names, q, qd = [*robot.joints], states.q, states.qd
        if (gripper := robot.gripper) is not None and gripper.joints:
            names += gripper.joints
            fingers = gripper.closed + states.gripper[:, None] * (gripper.open - gripper.closed)
            q, qd = np.hstack((q, fingers)), np.hstack((qd, np.gradient(fingers, states.t, axis=0)))
        for i, at in enumerate(states.t.tolist()):
            state = self.make(
                "sensor_msgs/JointState",
                header=self.header(robot.base, at),
                name=names,
                position=q[i],
                velocity=qd[i],
                effort=np.empty(0),
            )
            self.put("/joint_states", at, state)
            found = [(parent, link, pose) for link, (parent, pose) in self.links(states, i).items() if link in moving]
            self.put("/tf", at, self.transforms(at, found))
        return moving

    def put_trajectories(self, points: Samples) -> None:
        """Write the goals of the arm and of its fingers."""
        none = np.empty((len(points.t), 0))
        arm = self.trajectory(self.order.robot.joints, points.t, (points.q, points.qd, points.qdd, none))
        self.put("/joint_trajectory", 0.0, arm)
        gripper = self.order.robot.gripper
        if gripper is not None and gripper.joints:
            goal = finger_message(self.order.trajectory, gripper)
            since = (point["time_from_start"] for point in goal["points"])
            t = np.array([at["sec"] + 1e-9 * at["nanosec"] for at in since])
            q, none = np.array([point["positions"] for point in goal["points"]]), np.empty((len(t), 0))
            self.put("/gripper_trajectory", 0.0, self.trajectory(gripper.joints, t, (q, none, none, none)))

    def trajectory(self, names: Sequence[str], t: Array, columns: Sequence[Array]) -> Any:
        rows = [
            self.make(
                "trajectory_msgs/JointTrajectoryPoint",
                **dict(zip(("positions", "velocities", "accelerations", "effort"), row, strict=True)),
                time_from_start=self.time("Duration", round(1e9 * at)),
            )
            for at, *row in zip(t.tolist(), *columns, strict=True)
        ]
        now = self.make("std_msgs/Header", stamp=self.time("Time", 0), frame_id="")
        return self.make("trajectory_msgs/JointTrajectory", header=now, joint_names=list(names), points=rows)

    # --- the hand -----------------------------------------------------------------------------------------------------

    def put_recording(self, recording: Recording) -> None:
        """Write what the sensor said; a sample that is missing is left out."""
        unknown, known = np.append(-1.0, np.zeros(8)), np.zeros(9)
        nowhere = self.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        gyr = np.zeros_like(recording.acc) if recording.gyr is None else recording.gyr
        for i in np.flatnonzero(np.isfinite(recording.acc).all(axis=1) & np.isfinite(gyr).all(axis=1)).tolist():
            at = float(recording.t[i])
            imu = self.make(
                "sensor_msgs/Imu",
                header=self.header(SENSOR, at),
                orientation=nowhere,
                orientation_covariance=unknown,
                angular_velocity=self.vector(gyr[i]),
                angular_velocity_covariance=unknown if recording.gyr is None else known,
                linear_acceleration=self.vector(recording.acc[i]),
                linear_acceleration_covariance=known,
            )
            self.put("/imu", at, imu)
        mag = np.empty((0, 3)) if recording.mag is None else recording.mag
        for i in np.flatnonzero(np.isfinite(mag).all(axis=1)).tolist():
            at, tesla = float(recording.t[i]), self.vector(1e-6 * mag[i])
            field = {"header": self.header(SENSOR, at), "magnetic_field": tesla, "magnetic_field_covariance": known}
            self.put("/magnetic_field", at, self.make("sensor_msgs/MagneticField", **field))

    # --- messages -----------------------------------------------------------------------------------------------------

    def put(self, topic: str, at: float, message: Any) -> None:
        """Write a message at seconds from the start."""
        kind = message.__msgtype__
        if topic not in self.topics:
            qos = _latched() if topic in (*LATCHED, *PATHS) else ()
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store, offered_qos_profiles=qos)
        self.writer.write(self.topics[topic], self.start_ns + round(1e9 * at), self.store.serialize_cdr(message, kind))

    def make(self, kind: str, **fields: Any) -> Any:
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](**fields)

    def time(self, kind: str, ns: int) -> Any:
        return self.make(f"builtin_interfaces/{kind}", sec=ns // 10**9, nanosec=ns % 10**9)

    def header(self, frame: str, at: float) -> Any:
        return self.make("std_msgs/Header", stamp=self.time("Time", self.start_ns + round(1e9 * at)), frame_id=frame)

    def vector(self, v: Array, kind: str = "Vector3") -> Any:
        x, y, z = v.tolist()
        return self.make(f"geometry_msgs/{kind}", x=x, y=y, z=z)

    def quaternion(self, wxyz: Array) -> Any:
        x, y, z, w = quat_to_xyzw(wxyz).tolist()
        return self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def stamped(self, frame: str, at: float, p: Array, wxyz: Array) -> Any:
        pose = self.make("geometry_msgs/Pose", position=self.vector(p, "Point"), orientation=self.quaternion(wxyz))
        return self.make("geometry_msgs/PoseStamped", header=self.header(frame, at), pose=pose)

    def path(self, frame: str, t: Array, p: Array, wxyz: Array) -> Any:
        poses = [self.stamped(frame, *row) for row in zip(t.tolist(), p, wxyz, strict=True)]
        return self.make("nav_msgs/Path", header=self.header(frame, 0.0), poses=poses)

    def transforms(self, at: float, found: Sequence[tuple[str, str, Pose]]) -> Any:
        rows = []
        for parent, child, pose in found:
            place = {"translation": self.vector(pose.p), "rotation": self.quaternion(pose.wxyz)}
            transform = self.make("geometry_msgs/Transform", **place)
            header = self.header(parent, at)
            stamped = {"header": header, "child_frame_id": child, "transform": transform}
            rows.append(self.make("geometry_msgs/TransformStamped", **stamped))
        return self.make("tf2_msgs/TFMessage", transforms=rows)


def _latched() -> tuple[Any]:
    """What a publisher offers whose last message is kept for whoever comes later."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(2**31 - 1, 2**32 - 1)
    kept = QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL
    return (Qos(*kept, never, never, QosLiveliness.AUTOMATIC, never, False),)
