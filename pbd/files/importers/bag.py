"""A bag of ROS 2, as MCAP or SQLite: sensor_msgs/Imu, and sensor_msgs/MagneticField beside it. Read by rosbags.

Times are the headers' stamps: what the driver wrote when it read the sensor, not when the bag's writer got it. Where a
covariance begins with -1 there is no such estimate (sensor_msgs/Imu.msg), so what is beside it is not read.
"""

from __future__ import annotations

import mmap
import os
import stat
import struct
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.streams import Stream
from pbd.errors import PbdError, PbdWarning, RecordingError, in_words, listed
from pbd.io.opening import LARGE, read_text
from pbd.pose import Array, quat_from_xyzw, quat_to_rpy

IMU, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
IMU_DOUBLES, IMU_PARTS = 4 + 9 + 3 + 9 + 3 + 9, ((0, 4), (13, 16), (25, 28))
FIELD_DOUBLES, FIELD_PARTS = 3 + 9, ((0, 3),)
"""Imu: orientation xyzw, turn rate rad/s, specific force m/s2; MagneticField: the field in tesla; each with the nine
numbers of its covariance behind it, the first of which is -1 where it isn't known."""

AT_ONCE = 20_000
"""Messages decoded in one batch: 7 MB."""

MCAP_MAGIC = b"\x89MCAP0\r\n"
MCAP_FOOTER = b"\x02" + struct.pack("<Q", 20) + bytes(20) + MCAP_MAGIC
"""What ends an MCAP that has no index (mcap.dev/spec)."""

FOOTER, CHUNK, CHUNK_HEAD = 2, 6, struct.Struct("<QQQII")

MOST_SWOLLEN = 50
"""Largest ratio of a chunk's contents to its compressed bytes: numbers from a sensor shrink to a fifth at most."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""What a compressed message begins with (RFC 8878, 3.1.1); a message of CDR begins with a zero."""

LONGEST_MESSAGE = 10_000
"""Most that a compressed message may hold, bytes: an Imu has 316 and its frame's name."""


def read_bag(path: Path, topic: str | None = None) -> Recording:
    """Read a recording from a .mcap, a .db3 or a bag's folder.

    Args:
        path: the bag.
        topic: of its sensor_msgs/Imu; default: the only one.

    Raises:
        RecordingError: it can't be read, has no such topic, or has several and none is named.
        PbdError: rosbags is missing.
    """
    try:
        from rosbags.rosbag2 import Reader
    except ImportError:
        what = "a bag needs the package rosbags; install it with: pip install 'pbd-robot[ros]'"
        raise PbdError(what) from None
    imu, field = _Messages(path, IMU_PARTS, IMU_DOUBLES), _Messages(path, FIELD_PARTS, FIELD_DOUBLES)
    take = {IMU: imu.take, FIELD: field.take}
    try:
        with _whole(path) as whole, Reader(whole) as reader:
            wanted = _choose(path, reader.connections, topic)
            for kind, data in _messages(path, reader, wanted):
                take[kind](data)
    except PbdError:
        raise
    except Exception as reason:  # damaged bytes make sqlite, yaml and zstd raise errors of their own
        what = f"{path}: can't be read as a bag ({in_words(reason) or type(reason).__name__}); record it again"
        raise RecordingError(what, path=path) from None
    ns, values = imu.all()
    if not len(ns):
        raise RecordingError(f"{path}: its {IMU} has no messages; name another --topic", path=path)
    begin = ns[0]
    xyzw, gyr, acc = np.split(values, (4, 7), axis=1)
    t, mag = 1e-9 * (ns - begin), None
    ns_field, tesla = field.all()
    if len(ns_field):
        with np.errstate(all="ignore"):  # what becomes infinite is found with all else that is no number
            mag = Stream.of(1e-9 * (ns_field - begin), 1e6 * tesla).at(t)
    gyr_or_none = gyr if np.isfinite(gyr).any() else None
    return Recording(t=t, acc=acc, gyr=gyr_or_none, mag=mag, device_rpy=_device_rpy(xyzw))


class _Messages:
    """Messages of one type, decoded many at once: an object for each would take a minute for an hour at 400 Hz.

    In CDR a header comes first (4 bytes of encapsulation, seconds, nanoseconds, the frame's name); what follows in
    these types is doubles alone.
    """

    def __init__(self, path: Path, parts: tuple[tuple[int, int], ...], doubles: int) -> None:
        self._path, self._parts, self._doubles = path, parts, doubles
        self._waiting: list[bytes] = []
        self._ns: list[NDArray[np.int64]] = []
        self._values: list[Array] = []

    def take(self, message: bytes) -> None:
        """Take the next one."""
        self._waiting.append(message)
        if len(self._waiting) >= AT_ONCE:
            self._decode()

    def all(self) -> tuple[NDArray[np.int64], Array]:
        """Stamps (n,) ns, in order, and the parts side by side (n, m); NaN where a covariance says "none"."""
        self._decode()
        if not self._ns:
            return np.empty(0, dtype=np.int64), np.empty((0, 0))
        ns, values = np.concatenate(self._ns), np.vstack(self._values)
        by_time = np.argsort(ns, kind="stable")
        return ns[by_time], values[by_time]

    def _decode(self) -> None:
        waiting, self._waiting = self._waiting, []
        lengths = np.array([len(message) for message in waiting])
        for length in np.unique(lengths):
            if length < 16 + 8 * self._doubles:
                what = f"{self._path}: a message of {length} bytes is too short for its type; record it again"
                raise RecordingError(what, path=self._path)
            rows = np.flatnonzero(lengths == length)
            raw = np.frombuffer(b"".join(waiting[row] for row in rows), dtype=np.uint8).reshape(-1, length)
            order = "<" if raw[0, 1] & 1 else ">"
            seconds, nanoseconds = (raw[:, k : k + 4].copy() for k in (4, 8))
            ns = seconds.view(f"{order}i4")[:, 0].astype(np.int64) * 10**9
            self._ns.append(ns + nanoseconds.view(f"{order}u4")[:, 0])
            values = raw[:, -8 * self._doubles :].copy().view(f"{order}f8")
            known = (np.where(values[:, k : k + 1] == -1.0, np.nan, values[:, i:k]) for i, k in self._parts)
            self._values.append(np.hstack(list(known)))


def _messages(path: Path, reader: Any, wanted: set[tuple[str, str]]) -> Iterator[tuple[str, bytes]]:
    """Yield type and bytes of the messages of these topics and types, in the files' order: sorting takes as long."""
    for storage in getattr(reader.storage, "storages", (reader.storage,)):
        connections = [each for each in storage.connections if (each.topic, each.msgtype) in wanted]
        scan = getattr(storage, "messages_scan", storage.messages)
        for connection, _, data in scan(connections):
            yield connection.msgtype, _message(path, data) if data[:4] == ZSTD_MAGIC else data


def _message(path: Path, packed: bytes) -> bytes:
    """Unpack one message: rosbags has no bound on its size, and unpacks only where the bag's folder is given."""
    unpacker = _zstd().ZstdDecompressor()
    data: bytes = unpacker.decompress(packed, max_length=LONGEST_MESSAGE)
    if not unpacker.eof:
        what = (
            f"a message of {len(packed)} bytes is cut off, or swells to more than {LONGEST_MESSAGE}, which is refused"
        )
        raise RecordingError(f"{path}: {what}; record it again", path=path)
    return data


def _choose(path: Path, connections: list[Any], topic: str | None) -> set[tuple[str, str]]:
    """The topics to read, and their types."""
    imus = sorted({each.topic for each in connections if each.msgtype == IMU})
    if topic is None:
        if not imus:
            kinds = listed(sorted({f"{each.topic} ({each.msgtype})" for each in connections}))
            raise RecordingError(f"{path}: no topic of type {IMU}; it has {kinds}: record one", path=path)
        if len(imus) > 1:
            what = f"{len(imus)} topics of type {IMU}: {listed(imus)}; choose one with --topic"
            raise RecordingError(f"{path}: {what}", path=path, value=len(imus))
        topic = imus[0]
    elif topic not in imus:
        kind = next((each.msgtype for each in connections if each.topic == topic), None)
        what = f"the topic {topic} has messages of type {kind}" if kind else f"no topic {topic}"
        have = f"those of type {IMU} are {listed(imus)}"
        raise RecordingError(f"{path}: {what}; {have}; choose one with --topic", path=path, value=topic)
    # Of several fields the one whose name has most in common with the sensor's: /left/imu goes with /left/mag.
    fields = {each.topic for each in connections if each.msgtype == FIELD}
    near = sorted(fields, key=lambda name: (-_alike(name, str(topic)), name))
    return {(topic, IMU), *((name, FIELD) for name in near[:1])}


def _alike(a: str, b: str) -> int:
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _device_rpy(xyzw: Array) -> Array | None:
    """Roll, pitch, yaw (n, 3); an orientation that nobody filled in is all zeros, or the same all the time."""
    given = np.isfinite(xyzw).all(axis=1) & (np.abs(xyzw).sum(axis=1) > 0.5)
    if not given.any() or np.ptp(xyzw[given], axis=0).max() == 0.0:
        return None
    rpy = np.full((len(xyzw), 3), np.nan)
    rpy[given] = quat_to_rpy(quat_from_xyzw(xyzw[given]))
    return rpy


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Mend an MCAP whose end is missing, in a copy, and refuse one that swells."""
    for file in _mcaps(path):
        data = _mapped(file)
        if data[: len(MCAP_MAGIC)] != MCAP_MAGIC:
            raise RecordingError(f"{file}: it is no MCAP (its first bytes say so); give another file", path=file)
        parts, end = _whole_records(file, data)
        if data[-len(MCAP_MAGIC) :] == MCAP_MAGIC and end == len(data) - len(MCAP_MAGIC):
            continue
        what = f"{file}: its end is missing, as after a crash; it is read as far as it goes"
        if file != path:
            raise RecordingError(f"{what} if you import it instead of its folder", path=file)
        warnings.warn(what, PbdWarning, stacklevel=2)
        with TemporaryDirectory() as folder:
            mended = Path(folder) / "mended.mcap"
            mended.write_bytes(MCAP_MAGIC + b"".join(data[part] for part in parts) + MCAP_FOOTER)
            yield mended
        return
    yield path


def _mcaps(path: Path) -> list[Path]:
    """The MCAPs that rosbags will open; a bag of compressed files is refused, as rosbags has no bound on their size."""
    if not path.is_dir():
        return [path] if path.suffix.lower() == ".mcap" else []
    from ruamel.yaml import YAML

    text = read_text(path / "metadata.yaml", RecordingError, "give a bag that is whole")
    about = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    files = [path / PurePath(name).name for name in about["relative_file_paths"]]
    if files and (about.get("compression_mode") or "").lower() == "file":
        name, plain = files[0].name, files[0].stem
        what = f"{name} is compressed as a whole; unpack it with: zstd -d {name} -o {plain}, and import {plain}"
        raise RecordingError(f"{path}: {what}", path=path)
    return files if about["storage_identifier"] == "mcap" else []


def _mapped(path: Path) -> mmap.mmap | bytes:
    """A file's bytes, of which only those that are looked at are read: a bag may be larger than the memory."""
    try:
        with path.open("rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError("it is not a regular file")
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError:  # an empty file can't be mapped
        return b""
    except OSError as reason:
        raise RecordingError(f"{path}: can't be read ({in_words(reason)}); give a bag", path=path) from None


def _whole_records(path: Path, data: mmap.mmap | bytes, at: int = len(MCAP_MAGIC)) -> tuple[list[slice], int]:
    """Where all whole records are from `at` on, and where they end; of a last chunk that is cut off its records too."""
    begin = at
    while at + 9 <= len(data):
        kind, (size,) = data[at], struct.unpack_from("<Q", data, at + 1)
        inside = at + 9 + CHUNK_HEAD.size + 8
        if kind == CHUNK and inside <= len(data):
            _, _, contents, _, compression = CHUNK_HEAD.unpack_from(data, at + 9)
            if contents > min(LARGE, MOST_SWOLLEN * max(size, 10_000)):
                what = f"a chunk of {size} bytes swells to {contents / 1e6:.0f} MB, which is refused; record it again"
                raise RecordingError(f"{path}: {what}", path=path, value=contents)
            if at + 9 + size > len(data) and compression == 0:  # its records can be copied out of it
                inner, end = _whole_records(path, data, inside)
                return [slice(begin, at), *inner], end
            if at + 9 + size <= len(data) and compression:
                packed = data[inside + compression : at + 9 + size]
                if not _unpacks(data[inside - 8 : inside - 8 + compression], packed, contents):
                    what = f"a chunk of {size} bytes is damaged, or holds more than it says; record it again"
                    raise RecordingError(f"{path}: {what}", path=path, value=contents)
        if at + 9 + size > len(data):
            break
        at += 9 + size
        if kind == FOOTER:
            break
    return [slice(begin, at)], at


def _unpacks(compression: bytes, packed: bytes, size: int) -> bool:
    """Whether these bytes are `size` when they are unpacked: rosbags has no bound on that."""
    import lz4.frame  # type: ignore[import-untyped]

    zstd = _zstd()
    kinds = {b"zstd": zstd.ZstdDecompressor, b"lz4": lz4.frame.LZ4FrameDecompressor}
    try:
        unpacker = kinds[compression]()
        unpacked = unpacker.decompress(packed, max_length=size + 1)
    except (KeyError, EOFError, RuntimeError, zstd.ZstdError):
        return False
    return len(unpacked) == size and unpacker.eof and not unpacker.unused_data


def _zstd() -> Any:
    """The package that rosbags unpacks with."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd
