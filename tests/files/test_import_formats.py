"""Short files in the formats of other programs, written by hand after the published format that each one names."""

import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.files.importers import import_file
from pbd.tracking.noise import CALIBRATED, CLASSES
from pbd.tracking.repair.clock import with_checked_times
from tests.not_none import not_none

DEG = np.pi / 180.0


def imported(folder: Path, text: str, rate_hz: float | None = None, name: str = "run.csv", **units: str) -> Recording:
    (folder / name).write_text(text, encoding="utf-8")
    return import_file(folder / name, {}, units, rate_hz).recording


def decided(read: Recording) -> Mapping[str, str]:
    """Map our names to the file's columns."""
    return {column.ours: column.name for column in read.info.source.columns}


DOT = """sep=,
DeviceTag:,D422CD005F44,,,,,,,,,,,,,,,,,
FirmwareVersion:,2.4.0,,,,,,,,,,,,,,,,,
AppVersion:,2023.6.0,,,,,,,,,,,,,,,,,
OutputRate:,60Hz,,,,,,,,,,,,,,,,,
Measurement Mode:,Custom Mode 5,,,,,,,,,,,,,,,,,
StartTime:,2023-07-04 10:11:12.345 +0200,,,,,,,,,,,,,,,,,
Movella Technologies B. V. 2005-2023,,,,,,,,,,,,,,,,,,,

PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z,FreeAcc_X,FreeAcc_Y,FreeAcc_Z,Acc_X,Acc_Y,Acc_Z,\
Gyr_X,Gyr_Y,Gyr_Z,Mag_X,Mag_Y,Mag_Z
1,4294950629,1,0,0,0,0.1,0.2,0.3,0.5,0.25,9.75,90,0,-180,0.5,0,-0.75
2,4294967295,1,0,0,0,0.1,0.2,0.3,0.5,0.25,9.75,90,0,-180,0.5,0,-0.75
3,16666,1,0,0,0,0.1,0.2,0.3,0.5,0.25,9.75,90,0,-180,0.5,0,-0.75
"""
"""Format of Movella's Android SDK (DotLogger: `TITLE_...`) in Custom Mode 5, with a magnetometer.

SampleTimeFine is in us and wraps at 2^32; Acc is in m/s2, Gyr in deg/s (Movella DOT User Manual XD0502P)."""


def test_movella_dot(tmp_path: Path) -> None:
    recording = imported(tmp_path, DOT)
    assert_allclose(recording.t, [0.0, 0.016666, 0.033333], atol=2e-6)
    assert_allclose(recording.acc[0], [0.5, 0.25, 9.75])
    assert_allclose(not_none(recording.gyr)[0], [np.pi / 2, 0.0, -np.pi])
    assert recording.mag is not None
    assert recording.info.source.program == "Movella (Xsens) DOT"
    assert recording.info.source.unread["FreeAcc_X"] == "gravity, or gravity removed"
    assert decided(recording)["ax"] == "Acc_X"
    with pytest.raises(RecordingError, match="time runs backwards from 3000000000 to 16666"):  # it started anew
        imported(tmp_path, DOT.replace("4294967295", "3000000000").replace("4294950629", "2999983334"))


MT_MANAGER = """// General information:
//  MT Manager version: 2020.0.0
//  Update Rate: 100.0Hz
// Device information:
//  DeviceId: 01200311
PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z
00001\t5000100\t0.5\t0.25\t9.75\t1.5\t0\t-2\t0.5\t0\t-0.75
00002\t5000200\t0.5\t0.25\t9.75\t1.5\t0\t-2\t0.5\t0\t-0.75
"""
"""Format of Xsens' MT Manager for an MTi: SampleTimeFine is in 0.1 ms, Gyr in rad/s."""


def test_xsens_mt_manager(tmp_path: Path) -> None:
    recording = imported(tmp_path, MT_MANAGER, name="MT_01200311-000.txt")
    assert_allclose(recording.t, [0.0, 0.01])
    assert_allclose(not_none(recording.gyr)[0], [1.5, 0.0, -2.0])
    assert CLASSES[recording.info.sensor.split()[0]] is CALIBRATED
    untimed = imported(tmp_path, re.sub(r"\t(SampleTimeFine|5000[12]00)", "", MT_MANAGER), rate_hz=100.0)
    assert untimed.info.source.program == "Xsens MT Manager"
    by_remarks = imported(tmp_path, re.sub(r"\t(SampleTimeFine|5000[12]00)", "", MT_MANAGER))
    np.testing.assert_array_equal(by_remarks.t, untimed.t)  # the remarks have the rate
    (tmp_path / "ticks.txt").write_text(MT_MANAGER.replace("SampleTimeFine", "Ticks"), encoding="utf-8")
    named = import_file(tmp_path / "ticks.txt", {"t": "Ticks"}, {"t": "ms"}).recording
    assert_allclose(named.t, [0.0, 0.1])  # a column that is named has precedence


SHIMMER = """"sep=,"
S_Hand_Timestamp_Unix_CAL,S_Hand_Accel_WR_X_RAW,S_Hand_Accel_LN_X_CAL,S_Hand_Accel_LN_Y_CAL,S_Hand_Accel_LN_Z_CAL,\
S_Hand_Accel_WR_X_CAL,S_Hand_Accel_WR_Y_CAL,S_Hand_Accel_WR_Z_CAL,S_Hand_Gyro_X_CAL,S_Hand_Gyro_Y_CAL,\
S_Hand_Gyro_Z_CAL,S_Hand_Mag_X_CAL,S_Hand_Mag_Y_CAL,S_Hand_Mag_Z_CAL,
ms,no units,m/(s^2),m/(s^2),m/(s^2),m/(s^2),m/(s^2),m/(s^2),deg/s,deg/s,deg/s,local_flux,local_flux,local_flux,
1.5E12,100,0.5,0.25,9.75,7,7,7,90,0,-180,0.5,0,-0.75,
1.500000000020E12,100,0.5,0.25,9.75,7,7,7,90,0,-180,0.5,0,-0.75,
"""
"""Format of Shimmer's ConsensysPRO: names, units, rows, each with a comma at its end; two accelerometers."""


@pytest.mark.parametrize("delimiter", [",", "\t"])
def test_shimmer(tmp_path: Path, delimiter: str) -> None:
    recording = imported(tmp_path, SHIMMER.replace(",", delimiter))
    assert_allclose(recording.t, [0.0, 0.02], atol=1e-6)
    assert_allclose(recording.acc[0], [0.5, 0.25, 9.75])
    assert_allclose(not_none(recording.gyr)[0], [np.pi / 2, 0.0, -np.pi])
    assert recording.mag is not None
    assert recording.info.source.unread["S_Hand_Accel_WR_X_RAW (no units)"] == "raw counts"


def test_an_ximu3s_folder(tmp_path: Path) -> None:
    """The x-IMU3 GUI's data logger writes a folder with a file for each type of message."""
    inertial = "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),"
    inertial += "Accelerometer Y (g),Accelerometer Z (g)\n1000000,90,0,0,0,0,1\n1002500,90,0,0,0,0,1\n"
    field = "Timestamp (us),Magnetometer X (a.u.),Magnetometer Y (a.u.),Magnetometer Z (a.u.)\n"
    (tmp_path / "Inertial.csv").write_text(inertial)
    (tmp_path / "Magnetometer.csv").write_text(f"{field}1000000,1,0,-1\n1005000,0,0,-1\n")
    (tmp_path / "Quaternion.csv").write_text("Timestamp (us),W,X,Y,Z\n1000000,1,0,0,0\n")
    recording = import_file(tmp_path).recording
    assert decided(recording)["mx"] == "Magnetometer.csv: Magnetometer X (a.u.)"
    assert recording.info.source.unread == {"Quaternion.csv": "a file that isn't used"}
    assert recording.acc[0, 2] == GRAVITY
    assert_allclose(not_none(recording.mag), [[1.0, 0.0, -1.0], [0.5, 0.0, -1.0]])
    its = [f"Magnetometer.csv: Magnetometer {axis} (a.u.)" for axis in "XYZ"]
    turned = not_none(import_file(tmp_path, {"mx": f"-{its[2]}", "mz": its[0]}).recording.mag)
    assert_allclose(turned[0], [1.0, 0.0, 1.0])
    packed = Path(shutil.make_archive(str(tmp_path.with_name("packed")), "zip", tmp_path))
    for path in (tmp_path / "Magnetometer.csv", tmp_path / "Inertial.csv", packed):
        again = import_file(path).recording
        assert_array_equal(not_none(again.mag), not_none(recording.mag))
        assert_array_equal(again.acc, recording.acc)
        assert again.info.source == recording.info.source
    (tmp_path / "Inertial.csv").unlink()
    with pytest.raises(RecordingError, match=r"put it there \(an x-IMU3's is Inertial.csv\)"):
        import_file(tmp_path / "Magnetometer.csv")


PLOTTER = "AccelX:0.5,AccelY:0.25,AccelZ:9.75,GyroX:1.5,GyroY:0.00,GyroZ:-2.00\n"
"""Adafruit_MPU6050, examples/plotter/plotter.ino: m/s2, rad/s."""

BASIC_READINGS = """Acceleration X: 0.50, Y: 0.25, Z: 9.75 m/s^2
Rotation X: 1.50, Y: 0.00, Z: -2.00 rad/s
Temperature: 25.36 degC

"""
"""Adafruit_MPU6050, examples/basic_readings/basic_readings.ino."""

M5STICK = """Acceleration: X=0.50, Y=0.25, Z=9.75
Gyroscope: X=1.50, Y=0.00, Z=-2.00
"""
"""Format of sketches for M5StickC's MPU6886. The library's units are g and deg/s; here the values are SI."""


BNO08X = """Acceleration:
X: 0.500000  Y: 0.250000 Z: 9.750000  m/s^2

Gyro:
X: 1.500000  Y: 0.000000 Z: -2.000000 rads/s

"""
"""Adafruit_CircuitPython_BNO08x, examples/bno08x_simpletest.py."""


@pytest.mark.parametrize("line", [PLOTTER, BASIC_READINGS, M5STICK, BNO08X])
def test_lines_that_sketches_print(tmp_path: Path, line: str) -> None:
    text = line[20:] + 4 * line + line[:20]  # the serial monitor was opened and closed within a line
    recording = imported(tmp_path, text, 50.0, "monitor.log")
    assert_allclose(recording.acc, np.tile([0.5, 0.25, 9.75], (len(recording), 1)))
    assert_allclose(not_none(recording.gyr)[0], [1.5, 0.0, -2.0])
    assert len(recording) == 4
    with pytest.raises(RecordingError, match=r"no column for t .*or with its --rate HZ"):
        imported(tmp_path, text, None, "monitor.log")


@pytest.mark.parametrize(
    ("stamp", "atol"),
    [
        ("12:34:{} -> ", 1e-9),
        ("12:34:{}->", 1e-9),
        ("[2024-05-01 12:34:{}] ", 1e-7),  # seconds since 2000 are rounded
        ("2024-05-01 12:34:{} ", 1e-7),
    ],
)
def test_times_of_the_serial_monitor(tmp_path: Path, stamp: str, atol: float) -> None:
    lines = "".join(f"{stamp.format(at)}{PLOTTER}" for at in ("56.990", "56.995", "57.000"))
    recording = imported(tmp_path, lines, None, "monitor.txt")
    assert_allclose(recording.t, [0.0, 0.005, 0.01], atol=atol)


@pytest.mark.parametrize(
    ("line", "scales"),
    [
        ("AX: 1 g, AY: 2 g, AZ: 3 g, GX: 4 °/s, GY: 5 °/s, GZ: 6 °/s", (GRAVITY, DEG)),
        ("t: {} ms, AccX: 1G AccY: 2G AccZ: 3G GyroX: 4dps GyroY: 5dps GyroZ: 6dps", (GRAVITY, DEG)),
        ("ax: 1 ay: 2 az: 3 gx: 4 gy: 5 gz: 6 deg/s", (1.0, DEG)),
        ("AcX = 1 | AcY = 2 | AcZ = 3 | Tmp = 25.3 | GyX = 4 | GyY = 5 | GyZ = 6", (1.0, 1.0)),
        ("Accel: 1.0\t2.0\t3.0\tGyro: 4\t5\t6", (1.0, 1.0)),
        ("Accel (g): 1, 2, 3 - Gyro (dps): 4, 5, 6", (GRAVITY, DEG)),
        ("Acc: (1; 2; 30e-1) m/s²\nRotation: (4; 5; 6) mdps", (1.0, 1e-3 * DEG)),
        ("Acceleration (m/s^2): (1, 2, 3)\nGyro (°/s): (4, 5, 6)", (1.0, DEG)),
        ("Acc(g)=> X:1 Y:2 Z:3 gyro(dps)=> X:4 Y:5 Z:6 gravity=> X:7 Y:8 Z:9", (GRAVITY, DEG)),
        ("I ({}) main: ACC[g]: X=1 Y=2 Z=3 | GYRO[dps]: X=4 Y=5 Z=6 | TEMP[C]: 25", (GRAVITY, DEG)),
        ("Accel X: 1\nAccel Y: 2\nAccel Z: 3\nGyro X: 4\nGyro Y: 5\nGyro Z: 6radians/s", (1.0, 1.0)),
        ('{{"acc":[1,2,3],"gyro":[4,5,6]}}', (1.0, 1.0)),
        ("{{'ax': 1, 'ay': 2, 'az': 3, 'gx': 4, 'gy': 5, 'gz': 6}}", (1.0, 1.0)),
        (">ax:1§g\n>ay:2§g\n>az:3§g\n>gx:4§deg/s\n>gy:5§deg/s\n>gz:6§deg/s", (GRAVITY, DEG)),
        ("Scaled. Acc (mg) [  00001.00,  00002.00,  00003.00 ], Gyr (DPS) [  00004.00,  5, 6 ]", (GRAVITY / 1e3, DEG)),
        ('{{"ax":"1","ay":"2","az":"3","gx":"4","gy":"5","gz":"6"}}', (1.0, 1.0)),
    ],
)
def test_units_and_rows_of_axes_that_sketches_print(tmp_path: Path, line: str, scales: tuple[float, float]) -> None:
    """A unit counts for its own sensor's axes: neither for the time before them nor for the other sensor."""
    text = "".join(line.format(10 * k) + "\n" for k in range(4))
    recording = imported(tmp_path, text, None if "{}" in line else 100.0, "monitor.log")
    assert_allclose(recording.acc, np.tile([1.0, 2.0, 3.0], (4, 1)) * scales[0])
    assert_allclose(not_none(recording.gyr)[0], np.array([4.0, 5.0, 6.0]) * scales[1])
    assert_allclose(recording.t, 0.01 * np.arange(4))


def test_whole_seconds_and_words_before_a_line_are_not_the_time_of_its_sample(tmp_path: Path) -> None:
    """By whole seconds most samples would have the same time, and be left out."""
    text = "".join(f"[2024-05-01 12:34:{50 + k // 4}] ax: 1 ay: 2 az: 3\n" for k in range(12))
    with pytest.raises(RecordingError, match="no column for t"):
        imported(tmp_path, text, None, "monitor.log")
    recording = imported(tmp_path, 4 * "[temp:23,5] ax: 1 ay: 2 az: 3\n", 100.0, "monitor.log")
    assert_allclose(recording.acc, np.tile([1.0, 2.0, 3.0], (4, 1)))


@pytest.mark.parametrize(
    "lines",
    [
        ">ax:{0}:1§g|np\n>ay:{0}:2§g\n>az:{1}:3§g\n>gx:{1}:4§dps\n>gy:{1}:5§dps\n>gz:{1}:6§dps\n",
        "\x1b[0;32mI ({0}) imu: ax=1 ay=2 az=3 g\x1b[0m\n\x1b[0;32mI ({1}) imu: gx=4 gy=5 gz=6 dps\x1b[0m\n",
    ],
)
def test_times_of_teleplot_and_of_esp_idf(tmp_path: Path, lines: str) -> None:
    """A sample's time is that of its first line."""
    recording = imported(tmp_path, "".join(lines.format(5 + 10 * k, 6 + 10 * k) for k in range(4)), None, "monitor.log")
    assert_allclose(recording.t, 0.01 * np.arange(4), atol=1e-12)
    assert_allclose(recording.acc, np.tile([1.0, 2.0, 3.0], (4, 1)) * GRAVITY)
    assert_allclose(not_none(recording.gyr)[0], np.array([4.0, 5.0, 6.0]) * DEG)


def test_a_last_line_that_is_cut_off_before_its_unit_has_that_of_the_others(tmp_path: Path) -> None:
    recording = imported(tmp_path, 4 * "Acc: 1, 2, 3 g\n" + "Acc: 1, 2, 3", 100.0, "monitor.log")
    assert_allclose(recording.acc, np.tile([1.0, 2.0, 3.0], (5, 1)) * GRAVITY)


def test_biases_above_a_table_are_no_lines_of_a_sketch(tmp_path: Path) -> None:
    biases = "".join(f"{sensor} {axis}: 0.1\n" for sensor in ("Acc", "Gyro", "Mag") for axis in "XYZ")
    recording = imported(tmp_path, f"{biases}t,ax,ay,az\n0,1,2,3\n1,1,2,3\n")
    assert_allclose(recording.acc, [[1.0, 2.0, 3.0]] * 2)


def test_four_numbers_after_a_name_are_no_axes(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="looks like inertial data, but is not understood"):
        imported(tmp_path, 4 * "acc: 1 2 3 4.5e-3 gyro: 1 2 3\n", 100.0, "monitor.log")


# --- names ------------------------------------------------------------------------------------------------------------


def test_beside_another_gyro_gx_is_gravity(tmp_path: Path) -> None:
    """Short names of AndroSensor's columns: AX, GX is gravity, GYROX the gyro."""
    header = "t,AX,AY,AZ,GX,GY,GZ,LAX,LAY,LAZ,GYROX,GYROY,GYROZ"
    read = imported(tmp_path, f"{header}\n0,1,2,9,1,2,9,0,0,0,4,5,6\n1,1,2,9,1,2,9,0,0,0,4,5,6\n")
    assert_allclose(not_none(read.gyr)[0], [4.0, 5.0, 6.0])


@pytest.mark.parametrize(
    ("gravity", "rest", "sign"),
    [
        ("gravity.{}", "userAcceleration.{}", -1),  # MotionSense: Apple's Core Motion, in g, which points down
        ("gravity_{}(m/s^2)", "linear_acceleration_{}(m/s^2)", 1),
    ],
)
def test_gravity_and_the_rest_are_added(tmp_path: Path, gravity: str, rest: str, sign: int) -> None:
    names = [part.format(axis) for part in (gravity, rest) for axis in "xyz"]
    g = GRAVITY if sign < 0 else 1.0
    parts = [sign * each / g for each in (0.0, 0.0, 9.0, 0.5, 0.25, 0.75)]
    row = ",".join(map(str, (0.1, 0.2, *parts, 1.0, 0.0, -2.0)))
    text = f"attitude.roll,attitude.pitch,{','.join(names)},rotationRate.x,rotationRate.y,rotationRate.z\n"
    recording = imported(tmp_path, text + 2 * f"{row}\n", rate_hz=50.0)
    assert_allclose(recording.acc[0], [0.5, 0.25, 9.75])
    assert_allclose(not_none(recording.gyr)[0], [1.0, 0.0, -2.0])
    assert recording.info.source.unread[names[3]] == f"added to {names[0]}"


PARTS = "gravity.x,gravity.y,gravity.z,userAcceleration.x,userAcceleration.y,userAcceleration.z"
PARTS_ROW = "0.5,0,-1,0.25,0.125,-0.5\n"


@pytest.mark.parametrize("part", ["gravity", "userAcceleration"])
def test_axes_of_gravity_and_the_rest_can_be_swapped(tmp_path: Path, part: str) -> None:
    """As advice about axes does. It was refused or ignored; if all three axes were given, gravity alone was read."""
    columns = {"ax": f"{part}.y", "ay": f"-{part}.x"}
    (tmp_path / "run.csv").write_text(f"{PARTS}\n{2 * PARTS_ROW}")
    got = import_file(tmp_path / "run.csv", columns, rate_hz=50.0).recording
    assert_allclose(got.acc[0], np.array([-0.125, 0.75, 1.5]) * GRAVITY)
    assert [column.named_by for column in got.info.source.of("acc")] == ["--column", "--column", "its name"]


@pytest.mark.parametrize(("part", "other"), [("gravity.{}", "gravity.{} (m/s^2)"), ("gravity", "left_gravity")])
def test_gravity_in_another_unit_or_of_another_device_is_not_added(tmp_path: Path, part: str, other: str) -> None:
    header = re.sub(part.format("([xyz])"), other.format(r"\1"), PARTS)
    with pytest.raises(RecordingError, match=r"userAcceleration\.z are without gravity, which is needed"):
        imported(tmp_path, f"{header}\n{2 * PARTS_ROW}", rate_hz=50.0)


HYPERIMU = """@ HyperIMU
@ Sampling Rate:10ms

timestamp,accelerometer_lsm6ds3_c.x,accelerometer_lsm6ds3_c.y,accelerometer_lsm6ds3_c.z,rotation_Vector.x,\
rotation_Vector.y,rotation_Vector.z,gyroscope_lsm6ds3_c.x,gyroscope_lsm6ds3_c.y,gyroscope_lsm6ds3_c.z
1700000000000,0.5,0.25,9.75,0.1,0.2,0.3,1.5,0,-2
1700000000010,0.5,0.25,9.75,0.1,0.2,0.3,1.5,0,-2
"""
"""Format of an Android logger: each sensor's type, the phone's chip, the axis; the time in ms."""


def test_a_chip_may_follow_the_quantity_or_the_axis(tmp_path: Path) -> None:
    read = imported(tmp_path, HYPERIMU, t="ms")
    assert_allclose(read.acc[0], [0.5, 0.25, 9.75])
    assert_allclose(not_none(read.gyr)[0], [1.5, 0.0, -2.0])
    assert read.info.source.unread["rotation_Vector.x"] == "an attitude that isn't used"
    chips = [f"{name}_{chip}" for chip in ("adxl345", "mpu6050") for name in ("ax", "ay", "az", "gx", "gy", "gz")]
    header = ["t", *chips[:3], *chips[6:]]  # the first chip has no gyro
    read = imported(tmp_path, f"{','.join(header)}\n0,1,1,1,2,2,2,3,3,3\n1,1,1,1,2,2,2,3,3,3\n")
    assert decided(read) == dict(zip(["t", "ax", "ay", "az", "gx", "gy", "gz"], ["t", *chips[6:]], strict=True))
    for name in ("acc_free_bmi160_x", "acc_lin100_x"):
        with pytest.raises(RecordingError, match=f"{name} looks like inertial data"):
            imported(tmp_path, f"t,{name}\n0,1\n1,1\n")
    with pytest.raises(RecordingError, match="no column for ax, ay, az"):
        imported(tmp_path, "t,ax_std100,ay_std100,az_std100\n0,1,1,1\n1,1,1,1\n")


def test_a_unit_of_angles_may_follow_the_axis(tmp_path: Path) -> None:
    """`AngleX_deg` was said to be a gyro's."""
    read = imported(tmp_path, "t,ax,ay,az,AngleX_deg,AngleY_deg,AngleZ_deg\n0,0,0,9.8,90,0,0\n1,0,0,9.8,90,0,0\n")
    assert [column.unit for column in read.info.source.of("rpy")] == ["deg"] * 3
    assert_allclose(not_none(read.device_rpy)[0], [np.pi / 2, 0.0, 0.0])
    with pytest.raises(RecordingError, match="the unit 'deg' of column 'gyro_x_deg' is not known"):
        imported(tmp_path, "t,ax,ay,az,gyro_x_deg,gyro_y_deg,gyro_z_deg\n0,0,0,9.8,1,2,3\n")


def test_rostopic_prints_times_in_ns(tmp_path: Path) -> None:
    header = "%time,field.header.seq,field.header.stamp," + ",".join(f"field.linear_acceleration.{x}" for x in "xyz")
    read = imported(tmp_path, f"{header}\n7000000000,0,5000000000,0,0,9.8\n7020000000,1,5010000000,0,0,9.8\n")
    assert read.info.source.program == "rostopic"
    assert_allclose(read.t, [0.0, 0.01], atol=1e-9)


@pytest.mark.parametrize(
    ("header", "what", "option"),
    [
        ("turnX,turnY,turnZ", "look like a gyro", "gx=turnX"),
        ("gyroQ", "looks like a gyro", "gx=gyroQ"),
        ("rotationRateAlpha,rotationRateBeta", "look like a gyro", "gx=rotationRateAlpha"),
        ("GYRO1", "looks like a gyro", "gx=GYRO1"),
        ("IMUGyroFwd", "looks like a gyro", "gx=IMUGyroFwd"),
        ("imu_gyro_fwd", "looks like a gyro", "gx=imu_gyro_fwd"),
        ("pitch_rate", "looks like a gyro", "gx=pitch_rate"),
        ("Dreht_X [°/s],Dreht_Y [°/s]", "look like a gyro", r"gx='Dreht_X \[°/s\]'"),
        ("x (dps)", "looks like a gyro", r"gx='x \(dps\)'"),
        ("mag1", "looks like inertial data", "mx=mag1"),
    ],
)
def test_a_column_that_looks_inertial_is_never_ignored(tmp_path: Path, header: str, what: str, option: str) -> None:
    cells = ",1" * len(header.split(","))
    with pytest.raises(RecordingError, match=rf"{what}, but .* with --column {option} and its like"):
        imported(tmp_path, f"t,ax,ay,az,{header}\n0,0,0,9.8{cells}\n")
    read = imported(tmp_path, f"t,ax,ay,az,gx,gy,gz,mx,my,mz,{header}\n0,0,0,9.8,1,2,3,1,2,3{cells}\n")
    assert all(why.startswith("another column has the ") for why in read.info.source.unread.values())


def test_a_column_about_a_sensor_is_not_a_reading(tmp_path: Path) -> None:
    """Columns of SensorLog, Shimmer, `rostopic echo -p` and others that name a sensor but are no reading of it."""
    names = (
        "gyroTimestamp_sinceReboot(s),gyro_temp,motionMagneticFieldCalibrationAccuracy(Z),gyro_range,mag_norm,frame_rate,"
        "field.angular_velocity_covariance0,magneticHeading,accuracy,image,language,rotation_vector,heart_rate,gyro_bias_x"
    )
    read = imported(tmp_path, f"t,ax,ay,az,{names}\n0,0,0,9.8{',1' * len(names.split(','))}\n")
    assert list(read.info.source.unread) == names.split(",")
    assert all(read.info.source.unread.values())


@pytest.mark.parametrize(
    ("header", "rows", "wanted"),
    [
        ("time,seconds_elapsed", ("1700000000000000000,0", "1700000000010000000,0.01"), "seconds_elapsed"),
        ("date_time,micros", ("2024-01-01 10:00:00,500", "2024-01-01 10:00:00,10500"), "micros"),
        ("time_ms,timestamp", ("0,7", "10,7"), "time_ms"),
        ("timestamp,time_s", ("7,0", "6,0.01"), "time_s"),
    ],
)
def test_the_best_clock_of_several_is_chosen(tmp_path: Path, header: str, rows: tuple[str, ...], wanted: str) -> None:
    read = imported(tmp_path, f"{header},ax,ay,az\n" + "".join(f"{row},0,0,9.8\n" for row in rows))
    assert decided(read)["t"] == wanted
    assert_allclose(read.t, [0.0, 0.01])


ANDROSENSOR = """ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);\
LINEAR ACCELERATION X (m/s²);LINEAR ACCELERATION Y (m/s²);LINEAR ACCELERATION Z (m/s²);\
GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);MAGNETIC FIELD X (μT);MAGNETIC FIELD Y (μT);\
MAGNETIC FIELD Z (μT);ORIENTATION Z (azimuth °);Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS
0.5;0.25;9.75;0;0;0;1.5;0;-2;20;0;-40;12;10;2014-05-10 10:21:00:000
0.5;0.25;9.75;0;0;0;1.5;0;-2;20;0;-40;12;15;2014-05-10 10:21:00:005
"""

PHYSICS_TOOLBOX = """time,gFx,gFy,gFz,ax,ay,az,wx,wy,wz,p,Bx,By,Bz,Azimuth,Pitch,Roll
0.010,0.050986,0.025493,0.994223,0,0,0,1.5,0,-2,1013,20,0,-40,12,0,0
0.015,0.050986,0.025493,0.994223,0,0,0,1.5,0,-2,1013,20,0,-40,12,0,0
"""
"""gF is specific force over g, a is acceleration without gravity."""

PHYSICS_TOOLBOX_OTHER_ORDER = """time,ax,ay,az,wx,wy,wz,gFx,gFy,gFz,Bx,By,Bz
0.010,0,0,0,1.5,0,-2,0.050986,0.025493,0.994223,20,0,-40
0.015,0,0,0,1.5,0,-2,0.050986,0.025493,0.994223,20,0,-40
"""

ARTEMIS = """rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,
05/10/2024,10:21:00.00,50.986,25.493,994.223,85.9437,0,-114.5916,20,0,-40,25.1,100.0,
05/10/2024,10:21:00.01,50.986,25.493,994.223,85.9437,0,-114.5916,20,0,-40,25.1,100.0,
"""

BLUE_TRIDENT = """unix_timestamp_microsec,time_s,ax_m/s/s,ay_m/s/s,az_m/s/s,gx_deg/s,gy_deg/s,gz_deg/s,\
mx_microT,my_microT,mz_microT
1694101400000000,0.000,0.5,0.25,9.75,85.9437,0,-114.5916,20,0,-40
1694101400005000,0.005,0.5,0.25,9.75,85.9437,0,-114.5916,20,0,-40
"""


@pytest.mark.parametrize(
    ("text", "step_s"),
    [
        (ANDROSENSOR, 0.005),
        (PHYSICS_TOOLBOX, 0.005),
        (PHYSICS_TOOLBOX_OTHER_ORDER, 0.005),
        (ARTEMIS, 0.01),
        (BLUE_TRIDENT, 0.005),
    ],
)
def test_names_and_units_of_other_programs(tmp_path: Path, text: str, step_s: float) -> None:
    recording = imported(tmp_path, text)
    assert_allclose(recording.t, [0.0, step_s], atol=1e-6)
    assert_allclose(recording.acc, [[0.5, 0.25, 9.75]] * 2, rtol=1e-4)
    assert_allclose(not_none(recording.gyr), [[1.5, 0.0, -2.0]] * 2, rtol=1e-5)
    assert_allclose(not_none(recording.mag), [[20.0, 0.0, -40.0]] * 2)


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("Date", ("2024-01-01 10:00:00.990", "2024-01-01 10:00:01.000")),
        ("Recorded", ("2024-12-31T23:59:59.990+02:00", "2025-01-01T00:00:00.000+02:00")),
        ("wann", ("10:00:00.990", "10:00:01.000")),
    ],
)
def test_a_column_of_dates_may_have_any_name(tmp_path: Path, name: str, stamps: tuple[str, str]) -> None:
    read = imported(tmp_path, f"day,{name},ax,ay,az\n" + "".join(f"2024-01-01,{at},0,0,9.8\n" for at in stamps))
    assert_allclose(read.t, [0.0, 0.01], atol=1e-6)
    assert read.info.source.of("t")[0].named_by == "its dates"
    with pytest.raises(RecordingError, match=r"no column for t \(time\)"):  # the clock stands still
        imported(tmp_path, f"{name},ax,ay,az\n" + 2 * f"{stamps[0]},0,0,9.8\n")


def test_advice_has_the_files_names(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,acc X [g],acc_y (g),acc_z (g)\n0,0,0,1\n")
    source = import_file(tmp_path / "run.csv", {"ay": "-acc_y (g)"}).recording.info.source
    assert source.column_option("ax", "ay", reverse=False) == "--column 'ax=-acc_y (g)'"  # it was reversed before
    assert source.column_option("ay", "ax", reverse=True) == "--column 'ay=-acc X [g]'"
    assert source.reverse_acc_option() == "--unit acc=-g"


# --- bad input --------------------------------------------------------------------------------------------------------


def test_one_bad_row_of_many_is_named(tmp_path: Path) -> None:
    rows = [f"{k / 400:.4f},0,0,9.8" for k in range(20_000)]
    rows[17_777] = "44.4425,0,zero,9.8"
    with pytest.raises(RecordingError, match=r"run\.csv:17779: 'zero' in column 'ay' is not a number"):
        imported(tmp_path, "\n".join(["t,ax,ay,az", *rows]))
    rows[17_777] = "44.4425,0,9.8"
    with pytest.raises(RecordingError, match=r"run\.csv:17779: 3 cells where the header has 4"):
        imported(tmp_path, "\n".join(["t,ax,ay,az", *rows]))


def test_mixed_line_ends(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes(b"t,ax,ay,az\r\n0,0,0,9.8\r0.01,0,0,9.8\n\n0.02,0,0,9.8,\r\n")
    assert_allclose(import_file(tmp_path / "run.csv").recording.t, [0.0, 0.01, 0.02])


@pytest.mark.parametrize(
    ("row", "advice"),
    [
        ("0 1 2 3", "or give the right names: .* --columns t,ax,ay,az --separator space$"),
        ("0\t1\t2\t3", "--columns t,ax,ay,az --separator tab$"),
        ("0 | 1 | 2 | 3", r"--columns t,ax,ay,az --separator '\|'$"),
        ("1;2;3", "--columns ax,ay,az --separator ';' --rate HZ$"),
        ("1,2,3", "--columns ax,ay,az --rate HZ$"),
        ("110,4.26,-8.48,4.2,0,0,0,26", "--columns t,ax,ay,az,gx,gy,gz,_$"),
        ("10:00:07.120,1,2,3", "add a line with the names above them, as t,ax,ay,az,gx,gy,gz$"),
        ("2024-05-01T10:00:07.120Z,1,2,3", "add a line with the names above them, as t,ax,ay,az,gx,gy,gz$"),
        ("10:00:07,1,2,3;4;5", "add a line with the names above them, as t,ax,ay,az,gx,gy,gz$"),
        ("3.5", "add a line with the names above them, as t,ax,ay,az,gx,gy,gz$"),
    ],
)
def test_what_is_advised_for_rows_without_a_header(tmp_path: Path, row: str, advice: str) -> None:
    with pytest.raises(RecordingError, match=rf"run\.csv:1: numbers where the column names should be; .*{advice}"):
        imported(tmp_path, f"{row}\n9{row}\n")


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (2 * "a/g:\t1\t2\t3\t4\t5\t6\n", "_,ax,ay,az,gx,gy,gz --separator tab --rate HZ"),  # i2cdevlib's example
        ("IMU,5,1,2,3\nIMU,6,1,2,3\n", "_,t,ax,ay,az"),
        ("Raw:-8,5,8154,1,2,2\nRaw:-9,6,8153,1,3,2\n", "ax,ay,az,gx,gy,gz --prefix Raw: --rate HZ"),  # Adafruit's
        ("5,0.001,0,0,0.1,0.2,9.8\n6,0,0.002,0,0.1,0.2,9.8\n", "t,gx,gy,gz,ax,ay,az"),  # a gyro's norm scatters
        ("5,1,2,3\n0,5,0,1,2,1,2\n1,5,0,1,2,1,2\n", "t,ax,ay,az,gx,gy,gz"),  # it begins within a row
    ],
)
def test_labels_and_a_row_that_was_cut_off_are_no_header(tmp_path: Path, text: str, columns: str) -> None:
    with pytest.raises(RecordingError, match=rf"numbers where .* --sensor lines --columns {columns}$"):
        imported(tmp_path, text)


@pytest.mark.parametrize("name", ["run.csv", "run.mcap", "run.npz", "run.zip"])
def test_a_pointer_of_git_lfs_is_no_recording(tmp_path: Path, name: str) -> None:
    text = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n"
    with pytest.raises(RecordingError, match=r"it is Git LFS's pointer .*; fetch that with `git lfs pull`"):
        imported(tmp_path, text, name=name)


def test_a_folder_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"this folder: .* accelerometer.csv is not in it"):
        import_file(tmp_path)


def rows_of(*columns: Iterable[object], delimiter: str = ",") -> str:
    return "".join(delimiter.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


EUROC = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
EUROC += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"


@pytest.mark.parametrize(
    "text",
    [
        EUROC + "1403636579758555392,1,2,3,4,5,6\n1403636579768555392,1,2,3,4,5,6\n",
        "# t,gx,gy,gz,ax,ay,az\n0.0e+00,1,2,3,4,5,6\n1.0e-02,1,2,3,4,5,6\n",
        "# made by numpy, at 100 Hz, with, commas\n# t gx gy gz ax ay az\n0.0 1 2 3 4 5 6\n0.01 1 2 3 4 5 6\n",
        "# EuRoC's format: time[ns], wx(rad/s), wy, wz, ax, ay, az\n7,1,2,3,4,5,6\n10000007,1,2,3,4,5,6\n",
        "# columns: t gx gy gz ax ay az\n0.0 1 2 3 4 5 6\n0.01 1 2 3 4 5 6\n",
        "t,gx,gy,gz,ax,ay,az\n[s],[rad/s],[rad/s],[rad/s],[m/s2],[m/s2],[m/s2]\n0,1,2,3,4,5,6\n0.01,1,2,3,4,5,6\n",
        "t,gx,gy,gz,ax,ay,az\n0,1,2,3,4,5,6\n,,,,,,\n0.01,1,2,3,4,5,6\n,,,,,,\n",
        "header.stamp.sec,header.stamp.nanosec,gx,gy,gz,ax,ay,az\n7,995000000,1,2,3,4,5,6\n8,5000000,1,2,3,4,5,6\n",
    ],
    ids=[
        "EuRoC",
        "numpy.savetxt",
        "spaces",
        "format",
        "columns",
        "units in brackets",
        "rows of empty cells",
        "seconds and nanoseconds",
    ],
)
def test_other_ways_to_write_a_table(tmp_path: Path, text: str) -> None:
    recording = imported(tmp_path, text)
    assert_allclose(recording.t, [0.0, 0.01], atol=1e-6)
    assert_allclose([not_none(recording.gyr)[1], recording.acc[1]], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("Time (hh:mm:ss.ms)", ("12:00:00.000", "12:00:00.010")),
        ("Timestamp (ISO 8601)", ("2024-03-01T12:00:00.000Z", "2024-03-01T12:00:00.010Z")),
        ("timestamp (epoch ms)", ("1700000000000", "1700000000010")),
        ("timestampNanos", ("1700000000000000000", "1700000000010000000")),
        ("time_usec", ("0", "10000")),
        ("GPST", ("390884.27", "390884.28")),
        ("gps_tow", ("390884.27", "390884.28")),
        ("PCTimestamp", ("1700000000.00", "1700000000.01")),
        ("sensor_time_us", ("0", "10000")),
        ("Elapsed Time (ms)", ("0", "10")),
        ("time", ("01/05/2024 23:59:59.995", "01/06/2024 00:00:00.005")),
        ("time", ("12/01/2024 23:59:59.995", "13/01/2024 00:00:00.005")),
        ("time", ("24-01-31 23:59:59.995", "24-02-01 00:00:00.005")),
        ("time", ("2024-03-31T01:59:59.995+01:00", "2024-03-31T03:00:00.005+02:00")),
        ("time", ("2024-10-27T02:59:59.995+0200", "2024-10-27T02:00:00.005+0100")),
        ("time", ("2024-10-27 02:59:59.995+02", "2024-10-27 02:00:00.005+01")),  # as PostgreSQL
        ("time", ("31-Jul-2025 23:59:59.995", "01-Aug-2025 00:00:00.005")),  # as MATLAB
        ("Time", ("0 sec", "0.01 sec")),  # its durations
        ("Time", ("59:59.99", "00:00.00")),  # as spreadsheets show times with fractions
        ("hh:mm:ss.ms", ("10:00:00.000", "10:00:00.010")),  # as ST's Unicleo
        ("# time", ("12:00:00.000", "12:00:00.010")),  # a header of four columns after a #
    ],
)
def test_ways_to_write_the_time(tmp_path: Path, name: str, stamps: tuple[str, str]) -> None:
    text = f"{name},ax,ay,az\n{stamps[0]},1,2,3\n{stamps[1]},1,2,3\n"
    assert_allclose(imported(tmp_path, text).t, [0.0, 0.01], atol=1e-6)


@pytest.mark.parametrize("lost", [0, 1])
def test_counters_that_wrap_are_unwrapped_and_clocks_set_back_refused(tmp_path: Path, lost: int) -> None:
    """micros() of an Arduino wraps after 71 minutes, maybe at a lost sample. Where many are lost it may start anew."""
    k = np.arange(7) + lost * (np.arange(7) > 1)
    ones = [1] * len(k)
    wrapped = rows_of((2**32 - 20000 + 10000 * k) % 2**32, ones, ones, ones)
    assert_allclose(imported(tmp_path, f"micros,ax,ay,az\n{wrapped}").t, 0.01 * k)
    late = rows_of((2**32 - 20000 + 10000 * (k + 4 * (k > 1))) % 2**32, ones, ones, ones)
    for wrong in (wrapped.replace("4294957296", "4294900000"), late):
        with pytest.raises(RecordingError, match="time runs backwards"):
            imported(tmp_path, f"micros,ax,ay,az\n{wrong}")


def test_sensors_with_rows_of_their_own_are_joined(tmp_path: Path) -> None:
    t = 0.01 * np.arange(20)
    gyro = rows_of(t, 10 * t, t, t, *[[""] * 20] * 3)
    force = rows_of(t + 0.004, *[[""] * 20] * 3, t + 0.004, 0 * t, 0 * t)
    rows = sorted((gyro + force).splitlines(), key=lambda row: float(row.split(",")[0]))
    recording = imported(tmp_path, "\n".join(["t,gx,gy,gz,ax,ay,az", *rows]))
    assert_allclose(recording.t, t[:-1], atol=1e-9)  # from the second reading of the gyro
    assert_allclose(not_none(recording.gyr)[:, 0], 10 * t[1:])
    assert_allclose(recording.acc[:, 0], t[1:])
    for first in (1, 4):  # this sensor has every third row: the other's rows all stay
        table = np.tile(t, (7, 1)).T.astype(str)
        table[np.arange(20) % 3 > 0, first : first + 3] = ""
        recording = imported(tmp_path, "\n".join(["t,gx,gy,gz,ax,ay,az", *map(",".join, table)]))
        assert len(recording) == 20


@pytest.mark.parametrize("clock", ["{}_TimeStamp", "time_{}", "{} time (s)"])
def test_sensors_with_times_of_their_own_in_one_row_are_joined(tmp_path: Path, clock: str) -> None:
    """An Android logger's lists side by side: `Acc_TimeStamp,AccX,AccY,AccZ,Gyro_TimeStamp,GyroX,...`."""
    t, faster = 0.01 * np.arange(20), 0.0098 * np.arange(20)
    header = f"{clock.format('Acc')},AccX,AccY,AccZ,{clock.format('Gyro')},GyroX,GyroY,GyroZ"
    recording = imported(tmp_path, f"{header}\n{rows_of(t, t, t, t, faster, *[faster] * 3)}")
    assert_allclose(not_none(recording.gyr)[:, 0], faster, atol=1e-9)
    assert_allclose(recording.acc[:, 0], faster, atol=1e-9)
    # The rows' own clock may be another one, so that a sensor's times say nothing of it.
    header = f"time,ax,ay,az,{clock.format('Gyro')},gx,gy,gz"
    recording = imported(tmp_path, f"{header}\n{rows_of(t, t, t, t, faster + 9, *[faster] * 3)}")
    assert_allclose(recording.acc[:, 0], t, atol=1e-9)


def test_a_sensors_own_counter_wraps_too_and_one_that_restarts_is_refused(tmp_path: Path) -> None:
    """Half of the recording was dropped without a word."""
    header = "acc_timestamp_us,ax,ay,az,gyro_timestamp_us,gx,gy,gz"
    micros, t = 4_294_900_000 + 10_000 * np.arange(20), 0.01 * np.arange(20)
    wrapped = [each.tolist() for each in (micros % 2**32, (micros + 4000) % 2**32)]
    recording = imported(tmp_path, f"{header}\n{rows_of(wrapped[0], t, t, t, wrapped[1], t, t, t)}")
    assert_allclose(recording.t, t[:-1], atol=1e-9)
    assert_allclose(recording.acc[:, 0], t[:-1] + 0.004, atol=1e-9)
    restarted = [*range(0, 100_000, 10_000)] * 2
    with pytest.raises(RecordingError, match=r"csv:12: time runs backwards from .* in column 'gyro_timestamp_us'"):
        imported(tmp_path, f"{header}\n{rows_of(wrapped[0], t, t, t, restarted, t, t, t)}")


@pytest.mark.parametrize(
    "name", ["id", "sensor_id", "MAC", "imu", "node", "mpu_address", "i2c_addr", "frame_id", "DeviceName"]
)
def test_rows_of_two_devices_are_refused(tmp_path: Path, name: str) -> None:
    text = rows_of([0, 0, 1, 1], ["a", "b", "a", "b"], *[[1, 9, 1, 9]] * 3)
    with pytest.raises(RecordingError, match=f"rows of 2 devices .a, b. in the column '{name}'"):
        imported(tmp_path, f"t,{name},ax,ay,az\n{text}")
    counter = rows_of(range(30), range(30), *[[1] * 30] * 3)
    assert len(imported(tmp_path, f"t,{name},ax,ay,az\n{counter}")) == 30


@pytest.mark.parametrize("order", [("Accelerometer", "Gyroscope"), ("Gyroscope", "Accelerometer")])
def test_a_column_may_name_the_sensor_of_each_row(tmp_path: Path, order: tuple[str, str]) -> None:
    values = {"Accelerometer": "0.5,0.25,9.75", "Gyroscope": "1.5,0,-2", "Light": "300,,"}
    lines = [f"{k / 100},{name},{values[name]}\n" for k in range(4) for name in (*order, "Light")]
    recording = imported(tmp_path, "Timestamp,Sensor,X,Y,Z\n" + "".join(lines))
    assert_allclose(recording.t, [0.0, 0.01, 0.02, 0.03])
    assert_allclose(recording.acc, [[0.5, 0.25, 9.75]] * 4)
    assert_allclose(not_none(recording.gyr), [[1.5, 0.0, -2.0]] * 4)


@pytest.mark.parametrize(
    ("row", "rate_hz", "says"),
    [
        (f"0,Light,300{7 * ','}\n", None, ":602: 10 cells where the header has 5"),  # as many as three sensors' columns
        ("", 50.0, "the rows of 3 devices .* in the column 'Sensor'"),  # a rate of which rows?
    ],
)
def test_rows_of_sensors_that_cannot_be_told_are_refused(
    tmp_path: Path, row: str, rate_hz: float | None, says: str
) -> None:
    lines = 200 * "0,Accelerometer,0,0,9.75\n0,Gyroscope,1.5,0,-2\n0,Light,300,,\n"
    with pytest.raises(RecordingError, match=says):
        imported(tmp_path, f"Timestamp,Sensor,X,Y,Z\n{lines}{row}", rate_hz)


def test_the_step_of_time_goes_before_a_rate_in_the_remarks(tmp_path: Path) -> None:
    text = "# sampling rate: 100 Hz\ndt,ax,ay,az\n"
    assert_allclose(imported(tmp_path, text + 3 * "0.02,0,0,9.75\n").t, [0.0, 0.02, 0.04])


@pytest.mark.parametrize(("rate", "says"), [("EMG sampling rate: 2000", "no column for t"), ("Data rate: 0", "is 0;")])
def test_a_rate_that_is_not_the_samples_is_not_used(tmp_path: Path, rate: str, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        imported(tmp_path, f"# {rate} Hz\nax,ay,az,gx,gy,gz\n" + 3 * "0,0,9.75,0,0,0\n")


@pytest.mark.parametrize("remark", ["// Sample rate: 120.0Hz\n", "# Config: data_rate = 120.0 Hz, filter = 42 Hz\n\n"])
def test_the_rate_may_be_in_the_remarks(tmp_path: Path, remark: str) -> None:
    rows = "".join(f"{k},0.5,0.25,9.75,1.5,0,-2\n" for k in range(37328, 37332))
    recording = imported(tmp_path, f"{remark}Counter,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n{rows}")
    assert_allclose(recording.t, np.arange(4) / 120.0)
    dated = "".join(f"10:00:00.{k}5,0.5,0.25,9.75\n" for k in range(3))
    assert_allclose(imported(tmp_path, f"{remark}Recorded,Acc_X,Acc_Y,Acc_Z\n{dated}").t, [0.0, 0.1, 0.2], atol=1e-9)


def test_gyroflow_gives_the_units_above_the_header(tmp_path: Path) -> None:
    text = """GYROFLOW IMU LOG
version,1.3
orientation,YxZ
tscale,0.001
gscale,0.00053263221
ascale,0.00048828125
t,gx,gy,gz,ax,ay,az
39,86,183,-1137,0,0,2048
40,86,183,-1137,0,0,2048
"""
    recording = imported(tmp_path, text, name="run.gcsv")
    assert_allclose(recording.t, [0.0, 0.001])
    assert_allclose(recording.acc[0], [0.0, 0.0, GRAVITY])
    assert_allclose(not_none(recording.gyr)[0], np.array([86, 183, -1137]) * 0.00053263221)
    assert recording.info.source.program == "Gyroflow"


def test_times_in_an_unknown_form_can_be_replaced_by_the_rate(tmp_path: Path) -> None:
    text = f"time,ax,ay,az\n{rows_of(['3 May 2024 10:00:00.000', '3 May 2024 10:00:00.010'], *[[1, 9]] * 3)}"
    with pytest.raises(RecordingError, match=r"in column 'time' is not a number; .*--rate HZ"):
        imported(tmp_path, text)
    with pytest.warns(PbdWarning, match="--rate 100 is used instead"):
        assert imported(tmp_path, text, rate_hz=100.0).t.tolist() == [0.0, 0.01]


def test_a_column_of_times_without_a_number_is_named(tmp_path: Path) -> None:
    """MT Manager writes such for an MTw Awinda without a clock."""
    text = MT_MANAGER.replace("5000100", "NaN").replace("5000200", "NaN")
    with pytest.raises(RecordingError, match=r"the column SampleTimeFine for the time holds no number; .* --rate HZ"):
        imported(tmp_path, text)


def test_a_lone_sign_of_western_windows_is_not_chinese(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("t,ax,ay,az,mx (µT),my (µT),mz (µT)\n0,1,2,3,4,5,6\n".encode("cp1252"))
    assert [column.unit for column in import_file(path).recording.info.source.of("mag")] == ["uT"] * 3


def test_a_lost_line_moves_no_later_sample(tmp_path: Path) -> None:
    """With --rate the time is counted by the samples."""
    lines = [f"ax: {k} g, ay: 0 g, az: 1 g\ngx: 0 dps, gy: 0 dps, gz: 9 dps\ntemp: 20\n" for k in range(9)]
    lines[7] = lines[7].replace("temp: 20\n", "")
    read = imported(tmp_path, "".join(lines), rate_hz=100.0, name="run.log")
    assert_allclose(read.acc[:, 0], GRAVITY * np.arange(9))
    assert_allclose(not_none(read.gyr)[:, 2], 9 * DEG)


@pytest.mark.parametrize("counter", ["PacketCounter", "Counter", "field.header.seq", "sample_number", "sample"])
def test_lost_samples_show_in_a_counter_though_a_rate_is_given(tmp_path: Path, counter: str) -> None:
    """MT Manager writes a PacketCounter, and times only if they are chosen. The counter wraps at 2^16."""
    numbers = np.delete(np.arange(100), [40, 41, 42, 43, 44, 45, 46])
    text = f"{counter},ax,ay,az\n"
    read = imported(tmp_path, text + "".join(f"{(65510 + k) % 2**16},0,{k},9.8\n" for k in numbers), rate_hz=100.0)
    assert_allclose(read.t, numbers / 100.0)
    assert_allclose(read.acc[:, 1], numbers)
    assert counter in read.info.source.unread
    twos = imported(tmp_path, text + "".join(f"{2 * k},0,{k},9.8\n" for k in numbers), rate_hz=50.0)
    assert_allclose(twos.t, numbers / 50.0)


@pytest.mark.parametrize("count", [lambda k: k // 10, lambda k: 0, lambda k: "", lambda k: k**2])
def test_a_column_that_counts_something_else_tells_no_times(tmp_path: Path, count: Callable[[int], object]) -> None:
    rows = "".join(f"{count(k)},0,{k},9.8\n" for k in range(100))
    assert_allclose(imported(tmp_path, f"count,ax,ay,az\n{rows}", rate_hz=100.0).t, np.arange(100) / 100.0)


def test_a_counter_that_starts_anew_is_warned_of(tmp_path: Path) -> None:
    rows = "".join(f"{k if k < 60 else k - 60},0,{k},9.8\n" for k in range(100))
    with pytest.warns(
        PbdWarning, match="'seq', which counts samples, leaps from 59 to 0 after row 59: how many are missing"
    ):
        assert len(imported(tmp_path, f"seq,ax,ay,az\n{rows}", rate_hz=100.0)) == 100


ROS1_HEADER = 'header: \n  seq: {k}\n  stamp: \n    secs: 222\n    nsecs: {ns:>9}\n  frame_id: "imu_link"\n'
ROS2_HEADER = "header:\n  stamp:\n    sec: 222\n    nanosec: {ns}\n  frame_id: imu_link\n"
ROS1_COVARIANCE = "{name}_covariance: [0.0, 0.0, 0.0]\n"
ROS2_COVARIANCE = "{name}_covariance:\n- 0.0\n- 0.0\n"


def echoed(k: int, header: str, covariance: str) -> str:
    """A message as ROS's `topic echo` prints it."""
    vectors = (
        ("orientation", "  x: 0.0\n  y: 0.0\n  z: 0.0\n  w: 1.0\n"),
        ("angular_velocity", f"  x: {k}.5\n  y: 2e-07\n  z: -3.0\n"),
        ("linear_acceleration", f"  x: 0.{k}\n  y: 0.0\n  z: 9.8\n"),
    )
    text = "".join(f"{name}:\n{axes}{covariance.format(name=name)}" for name, axes in vectors)
    return f"{header.format(k=k, ns=k * 50_000_000)}{text}---\n"


def test_lines_with_names_but_fewer_than_three_numbers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match="no line has three numbers with names; import it with --sensor lines --columns"
    ):
        imported(tmp_path, "ax: 0.1 ay: 9.8\n" * 30, name="log.txt")


@pytest.mark.parametrize(
    ("header", "covariance"), [(ROS1_HEADER, ROS1_COVARIANCE), (ROS2_HEADER, ROS2_COVARIANCE), ("", ROS2_COVARIANCE)]
)
def test_messages_that_ros_printed(tmp_path: Path, header: str, covariance: str) -> None:
    text = "".join(echoed(k, header, covariance) for k in range(5))
    text += text[: len(text) // 5 - 30]  # the last message is cut off
    recording = imported(tmp_path, text, None if header else 20.0, "imu.txt")
    assert_allclose(recording.t, 0.05 * np.arange(5), atol=1e-9)
    assert_allclose(recording.acc, [(0.1 * k, 0.0, 9.8) for k in range(5)])
    assert_allclose(not_none(recording.gyr), [(k + 0.5, 2e-7, -3.0) for k in range(5)])
    assert recording.info.source.unread["orientation_x"]


def test_a_cut_message_of_ros_moves_no_other(tmp_path: Path) -> None:
    messages = [echoed(k, "", ROS1_COVARIANCE) for k in range(5)]
    messages[2] = messages[2].replace("  x: 0.2\n", "")
    read = imported(tmp_path, "".join(messages), 20.0, "imu.log")
    assert_allclose(read.acc[:, 0], [0.0, 0.1, np.nan, 0.3, 0.4])


def test_keys_above_a_table_are_no_messages_of_ros(tmp_path: Path) -> None:
    above = "device: x\nrate: 100\nmode: 1\n---\n"
    assert len(imported(tmp_path, f"{above}t,ax,ay,az\n0,1,2,3\n1,2,3,4\n")) == 2


SENSORLOG = """loggingTime(txt),loggingSample(N),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),\
accelerometerAccelerationY(G),accelerometerAccelerationZ(G),motionRotationRateX(rad/s),motionRotationRateY(rad/s),\
motionRotationRateZ(rad/s),motionGravityX(G)
2024-05-01 10:00:00.000 +0200,1,5000.00,-0.05,-0.03,-1.00,1.5,0,-2,-0.05
2024-05-01 10:00:00.010 +0200,2,5000.01,-0.05,-0.03,-1.00,1.5,0,-2,-0.05
"""


def test_the_force_of_an_iphones_sensorlog_points_up(tmp_path: Path) -> None:
    """CoreMotion gives gravity and what the hand adds, both reversed: -1 g on z if the phone lies face up."""
    read = imported(tmp_path, SENSORLOG)
    assert_allclose(read.acc[0], GRAVITY * np.array((0.05, 0.03, 1.0)))
    assert_allclose(not_none(read.gyr)[0], (1.5, 0.0, -2.0))
    assert_allclose(imported(tmp_path, SENSORLOG, acc="-g").acc, read.acc)
    assert read.info.source.reverse_acc_option() == "--unit acc=g"  # it had no effect
    assert_allclose(imported(tmp_path, SENSORLOG, acc="g").acc, -read.acc)


def test_raw_counts_give_way_to_readings_with_a_unit(tmp_path: Path) -> None:
    """Garmin's FIT files as CSV: the counts come first."""
    names = [
        f"{kind}{sensor}_{axis} ({unit})"
        for sensor, its in (("accel", "g"), ("gyro", "deg/s"))
        for kind, unit in (("", "counts"), ("calibrated_", its))
        for axis in "xyz"
    ]
    row = "7,8,9,0,0,1,7,8,9,90,0,-180"
    read = imported(tmp_path, f"t,{','.join(names)}\n0,{row}\n0.01,{row}\n")
    assert_allclose(read.acc[0], (0.0, 0.0, GRAVITY))
    assert_allclose(not_none(read.gyr)[0], (np.pi / 2, 0.0, -np.pi))


def test_of_two_accelerations_the_total_one_has_gravity(tmp_path: Path) -> None:
    """As in UCI HAR: body_acc has none, and comes first, beside body_gyro."""
    names = ",".join(f"{name}_{axis}" for name in ("body_acc", "body_gyro", "total_acc") for axis in "xyz")
    read = imported(tmp_path, f"t,{names}\n0,0,0,0,1,2,3,0.5,0.25,9.75\n0.01,0,0,0,1,2,3,0.5,0.25,9.75\n")
    assert_allclose(read.acc[0], (0.5, 0.25, 9.75))


def test_a_file_of_labview(tmp_path: Path) -> None:
    """The remarks of each channel are numbers too, and a row without a comment has no cell for it."""
    end = "***End_of_Header***"
    remarks = f"LabVIEW Measurement\t\nDecimal_Separator\t,\n{end}\t\n\nChannels\t3\nX0\t0,0\t0,0\t0,0\t\n{end}\n"
    rows = "X_Value\tax\tay\taz\tComment\n0,00\t0,5\t0,25\t9,75\n0,01\t0,5\t0,25\t9,75\n"
    read = imported(tmp_path, remarks + rows, name="run.lvm")
    assert_allclose(read.t, (0.0, 0.01))
    assert_allclose(read.acc[0], (0.5, 0.25, 9.75))


@pytest.mark.parametrize("delimiter", [",", "\t"])
@pytest.mark.parametrize("header", ["t,ax,ay,az,gx,gy,gz", "{}ax,ay,az,gx,gy,gz"])
@pytest.mark.parametrize("stamp", ["[2024-05-01 10:00:00.{}] ", "10:00:00.{} -> "])
def test_a_serial_monitors_times_before_bare_numbers(tmp_path: Path, stamp: str, header: str, delimiter: str) -> None:
    rows = "".join(f"{stamp.format(ms)}0.5,0.25,9.75,1,2,3\n" for ms in ("010", "020"))
    text = f"{header}\n{rows}".replace(",", delimiter)
    read = imported(tmp_path, text.format(stamp.format("000")))
    assert_allclose(read.t, (0.0, 0.01), atol=1e-6)
    assert_allclose(read.acc[0], (0.5, 0.25, 9.75))


def test_the_name_of_the_next_numbers_is_no_unit(tmp_path: Path) -> None:
    read = imported(tmp_path, "A: 0.5 0.25 9.75  G: 1 2 3\n" * 3, rate_hz=100.0, name="run.log")
    assert_allclose(read.acc[0], (0.5, 0.25, 9.75))
    assert_allclose(not_none(read.gyr)[0], (1.0, 2.0, 3.0))


def test_parts_of_a_second_without_leading_zeros_are_not_to_be_sorted(tmp_path: Path) -> None:
    """As `f"{second}.{millisecond}"` writes them."""
    rows = "".join(f"12:00:07.{ms},0,0,9.8\n" for ms in (80, 90, 100, 110))
    with pytest.raises(
        RecordingError, match=r"from 12:00:07.90 to 12:00:07.100 in .*lack their leading zeros.* --rate"
    ):
        imported(tmp_path, f"time,ax,ay,az\n{rows}")
    with pytest.raises(RecordingError, match=r"from 0.120 to 0.110 in column 'time'; sort the file"):
        imported(tmp_path, "time,ax,ay,az\n0.110,0,0,9.8\n0.120,0,0,9.8\n0.110,0,0,9.8\n0.120,0,0,9.8\n")


def test_a_second_header_ends_the_recording(tmp_path: Path) -> None:
    half = "t,ax,ay,az\n0,0,0,9.8\n0.01,0,0,9.8\n"
    with pytest.raises(RecordingError, match=r"run.csv:4: .*; the header is there again: cut the file there"):
        imported(tmp_path, half + half)


def test_an_mti_clock_read_as_a_dots_is_named_by_its_steps(tmp_path: Path) -> None:
    """Xsens' SDK writes no remarks by which an MTi, which counts 0.1 ms, could be told from a DOT, which counts us."""
    rows = "".join(f"{k},{100 * k},0,0,9.8,0,0,0\n" for k in range(200))
    text = f"PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n{rows}"
    with pytest.raises(
        RecordingError, match=r"likely in 0.1ms or ms: import the file with --unit t=0.1ms or --unit t=ms$"
    ):
        with_checked_times(imported(tmp_path, text))
    assert_allclose(imported(tmp_path, text, t="0.1ms").t[1], 0.01)
