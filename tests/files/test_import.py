"""Imported tables with the headers of other programs, and the real files of the data folder."""

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pbd.data import GRAVITY, Recording
from pbd.data.source_columns import Column
from pbd.errors import PbdWarning, RecordingError, UsageError
from pbd.files.importers import import_file
from pbd.pose import Array

DEG = math.pi / 180.0

NGIMU = "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s)," + (
    "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"
)
XIMU3 = NGIMU.replace("Time (s)", "Timestamp (us)")
XIMU3_MAGNETOMETER = "Timestamp (us),Magnetometer X (a.u.),Magnetometer Y (a.u.),Magnetometer Z (a.u.)"


def import_text(
    folder: Path,
    text: str,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    name: str = "run.csv",
) -> Recording:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    demo = import_file(path, columns, units)
    assert demo.recording.info.name == path.stem
    assert demo.notes == f"Imported from {name}."
    return demo.recording


def two_rows(header: str) -> str:
    """Return a table with the rows 0, 1, 2, ... and 1, 2, 3, ..."""
    n = len(header.split(","))
    return "\n".join([header, ",".join(map(str, range(n))), ",".join(map(str, range(1, n + 1)))])


def channel(recording: Recording, name: str) -> Array:
    values: Array | None = getattr(recording, name)
    assert values is not None
    return values


COUNTING = np.array([[1.0, 2.0, 3.0], [2.0, 3.0, 4.0]])

# --- CSV --------------------------------------------------------------------------------------------------------------


def test_ximu3_joins_its_magnetometer_by_time(tmp_path: Path) -> None:
    (tmp_path / "Magnetometer.csv").write_text(f"{XIMU3_MAGNETOMETER}\n1000000,0,0,-1\n1020000,1,2,-1\n")
    inertial = f"{XIMU3}\n1000000,90,0,0,0,0,1\n1005000,0,0,0,0,0,1\n1030000,0,0,0,0,0,1\n"
    recording = import_text(tmp_path, inertial, name="Inertial.csv")
    assert_allclose(recording.t, [0.0, 0.005, 0.03], atol=1e-15)
    assert_allclose(channel(recording, "gyr"), np.outer((math.pi / 2, 0.0, 0.0), (1.0, 0.0, 0.0)))
    unknown = [np.nan] * 3  # after the last reading of the magnetometer
    assert_allclose(channel(recording, "mag"), [[0.0, 0.0, -1.0], [0.25, 0.5, -1.0], unknown])
    assert import_text(tmp_path, inertial, name="other.csv").mag is None  # it belongs only to Inertial.csv
    two_axes = XIMU3_MAGNETOMETER.rpartition(",")[0]
    (tmp_path / "Magnetometer.csv").write_text(f"{two_axes}\n1000000,0,0\n1020000,1,2\n")
    recording = import_text(tmp_path, inertial, name="Inertial.csv")
    assert recording.mag is None
    assert recording.info.source.unread["Magnetometer.csv"] == "a file that isn't used"


def test_quoted_cells_are_the_same_as_bare_ones(tmp_path: Path) -> None:
    bare = f"{NGIMU}\n5.5,90,0,-180,0,0,1\n5.51,0,0,0,0.5,0,-1\n"
    quoted = re.sub(r"[^,\n]+", lambda cell: f'"{cell[0]}"', bare)
    first, *rows = quoted.splitlines()
    long = '"' + "a note in lines\n" * 500 + '"'
    quoted = "\n".join((f'"Notes",{first}', *(f"{long},{row}" for row in rows)))
    one, other = (import_text(tmp_path, text) for text in (bare, quoted))
    for name in ("t", "gyr", "acc"):
        assert_allclose(channel(other, name), channel(one, name), rtol=0.0, atol=0.0)


def test_our_imu_csv_in_any_order_of_columns(tmp_path: Path) -> None:
    header = "mx,my,mz,ax,ay,az,t,roll,heading,pitch,temperature,gx,gy,gz"
    recording = import_text(tmp_path, f"{header}\n1,2,3,4,5,6,7,0.1,0.2,0.3,99,11,12,13\n")
    assert_array_equal(recording.t, [0.0])
    assert_array_equal(channel(recording, "mag"), [[1, 2, 3]])
    assert_array_equal(recording.acc, [[4, 5, 6]])
    assert_array_equal(channel(recording, "gyr"), [[11, 12, 13]])
    # a compass counts heading clockwise from north, pitch nose up; rpy is about x (east), y, z (up)
    assert_allclose(channel(recording, "device_rpy"), [[0.1, -0.3, math.pi / 2 - 0.2]])


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("t,ax,ay,az", 1.0),
        ("time,acc_x [g],acc_y [g],acc_z [g]", GRAVITY),
        ("Timestamp,AccX (mg),AccY (mg),AccZ (mg)", GRAVITY / 1000),
        ("seconds,accel.x,accel.y,accel.z", 1.0),
        ("Time,Linear Acceleration x (m/s²),Linear Acceleration y (m/s²),Linear Acceleration z (m/s²)", 1.0),
        ("TIME,ACCELEROMETER-X [m/s^2],ACCELEROMETER-Y [m/s^2],ACCELEROMETER-Z [m/s^2]", 1.0),
        ("Time,ax (m s-2),ay (m s-2),az (m s-2)", 1.0),
        ("time,ax [g],ay,az", GRAVITY),
        ("time,ax_m_s2,ay,az", 1.0),
        ("time,ax [g's],ay [g's],az [g's]", GRAVITY),
        ("Zeit [s],Beschl. X [g],Beschl. Y [g],Beschl. Z [g]", GRAVITY),
        ("t,ax (0.5g),ay (0.5g),az (0.5g)", 0.5 * GRAVITY),
        ("Zeit (s),Beschleunigung x (m/s^2),Beschleunigung y (m/s^2),Beschleunigung z (m/s^2)", 1.0),
    ],
)
def test_spellings_of_specific_force(tmp_path: Path, header: str, scale: float) -> None:
    recording = import_text(tmp_path, two_rows(header))
    assert_array_equal(recording.t, [0.0, 1.0])
    assert_allclose(recording.acc, COUNTING * scale)


@pytest.mark.parametrize(
    ("name", "header", "scale"),
    [
        ("gyr", "gyro_x [dps],gyro_y [dps],gyro_z [dps]", DEG),
        ("gyr", "gyro_x_dps,gyro_y_dps,gyro_z_dps", DEG),
        ("gyr", "Angular Velocity X (°/s),Angular Velocity Y (°/s),Angular Velocity Z (°/s)", DEG),
        ("gyr", "wx (rad/s),wy (rad/s),wz (rad/s)", 1.0),
        ("gyr", "Drehrate x (°/s),Drehrate y (°/s),Drehrate z (°/s)", DEG),
        ("gyr", "Dreh. x (°/s),Dreh. y (°/s),Dreh. z (°/s)", DEG),
        ("mag", "Magnetometer X (µT),Magnetometer Y (µT),Magnetometer Z (µT)", 1.0),
        ("mag", "mag_x (mGauss),mag_y (mGauss),mag_z (mGauss)", 0.1),
        ("mag", "mx (mG),my (mG),mz (mG)", 0.1),
        ("mag", "magx [G],magy [G],magz [G]", 100.0),
        ("mag", "magnetic_field.x (T),magnetic_field.y (T),magnetic_field.z (T)", 1e6),
    ],
)
def test_spellings_of_gyro_and_magnetometer(tmp_path: Path, name: str, header: str, scale: float) -> None:
    recording = import_text(tmp_path, two_rows(f"{header},t,ax,ay,az"))
    assert_allclose(channel(recording, name), (COUNTING - 1.0) * scale)


@pytest.mark.parametrize(("unit", "seconds"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0)])
def test_units_of_time(tmp_path: Path, unit: str, seconds: float) -> None:
    assert_allclose(import_text(tmp_path, two_rows(f"t ({unit}),ax,ay,az")).t, [0.0, seconds])
    assert_allclose(import_text(tmp_path, two_rows("t,ax,ay,az"), units={"t": unit}).t, [0.0, seconds])


def test_the_caller_names_columns_and_units(tmp_path: Path) -> None:
    text = two_rows("clock,forward,left,up (g),rate_x,rate_y,rate_z")
    columns = {"t": "clock", "ax": "forward", "ay": "left", "az": "up (g)", "gx": "rate_x"}
    columns |= {"gy": "rate_y", "gz": "rate_z"}
    recording = import_text(tmp_path, text, columns, {"t": "ms", "acc": "m/s2", "gyr": "deg/s"})
    assert_allclose(recording.t, [0.0, 1e-3])
    assert_allclose(recording.acc, COUNTING)  # the caller's unit wins over the header's
    assert_allclose(channel(recording, "gyr"), (COUNTING + 3.0) * DEG)


def test_signs_are_reversed_by_axis_or_by_unit(tmp_path: Path) -> None:
    text = two_rows("t,ax,ay,az")
    one = import_text(tmp_path, text, {"ay": "-ay"})
    assert_array_equal(one.acc, COUNTING * (1.0, -1.0, 1.0))
    both = import_text(tmp_path, text, {"ay": "-ay"}, {"acc": "-g"})
    assert_allclose(both.acc, -COUNTING * (1.0, -1.0, 1.0) * GRAVITY)
    named_so = import_text(tmp_path, two_rows("t,ax,-y,az"), {"ay": "-y"})
    assert_array_equal(named_so.acc, COUNTING)  # here the minus is part of the column's name


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "gb18030", "cp1252"])
def test_any_encoding_that_has_the_degree_sign(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(two_rows("t,ax,ay,az,gx (°/s),gy (°/s),gz (°/s)"), encoding=encoding)
    assert_allclose(channel(import_file(path).recording, "gyr"), (COUNTING + 3.0) * DEG)


@pytest.mark.parametrize(
    ("header", "columns", "units", "message"),
    [
        ("t,gx,gy,gz", {}, {}, "no column for ax, ay, az (specific force); the columns are t, gx, gy, gz: import it"),
        ("ax,ay,az", {}, {}, "no column for t (time); the columns are ax, ay, az: import it with --column"),
        (
            "t,ax,ay",
            {},
            {},
            "no column for 'az', though there is 'ax'; the columns are t, ax, ay: import it with --col",
        ),
        ("t,ax,ay,az,gz", {}, {}, "no column for 'gx', though there is 'gz'; "),
        (
            "t (weeks),ax,ay,az",
            {},
            {},
            "the unit 'weeks' of column 't (weeks)' is not known; import it with --unit t=UNIT, one of s, ",
        ),
        ("t,ax (lb),ay (lb),az (lb)", {}, {}, "the unit 'lb' of column 'ax (lb)' is not known; import it with --unit "),
        ("t,ax,ay,az", {}, {"acc": "deg/s"}, "the unit 'deg/s' of column 'ax' is not known; import it with --unit "),
        ("t,ax,ay,az", {}, {"ax": "g"}, "no unit can be given for 'ax'; give it for acc, gyr, mag, angle, t"),
        ("t,ax,ay,az", {"a_x": "ax"}, {}, "unknown channel 'a_x'; choose one of t, gx, gy, gz, ax, "),
        ("t,ax,ay,az", {"ax": "AccX"}, {}, "no column 'AccX'; the columns are t, ax, ay, az"),
        ("t,ax,ay,az", {"ax": "-AccX"}, {}, "no column 'AccX'; the columns are t, ax, ay, az"),
    ],
)
def test_an_unknown_column_or_unit_is_refused(
    tmp_path: Path, header: str, columns: dict[str, str], units: dict[str, str], message: str
) -> None:
    with pytest.raises((RecordingError, UsageError)) as caught:
        import_text(tmp_path, two_rows(header), columns, units)
    assert caught.value.exit_code == (2 if units or "a_x" in columns else 1)
    assert message in caught.value.message


def test_decimal_commas_with_exponents(tmp_path: Path) -> None:
    """A European spreadsheet writes our imu.csv like this."""
    rows = "0;-2,7726809378185525e-05;,5;9,81\n0,01;1E-3;2,5;3\n"
    recording = import_text(tmp_path, f"t;ax;ay;az\n{rows}")
    assert_array_equal(recording.t, [0.0, 0.01])
    assert_array_equal(recording.acc, [[-2.7726809378185525e-05, 0.5, 9.81], [1e-3, 2.5, 3.0]])


@pytest.mark.parametrize("rate_hz", [100.0, 37.5])
def test_a_table_without_times_takes_a_rate(tmp_path: Path, rate_hz: float) -> None:
    (tmp_path / "run.csv").write_text("ax,ay,az\n0,0,9.8\n0,1,9.8\n0,2,9.8\n")
    recording = import_file(tmp_path / "run.csv", rate_hz=rate_hz).recording
    assert_allclose(recording.t, [0.0, 1.0 / rate_hz, 2.0 / rate_hz], rtol=1e-15)
    assert_array_equal(recording.acc[:, 1], [0.0, 1.0, 2.0])
    assert recording.info.rate_hz == rate_hz


def test_a_day_alone_is_no_time(tmp_path: Path) -> None:
    rows = "2026-01-01,0,0,9.8\n2026-01-01,0,1,9.8\n"
    with pytest.raises(RecordingError, match=r"no column for t"):
        import_text(tmp_path, f"Date,ax,ay,az\n{rows}")
    assert_array_equal(import_file(tmp_path / "run.csv", rate_hz=10.0).recording.t, [0.0, 0.1])


def test_a_rate_wins_over_the_times_of_a_table(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(two_rows("Zeit,ax,ay,az"))
    with pytest.warns(PbdWarning, match=r"--rate 100 is used instead of the times in the column 'Zeit'"):
        recording = import_file(tmp_path / "run.csv", rate_hz=100.0).recording
    assert_allclose(recording.t, [0.0, 0.01])
    with pytest.raises(RecordingError, match="an npz has a rate of its own; leave --rate out"):
        import_file(tmp_path / "run.npz", rate_hz=100.0)


@pytest.mark.parametrize(("rate_hz", "told"), [(100.0, False), (104.0, False), (115.0, True), (50.0, True)])
def test_a_rate_that_times_in_a_known_unit_contradict_is_told(tmp_path: Path, rate_hz: float, told: bool) -> None:
    rows = "\n".join(f"{10 * k},0,0,9.8" for k in range(20))
    (tmp_path / "run.csv").write_text(f"millis,ax,ay,az\n{rows}\n")
    with pytest.warns(PbdWarning, match="is used instead of the times") as caught:
        import_file(tmp_path / "run.csv", rate_hz=rate_hz)
    said = f", by which the samples come at 100 Hz: if they are right, every distance comes out {1e4 / rate_hz**2:.2f} "
    assert any(said in str(each.message) for each in caught) == told


def test_repeated_rows_are_left_out_if_most_are(tmp_path: Path) -> None:
    """A program that reads faster than the sensor writes each sample twice; a cell may be empty."""
    with pytest.warns(PbdWarning, match="3 rows that repeat the row before are left out"):
        got = import_text(tmp_path, "t,ax,ay,az\n0,0,0,9\n0,0,0,9\n1,0,0,\n1,0,0,\n2,0,0,9\n2,0,0,9\n")
    assert_array_equal(got.t, [0.0, 1.0, 2.0])


@pytest.mark.parametrize("stamps", [("23:59:59.5", "00:00:00.5"), ("11:59:59.5 AM", "12:00:00.5 PM")])
def test_times_of_day_pass_midnight_and_noon(tmp_path: Path, stamps: tuple[str, str]) -> None:
    assert_allclose(import_text(tmp_path, "time,ax,ay,az\n{},0,0,9\n{},0,0,9\n".format(*stamps)).t, [0.0, 1.0])


# --- every format -----------------------------------------------------------------------------------------------------


def test_axes_and_units_are_corrected_without_a_header(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", rate_hz=100.0, acc=COUNTING, gyr=COUNTING)
    columns = {"ax": "-ay", "ay": "acc.x", "gz": "-gyr.z"}
    read = import_file(tmp_path / "run.npz", columns, {"acc": "-g"})
    assert_allclose(read.recording.acc, -GRAVITY * COUNTING[:, [1, 0, 2]] * (-1.0, 1.0, 1.0))
    assert_allclose(channel(read.recording, "gyr"), COUNTING * (1.0, 1.0, -1.0))
    rows = {
        row["column"]: (row["read_as"], row["unit"], row["decided_by"])
        for row in map(Column.row, read.recording.info.source.columns)
    }
    assert rows["acc.y"] == ("ax", "g", "--column; unit: --unit")
    assert rows["gyr.z"] == ("-gz", "rad/s", "--column; unit: its name")
    for given, units, message in (
        ({"ax": "gyr.x"}, {}, r"no column 'gyr\.x'; its columns for ax are acc\.x, acc\.y, acc\.z"),
        ({"mx": "my"}, {}, r"no column 'my'; its columns for mx are \(none\)"),
        ({"a": "ax"}, {}, "unknown channel 'a'"),
        ({}, {"t": "ms"}, "the unit t=ms is not known here; give it for gyr, acc"),
        ({}, {"acc": "lb"}, "the unit acc=lb is not known here; give one of m/s2, "),
    ):
        with pytest.raises((RecordingError, UsageError), match=message):
            import_file(tmp_path / "run.npz", given, units)


def test_an_unknown_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match=r"can't import '\.xlsx' files; give a \.csv, \.tsv, \.txt, \.npz, \.mcap, \.db3 or "
    ):
        import_file(tmp_path / "run.XLSX")
    with pytest.raises(RecordingError, match="only a bag has topics; leave --topic out"):
        import_file(tmp_path / "run.csv", topic="/imu")


def test_exported_keyframes_are_not_imported_but_edited_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "tea.json").write_text("{}")
    with pytest.raises(
        RecordingError, match=r"edited in keyframes\.toml, which `pbd keyframes DEMO --save` writes; give"
    ):
        import_file(tmp_path / "tea.json")


# --- real files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("after", "do"), [((0, 10, 20), "the device restarted, so cut"), ((115, 130, 140), "sort the")]
)
def test_a_clock_that_began_anew_is_no_reason_to_sort(tmp_path: Path, after: tuple[int, ...], do: str) -> None:
    """Sorted by time, the rows before and after a restart would be mixed."""
    rows = "".join(f"{t},0,0,9.81\n" for t in (100, 110, 120, *after))
    with pytest.raises(RecordingError, match=rf":5: time runs backwards from 120 to {after[0]} in column 't'; {do}"):
        import_text(tmp_path, f"t,ax,ay,az\n{rows}", units={"t": "ms"})
