"""Recordings with a file for each sensor. The formats are those that MetaBase, MATLAB and users' own loggers write."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data import GRAVITY
from pbd.errors import PbdWarning, RecordingError
from pbd.files.importers import import_file
from tests.not_none import not_none

METABASE = "Hand_2023-11-14T22.13.20.000_C1A2B3D4E5F6_{}_100.000Hz_1.7.3.csv"
HEADS = (
    "epoc (ms),timestamp (+0100),elapsed (s),x-axis ({0}),y-axis ({0}),z-axis ({0})\n",
    "epoch (ms),time (01:00),elapsed (s),x-axis ({0}),y-axis ({0}),z-axis ({0})\n",
)
DEG = np.pi / 180.0


@pytest.mark.parametrize("head", HEADS)
def test_metabase_has_a_file_for_each_sensor(tmp_path: Path, head: str) -> None:
    """`elapsed` counts from the first sample of each file, so only `epoc` says that the gyroscope is 5 ms later."""
    sensors = {"Accelerometer": ("g", "0.5,0,{}"), "Gyroscope": ("deg/s", "90,0,{}"), "Quaternion": ("", "1,0,{}")}
    for k, (sensor, (unit, row)) in enumerate(sensors.items()):
        rows = [
            f"{1_700_000_000_000 + at + 5 * k},2023-11-14T22.13.20.0{at + 5 * k},{(at - 10) / 1000},{row.format(at)}\n"
            for at in (10, 20, 30)
        ]
        (tmp_path / METABASE.format(sensor)).write_text(head.format(unit) + "".join(rows))
    for path in (tmp_path, tmp_path / METABASE.format("Gyroscope")):
        recording = import_file(path).recording
        assert_allclose(recording.t, [0.0, 0.01], atol=1e-6)
        assert_allclose(recording.acc, [[0.5 * GRAVITY, 0.0, g * GRAVITY] for g in (15.0, 25.0)], rtol=1e-4)
        assert_allclose(not_none(recording.gyr), [[np.pi / 2, 0.0, rate * DEG] for rate in (10.0, 20.0)])
        assert recording.info.source.unread[METABASE.format("Quaternion")] == "a file that isn't used"
        assert recording.info.source.program == "MetaBase (MbientLab)"
        assert recording.info.sensor == "metawear"
    (tmp_path / METABASE.format("Accelerometer").replace("Hand", "Foot")).write_text(
        head.format("g") + "1700000000010,2023-11-14T22.13.20.010,0,0,0,1\n"
    )
    with pytest.raises(RecordingError, match="it holds 2 recordings; name a file of one of them"):
        import_file(tmp_path)
    (tmp_path / METABASE.format("Accelerometer")).unlink()
    with pytest.raises(RecordingError, match="no file of the accelerometer is beside it"):
        import_file(tmp_path / METABASE.format("Gyroscope"))


def written(folder: Path, files: Mapping[str, str], times: Mapping[str, tuple[str, ...]]) -> Path:
    """Write each file's header and a row for each of its times; all read 1, 2, 3."""
    folder.mkdir()
    for name, header in files.items():
        rows = "".join(f"{at},1,2,3\n" for at in times[name])
        (folder / f"{name}.csv").write_text(f"{header}\n{rows}")
    return folder


@pytest.mark.parametrize(
    ("names", "header", "times", "unit"),
    [
        (("accelerometer", "gyroscope"), "timestamp,x,y,z", ("1.000", "1.010"), {}),
        (("acc", "gyro"), "time_ms,X,Y,Z", ("1000", "1010"), {}),
        (("run1_acc", "run1_gyr"), "timestamp,x,y,z", ("1700000000000", "1700000000010"), {"t": "ms"}),
        (
            ("Acceleration", "AngularVelocity"),
            "Timestamp,X,Y,Z",
            ("14-Nov-2023 22:13:20.000", "14-Nov-2023 22:13:20.010"),
            {},
        ),
    ],
)
def test_a_files_name_says_which_sensor_it_is(
    tmp_path: Path, names: tuple[str, str], header: str, times: tuple[str, str], unit: dict[str, str]
) -> None:
    folder = written(tmp_path / "walk", dict.fromkeys(names, header), dict.fromkeys(names, times))
    packed = Path(shutil.make_archive(str(tmp_path / "walk"), "zip", folder))
    for path in (folder, packed, folder / f"{names[1]}.csv"):
        recording = import_file(path, {}, unit).recording
        assert_allclose(recording.t, [0.0, 0.01], atol=1e-6)
        assert_allclose(recording.acc, [[1.0, 2.0, 3.0]] * 2)
        assert_allclose(not_none(recording.gyr), [[1.0, 2.0, 3.0]] * 2)
    turned = import_file(folder, {"ax": f"-{names[0]}.csv: {header.split(',')[2]}"}, unit).recording
    assert_allclose(turned.acc[0], [-2.0, 2.0, 3.0])


def test_each_files_counter_is_unwrapped_and_one_that_restarts_is_refused(tmp_path: Path) -> None:
    times = {"acc": ("4294957296", "4294967290", "9994"), "gyro": ("4294957296", "4294967290", "9994")}
    folder = written(tmp_path / "walk", dict.fromkeys(times, "micros,x,y,z"), times)
    assert_allclose(import_file(folder).recording.t, [0.0, 0.009994, 0.019994], atol=1e-6)
    restart = {"acc": ("1", "2", "3", "4"), "gyro": ("3", "4", "1", "2")}
    folder = written(tmp_path / "restart", dict.fromkeys(restart, "t,x,y,z"), restart)
    with pytest.raises(RecordingError, match=r"gyro.csv:4: time runs backwards from 4 to 1 in column 't'"):
        import_file(folder)


def test_units_are_the_headers_or_the_callers(tmp_path: Path) -> None:
    times = {"acc": ("1", "2"), "gyro": ("1", "2")}
    folder = written(tmp_path / "walk", {"acc": "t,ax (g),ay (g),az (g)", "gyro": "t,gx,gy,gz"}, times)
    recording = import_file(folder, {}, {"gyr": "deg/s"}).recording
    assert_allclose(recording.acc[0], np.array([1.0, 2.0, 3.0]) * GRAVITY)
    assert_allclose(not_none(recording.gyr)[0], np.array([1.0, 2.0, 3.0]) * DEG)


def test_times_that_begin_at_0_in_each_file_are_warned_of(tmp_path: Path) -> None:
    times = {"acc": ("0.00", "0.01"), "gyro": ("0.000", "0.010")}
    folder = written(tmp_path / "walk", dict.fromkeys(times, "t,x,y,z"), times)
    with pytest.warns(PbdWarning, match="the times in the column 't' begin at 0 in each file"):
        import_file(folder)


def test_files_without_a_common_clock_or_of_one_sensor_are_refused(tmp_path: Path) -> None:
    times = {"acc": ("1", "2"), "gyro": ("1", "2")}
    apart = written(tmp_path / "apart", {"acc": "t,x,y,z", "gyro": "timestamp,x,y,z"}, times)
    with pytest.raises(RecordingError, match=r"no column of times in common \(acc.csv: t, gyro.csv: timestamp\)"):
        import_file(apart)
    twice = written(tmp_path / "twice", {"acc": "t,x,y,z", "accel": "t,x,y,z"}, {**times, "accel": ("1", "2")})
    with pytest.raises(RecordingError, match=r"acc.csv and accel.csv are of the same sensor"):
        import_file(twice)


def test_a_table_of_all_sensors_may_be_called_after_one(tmp_path: Path) -> None:
    (tmp_path / "gyro.csv").write_text("t,x,y,z\n1,9,9,9\n2,9,9,9\n")
    (tmp_path / "acc.csv").write_text("t,ax,ay,az,gx,gy,gz\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n")
    recording = import_file(tmp_path / "acc.csv").recording
    assert_allclose(not_none(recording.gyr)[0], [4.0, 5.0, 6.0])


def test_acceleration_without_gravity_beside_the_accelerometer_is_not_read(tmp_path: Path) -> None:
    times = dict.fromkeys(("accelerometer", "gyroscope", "linear_acceleration"), ("1", "2"))
    folder = written(tmp_path / "walk", dict.fromkeys(times, "t,x,y,z"), times)
    recording = import_file(folder).recording
    assert recording.gyr is not None
    assert "linear_acceleration.csv" in recording.info.source.unread


def test_a_phones_file_with_a_unit_is_an_ordinary_table(tmp_path: Path) -> None:
    """By its name alone, an acceleration without gravity would be read, and its `time` in ns as seconds."""
    times = dict.fromkeys(("Accelerometer", "Gyroscope"), ("1000000000,0", "1010000000,0.01"))
    folder = written(tmp_path / "walk", dict.fromkeys(times, "time,seconds_elapsed,z,y,x"), times)
    with pytest.raises(RecordingError, match="no column for ax, ay, az"):
        import_file(folder / "Accelerometer.csv", {}, {"acc": "g"})


@pytest.mark.parametrize("broken", ["t,x,y,z\n", "t,x,y,z\n1,2,3,4\n2,a,3,4\n", "t,x,y,z\n2,1,2,3\n1,1,2,3\n"])
def test_a_broken_file_that_is_not_needed_may_be_removed(tmp_path: Path, broken: str) -> None:
    times = dict.fromkeys(("acc", "gyro"), ("1", "2"))
    folder = written(tmp_path / "walk", dict.fromkeys(times, "t,x,y,z"), times)
    (folder / "gyro.csv").write_text(broken)
    with pytest.raises(RecordingError, match=r"gyro.csv.*; or remove gyro.csv, to import .* without its gyro$"):
        import_file(folder)
    (folder / "gyro.csv").unlink()
    assert import_file(folder).recording.gyr is None
    (folder / "acc.csv").write_text(broken)
    with pytest.raises(RecordingError, match=r"acc\.csv") as refused:
        import_file(folder)
    assert "remove acc.csv" not in refused.value.message


@pytest.mark.parametrize(("header", "missing"), [("t,x,y", "z"), ("x,y,z", "t")])
def test_a_file_that_lacks_an_axis_or_the_time_is_not_passed_over(tmp_path: Path, header: str, missing: str) -> None:
    folder = written(tmp_path / "walk", {"acc": "t,x,y,z"}, {"acc": ("1", "2")})
    (folder / "gyro.csv").write_text(f"{header}\n1,2,3\n2,2,3\n")
    for path in (folder, folder / "gyro.csv", folder / "acc.csv"):
        with pytest.raises(RecordingError, match=rf"gyro\.csv: no column for '{missing}', .* or remove gyro\.csv, to"):
            import_file(path)
