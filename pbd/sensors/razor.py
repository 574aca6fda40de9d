"""SparkFun's Razor and 9DOF Sensor Stick with the Razor AHRS firmware: `#A-C=`, `#M-C=`, `#G-C=` make a sample.

Source: Razor AHRS firmware 1.4 to 1.7 (Output.ino, Sensors.ino, Razor_AHRS.ino). The command `#osct` makes it send its
calibrated sensors as text. Its axes are x forward, y right, z down, and its accelerometer has the sign of gravity: +256
on z when level. So the signs of acceleration x, gyro y, z and field y, z are flipped to get specific force in x
forward, y left, z up.

Calibrated values: acceleration 256 for 1 g; field 100 for its strength at calibration, without a unit; gyro minus its
offset, in counts of 0.06957 deg/s on the boards with an ITG-3200 (SEN-10125, 10736, 10183, 10321, 10724), in rad/s on
those with an MPU-9250 or ICM-20948 (SEN-14001, OpenLog Artemis), which need `--unit gyr=rad/s`.
Raw values (`#A-R=`, `#M-R=`, `#G-R=`) are not read. They are counts of 3.9 mg (ADXL345), of 0.06957 deg/s, and of the
magnetometer's own unit.
"""

from collections.abc import Mapping
from types import MappingProxyType

from pbd.sensors.line_layout import Line, LineLayout
from pbd.sensors.lines import LineDecoder


def razor_layout(units: Mapping[str, str] = MappingProxyType({})) -> LineLayout:
    """Make the Razor's layout; `units` override those of the ITG-3200 boards."""
    lines = (
        Line(("-ax", "ay", "az"), "#A-C="),
        Line(("mx", "-my", "-mz"), "#M-C="),
        Line(("gx", "-gy", "-gz"), "#G-C="),
    )
    return LineLayout(lines, {"acc": "0.00390625 g", "gyr": "0.06957 deg/s", **units})


def razor_decoder() -> LineDecoder:
    """Make the decoder of the ITG-3200 boards."""
    return LineDecoder(razor_layout())
