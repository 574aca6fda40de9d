"""The calibration of an arm's servos in LeRobot's format: a JSON object with five integers for each joint."""

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pbd.errors import CalibrationError, listed, printable
from pbd.io.atomic import is_file, write_text
from pbd.io.read_file import read_text

COUNTS = 4096
"""Counts per turn of an STS3215."""

LARGEST_OFFSET_COUNTS = 2047
"""Largest magnitude of the homing offset that a servo can store, counts."""


@dataclass(frozen=True)
class ServoCalibration:
    """One servo.

    Attributes:
        drive_mode: 1 if the gripper's percentage is reversed.
        homing_offset: counts that the servo subtracts from its encoder.
        range_min, range_max: the ends of the joint's range, in counts after the offset.
    """

    id: int
    drive_mode: int
    homing_offset: int
    range_min: int
    range_max: int


BOUNDS = {
    "id": (1, 253),
    "drive_mode": (0, 1),
    "homing_offset": (-LARGEST_OFFSET_COUNTS, LARGEST_OFFSET_COUNTS),
    "range_min": (0, COUNTS - 1),
    "range_max": (0, COUNTS - 1),
}
"""Lowest and highest value of each field of `ServoCalibration`."""


def read_servo_calibration(path: Path, joints: Sequence[str]) -> dict[str, ServoCalibration]:
    """Read the servos of these joints, in their order; CalibrationError: one is missing, or has an invalid number."""
    text = read_text(path, CalibrationError, "make one with `pbd run --calibrate --robot R`, or name LeRobot's")
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as reason:
        raise _wrong(path, f"is not JSON ({str(reason)[:100]})") from None
    if not isinstance(values, dict):
        raise _wrong(path, "holds no object with the joints' names")
    if missing := [joint for joint in joints if joint not in values]:
        raise _wrong(path, f"lacks {listed(missing)}: it has {listed(map(str, values))}")
    servos = {joint: _servo(path, joint, values[joint]) for joint in joints}
    ids = [servo.id for servo in servos.values()]
    if twice := [joint for joint, servo in servos.items() if ids.count(servo.id) > 1]:
        raise _wrong(path, f"gives one id to {listed(twice)}")
    return servos


def write_servo_calibration(servos: Mapping[str, ServoCalibration], path: Path) -> None:
    """Write the file in LeRobot's format; PbdError: it can't be written."""
    text = json.dumps({joint: asdict(servo) for joint, servo in servos.items()}, indent=4)
    write_text(path, text + "\n", parents=True)


def find_servo_calibration(named: Path | None, robot: str, robot_type: str) -> Path:
    """Return the named file, else ./calibration/ROBOT-servos.json, else LeRobot's only file for this type of arm.

    Raises:
        CalibrationError: there is none, or LeRobot has several.
    """
    if named is not None:
        return named
    own = own_servo_calibration(robot)
    if is_file(own):
        return own
    folder = _lerobots_folder()
    names = robot_type, "so_follower"  # since version 0.5 of the SO-100 and the SO-101
    found = sorted(path for name in names for path in (folder / name).glob("*.json"))
    if len(found) == 1:
        return found[0]
    if found:
        what = f"LeRobot has calibrated several arms ({listed(path.stem for path in found)}): name one,"
        raise CalibrationError(f"{what} --servos {shlex.quote(str(found[0]))}", path=folder)
    what = f"no calibration of the servos: there is no {own}, and LeRobot has none in {folder / robot_type}"
    make = f"make one with `pbd run --calibrate --robot {shlex.quote(robot)}`"
    raise CalibrationError(f"{what}; {make}, or name its file with --servos")


def own_servo_calibration(robot: str) -> Path:
    """Return the path of the file that `pbd run --calibrate` writes: ./calibration/ROBOT-servos.json."""
    return Path("calibration") / f"{robot}-servos.json"


def _lerobots_folder() -> Path:
    """Return the folder of LeRobot's calibrations (lerobot/utils/constants.py)."""
    hub = os.environ.get("HF_HOME") or str(Path("~/.cache/huggingface"))
    home = os.environ.get("HF_LEROBOT_HOME") or os.path.join(hub, "lerobot")  # noqa: PTH118 (HF_HOME may be "")
    calibration = os.environ.get("HF_LEROBOT_CALIBRATION") or os.path.join(home, "calibration")  # noqa: PTH118
    return Path(os.path.expanduser(calibration)) / "robots"  # noqa: PTH111 (pathlib's raises where there is no home)


def _servo(path: Path, joint: str, value: Any) -> ServoCalibration:
    if not isinstance(value, dict):
        raise _wrong(path, f"{joint} is no object")
    numbers = {}
    for name, (low, high) in BOUNDS.items():
        number = value.get(name)
        if type(number) is not int or not low <= number <= high:
            fault = "is missing" if number is None else f"is {printable(json.dumps(number))}"
            raise _wrong(path, f"{name} of {joint} {fault}, not a whole number from {low} to {high}")
        numbers[name] = number
    servo = ServoCalibration(**numbers)
    if not servo.range_min < servo.range_max:
        raise _wrong(path, f"range_min of {joint}, {servo.range_min}, is not below its range_max, {servo.range_max}")
    return servo


def _wrong(path: Path, what: str) -> CalibrationError:
    return CalibrationError.at(path, f"{what}; make it anew with `pbd run --calibrate --robot R`")
