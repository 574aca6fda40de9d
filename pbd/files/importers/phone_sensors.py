"""What the apps Sensor Logger (a phone's, or an Apple Watch's) and phyphox call the sensors in their CSV files.

Specific force, +g up, comes from
- TotalAcceleration.csv of Sensor Logger on Android. Accelerometer.csv is without gravity on both systems.
- Accelerometer.csv + Gravity.csv of Sensor Logger on iOS, both with reversed sign; or AccelerometerUncalibrated.csv, in
  g and reversed too. With "Standardise Units & Frames" (`standardisation` in Metadata.csv) all is as on Android.
- gravity + acceleration in WristMotion.csv of Sensor Logger on a watch, both reversed and in g, or standardised.
- "Acceleration x (m/s^2)" of phyphox, "X (m/s^2)" in Accelerometer.csv of an iPhone's simple experiment. "Linear
  Acceleration x (m/s^2)" is without gravity.

Sources: Sensor Logger's documentation (github.com/tszheichoi/awesome-sensor-logger: UNITS.md, COORDINATES.md,
CROSSPLATFORM.md); phyphox' DataExport.java, SimpleExperimentSerializer.swift and documentation
(github.com/phyphox).
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.data import GRAVITY
from pbd.data.source_columns import CHANNELS
from pbd.errors import RecordingError
from pbd.files.importers.columns import why_not_read
from pbd.files.importers.csv_bundle import Files
from pbd.files.table import Sheet

METADATA, WRIST = "Metadata", "WristMotion"
"""Sensor Logger's files about the phone, and of a watch."""

LINEAR = "linear"
"""The sensor of an acceleration without gravity."""

Part = tuple[Sheet, dict[str, str]]
"""A file with a sensor, and its columns: our name -> the file's."""


@dataclass(frozen=True)
class Program:
    """What a program calls its sensors, whose units and signs it documents.

    Attributes:
        sensor: the device, as in `Recording.info`.
        time: the column of times, in s.
        sensors: acc, gyr, mag, and others of which acc is made -> pattern of `file: column`, with a group for the axis.
        force: the sensors whose sum is specific force, the best first.
        files: the names of files that belong to one recording. In phyphox' folders, others may have sensors too.
    """

    name: str
    sensor: str
    time: str
    sensors: Mapping[str, str]
    force: Sequence[tuple[str, ...]] = (("acc",),)
    files: Sequence[str] = ()


LOGGER = Program(
    "Sensor Logger",
    "phone",
    "seconds_elapsed",
    {
        "acc": "TotalAcceleration: ([xyz])",
        LINEAR: "Accelerometer: ([xyz])",
        "gravity": "Gravity: ([xyz])",
        "uncalibrated": "AccelerometerUncalibrated: ([xyz])",
        "gyr": "Gyroscope(?:Uncalibrated)?: ([xyz])",
        "mag": "Magnetometer(?:Uncalibrated)?: ([xyz])",
    },
    (("acc",), (LINEAR, "gravity"), ("uncalibrated",)),
    (
        *("TotalAcceleration", "Accelerometer", "AccelerometerUncalibrated", "Gravity"),
        *("Gyroscope", "GyroscopeUncalibrated", "Magnetometer", "MagnetometerUncalibrated"),
    ),
)
PHYPHOX = Program(
    "phyphox",
    "phone",
    "Time (s)",
    {
        "gyr": r"(?i:.*: (?:gyroscope|rotation rate) ([xyz]) \(rad/s\))|Gyroscope: ([XYZ]) \(rad/s\)",
        "acc": r"(?i:.*: acceleration ([xyz]) \(m/s(?:\^2|²)\))|Accelerometer: ([XYZ]) \(m/s(?:\^2|²)\)",
        "mag": r"(?i:.*: magnetic field ([xyz]) \([µμ]t\))|Magnetometer: ([XYZ]) \([µμ]T\)",
        LINEAR: r"(?i:.*: linear acceleration ([xyz]) \(m/s(?:\^2|²)\))|Linear Accelerometer: ([XYZ]) \(m/s(?:\^2|²)\)",
    },
    files=("Accelerometer", "Acceleration", "Linear Accelerometer", "Gyroscope", "Magnetometer", "Magnetic field"),
)
WATCH = Program(
    "Sensor Logger",
    "watch",
    "seconds_elapsed",
    {
        "gyr": "WristMotion: rotationRate([XYZ])",
        "gravity": "WristMotion: gravity([XYZ])",
        LINEAR: "WristMotion: acceleration([XYZ])",
    },
    (("gravity", LINEAR),),
    (WRIST,),
)
PROGRAMS = (LOGGER, PHYPHOX, WATCH)
"""In the order in which they are looked for: a watch is read where there is no phone."""


def sensors_in(program: Program, file: str, header: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return each sensor in a file and its columns (t, and x, y, z).

    None are phyphox' if another column looks inertial.
    """
    if program.time not in header:
        return {}
    found: dict[str, dict[str, str]] = {}
    for sensor, pattern in program.sensors.items():
        matches = ((name, re.fullmatch(pattern, f"{file}: {name}")) for name in header)
        axes = {match[match.lastindex or 1].lower(): name for name, match in matches if match}
        if axes.keys() == set("xyz"):
            ours = CHANNELS.get(sensor, CHANNELS["acc"])
            found[sensor] = {"t": program.time, **{each: axes[each[-1]] for each in ours}}
    known = {name for columns in found.values() for name in columns.values()}
    have = ["t", *(CHANNELS[sensor][0] for sensor in found if sensor in CHANNELS)]
    foreign = program is PHYPHOX and not all(name in known or why_not_read(name, have) for name in header)
    return {} if foreign else found


def parts_of_force(
    path: Path, program: Program, found: Mapping[str, Part], metadata: Mapping[str, str]
) -> tuple[Sequence[str], str]:
    """Return the sensors whose sum is specific force, and their unit, with a sign.

    Args:
        metadata: of Sensor Logger (`read_metadata`).

    Raises:
        RecordingError: there are none, or their sign is not known.
    """
    force = next((sensors for sensors in program.force if found.keys() >= {*sensors}), ())
    if not force:
        raise RecordingError.at(path, _what_is_needed(program, LINEAR in found, metadata))
    if program is WATCH or force == ("uncalibrated",):  # as on Android, or reversed and in g
        sheet, columns = found[force[0]]
        norm = np.linalg.norm(sheet.read([name for ours, name in columns.items() if ours != "t"]).values, axis=1)
        small = 2 * (norm < 0.5 * GRAVITY).sum() > np.isfinite(norm).sum()
        return force, "-g" if small else "m/s2"
    if program is LOGGER and len(force) > 1 and not metadata:
        what = "Metadata.csv is missing, which says whether the signs are an iPhone's; add it, or export again"
        raise RecordingError.at(path, what)
    reversed_ = metadata.get("platform") == "ios" and metadata.get("standardisation") != "true"
    return force, "-m/s2" if reversed_ else "m/s2"


def _what_is_needed(program: Program, is_linear: bool, metadata: Mapping[str, str]) -> str:
    without = "Linear Acceleration" if program is PHYPHOX else "Accelerometer.csv"
    why = f"{without} is without gravity" if is_linear else "no acceleration is in it"
    if program is PHYPHOX:
        do = "record with the experiment that `pbd sensors phyphox` gives to the phone"
        return f"{why}, and 'Acceleration x (m/s^2)' is needed; {do}"
    ios = metadata.get("platform") == "ios"
    needed = "Gravity.csv beside Accelerometer.csv" if ios else "TotalAcceleration.csv"
    needed += " (an iPhone's Gravity.csv)" * (not metadata)
    switch = "Gravity" if ios else "Total Acceleration" if metadata else "Total Acceleration' or 'Gravity"
    return f"{why}, and {needed} is needed; switch on '{switch}' in Sensor Logger and record again"


def read_metadata(path: Path, files: Files) -> Mapping[str, str]:
    """Read Sensor Logger's Metadata.csv, in lower case; it may be missing. RecordingError: it can't be read."""
    if METADATA not in files:
        return {}
    try:
        rows = list(csv.DictReader(files[METADATA]().decode("utf-8", "replace").splitlines()))
    except csv.Error as reason:
        raise RecordingError.at(path, f"{METADATA}.csv can't be read ({reason}); export it again") from None
    return {str(key).strip().lower(): str(value).strip().lower() for key, value in rows[0].items()} if rows else {}
