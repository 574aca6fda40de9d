"""MCAP files, read back by rosbags and by mcap-ros2-support."""

import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.cli import main
from pbd.files.exporters import export
from pbd.files.exporters.mcap import UNDATED_NS, _start_ns
from pbd.pose import Array, Pose, quat_from_xyzw
from tests.arm.bundled import arm_of
from tests.files.planned_motions import planned
from tests.not_none import not_none

Topics = dict[str, list[tuple[int, Any]]]
CREATED = "2026-05-01T12:00:00.75+02:00"


def by_rosbags(path: Path) -> Topics:
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store, topics = get_typestore(Stores.ROS2_JAZZY), defaultdict(list)
    with Reader(path) as reader:
        for connection, ns, data in reader.messages():
            topics[connection.topic].append((ns, store.deserialize_cdr(data, connection.msgtype)))
    return topics


def by_mcap_ros2(path: Path) -> Topics:
    """Read messages by the definitions in the file."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    topics = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, raw, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            topics[channel.topic].append((raw.log_time, message))
    return topics


def pose_of(p: Any, xyzw: Any) -> Pose:
    return Pose(np.array([p.x, p.y, p.z]), quat_from_xyzw(np.array([xyzw.x, xyzw.y, xyzw.z, xyzw.w])))


def tool_by_tf(topics: Topics, robot: Any, i: int) -> Pose:
    """Compute the tool's pose in base at the i-th joint state from the transforms, as a receiver does."""
    transforms = [*topics["/tf_static"][0][1].transforms]
    ns = topics["/joint_states"][i][0]
    transforms += [each for at, message in topics["/tf"] if at == ns for each in message.transforms]
    above = {each.child_frame_id: each for each in transforms}

    def in_root(frame: str) -> Pose:
        if frame not in above:
            return Pose.identity()
        each = above[frame]
        return in_root(each.header.frame_id) @ pose_of(each.transform.translation, each.transform.rotation)

    return in_root(robot.base).inverse() @ in_root("pbd_tool")


@pytest.mark.parametrize(
    ("name", "demo", "read"), [("panda", "paper-test1", by_rosbags), ("ur5", "paper-test2", by_mcap_ros2)]
)
def test_the_bag_has_the_motion_and_the_recording(tmp_path: Path, name: str, demo: str, read: Any) -> None:
    plan, robot, source = planned(name, demo)
    export(plan.trajectory, robot, "mcap", tmp_path / "p.mcap", 10.0, source=source)
    assert list(tmp_path.iterdir()) == [tmp_path / "p.mcap"]
    topics, trajectory = read(tmp_path / "p.mcap"), plan.trajectory
    start = topics["/robot_description"][0][0]
    assert topics["/robot_description"][0][1].data == robot.urdf.read_text()

    states, k = topics["/joint_states"], len(robot.joints)
    t = 1e-9 * np.array([ns - start for ns, _ in states])
    points = trajectory.at(t)
    assert_allclose(t, trajectory.sample(10.0).t, atol=1e-9)
    assert_allclose([message.position[:k] for _, message in states], points.q, atol=1e-8)
    assert_allclose([message.velocity[:k] for _, message in states], points.qd, atol=1e-6)
    gripper = not_none(robot.gripper)
    assert list(states[0][1].name) == [*robot.joints, *gripper.joints]
    for (_, message), opening in zip(states, points.gripper, strict=True):
        assert_allclose(
            message.position[k:], gripper.closed + opening * (gripper.open - gripper.closed), atol=1e-6
        )  # the opening changes by this much in a nanosecond
    for i in range(0, len(states), 29):
        assert max(tool_by_tf(topics, robot, i).distance(arm_of(name).forward(points.q[i]))) < 1e-6

    goal = topics["/joint_trajectory"][0][1]
    assert list(goal.joint_names) == list(robot.joints)
    at = [each.time_from_start.sec + 1e-9 * each.time_from_start.nanosec for each in goal.points]
    assert_allclose([each.positions for each in goal.points], trajectory.at(np.array(at)).q, atol=1e-8)
    fingers = [list(message.joint_names) for _, message in topics.get("/gripper_trajectory", ())]
    assert fingers == ([["panda_finger_joint1"]] if name == "panda" else [])

    assert_allclose([1e-9 * (ns - start) for ns, _ in topics["/keyframes"]], trajectory.keyframe_t, atol=1e-9)
    for (_, message), q in zip(topics["/keyframes"], trajectory.keyframe_q, strict=True):
        assert message.header.frame_id == robot.base
        where = pose_of(message.pose.position, message.pose.orientation)
        assert max(where.distance(arm_of(name).forward(q))) < 1e-9
    assert len(topics["/keyframes/path"][0][1].poses) == len(trajectory.keyframe_t)
    assert len(topics["/tool/path"][0][1].poses) == len(states)

    hand = source.hand
    recording = not_none(hand.tracking).demo.recording

    def vectors(topic: str, field: str) -> Array:
        return np.array([(v.x, v.y, v.z) for v in (getattr(message, field) for _, message in topics[topic])])

    assert_allclose(vectors("/imu", "linear_acceleration"), recording.acc)
    assert_allclose(vectors("/imu", "angular_velocity"), not_none(recording.gyr))
    assert topics["/imu"][0][1].orientation_covariance[0] == -1.0  # no orientation
    if recording.mag is not None:
        assert_allclose(vectors("/magnetic_field", "magnetic_field"), 1e-6 * recording.mag)  # tesla
    hand_p = np.array([(m.pose.position.x, m.pose.position.y, m.pose.position.z) for _, m in topics["/hand/pose"]])
    assert_allclose(hand_p, hand.p_nav_sensor)

    poses = {topic: [m.pose.orientation for _, m in topics[topic]] for topic in ("/hand/pose", "/keyframes")}
    for each in (each for _, message in topics["/tf"] for each in message.transforms):
        poses.setdefault(each.child_frame_id, []).append(each.transform.rotation)
    for topic, turns in poses.items():
        xyzw = np.array([(q.x, q.y, q.z, q.w) for q in turns])
        assert ((xyzw[1:] * xyzw[:-1]).sum(axis=1) >= 0.0).all(), topic  # a plot of them doesn't jump


def test_the_bag_begins_when_the_recording_does(tmp_path: Path) -> None:
    ns = 1777629600_750000000  # CREATED
    plan, robot, source = planned("panda", "paper-test2")
    tracking = not_none(source.hand.tracking)
    recording = tracking.demo.recording
    dated = replace(tracking.demo, recording=replace(recording, info=replace(recording.info, created=CREATED)))
    source = replace(source, hand=replace(source.hand, tracking=replace(tracking, demo=dated)))
    export(plan.trajectory, robot, "mcap", tmp_path / "p.mcap", 10.0, source=source)
    topics = by_rosbags(tmp_path / "p.mcap")
    assert {topics[topic][0][0] for topic in ("/joint_states", "/imu", "/hand/pose", "/tf")} == {ns}
    stamp = topics["/imu"][0][1].header.stamp
    assert 10**9 * stamp.sec + stamp.nanosec == ns


def test_without_a_date_that_can_be_a_bag_begins_at_one_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    assert _start_ns("2026-05-01T10:00:00") == 1777629600_000000000  # UTC on every computer
    for off in ("2045-01-01T00:00:00Z", "1969-12-31T23:59:59Z", None):
        assert _start_ns(off) == UNDATED_NS
    monkeypatch.undo()
    time.tzset()


def test_a_fused_demonstration_has_the_hands_mean_path_and_no_takes_samples(tmp_path: Path) -> None:
    plan, robot, source = planned("panda")
    tracking = not_none(source.hand.tracking)
    fused = replace(tracking, demo=replace(tracking.demo, takes=(tracking.demo, tracking.demo)))
    source = replace(source, hand=replace(source.hand, tracking=fused))
    export(plan.trajectory, robot, "mcap", tmp_path / "p.mcap", 10.0, source=source)
    topics = by_rosbags(tmp_path / "p.mcap")
    assert len(topics["/hand/pose"]) == len(source.hand.t)
    assert not {"/imu", "/magnetic_field"} & {*topics}


def test_without_rosbags_it_says_what_to_install(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    assert main(["export", "pouring", "--robot", "panda", "-o", "p.mcap"]) == 1
    message = "pbd: mcap needs the package rosbags; install it with: pip install 'pbd-robot[ros]'\n"
    assert capsys.readouterr().err == message
    assert not [*elsewhere.iterdir()]
