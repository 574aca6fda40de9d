"""The same table as programs and spreadsheets spell it: units, names of axes, headers, missing cells, times."""

import re
import warnings
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data import Recording
from pbd.data.units import unit_factor
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.files.importers.header_names import is_time, our_name, split_unit, why_never_read
from pbd.tracking.repair.clock import with_checked_times
from tests.not_none import not_none

DEG = np.pi / 180.0
ACC, GYR = (0.5, 0.25, 9.75), (1.5, 0.0, -2.0)
AXES = ("ax", "ay", "az", "gx", "gy", "gz")


def table(header: str, times: Sequence[object] = (0.0, 0.01), delimiter: str = ",") -> str:
    return "\n".join([header, *(delimiter.join(map(str, (t, *ACC, *GYR))) for t in times)]) + "\n"


def read(folder: Path, text: str, rate_hz: float | None = None, **units: str) -> Recording:
    (folder / "run.csv").write_text(text, encoding="utf-8")
    return import_file(folder / "run.csv", {}, units, rate_hz).recording


def assert_read(recording: Recording, end: float = 0.01) -> None:
    assert_allclose(recording.t[-1], end, atol=2e-6)
    assert_allclose(recording.acc[0], ACC)
    assert_allclose(not_none(recording.gyr)[0], GYR)


@pytest.mark.parametrize(
    ("quantity", "unit", "factor"),
    [
        *(
            ("gyr", unit, DEG)
            for unit in ("deg/sec", "°/sec", "º/s", "degrees/second", "deg.s-1", "°·s⁻¹", "Grad/s", "d/s")
        ),
        *(("gyr", unit, 1.0) for unit in ("rad/sec", "radians/s", "rad s^-1", "rad_per_s")),
        ("gyr", "rpm", 2.0 * np.pi / 60.0),
        ("gyr", "mrad/s", 1e-3),
        *(
            ("acc", unit, 1.0)
            for unit in ("m/sec^2", "m/s**2", "m·s⁻²", "m.s-2", "meters/s^2", "metres/s^2", "m/(sec^2)", "mss")
        ),
        *(("acc", unit, 9.80665) for unit in ("g's", "Gs", "g-force", "1000 milli-g")),
        *(
            ("mag", unit, 1.0)
            for unit in ("microTesla", "microteslas", "micro T", "uTesla", "10 milligauss", "1000 nanotesla")
        ),
        *(
            ("t", unit, factor)
            for unit, factor in (("msec", 1e-3), ("microseconds", 1e-6), ("mins", 60.0), ("Hours", 3600.0))
        ),
    ],
)
def test_a_unit_may_be_spelled_in_many_ways(quantity: str, unit: str, factor: float) -> None:
    assert unit_factor(quantity, unit) == pytest.approx(factor, rel=1e-12)


def test_a_multiple_of_a_unit_is_a_number() -> None:
    assert unit_factor("t", "1e300 s") == pytest.approx(1e300)
    assert unit_factor("t", "1e400 s") is None


@pytest.mark.parametrize("today", [45000.123456, 738000.5])
def test_spreadsheets_and_matlabs_day_numbers_are_recognised_by_their_steps(tmp_path: Path, today: float) -> None:
    text = table("Time,ax,ay,az,gx,gy,gz", [f"{today + k * 0.01 / 86400.0:.10f}" for k in range(200)])
    with pytest.raises(RecordingError, match=r"likely in days: import the file with --unit t=day$"):
        with_checked_times(read(tmp_path, text))
    assert_allclose(with_checked_times(read(tmp_path, text, t="day")).t, np.arange(200) * 0.01, atol=3e-5)


@pytest.mark.parametrize("cell", ["", "N/A", "n/a", "NULL", "None", "-", "#N/A", "#NV", "NaN", "-nan(ind)"])
def test_a_cell_may_say_that_it_has_no_number(tmp_path: Path, cell: str) -> None:
    recording = read(tmp_path, f"t,ax,ay,az,gx,gy,gz\n0,{cell},1,9,1,{cell},{cell}\n0.01,0,1,9,1,2,3\n")
    assert_allclose(not_none(recording.gyr), [[1.0, np.nan, np.nan], [1.0, 2.0, 3.0]])


def test_rows_whose_cells_mostly_have_no_number_are_not_the_header(tmp_path: Path) -> None:
    text = "t,ax,ay,az,mx,my,mz,temp,hum\n0,0.5,0.25,9.75,N/A,N/A,N/A,N/A,N/A\n0.01,0.5,0.25,9.75,1,2,3,20,50\n"
    assert len(read(tmp_path, text).t) == 2


@pytest.mark.parametrize(
    "header",
    [
        "Time_A,Acc_x_A,Acc_y_A,Acc_z_A,Gyro_x_A,Gyro_y_A,Gyro_z_A",
        "time,acc_x_1,acc_y_1,acc_z_1,gyro_x_1,gyro_y_1,gyro_z_1",
        "t,ax,ay,az,rotationRateX,rotationRateY,rotationRateZ",
        "t,ax,ay,az,motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s)",  # SensorLog
        "t,ax,ay,az,imu/angular_velocity/x,imu/angular_velocity/y,imu/angular_velocity/z",
        "Time,AccelCorrectedX,AccelCorrectedY,AccelCorrectedZ,GyroCorrectedX,GyroCorrectedY,GyroCorrectedZ",  # Yost
        "time,acc1_x,acc1_y,acc1_z,gyro1_x,gyro1_y,gyro1_z",
        "t,S1_ax,S1_ay,S1_az,S1_gx,S1_gy,S1_gz",
        "time_x,acc_x_x,acc_y_x,acc_z_x,angular_velocity_x_x,angular_velocity_y_x,angular_velocity_z_x",  # pandas.merge
        "Time,X_Acceleration,Y_Acceleration,Z_Acceleration,X_AngularVelocity,Y_AngularVelocity,Z_AngularVelocity",
        "Time,M.xacc,M.yacc,M.zacc,M.xgyro,M.ygyro,M.zgyro",  # QGroundControl
        "Time,accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],gyro_rad[0],gyro_rad[1],gyro_rad[2]",
        "Time / s,AccX / m/s²,AccY / m/s²,AccZ / m/s²,GyrX / rad/s,GyrY / rad/s,GyrZ / rad/s",
        "t/s,a_x/m/s²,a_y/m/s²,a_z/m/s²,w_x/rad/s,w_y/rad/s,w_z/rad/s",  # DIN 1313
        "Zeit/s,Acc X/m·s⁻²,Acc Y/m·s⁻²,Acc Z/m·s⁻²,ω_x/rad·s⁻¹,ω_y/rad·s⁻¹,ω_z/rad·s⁻¹",
        "Time in s,Acc X in m/s²,Acc Y in m/s²,Acc Z in m/s²,Gyro X in rad/s,Gyro Y in rad/s,Gyro Z in rad/s",
        "Timestamp,Accel_X_m_s2,Accel_Y_m_s2,Accel_Z_m_s2,Gyro_X_rad_per_s,Gyro_Y_rad_per_s,Gyro_Z_rad_per_s",  # eSense
        "unit__timestamp[s],bmi160_a_x[m/s2],bmi160_a_y[m/s2],bmi160_a_z[m/s2],bmi160_g_x,bmi160_g_y,bmi160_g_z",
        "t,Accel Sensor X,Accel Sensor Y,Accel Sensor Z,Gyro Sensor X,Gyro Sensor Y,Gyro Sensor Z",  # Noraxon
        "t,acc[0],acc[1],acc[2],pqr[0],pqr[1],pqr[2]",  # Inertial Sense
        "time_s,X_accel_ms2,Y_accel_ms2,Z_accel_ms2,X_gyro_rads,Y_gyro_rads,Z_gyro_rads",
        "t,AccelX_mss,AccelY_mss,AccelZ_mss,GyroX_rads,GyroY_rads,GyroZ_rads",  # Bolder Flight
        "time (s), accSmooth[0], accSmooth[1], accSmooth[2], gyroADC[0], gyroADC[1], gyroADC[2]",  # Betaflight
        "t,Accelerometer (x) [m/s²],Accelerometer (y) [m/s²],Accelerometer (z) [m/s²],Gyroscope (x) [rad/s],"
        "Gyroscope (y) [rad/s],Gyroscope (z) [rad/s]",  # gopro-telemetry
        "t,Acc X-axis,Acc Y-Axis,Acc Z axis,Gyro X-axis,Gyro Y-Axis,Gyro Z axis",
        # axes after the first without their quantity
        "time,Accel: x,y,z,AngVel: x,y,z",
        "t,acc_x,y,z,gyro_x,y,z",
        "t,accX,Y,Z,gyrX,Y,Z",
        # merged cells above the axes
        "Time,Accelerometer,,,Gyroscope,,\n,x,y,z,x,y,z",
        ",Accelerometer,,,Gyroscope,,,\nTime,x,y,z,x,y,z,",
        "Time (s),Acceleration (m/s²),,,Angular rate (rad/s),,\n,X,Y,Z,X,Y,Z",
        "Time,Accelerometer,,,Gyroscope,,\n(s),X (m/s²),Y (m/s²),Z (m/s²),X (rad/s),Y (rad/s),Z (rad/s)",
        "Time,Accelerometer,,,Gyroscope,,\n,X,Y,Z,X,Y,Z\ns,m/s²,m/s²,m/s²,rad/s,rad/s,rad/s",
        "Time,Acc,Acc,Acc,Gyr,Gyr,Gyr\n,x,y,z,x,y,z",  # pandas' columns of two levels
    ],
)
def test_names_of_axes(tmp_path: Path, header: str) -> None:
    assert_read(read(tmp_path, table(header)))


def test_the_rate_below_a_unit_is_no_unit(tmp_path: Path) -> None:
    """Delsys' Trigno Discover 1.5."""
    header = "EMG 1 (mV), ACC X (G), ACC Y (G), ACC Z (G), GYRO X (deg/s), GYRO Y (deg/s), GYRO Z (deg/s)"
    rates = "1259.2593 Hz" + 6 * ", 148.1481 Hz"
    got = read(tmp_path, table(f"{header}\n{rates}"), rate_hz=148.1481)
    assert_allclose(got.acc[0], np.multiply(ACC, 9.80665))
    assert_allclose(not_none(got.gyr)[0], np.multiply(GYR, DEG))


@pytest.mark.parametrize("axes", ["[0] [1] [2]", "(x) (y) (z)"])
def test_the_unit_below_an_axis_in_brackets_is_read(tmp_path: Path, axes: str) -> None:
    names = ",".join(f"{quantity} {axis}" for quantity in ("Acc", "Gyro") for axis in axes.split())
    got = read(tmp_path, table(f"t,{names}\ns{3 * ',g'}{3 * ',deg/s'}"))
    assert_allclose(got.acc[0], np.multiply(ACC, 9.80665))
    assert_allclose(not_none(got.gyr)[0], np.multiply(GYR, DEG))


def test_devices_may_be_above_the_quantities_and_a_first_column_without_a_name_can_be_named(tmp_path: Path) -> None:
    """pandas writes an index and columns of two levels so; gaitmap's example data."""
    axes = ",".join(2 * ["acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"])
    row = ",".join(map(str, 2 * (*ACC, *GYR)))
    text = f"{6 * ',left_sensor'}{6 * ',right_sensor'}\n,{axes}\n0,{row}\n0.01,{row}\n"
    with pytest.raises(RecordingError, match=r"the columns are column 1, left_sensor acc_x, .* --column t=NAME"):
        read(tmp_path, text)
    assert_read(import_file(tmp_path / "run.csv", {"t": "column 1"}).recording)


def test_a_unit_after_a_slash_is_known(tmp_path: Path) -> None:
    got = read(tmp_path, table("t/µs,a_x/g,a_y/g,a_z/g,w_x/dps,w_y/°/s,w_z/deg/s", (0, 10000)))
    assert_allclose((got.t[-1], *got.acc[0]), (0.01, *(9.80665 * np.array(ACC))))
    assert_allclose(not_none(got.gyr)[0], DEG * np.array(GYR))
    for name in ("imu/acc_x", "imu/ms", "sensor/x", "a/b", "T/°C", "km/h"):
        assert split_unit(name) == (name, "")
    assert split_unit("gx_deg/s") == ("gx", "deg/s")


def test_of_several_devices_the_first_with_both_sensors_is_read(tmp_path: Path) -> None:
    header, *rows = table("t,acc_x_2,acc_y_2,acc_z_2,gyr_x_2,gyr_y_2,gyr_z_2").strip().split("\n")
    others = ",".join(f"acc_{axis}_{k}" for k in range(10, 29) for axis in "xyz")
    assert_read(read(tmp_path, "\n".join([f"{others},{header}", *(f"{19 * '7,8,9,'}{row}" for row in rows)])))


def test_a_range_in_a_name_is_no_unit(tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match="acc_x_2g, acc_y_2g, acc_z_2g look like inertial data, but are not understood"
    ):
        read(tmp_path, table("t,acc_x_2g,acc_y_2g,acc_z_2g,gx,gy,gz"))


def test_angles_of_a_marker_are_not_turn_rates(tmp_path: Path) -> None:
    header, *rows = table("t,ax,ay,az,gx,gy,gz").strip().split("\n")
    assert_read(read(tmp_path, "\n".join([f"x_rot,y_rot,z_rot,{header}", *(f"7,8,9,{row}" for row in rows)])))


def test_two_imus_below_merged_cells_are_told(tmp_path: Path) -> None:
    """APDM's Mobility Lab writes a line with the sensors above those of the quantities and axes."""
    header = "Format=7,1,,Waist,,,2,,Hand,,,\nTime,Accelerometer,,,Gyroscope,,,Accelerometer,,,Gyroscope,,\n"
    rows = "".join(f"{t},{','.join(map(str, (*ACC, *GYR, *ACC, *GYR)))}\n" for t in (0.0, 0.01))
    with pytest.raises(RecordingError, match=r"the column 'Accelerometer X' is there twice; rename one"):
        read(tmp_path, f"{header},X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z\n{rows}")


def test_ardupilots_imus_are_told_apart(tmp_path: Path) -> None:
    """One file has the rows of all IMUs, numbered in `I` (ArduPilot, libraries/AP_InertialSensor/LogStructure.h)."""
    rows = [f"{1000 * k + i},{i},0,0,0,0,0,-9.8" for k in range(5) for i in range(2)]
    text = "\n".join(["TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", *rows])
    with pytest.raises(RecordingError, match=r"rows of 2 devices \(0, 1\) in the column 'I'; keep one device's"):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("name", "unit_s"), [("dt", 1.0), ("Delta T (ms)", 1e-3), ("dt_us", 1e-6), ("sample_interval_ms", 1e-3)]
)
def test_times_since_the_row_before_are_added_up(tmp_path: Path, name: str, unit_s: float) -> None:
    steps = np.array([0.5, 0.01, 0.012, 0.008, 0.02])
    recording = read(tmp_path, table(",".join((name, *AXES)), (steps / unit_s).tolist()))
    assert_allclose(recording.t, np.cumsum(steps) - 0.5, atol=1e-9)


def test_times_since_the_row_before_may_be_called_times(tmp_path: Path) -> None:
    text = table(",".join(("t", *AXES)), (10, 9, 11, 10))
    with pytest.raises(RecordingError, match=r"time runs backwards from 10 to 9 .* import it with --column dt=t$"):
        read(tmp_path, text)
    recording = import_file(tmp_path / "run.csv", {"dt": "t"}, {"t": "ms"}, None).recording
    assert_allclose(recording.t, [0.0, 0.009, 0.02, 0.03], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "unit"), [("timestamp_ms", {}), ("Time (ms)", {}), ("timestamp", {}), ("when", {}), ("server_time", {})]
)
def test_dates_are_in_seconds_whatever_their_name_says(tmp_path: Path, name: str, unit: dict[str, str]) -> None:
    times = ["2026-04-03T14:57:09.405", "2026-04-03T14:57:09.415"]
    assert_read(read(tmp_path, table(",".join((name, *AXES)), times)))
    with pytest.raises(RecordingError, match=rf"'{re.escape(name)}' has dates or times of day, .* leave --unit t out$"):
        read(tmp_path, table(",".join((name, *AXES)), times), t="ms")


@pytest.mark.parametrize(("name", "step_s"), [("time", 0.5), ("time_ms", 0.5), ("time", 10.0)])
@pytest.mark.parametrize("dates", [False, True])
def test_a_slow_recording_is_not_told_to_take_its_times_for_others(
    tmp_path: Path, name: str, step_s: float, dates: bool
) -> None:
    seconds = [step_s * k for k in range(40)]
    numbers = [round(1e3 * s) for s in seconds] if name == "time_ms" else seconds
    stamps = [f"{datetime(2025, 8, 1) + timedelta(seconds=s):%Y-%m-%d %H:%M:%S.%f}" for s in seconds]
    (tmp_path / "run.csv").write_text(table(",".join((name, *AXES)), stamps if dates else numbers))
    found = import_file(tmp_path / "run.csv")
    with pytest.raises(RecordingError) as refused:
        with_checked_times(found.recording)
    said, faster = refused.value.message, "; record faster, 4 a second at least"
    if dates or name == "time_ms":
        assert said.endswith(f" s apart{faster}")
    elif step_s < 1.0:
        assert said.endswith(f" s apart{faster}; if the time is in ms, import the file with --unit t=ms")
    else:
        assert said.endswith(" s apart; the time is likely in ms: import the file with --unit t=ms")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("server_time", "device_timestamp_ms"),
        ("mac_timestamp", "esp32_ms"),
        ("host_time", "imu_time_ms"),
        ("timestamp", "sensor_us"),
    ],
)
def test_of_two_clocks_the_devices_is_read(tmp_path: Path, first: str, second: str) -> None:
    ticks = (18452000, 18462000) if second.endswith("us") else (18452, 18462)
    rows = [f"{1777658988.4 + 0.2 * k},{tick}" for k, tick in enumerate(ticks)]
    assert_read(read(tmp_path, table(f"{first},{second},{','.join(AXES)}", rows)))
    assert_read(read(tmp_path, table(",".join((first, *AXES)))))
    assert_read(read(tmp_path, table(",".join((second, *AXES)), ticks)))


def test_dates_as_c_and_python_write_them(tmp_path: Path) -> None:
    times = ["Wed Dec 22 23:59:59 2021", "Thu Dec 23 00:00:00 2021"]
    assert_read(read(tmp_path, table(",".join(("Time", *AXES)), times)), end=1.0)


def test_cells_in_quotes_may_contain_other_delimiters(tmp_path: Path) -> None:
    names = ("Time,s", "Accel X,m/s2", "Accel Y,m/s2", "Accel Z,m/s2", "Gyro X,rad/s", "Gyro Y,rad/s", "Gyro Z,rad/s")
    for delimiter in ("\t", ";", ","):
        header = delimiter.join(f'"{name}"' for name in names)
        assert_read(read(tmp_path, table(f"{header}", delimiter=delimiter)))


def test_angular_accelerations_quaternions_and_statistics_are_no_readings(tmp_path: Path) -> None:
    for name in ("AngAccel: x", "angular_acceleration_x", "bias_gyro_x", "mean_acc_x", "ref_gyro_x", "gps_acc_x"):
        assert our_name(name) is None
        assert why_never_read(name)
    assert our_name("gnss_imu_acc_x") is not None
    header = "t,rot_x,rot_y,rot_z,rot_w,acc_x,acc_y,acc_z"
    (tmp_path / "run.csv").write_text(f"{header}\n0,0,0,0,1,0,0,9.8\n1,0,0,0,1,0,0,9.8\n")
    understood = import_file(tmp_path / "run.csv").recording.info.source
    assert not understood.of("gyr")
    assert understood.unread["rot_x"] == "a quaternion"


@pytest.mark.parametrize("name", ["T(°)", "T (°C)", "t [K]", "T (degC)", "T(celsius)"])
def test_a_temperature_is_no_time(name: str) -> None:
    assert not is_time(name)
    assert is_time("T (s)")


def test_rows_of_many_samples_are_refused(tmp_path: Path) -> None:
    names = [f"{axis}{k}" for k in range(21) for axis in AXES]
    for header, say in (
        (f"{','.join(names)},label\n", r"has 21 accelerometers or samples \(ax0, ax1, ax2, ...\); write one sample"),
        ("", "if its 127 columns are several samples, write each in its own row"),
    ):
        (tmp_path / "run.csv").write_text(header + 2 * f"{','.join('1' for _ in names)},0\n")
        with pytest.raises(RecordingError, match=say):
            import_file(tmp_path / "run.csv", rate_hz=100.0)


def test_a_header_with_too_few_names_is_told_before_names_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("Gyro: x, y, z Accel: x, y, z, time\n" + 3 * "1, 2, 3, 4, 5, 6, 7, 8, 9\n")
    with pytest.raises(RecordingError, match="9 cells where the header has 6, as in the lines below; name each column"):
        import_file(tmp_path / "run.csv")


def test_acceleration_that_includes_gravity_is_read_rather_than_that_without(tmp_path: Path) -> None:
    names = [f"{name}.{axis}" for name in ("acceleration", "accelerationIncludingGravity") for axis in "xyz"]
    (tmp_path / "run.csv").write_text(f"t,{','.join(names)}\n0,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n")
    assert_allclose(import_file(tmp_path / "run.csv").recording.acc[0], (0.0, 0.0, 9.8))


@pytest.mark.parametrize("start", [0, 100010, 999000])
def test_points_between_thousands_are_no_decimal_marks(tmp_path: Path, start: int) -> None:
    """German spreadsheets write 1.000 ms."""
    times = [start + 10 * k for k in range(200)]
    rows = table("Datum;time_ms;ax;ay;az;gx;gy;gz", [f"29.11.2026;{t:,}".replace(",", ".") for t in times], ";")
    text = rows.replace("0.5;0.25;9.75;1.5;0.0;-2.0", "0,5;0,25;9,75;1,5;0,0;-2,0")
    assert "0,25" in text
    assert_read(read(tmp_path, text), end=1.99)


@pytest.mark.parametrize("name", ["time_s", "Time", "time_ms"])
def test_points_beside_decimal_commas_may_be_decimal_marks(tmp_path: Path, name: str) -> None:
    start = 0.0 if name == "time_ms" else 100.0  # 0.000 has no thousands
    times = [f"{start + 10.0 ** (3 * (name == 'time_ms')) * 0.01 * k:.3f}" for k in range(2)]
    text = table(";".join((name, *AXES)), times, ";").replace("9.75", "9,75")
    assert_read(read(tmp_path, text))


def test_times_that_are_too_close_are_named_in_their_own_unit(tmp_path: Path) -> None:
    text = table(";".join(("time_ms", *AXES)), [f"{100 + 0.01 * k:.3f}" for k in range(200)], ";")
    with pytest.raises(
        RecordingError, match=r"closer than any sensor's; the time is likely in s: import the file with --unit t=s$"
    ):
        with_checked_times(read(tmp_path, text))


def test_a_row_that_begins_with_no_number_is_no_comment(tmp_path: Path) -> None:
    for cell in ("#N/A", "#NV"):
        rows = [f"{first},{','.join(map(str, (*ACC[1:], *GYR)))}" for first in (ACC[0], cell, ACC[0])]
        assert_read(read(tmp_path, "\n".join((",".join(AXES), *rows)) + "\n", rate_hz=100.0), end=0.02)


def test_a_clock_without_times_is_not_preferred_to_one_that_runs_backwards(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"run.csv:4: time runs backwards from 0\.02 to 0\.01 in column 'time'"):
        read(tmp_path, table(",".join(("time", "chip_time", *AXES)), ("0.00,", "0.02,", "0.01,", "0.03,")))


def test_infinite_times_are_no_warning(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read(tmp_path, table(",".join(("t", *AXES)), (0.0, 0.01, 0.02, "inf", "inf"))).t) == 5


def test_huge_numbers_without_a_header_are_advised_on(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k},0,0,{'9' * 400},0,0,0\n" for k in range(3))
    with pytest.raises(RecordingError, match="numbers where the column names should be"):
        read(tmp_path, rows)
