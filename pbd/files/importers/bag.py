"""Bags of ROS 2 (MCAP, SQLite) and ROS 1: sensor_msgs/Imu and, optionally, sensor_msgs/MagneticField, with rosbags.

Times are the headers' stamps, which the driver wrote when it read the sensor, not when the message was recorded. A
covariance that begins with -1 means that there is no such measurement (sensor_msgs/Imu.msg), so it is not read. If a
driver left the stamps empty, the times of recording are used.
"""

from collections.abc import Collection, Iterator
from itertools import groupby
from os.path import commonprefix
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Demonstration, Recording
from pbd.data.streams import Stream, joined
from pbd.errors import PbdError, RecordingError, amount, in_words, listed, require_package, warn
from pbd.files.importers.columns import remapped, with_source
from pbd.files.importers.mcap_repair import repaired_bag, zstd_package
from pbd.files.importers.request import Request
from pbd.io.atomic import is_file
from pbd.pose import Array, quat_from_xyzw, quat_to_rpy

IMU, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
VECTORS = {IMU: (4, 3, 3), FIELD: (3,)}
"""Sizes of the vectors in the two messages.

Imu: orientation xyzw, angular velocity in rad/s, specific force in m/s2. MagneticField: the field in tesla. The nine
numbers of a vector's covariance follow it; the first is -1 if the vector is not known.
"""

BATCH_MESSAGES = 20_000
"""Messages decoded in one batch: 7 MB."""

LONGEST_MESSAGE = 10_000
"""Largest size of a decompressed message, bytes. An Imu has 316 and its frame's name."""


def read_bag(request: Request) -> Demonstration | None:
    """Read a .mcap, a .db3 or a .bag file, or a ROS 2 bag's folder; None: it is none of these.

    Raises:
        PbdError: rosbags is missing.
        RecordingError: the bag can't be read, or the topic of sensor_msgs/Imu must be named: there are several.
    """
    path, topic = request.path, request.topic
    if request.suffix not in (".mcap", ".db3", ".bag") and not (path / "metadata.yaml").is_file():
        if topic is not None:
            raise RecordingError.at(path, "only a bag has topics; leave --topic out")
        return None
    request.refuse_rate("a bag has times")
    if not path.is_dir() and not is_file(path):  # a pipe waits for its writer
        raise RecordingError.at(path, "there is no such file; give a bag that is whole")
    require_package("rosbags.rosbag2", "ros", "a bag")
    imus, field, read, unread = _read_topics(path, topic)
    of_gyr, of_acc = imus[-1], imus[0]
    begin, values = read[of_gyr][0][0], read[of_gyr][1]
    times = {name: 1e-9 * (ns - begin) for name, (ns, _) in read.items()}
    # Tracking is faster with contiguous columns.
    t, (xyzw, gyr, acc) = times[of_gyr], map(np.asfortranarray, np.split(values, (4, 7), axis=1))
    if of_acc != of_gyr:
        streams = {"acc": Stream.of(times[of_acc], read[of_acc][1][:, 7:]), "gyr": Stream.of(t, gyr)}
        t, at = joined(streams)
        acc, gyr, xyzw = at["acc"], at["gyr"], np.full((len(t), 4), np.nan)
    mag = None
    if field and len(times[field[0]]):
        with np.errstate(all="ignore"):  # infinite values are repaired later, like other invalid samples
            mag = Stream.of(times[field[0]], 1e6 * read[field[0]][1]).at(t)
    gyr_or_none = gyr if np.isfinite(gyr).any() else None
    recording = Recording(t=t, acc=acc, gyr=gyr_or_none, mag=mag, device_rpy=_device_rpy(xyzw))
    names = {"t": f"{of_gyr}: header.stamp", "gyr": f"{of_gyr}: angular_velocity"}
    names |= {"acc": f"{of_acc}: linear_acceleration", "rpy": f"{of_gyr}: orientation"}
    names |= {"mag": f"{field[0]}: magnetic_field"} if field else {}
    recording = with_source(recording, names, "its type", unread, {"mag": "T"})
    return Demonstration(remapped(path, recording, request.columns, request.units))


def _read_topics(
    path: Path, topic: str | None
) -> tuple[list[str], list[str], dict[str, tuple[NDArray[np.int64], Array]], dict[str, str]]:
    """Return the topics of `_choose_topics`, each one's stamps and vectors, and the other topics, with their types."""
    from rosbags import rosbag1, rosbag2

    kind: Any = rosbag1 if path.suffix.lower() == ".bag" and path.is_file() else rosbag2
    try:
        with repaired_bag(path) as repaired, kind.Reader(repaired) as reader:
            imus, field = _choose_topics(path, reader.connections, topic)
            wanted = {name: _Decoder(path, VECTORS[IMU if name in imus else FIELD]) for name in (*imus, *field)}
            types = {each.topic: each.msgtype for each in reader.connections}
            for name, received, data in _messages(path, reader, wanted):
                wanted[name].add(received, data)
            read = {name: decoder.all() for name, decoder in wanted.items()}
    except PbdError:
        raise
    except Exception as reason:  # damaged bytes cause errors of sqlite, yaml and zstd
        do = "try `rosbag reindex`, or record it again" if kind is rosbag1 else "record it again"
        what = f"can't be read as a bag ({in_words(reason)}); {do}"
        raise RecordingError.at(path, what) from None
    if empty := next((name for name in imus if not len(read[name][0])), None):
        raise RecordingError.at(path, f"its {empty} ({IMU}) has no messages; record it again, or name another --topic")
    return imus, field, read, {name: f"another topic, of {of}" for name, of in types.items() if name not in wanted}


class _Decoder:
    """Decodes messages of one type in batches. One by one, an hour at 400 Hz would take a minute.

    In CDR, a message begins with 4 bytes of encapsulation and a header: seconds, nanoseconds, the frame's name. The
    rest of these messages is doubles.
    """

    def __init__(self, path: Path, vectors: tuple[int, ...]) -> None:
        """See VECTORS."""
        self._path, self._vectors = path, vectors
        self._waiting: list[bytes] = []
        self._received: list[int] = []
        self._ns: list[NDArray[np.int64]] = []
        self._values: list[Array] = []
        self._frames: set[bytes] = set()

    def add(self, received_ns: int, message: bytes) -> None:
        """Add the next message, and when it was recorded."""
        self._received.append(received_ns)
        self._waiting.append(message)
        if len(self._waiting) >= BATCH_MESSAGES:
            self._decode()

    def all(self) -> tuple[NDArray[np.int64], Array]:
        """Return sorted stamps (n,), ns, and the vectors side by side (n, m); NaN if the covariance begins with -1.

        Raises:
            RecordingError: messages of several devices, or stamps that run backwards.
        """
        self._decode()
        if not self._ns:
            return np.empty(0, dtype=np.int64), np.empty((0, 0))
        if len(self._frames) > 1:
            frames = listed(sorted(frame.rstrip(b"\0").decode("utf-8", "replace") for frame in self._frames))
            what = f"its messages are of {len(self._frames)} devices (the frames {frames}); give each its own topic"
            raise RecordingError.at(self._path, what, value=len(self._frames))
        received = np.array(self._received, dtype=np.int64)  # SQLite may hold words
        ns, values = np.concatenate(self._ns), np.vstack(self._values)
        self._values.clear()  # as large as the bag
        if len(ns) > 1 and not np.ptp(ns) and np.ptp(received):
            warn(f"{self._path}: the headers' stamps are empty; the times at which the messages were recorded are used")
            ns = received
        by_arrival = np.argsort(received, kind="stable")
        ns, values = ns[by_arrival], values[by_arrival]
        by_time = np.argsort(ns, kind="stable")
        overtaken = np.abs(np.arange(len(ns)) - by_time)
        ns, values = ns[by_time], values[by_time]
        if overtaken.max() >= 3:  # fewer messages may overtake one another on the network
            at = 1e-9 * float(ns[np.argmax(overtaken)] - ns[0])
            what = f"the headers' stamps run backwards near t = {at:.1f} s, because a clock was set back"
            raise RecordingError.at(self._path, f"{what}; record again, or cut the bag there")
        again = np.flatnonzero(np.diff(ns) == 0)  # with the time of the one before, and its values too
        again = again[(np.nan_to_num(values[again]) == np.nan_to_num(values[again + 1])).all(axis=1)]
        return np.delete(ns, again + 1), np.delete(values, again + 1, axis=0)

    def _decode(self) -> None:
        waiting, self._waiting = self._waiting, []
        for length, same in groupby(waiting, len):
            padded = length - 16 - sum(8 * (size + 9) for size in self._vectors)
            if padded < 0:
                what = f"a message of {amount(length, 'byte')} is too short for its type; record it again"
                raise RecordingError.at(self._path, what)
            data = b"".join(same)
            order = "<" if data[1] & 1 else ">"
            header = [("kind", "V4"), ("s", f"{order}i4"), ("ns", f"{order}u4"), ("size", f"{order}u4")]
            covariance = ("covariance", f"{order}f8", 9)
            vectors = [(f"{k}", [("vector", f"{order}f8", size), covariance]) for k, size in enumerate(self._vectors)]
            read = np.frombuffer(data, [*header, ("frame", f"V{padded}"), *vectors])
            self._frames |= {frame[: read["size"][0]] for frame in set(read["frame"].tolist())}
            self._ns.append(read["s"].astype(np.int64) * 10**9 + read["ns"])
            parts = (read[name] for name, _ in vectors)
            known = (np.where(part["covariance"][:, :1] == -1.0, np.nan, part["vector"]) for part in parts)
            self._values.append(np.hstack(list(known)))


def _messages(path: Path, reader: Any, wanted: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, time of recording (ns) and bytes of these topics' messages, in the files' order: sorting is slow."""
    if not hasattr(reader, "storage"):
        from rosbags.typesys import Stores, get_typestore

        as_cdr = get_typestore(Stores.ROS2_HUMBLE).ros1_to_cdr  # without ROS 1's number of a message
        for connection, received, data in reader.messages(
            [each for each in reader.connections if each.topic in wanted]
        ):
            yield connection.topic, received, bytes(as_cdr(data, connection.msgtype))
        return
    for storage in getattr(reader.storage, "storages", (reader.storage,)):
        connections = [each for each in storage.connections if each.topic in wanted and each.msgtype in (IMU, FIELD)]
        scan = getattr(storage, "messages_scan", storage.messages)
        for connection, received, data in scan(connections):
            is_zstd = data[:4] == b"\x28\xb5\x2f\xfd"  # RFC 8878, 3.1.1; an uncompressed CDR message begins with a zero
            yield connection.topic, received, _decompressed(path, data) if is_zstd else data


def _decompressed(path: Path, packed: bytes) -> bytes:
    """Decompress a message. rosbags does not bound its size, and only does so if the bag's folder is given."""
    unpacker = zstd_package().ZstdDecompressor()
    data: bytes = unpacker.decompress(packed, max_length=LONGEST_MESSAGE)
    if not unpacker.eof:
        what = f"a message of {amount(len(packed), 'byte')} is cut off, or decompresses to more than {LONGEST_MESSAGE}"
        raise RecordingError.at(path, f"{what}, which is refused; record it again")
    return data


def _choose_topics(path: Path, connections: list[Any], topic: str | None) -> tuple[list[str], list[str]]:
    """Return the topic of the Imu to read, and that of the MagneticField that belongs to it, if there is one.

    Some drivers have two topics of Imu, as RealSense's `accel/sample` and `gyro/sample`: both are returned, in this
    order.
    """
    imus = sorted({each.topic for each in connections if each.msgtype == IMU})
    pairs = [[name, other] for name in imus if (other := name.replace("accel", "gyro")) != name and other in imus]
    choices = [*pairs, *([name] for name in imus if not any(name in pair for pair in pairs))]
    if topic is None:
        if not imus:
            kinds = listed(sorted({f"{each.topic} ({each.msgtype})" for each in connections}))
            raise RecordingError.at(path, f"no topic of type {IMU}; it has {kinds}: record one")
        if len(choices) > 1:
            what = f"{len(imus)} topics of type {IMU}: {listed(imus)}; choose one with pbd import --topic"
            raise RecordingError.at(path, what, value=len(imus))
    elif topic not in imus:
        kind = next((each.msgtype for each in connections if each.topic == topic), None)
        what = f"the topic {topic} has messages of type {kind}" if kind else f"no topic {topic}"
        have = f"those of type {IMU} are {listed(imus)}"
        raise RecordingError.at(path, f"{what}; {have}; choose one with pbd import --topic", value=topic)
    chosen = next(choice for choice in choices if topic is None or topic in choice)
    # Of several fields, take the one with the Imu's longest prefix: /left/mag belongs to /left/imu.
    fields = {each.topic for each in connections if each.msgtype == FIELD}
    near = sorted(fields, key=lambda name: (-len(commonprefix((name, chosen[0]))), name))  # noqa: RUF071 (letters)
    return chosen, near[:1]


def _device_rpy(xyzw: Array) -> Array | None:
    """Return roll, pitch, yaw (n, 3); None if the orientation is always zero or constant: it was never filled in."""
    given = np.isfinite(xyzw).all(axis=1) & (np.abs(xyzw).sum(axis=1) > 0.5)
    if not given.any() or np.ptp(xyzw[given], axis=0).max() == 0.0:
        return None
    rpy = np.full((len(xyzw), 3), np.nan)
    rpy[given] = quat_to_rpy(quat_from_xyzw(xyzw[given]))
    return rpy
