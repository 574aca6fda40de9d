"""Bags of ROS 2: our own export, and bags as drivers record them."""

import os
import sqlite3
import struct
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.rosbag2 import storage_mcap

from pbd.data import Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.files.demo import load_demo
from pbd.files.exporters import export
from pbd.files.importers import bag as bag_importer
from pbd.files.importers import import_file
from pbd.pose import Array, quat_exp, quat_from_rpy
from pbd.simulation.simulate import simulate
from pbd.tracking.repair.repair_recording import repair_recording
from tests.files.planned_motions import planned
from tests.files.write_bag import LATE_NS, write_bag
from tests.not_none import not_none

Row = tuple[int, int, str, Array, Array]
"""Stamp and time of recording, ns; frame; acc and gyr, mag."""


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = simulate("pour", "modern", 0).recording
    return Recording(**{name: getattr(whole, name)[:300] for name in ("t", "acc", "gyr", "mag")})


def edit(bag: Path, change: str, *values: bytes) -> None:
    """Change a bag in SQLite."""
    with closing(sqlite3.connect(bag)) as opened:
        opened.execute(change, values)
        opened.commit()


def write_imus(path: Path, rows: list[Row]) -> Path:
    """Write sensor_msgs/Imu and, in uT, MagneticField: (stamp, time of recording, frame, acc and gyr, mag) each."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds: dict[str, Any] = {name.split("/")[-1]: made for name, made in store.types.items()}
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        types = {"Imu": "sensor_msgs/msg/Imu", "MagneticField": "sensor_msgs/msg/MagneticField"}
        to = {kind: writer.add_connection(f"/{kind}", name, typestore=store) for kind, name in types.items()}
        for ns, received, frame, values, field in rows:
            stamp = kinds["Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            header, covariance = kinds["Header"](stamp=stamp, frame_id=frame), np.zeros(9)
            acc, gyr, mag = (
                kinds["Vector3"](**dict(zip("xyz", map(float, each), strict=True)))
                for each in (values[:3], values[3:], field)
            )
            wxyz = kinds["Quaternion"](x=0.0, y=0.0, z=0.0, w=0.0)
            imu = kinds["Imu"](header, wxyz, np.array([-1.0, *covariance[1:]]), gyr, covariance, acc, covariance)
            for kind, message in (("Imu", imu), ("MagneticField", kinds["MagneticField"](header, mag, covariance))):
                writer.write(to[kind], received, store.serialize_cdr(message, types[kind]))
    return path


def as_ros1(bag: Path, path: Path) -> Path:
    """Write a bag of ROS 2 as one of ROS 1, with the same messages and times of recording."""
    from rosbags.rosbag1 import Writer
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store, types = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    with Reader(bag) as reader, Writer(path) as writer:
        to = {each.id: writer.add_connection(each.topic, each.msgtype, typestore=types) for each in reader.connections}
        for connection, received, data in reader.messages():
            writer.write(to[connection.id], received, bytes(store.cdr_to_ros1(data, connection.msgtype)))
    return path


def test_a_bag_of_ros_1_is_read_like_one_of_ros_2(tmp_path: Path, recording: Recording) -> None:
    write_bag(tmp_path / "bag", recording)
    of_ros1 = import_file(as_ros1(tmp_path / "bag", tmp_path / "walk.bag")).recording
    of_ros2 = import_file(tmp_path / "bag").recording
    for name in ("t", "acc", "gyr", "mag"):
        assert_array_equal(getattr(of_ros1, name), getattr(of_ros2, name))
    (tmp_path / "bag").rename(tmp_path / "folder.bag")  # ROS 2's folder may have the name of ROS 1's file
    assert_array_equal(import_file(tmp_path / "folder.bag").recording.t, of_ros2.t)
    (tmp_path / "walk.bag").write_bytes((tmp_path / "walk.bag").read_bytes()[:-1000])
    with pytest.raises(RecordingError, match=r"walk.bag: can't be read as a bag .*`rosbag reindex`"):
        import_file(tmp_path / "walk.bag")


@pytest.fixture
def rows(recording: Recording) -> list[Row]:
    ns = [1_700_000_000_000_000_000 + round(1e9 * t) for t in recording.t.tolist()]
    values = np.hstack((recording.acc, not_none(recording.gyr)))
    return [
        (at, at + LATE_NS, "imu", row, mag) for at, row, mag in zip(ns, values, not_none(recording.mag), strict=True)
    ]


@pytest.mark.parametrize("topic", [None, "/camera/gyro/sample"])
def test_accelerometer_and_gyro_may_have_topics_of_their_own(
    tmp_path: Path, recording: Recording, topic: str | None
) -> None:
    others = () if topic is None else ("/imu",)
    bag = write_bag(tmp_path / "bag", recording, ("/camera/gyro/sample", "/camera/accel/sample", *others))
    read = import_file(bag, topic=topic)
    assert_allclose(read.recording.acc, recording.acc)
    assert_allclose(not_none(read.recording.gyr), not_none(recording.gyr))
    assert read.recording.info.source.of("acc")[0].name.startswith("/camera/accel/sample: linear_accel")


def test_a_clock_that_was_set_back_is_refused(tmp_path: Path, rows: list[Row]) -> None:
    """Sorted by their stamps, the messages before and after would be mixed."""
    rows[100:] = [(row[0] - 300_000_000, *row[1:]) for row in rows[100:]]
    with pytest.raises(RecordingError, match=r"the headers' stamps run backwards near t = 0\.7 s"):
        import_file(write_imus(tmp_path / "bag", rows))


def test_messages_may_overtake_one_another_or_come_twice(tmp_path: Path, recording: Recording, rows: list[Row]) -> None:
    rows[100], rows[101] = rows[101], rows[100]
    rows[100], rows[101] = ((row[0], 10**18 + k, *row[2:]) for k, row in enumerate(rows[100:102]))
    rows[:100] = [(row[0], k, *row[2:]) for k, row in enumerate(rows[:100])]
    read = import_file(write_imus(tmp_path / "bag", [each for row in rows for each in (row, row)])).recording
    assert_allclose(read.t, recording.t, atol=2e-9)
    assert_allclose(read.acc, recording.acc)


def test_empty_stamps_are_replaced_by_the_times_of_recording(
    tmp_path: Path, recording: Recording, rows: list[Row]
) -> None:
    with pytest.warns(PbdWarning, match="the headers' stamps are empty; the times at which"):
        read = import_file(write_imus(tmp_path / "bag", [(0, *row[1:]) for row in rows])).recording
    assert_allclose(read.t, recording.t, atol=2e-9)


def test_two_devices_on_one_topic_are_refused(tmp_path: Path, rows: list[Row]) -> None:
    both = [(row[0] + k, row[1], frame, *row[3:]) for row in rows for k, frame in enumerate(("left", "right"))]
    with pytest.raises(RecordingError, match=r"of 2 devices \(the frames left, right\)"):
        import_file(write_imus(tmp_path / "bag", both))


def test_a_driver_that_does_not_publish_tesla(tmp_path: Path, recording: Recording, rows: list[Row]) -> None:
    path = write_imus(tmp_path / "bag", rows)
    with pytest.raises(RecordingError, match=r"the magnetometer reads .*--unit mag="):
        repair_recording(import_file(path).recording)
    read = not_none(import_file(path, units={"mag": "uT"}).recording.mag)
    assert_allclose(read, not_none(recording.mag))


def assert_same(read: Recording, written: Recording) -> None:
    assert_allclose(read.t, written.t - written.t[0], atol=2e-9)
    for name in ("acc", "gyr", "mag"):
        assert_allclose(getattr(read, name), getattr(written, name), rtol=1e-9, atol=1e-9)
    assert read.device_rpy is None


@pytest.mark.parametrize(
    ("mcap", "packed"), [(True, "none"), (False, "none"), (True, "message"), (False, "message"), (True, "storage")]
)
def test_both_storages_are_read_by_their_header_stamps(
    tmp_path: Path, recording: Recording, mcap: bool, packed: str
) -> None:
    bag = write_bag(tmp_path / "bag", recording, mcap=mcap, packed=packed)
    for place in (bag, bag.parent):
        assert_same(import_file(place).recording, recording)


def test_the_devices_own_attitude_is_read_in_batches(
    tmp_path: Path, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_importer, "BATCH_MESSAGES", 70)
    wxyz = quat_exp(np.outer(np.linspace(0.0, 1.2, len(recording)), (0.5, -0.8, 1.7)))
    wxyz[3] = 0.0  # a driver that has no attitude yet
    read = import_file(write_bag(tmp_path / "bag", recording, wxyz=wxyz)).recording
    assert read.device_rpy is not None
    assert np.flatnonzero(np.isnan(read.device_rpy).any(axis=1)).tolist() == [3]
    same = np.einsum("ij,ij->i", quat_from_rpy(read.device_rpy), wxyz)
    assert_allclose(np.abs(np.delete(same, 3)), 1.0, atol=1e-12)
    assert_same(replace(read, device_rpy=None), recording)
    wxyz[:] = (1.0, 0.0, 0.0, 0.0)  # a driver that never has one
    assert_same(import_file(write_bag(tmp_path / "never", recording, wxyz=wxyz)).recording, recording)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            "UPDATE messages SET data = substr(data, 1, 100) WHERE id = 7",
            "a message of 100 bytes is too short for its type; record it again",
        ),
        (
            "DELETE FROM messages WHERE topic_id = 1",
            r"its /imu \(.*\) has no messages; record it again, or name another",
        ),
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 7", "can't be read as a bag .*; record it again"),
        ("UPDATE messages SET data = hex(data) WHERE id = 7", "can't be read as a bag .*; record it again"),
    ],
)
def test_short_and_missing_messages_are_refused(tmp_path: Path, recording: Recording, change: str, says: str) -> None:
    bag = write_bag(tmp_path / "bag", recording, mcap=False)
    edit(bag, change)
    with pytest.raises(RecordingError, match=says):
        import_file(bag)


def test_a_magnetometer_that_never_published_is_none(tmp_path: Path, recording: Recording) -> None:
    bag = write_bag(tmp_path / "bag", recording, mcap=False)
    edit(bag, "DELETE FROM messages WHERE topic_id = 2")
    assert import_file(bag).recording.mag is None


def test_a_message_that_decompresses_to_too_much_is_refused(tmp_path: Path, recording: Recording) -> None:
    bag = write_bag(tmp_path / "bag", recording, mcap=False, packed="message")
    edit(bag, "UPDATE messages SET data = ? WHERE id = 7", storage_mcap.zstd.compress(bytes(10**8)))
    for place in (bag, bag.parent):
        with pytest.raises(RecordingError, match=r"of \d+ bytes is cut off, or decompresses to more than 10000"):
            import_file(place)


@pytest.mark.parametrize("mcap", [True, False])
def test_a_bag_of_compressed_files_says_how_to_unpack_it(tmp_path: Path, recording: Recording, mcap: bool) -> None:
    bag = write_bag(tmp_path / "bag", recording, mcap=mcap, packed="file")
    with pytest.raises(RecordingError, match=rf"{bag.name} is compressed as a whole; .* -o {bag.stem}, and import"):
        import_file(bag.parent)
    bag.with_suffix("").write_bytes(storage_mcap.zstd.decompress(bag.read_bytes()))
    assert_same(import_file(bag.with_suffix("")).recording, recording)


def test_the_mcap_of_a_bag_may_have_any_suffix(tmp_path: Path, recording: Recording) -> None:
    """rosbags opens the files that metadata.yaml names."""
    bag = write_bag(tmp_path / "bag", recording)
    about = bag.parent / "metadata.yaml"
    about.write_text(about.read_text().replace("bag.mcap", "bag.bin"))
    bag.with_suffix(".bin").write_bytes(bag.read_bytes()[:-100])
    with pytest.raises(RecordingError, match=r"bag\.bin: its end is missing, .* if you import it instead of"):
        import_file(bag.parent)


def test_our_own_export_comes_back(tmp_path: Path) -> None:
    plan, robot, source = planned("panda")
    export(plan.trajectory, robot, "mcap", tmp_path / "out.mcap", 10.0, source=source)
    ours = load_demo("paper-test1").recording
    assert_same(import_file(tmp_path / "out.mcap").recording, replace(ours, device_rpy=None))


@pytest.mark.parametrize("suffix", ["db3", "bag", "mcap"])
def test_a_pipe_is_no_bag(tmp_path: Path, suffix: str) -> None:
    os.mkfifo(tmp_path / f"run.{suffix}")
    with pytest.raises(RecordingError, match="there is no such file; give a bag that is whole"):
        import_file(tmp_path / f"run.{suffix}")


def test_a_bag_without_its_file_is_refused(tmp_path: Path, recording: Recording) -> None:
    bag = write_bag(tmp_path / "bag", recording)
    bag.write_bytes(b"")
    with pytest.raises(RecordingError, match="it is no MCAP"):
        import_file(bag.parent)
    bag.unlink()
    for is_pipe in (False, True):  # a pipe would wait for its writer
        if is_pipe:
            os.mkfifo(bag)
        with pytest.raises(RecordingError, match=r"bag\.mcap: there is no such file; give a bag that is whole"):
            import_file(bag.parent)


def test_a_topic_is_chosen_or_the_only_one(tmp_path: Path, recording: Recording) -> None:
    bag = write_bag(tmp_path / "bag", recording, ("/left/imu", "/right/imu"))
    with pytest.raises(RecordingError, match=r"2 topics of type sensor_msgs/msg/Imu: /left/imu, /right/imu; choose"):
        import_file(bag)
    assert_same(import_file(bag, topic="/right/imu").recording, recording)
    with pytest.raises(RecordingError, match=r"no topic /imu; those of type sensor_msgs/msg/Imu are /left/imu, /right"):
        import_file(bag, topic="/imu")
    with pytest.raises(RecordingError, match=r"the topic /text has messages of type std_msgs/msg/String; those of"):
        import_file(bag, topic="/text")


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_a_bag_whose_end_is_missing_is_read_as_far_as_it_goes(
    tmp_path: Path, recording: Recording, share: float
) -> None:
    bag = write_bag(tmp_path / "bag", recording)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(bag.read_bytes()[: int(share * bag.stat().st_size)])
    with pytest.warns(PbdWarning, match=r"cut\.mcap: its end is missing, as after a crash; it is read as far as"):
        read = import_file(cut).recording
    n = len(read)
    assert 0.6 * share * len(recording) < n < len(recording)
    assert_allclose(read.acc, recording.acc[:n])


def test_a_compressed_chunk_that_is_cut_off_is_left_out(tmp_path: Path, recording: Recording) -> None:
    packed = storage_mcap.zstd.compress(bytes(1000))
    chunk = struct.pack("<QQQII4sQ", 0, 0, 1000, 0, 4, b"zstd", len(packed)) + packed
    cut = tmp_path / "cut.mcap"
    whole = write_bag(tmp_path / "bag", recording).read_bytes()
    cut.write_bytes(whole[:-37] + struct.pack("<BQ", 6, len(chunk)) + chunk[:-1])
    with pytest.warns(PbdWarning, match=r"cut\.mcap: its end is missing"):
        assert_same(import_file(cut).recording, recording)


def test_other_files_are_refused(tmp_path: Path, recording: Recording) -> None:
    bag = write_bag(tmp_path / "bag", recording, ())
    with pytest.raises(RecordingError, match=r"no topic of type sensor_msgs/msg/Imu; it has /mag \(sensor_msgs/msg/M"):
        import_file(bag)
    for name in ("text.mcap", "text.db3"):
        (tmp_path / name).write_bytes(b"no bag at all" * 9)
        with pytest.raises(RecordingError, match=r"text\.\w+: (it is no MCAP|can't be read as a bag)"):
            import_file(tmp_path / name)
    # A chunk of 100 bytes that claims to contain ten gigabytes.
    swelling = struct.pack("<BQQQQI", 6, 100, 0, 0, 10**10, 0) + bytes(72)
    (tmp_path / "bomb.mcap").write_bytes(bag.read_bytes()[:8] + swelling + bytes(37))
    with pytest.raises(RecordingError, match="a chunk of 100 bytes decompresses to 10000 MB, which is refused"):
        import_file(tmp_path / "bomb.mcap")


def test_a_chunk_with_a_wrong_size_in_its_header_is_refused(tmp_path: Path, recording: Recording) -> None:
    """A file and its folder are opened by different parts of rosbags."""
    bag = write_bag(tmp_path / "bag", recording)
    whole, zstd = bag.read_bytes(), storage_mcap.zstd
    first = zstd.compress(bytes(1000))
    for packed in (zstd.compress(bytes(10**8)), first + zstd.compress(bytes(10**8)), first[:-1], b"no zstd"):
        chunk = struct.pack("<QQQII4sQ", 0, 0, 1000, 0, 4, b"zstd", len(packed)) + packed
        footer = whole[-37:]
        bag.write_bytes(whole[:-37] + struct.pack("<BQ", 6, len(chunk)) + chunk + footer)
        for place in (bag, bag.parent):
            with pytest.raises(RecordingError, match=r"a chunk of \d+ bytes is damaged, or holds more than it says"):
                import_file(place)
    bag.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingError, match=r"bag\.mcap: its end is missing, .* if you import it instead of"):
        import_file(bag.parent)
