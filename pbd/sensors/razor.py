"""SparkFun's Razor and 9DOF Sensor Stick under the Razor AHRS firmware: `#A-C=`, `#M-C=`, `#G-C=` make a sample.

Source: Razor AHRS firmware 1.4 to 1.7 (Output.ino, Sensors.ino, Razor_AHRS.ino), text of its calibrated sensors: send
`#osct`. Its axes are x forward, y right, z down, and its accelerometer's sign is that of gravity: +256 on z when level.
So x of the acceleration and y, z of gyro and field change sign, to x forward, y left, z up and specific force.

Calibrated numbers: acceleration 256 for 1 g; field 100 for its strength at calibration, without a unit; gyro less its
offset, in counts of 0.06957 deg/s on the boards with an ITG-3200 (SEN-10125, 10736, 10183, 10321, 10724), in rad/s on
those with an MPU-9250 or ICM-20948 (SEN-14001, OpenLog Artemis): say `--unit gyr=rad/s` there.
Raw ones (`#A-R=`, `#M-R=`, `#G-R=`, not read here) are counts: 3.9 mg (ADXL345), 0.06957 deg/s, the magnetometer's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from pbd.sensors.line_layout import Line, LineLayout
from pbd.sensors.lines import LineDecoder

UNITS: Mapping[str, str] = MappingProxyType({"acc": "0.00390625 g", "gyr": "0.06957 deg/s"})


def razor_layout(units: Mapping[str, str] | None = None) -> LineLayout:
    """Make the Razor's layout; `units` stand in place of the ITG-3200 boards' own."""
    lines = (
        Line(("-ax", "ay", "az"), "#A-C="),
        Line(("mx", "-my", "-mz"), "#M-C="),
        Line(("gx", "-gy", "-gz"), "#G-C="),
    )
    return LineLayout(lines, {**UNITS, **(units or {})})


def razor_decoder() -> LineDecoder:
    """Make the decoder of the ITG-3200 boards."""
    return LineDecoder(razor_layout())
