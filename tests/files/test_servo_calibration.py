"""LeRobot's calibration of an arm's servos: its format, and where it is found."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.driving.encoders import Encoders, servo_names
from pbd.errors import CalibrationError, RobotError
from pbd.files.robot import load_robot
from pbd.files.servo_calibration import (
    ServoCalibration,
    find_servo_calibration,
    read_servo_calibration,
    write_servo_calibration,
)
from tests.driving.emulator import calibration_of

SO101 = load_robot("so101")
NAMES = servo_names(SO101)


def test_a_calibration_is_read_as_written(tmp_path: Path) -> None:
    file = tmp_path / "calibration" / "mine.json"
    write_servo_calibration(calibration_of("so101"), file)
    assert read_servo_calibration(file, NAMES) == calibration_of("so101")


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("range_max", None, "range_max of elbow_flex is missing, not a whole number from 0 to 4095; make it anew"),
        ("range_min", 12.5, "range_min of elbow_flex is 12.5, not a whole number from 0 to 4095"),
        ("homing_offset", 2048, "homing_offset of elbow_flex is 2048, not a whole number from -2047 to 2047"),
        ("id", True, "id of elbow_flex is true, not a whole number from 1 to 253"),
        ("id", 1, "gives one id to shoulder_pan, elbow_flex"),
        ("range_min", 3061, "range_min of elbow_flex, 3061, is not below its range_max, 3061"),
    ],
)
def test_an_invalid_number_is_refused(tmp_path: Path, key: str, value: object, says: str) -> None:
    file = tmp_path / "mine.json"
    write_servo_calibration(calibration_of("so101"), file)
    values = json.loads(file.read_text())
    values["elbow_flex"][key] = value
    file.write_text(json.dumps(values))
    with pytest.raises(CalibrationError) as told:
        read_servo_calibration(file, NAMES)
    assert f"{file}: {says}" in str(told.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "is not JSON"),
        ("[1]", "holds no object"),
        ('{"elbow": {}}', "lacks shoulder_pan, .*: it has elbow"),
        (json.dumps(dict.fromkeys(NAMES, 2048)), "shoulder_pan is no object; make it anew with"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "mine.json").write_text(text)
    with pytest.raises(CalibrationError, match=says):
        read_servo_calibration(tmp_path / "mine.json", NAMES)


def test_the_places_where_it_is_found(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(elsewhere / "lerobot"))

    def found(named: Path | None = None) -> Path:
        return find_servo_calibration(named, "so101", "so101_follower")

    with pytest.raises(CalibrationError, match="make one with `pbd run --calibrate --robot so101`"):
        found()
    theirs = elsewhere / "lerobot" / "robots" / "so101_follower"
    write_servo_calibration(calibration_of("so101"), theirs / "left.json")
    assert found() == theirs / "left.json"
    write_servo_calibration(calibration_of("so101"), theirs.with_name("so_follower") / "right.json")
    with pytest.raises(CalibrationError, match=r"several arms \(left, right\): name one, --servos .*left\.json"):
        found()
    write_servo_calibration(calibration_of("so101"), Path("calibration/so101-servos.json"))
    assert found() == Path("calibration/so101-servos.json")
    assert found(Path("x.json")) == Path("x.json")


def test_lerobots_degrees_and_percent() -> None:
    """LeRobot's rule (motors_bus.py, `_normalize`): the middle of the range is 0 degrees."""
    encoders = Encoders(SO101, calibration_of("so101"))
    q = np.array([[0.1, -0.5, 0.7, -0.9, 1.1]])
    at = encoders.from_joints(q, np.array([1.0]))
    wrist = calibration_of("so101")["wrist_flex"]
    degrees = (at[0, 3] - (wrist.range_min + wrist.range_max) / 2) * 360 / 4096
    assert degrees == pytest.approx(np.degrees(-0.9))
    np.testing.assert_allclose(encoders.to_joints(at), q)
    # The tool's "open" is 1 rad of the jaw, which LeRobot's range of -10 to 100 degrees makes 61 %.
    assert encoders.gripper_percent(at)[0] == pytest.approx(100 * (1.0 + 0.174533) / (1.74533 + 0.174533))
    servos = calibration_of("so101")
    turned = Encoders(SO101, servos | {"gripper": replace(servos["gripper"], drive_mode=1)})
    ours = turned.from_joints(q, np.array([1.0]))
    assert ours[0, 5] - turned.lower[5] == pytest.approx(turned.upper[5] - at[0, 5])
    assert turned.gripper_percent(ours) == pytest.approx(encoders.gripper_percent(at))


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        (
            "elbow_flex",
            {"range_min": 1500, "range_max": 2600},
            "range of 97 degrees for elbow_flex; the model has 194",
        ),
        ("elbow_flex", {"range_min": 4, "range_max": 4090}, "range of 359 degrees for elbow_flex; the model has 194"),
        ("gripper", {"range_min": 2047, "range_max": 2047}, "range of 0 degrees for gripper; the model has 110"),
        ("elbow_flex", {"drive_mode": 1}, "drive_mode of elbow_flex is 1"),
    ],
)
def test_an_implausible_calibration_is_refused(name: str, change: dict[str, int], says: str) -> None:
    servos = calibration_of("so101")
    with pytest.raises(CalibrationError, match=says):
        Encoders(SO101, servos | {name: replace(servos[name], **change)})


@pytest.mark.parametrize("robot", ["so100", "so101"])
def test_a_real_calibration_is_plausible(robot: str) -> None:
    """Made by LeRobot, of a real SO-ARM101 (github.com/matrix97317/UniRobot, so_arm101_calib.py)."""
    ranges = ((746, 3477), (822, 3211), (901, 3110), (849, 3216), (135, 3984), (1975, 3565))
    arm = load_robot(robot)
    servos = zip(servo_names(arm), ranges, strict=True)
    Encoders(arm, {name: ServoCalibration(i, 0, 0, *ends) for i, (name, ends) in enumerate(servos, start=1)})


def test_an_arm_without_servos_is_refused() -> None:
    with pytest.raises(RobotError, match="panda has no"):
        Encoders(load_robot("panda"), {})
