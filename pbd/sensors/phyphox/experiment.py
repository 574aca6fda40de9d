"""The experiment for phyphox: its file, and the QR codes that bring it to a phone without a network.

Source: phyphox' documentation of its file format and of offline QR codes (github.com/phyphox/phyphox-docs,
docs/file-format and docs/transferring-experiments.md). A code holds the seven letters "phyphox", the CRC32 of the zip,
the code's index, the number of codes, and a part of the zip. The app reads a code's first byte segment only, so each
code has just one.
"""

import io
import zipfile
import zlib
from collections.abc import Iterator

from pbd.sensors.phyphox.answers import BUFFERS

EXPERIMENT_FILE = "pbd.phyphox"
"""Name of the experiment's file."""

BUFFER_ROWS = 60_000
"""Samples of each sensor that the phone keeps: 10 minutes at 100 Hz, 2.5 minutes at 400 Hz. The network may fail for as
long. Longer buffers would be slow, because the app copies them at each request."""

MAX_QR_CODES = 12
"""Largest number of codes for the experiment."""

_SENSORS = {
    "acc": ("accelerometer", "Acceleration", "m/s^2"),
    "gyr": ("gyroscope", "Gyroscope", "rad/s"),
    "mag": ("magnetic_field", "Magnetic field", "µT"),
}


def experiment() -> str:
    """Return the experiment's XML: accelerometer with gravity, gyro and magnetometer at the phone's highest rates.

    Format 1.8 (phyphox 1.1.3) is the oldest with `ignoreUnavailable`, which a phone without a magnetometer needs.
    """
    buffers = [name for names in BUFFERS.values() for name in names]
    containers = "".join(f'<container size="{BUFFER_ROWS}">{name}</container>' for name in buffers)
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


def qr_payloads(count: int) -> Iterator[bytes]:
    """Yield the content of each of `count` QR codes, the same bytes each time."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        member = zipfile.ZipInfo(EXPERIMENT_FILE)  # dated 1980, whenever it is made
        archive.writestr(member, experiment(), zipfile.ZIP_DEFLATED, 9)
    data = packed.getvalue()
    head = b"phyphox" + zlib.crc32(data).to_bytes(4, "big")
    size = -(-len(data) // count)
    for k in range(count):
        yield head + bytes((k, count)) + data[k * size : (k + 1) * size]
