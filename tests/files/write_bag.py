"""Writes bags of ROS 2 as drivers do."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Recording
from pbd.pose import Array
from tests.not_none import not_none

LATE_NS = 40_000_000
"""Delay between a reading of the sensor and the recording of its message, ns."""

OTHER_VECTOR = {"accel": "angular_velocity", "gyro": "linear_acceleration"}


def write_bag(
    path: Path,
    recording: Recording,
    topics: tuple[str, ...] = ("/imu",),
    mcap: bool = True,
    packed: str = "none",
    wxyz: Array | None = None,
) -> Path:
    """Write a bag with rosbags as a driver does: messages arrive later than their stamps; orientations if given."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds: dict[str, Any] = {name.split("/")[-1]: made for name, made in store.types.items()}
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3

    def vector(values: Any) -> Any:
        x, y, z = map(float, values)
        return kinds["Vector3"](x=x, y=y, z=z)

    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    with writer:
        imus = [writer.add_connection(name, "sensor_msgs/msg/Imu", typestore=store) for name in topics]
        field = writer.add_connection("/mag", "sensor_msgs/msg/MagneticField", typestore=store)
        text = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        unset = np.pad(recording.t[:, None], ((0, 0), (0, 3)), constant_values=0.5)
        attitudes = unset if wxyz is None else wxyz
        channels = recording.t, recording.acc, not_none(recording.gyr), not_none(recording.mag), attitudes
        for t, acc, gyr, mag, attitude in zip(*channels, strict=True):
            ns = 1_700_000_000_000_000_000 + round(1e9 * float(t))
            stamp = kinds["Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            header = kinds["Header"](stamp=stamp, frame_id="imu")
            unknown, known = np.array([-1.0, *[0.0] * 8]), np.zeros(9)
            imu = kinds["Imu"](
                header=header,
                orientation=kinds["Quaternion"](**dict(zip("wxyz", map(float, attitude), strict=True))),
                orientation_covariance=unknown if wxyz is None else known,
                angular_velocity=vector(gyr),
                angular_velocity_covariance=known,
                linear_acceleration=vector(acc),
                linear_acceleration_covariance=known,
            )
            for connection in imus:
                # RealSense's driver leaves the other sensor's vector zero.
                empty = [part for part in OTHER_VECTOR if part in connection.topic]
                given = replace(imu, **{OTHER_VECTOR[part]: vector((0, 0, 0)) for part in empty})
                writer.write(connection, ns + LATE_NS, store.serialize_cdr(given, "sensor_msgs/msg/Imu"))
            message = kinds["MagneticField"](
                header=header, magnetic_field=vector(1e-6 * mag), magnetic_field_covariance=known
            )
            writer.write(field, ns + LATE_NS, store.serialize_cdr(message, "sensor_msgs/msg/MagneticField"))
        writer.write(text, ns, store.serialize_cdr(kinds["String"](data="end"), "std_msgs/msg/String"))
    return next(path.glob("*.mcap*" if mcap else "*.db3*"))
