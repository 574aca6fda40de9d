"""The experiment for phyphox: its file, and the QR codes that carry it to a phone without a network.

Source: phyphox' documentation of its file format and of offline QR codes (github.com/phyphox/phyphox-docs,
docs/file-format and docs/transferring-experiments.md): seven letters, the CRC32 of the zip, the code's index and the
number of codes, then a part of the zip. The app reads the first byte segment of a code, so it has just one.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator

from pbd.sensors.phyphox.answers import BUFFERS

NAME = "pbd.phyphox"

ROWS = 60_000
"""Samples that the phone keeps of each sensor: 10 minutes at 100 Hz, 2.5 at 400 Hz. A lost network may last as long.
More would be slow: the app copies a buffer at each request."""

MOST_CODES = 12
"""Most codes that one experiment is spread over."""

_SENSORS = {
    "acc": ("accelerometer", "Acceleration", "m/s^2"),
    "gyr": ("gyroscope", "Gyroscope", "rad/s"),
    "mag": ("magnetic_field", "Magnetic field", "µT"),
}


def experiment() -> str:
    """Return the experiment: accelerometer with gravity, gyro and magnetometer together, as fast as the phone can.

    Format 1.8 (phyphox 1.1.3) is the oldest with `ignoreUnavailable`: a phone without a magnetometer is welcome.
    """
    containers = "".join(f'<container size="{ROWS}">{name}</container>' for names in BUFFERS.values() for name in names)
    inputs, values, sets = "", "", ""
    for kind, (sensor, title, unit) in _SENSORS.items():
        t, *axes = BUFFERS[kind]
        optional = ' ignoreUnavailable="true"' if kind == "mag" else ""
        outputs = "".join(
            f'<output component="{c}">{name}</output>' for c, name in zip("txyz", BUFFERS[kind], strict=True)
        )
        inputs += f'<sensor type="{sensor}"{optional}>{outputs}</sensor>'
        values += f'<value label="{title} z" unit="{unit}"><input>{axes[2]}</input></value>'
        data = "".join(f'<data name="{title} {c} ({unit})">{name}</data>' for c, name in zip("xyz", axes, strict=True))
        sets += f'<set name="{title}"><data name="Time (s)">{t}</data>{data}</set>'
    about = "All motion sensors for pbd: allow remote access in the menu, and keep this screen open."
    return (
        '<phyphox version="1.8"><title>pbd</title><category>pbd</category>'
        f"<description>{about}</description><data-containers>{containers}</data-containers><input>{inputs}</input>"
        f'<views><view label="pbd"><info label="{about}"/>{values}</view></views><export>{sets}</export></phyphox>\n'
    )


def zipped() -> bytes:
    """Return the experiment as the app likes it best: a zip with one file. The same bytes each time."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        member = zipfile.ZipInfo(NAME)  # its time is 1980
        archive.writestr(member, experiment(), zipfile.ZIP_DEFLATED, 9)
    return packed.getvalue()


def code_parts(count: int) -> Iterator[bytes]:
    """Yield what each of `count` codes says."""
    data = zipped()
    head = b"phyphox" + zlib.crc32(data).to_bytes(4, "big")
    size = -(-len(data) // count)
    for k in range(count):
        yield head + bytes((k, count)) + data[k * size : (k + 1) * size]
