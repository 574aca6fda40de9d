"""Recordings of Sensor Logger and phyphox: sign, unit and file of specific force; a common clock; damaged zips."""

import re
import shutil
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.files.importers import import_file
from tests.not_none import not_none

N = 200
T = np.arange(N) / 100.0
UP = np.column_stack((0.3 * np.sin(T), 0.2 * np.cos(T), GRAVITY + 0.5 * np.sin(3.0 * T)))
"""Specific force of a phone that lies on its back, m/s2."""

GRAVITY_PART = np.tile((0.0, 0.0, GRAVITY), (N, 1))
TURN = np.column_stack((np.sin(T), np.cos(T), T))
FIELD = np.column_stack((20.0 + T, 2.0 - T, -40.0 + T))
HEAD = "time,seconds_elapsed,z,y,x"
ABOUT = "version,device name,recording epoch time,platform,appVersion,standardisation"


def table(t: np.ndarray, xyz: np.ndarray) -> str:
    """Write a table like Sensor Logger: nanoseconds, seconds, z, y, x."""
    ns = 1_787_923_304_000_000_000
    rows = (f"{ns + round(1e9 * at)},{at},{z},{y},{x}" for at, (x, y, z) in zip(t.tolist(), xyz.tolist(), strict=True))
    return "\n".join((HEAD, *rows)) + "\n"


def folder(place: Path, tables: Mapping[str, np.ndarray], platform: str = "android", standard: str = "false") -> Path:
    place.mkdir(exist_ok=True)
    for name, xyz in tables.items():
        (place / f"{name}.csv").write_text(table(T, xyz))
    (place / "Metadata.csv").write_text(f"{ABOUT}\n3,Phone,1787923304000,{platform},1.64,{standard}\n")
    return place


def packed(place: Path) -> Path:
    return Path(shutil.make_archive(str(place), "zip", place))


def read(path: Path) -> Recording:
    return import_file(path).recording


def test_android_reads_total_acceleration_from_zip_folder_and_csv(tmp_path: Path) -> None:
    tables = {"TotalAcceleration": UP, "Accelerometer": UP - GRAVITY_PART, "Gyroscope": TURN, "Magnetometer": FIELD}
    place = folder(tmp_path / "walk", tables)
    for path in (place, packed(place), place / "Gyroscope.csv"):
        got = read(path)
        assert_allclose(got.acc, UP, atol=1e-12)
        assert_allclose(not_none(got.gyr), TURN, atol=1e-12)
        assert_allclose(not_none(got.mag), FIELD, atol=1e-12)
        assert_allclose(got.t, T, atol=1e-6)


@pytest.mark.parametrize("name", ["missing.csv", "missing.txt"])
def test_a_missing_file_beside_a_recording_is_not_that_recording(tmp_path: Path, name: str) -> None:
    place = folder(tmp_path / "walk", {"TotalAcceleration": UP, "Gyroscope": TURN})
    with pytest.raises(RecordingError, match=rf"{name}: can't be read \(No such file"):
        import_file(place / name)


def test_every_column_of_every_file_is_listed(tmp_path: Path) -> None:
    place = folder(tmp_path / "walk", {"TotalAcceleration": UP, "Accelerometer": UP - GRAVITY_PART, "Gyroscope": TURN})
    (place / "Barometer.csv").write_text("time,seconds_elapsed,pressure\n0,0,1013\n")
    understood = not_none(import_file(packed(place)).recording.info.source)
    assert [column.ours for column in understood.columns] == ["t", "ax", "ay", "az", "t", "gx", "gy", "gz"]
    assert understood.columns[0].name == "TotalAcceleration.csv: seconds_elapsed"
    assert understood.unread == {
        "Accelerometer.csv": "without gravity",
        "TotalAcceleration.csv: time": "another column has the time",
        "Gyroscope.csv: time": "another column has the time",
        "Barometer.csv": "a file that isn't used",
    }


def test_a_message_names_the_time_of_the_accelerometer(tmp_path: Path) -> None:
    """Each file has times. The accelerometer's are those of the recording."""
    source = import_file(folder(tmp_path / "walk", {"TotalAcceleration": UP, "Gyroscope": TURN})).recording.info.source
    assert source.time_advice() == "the column 'TotalAcceleration.csv: seconds_elapsed' must be seconds"


def test_a_recording_is_found_among_pictures_and_other_tables(tmp_path: Path) -> None:
    """Sensor Logger stores a picture a second. A Mac puts a file of its own beside each that it zips."""
    place = tmp_path / "walk.zip"
    with zipfile.ZipFile(place, "w") as archive:
        for k in range(1200):
            archive.writestr(f"Camera/{k}.jpg", b"")
        archive.writestr("TotalAcceleration.csv", table(T, UP))
        archive.writestr("__MACOSX/._TotalAcceleration.csv", b"\0\5\26\7")
    found = import_file(place)
    assert_allclose(found.recording.acc, UP, atol=1e-12)
    assert set(found.recording.info.source.unread) == {"TotalAcceleration.csv: time"}
    for k in range(1200):
        (tmp_path / f"{k}.csv").touch()
    (tmp_path / "TotalAcceleration.csv").write_text(table(T, UP))
    assert_allclose(read(tmp_path / "TotalAcceleration.csv").acc, UP, atol=1e-12)


@pytest.mark.parametrize(
    ("tables", "standard"),
    [
        ({"Accelerometer": GRAVITY_PART - UP, "Gravity": -GRAVITY_PART}, "false"),
        ({"Accelerometer": UP - GRAVITY_PART, "Gravity": GRAVITY_PART}, "true"),
        ({"AccelerometerUncalibrated": -UP / GRAVITY}, "false"),
        ({"AccelerometerUncalibrated": UP}, "true"),
    ],
)
def test_signs_and_units_of_an_iphone(tmp_path: Path, tables: dict[str, np.ndarray], standard: str) -> None:
    place = folder(tmp_path / "i", {**tables, "Gyroscope": TURN}, "ios", standard)
    for path in (place, place / f"{next(iter(tables))}.csv"):
        assert_allclose(read(path).acc, UP, atol=1e-9)


@pytest.mark.parametrize("name", ["a{}", "-AccelerometerUncalibrated.csv: {}"], ids=["ours", "the file's"])
def test_swapped_axes_of_an_iphone_are_corrected_by_either_name(tmp_path: Path, name: str) -> None:
    place = folder(tmp_path / "i", {"AccelerometerUncalibrated": -UP[:, [1, 0, 2]] / GRAVITY}, "ios")
    columns = {"ax": name.format("y"), "ay": name.format("x")}
    assert_allclose(import_file(place, columns).recording.acc, UP, atol=1e-9)


@pytest.mark.parametrize("written", [UP, -UP / GRAVITY], ids=["Android's", "an iPhone's"])
def test_the_phone_is_recognised_by_the_norm_without_metadata(tmp_path: Path, written: np.ndarray) -> None:
    place = folder(tmp_path / "w", {"AccelerometerUncalibrated": written, "Gyroscope": TURN})
    (place / "Metadata.csv").unlink()
    assert_allclose(read(place).acc, UP, atol=1e-9)


def test_a_sensor_without_any_number_is_refused(tmp_path: Path) -> None:
    place = folder(tmp_path / "w", {"AccelerometerUncalibrated": np.full_like(UP, np.nan), "Gyroscope": TURN})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(RecordingError, match="its sensors have no time in common"):
            read(place)


@pytest.mark.parametrize("standard", [False, True])
def test_a_watch_gives_gravity_and_the_rest_of_its_acceleration(tmp_path: Path, standard: bool) -> None:
    quantities = ("rotationRate", "gravity", "acceleration")
    header = ["time", "seconds_elapsed", *(f"{name}{axis}" for name in quantities for axis in "XYZ"), "yaw"]
    parts = np.hstack((GRAVITY_PART, UP - GRAVITY_PART)) / (1.0 if standard else -GRAVITY)
    rows = np.column_stack((1e9 * T, T, TURN, parts, T))
    place = folder(tmp_path / "w", {})
    path = place / "WristMotion.csv"
    path.write_text("\n".join((",".join(header), *(",".join(map(str, row)) for row in rows.tolist()))))
    for each in (place, packed(place), path):
        found = import_file(each)
        assert found.recording.info.sensor == "watch"
        assert_allclose(found.recording.acc, UP, atol=1e-9)
        assert_allclose(not_none(found.recording.gyr), TURN, atol=1e-12)
        source = found.recording.info.source
        assert {each.sign for each in source.columns if each.ours == "ax"} == {1.0 if standard else -1.0}
        assert source.unread["WristMotion.csv: yaw"] == "an attitude that isn't used"
    (place / "TotalAcceleration.csv").write_text(table(T, GRAVITY_PART))
    with pytest.warns(PbdWarning, match=r"the phone is read, not the watch; for that import WristMotion\.csv alone"):
        assert_allclose(read(place).acc, GRAVITY_PART)
    assert_allclose(read(path).acc, UP, atol=1e-9)


def test_without_metadata_both_systems_switches_are_named(tmp_path: Path) -> None:
    place = folder(tmp_path / "w", {"Accelerometer": UP - GRAVITY_PART, "Gyroscope": TURN})
    (place / "Metadata.csv").unlink()
    with pytest.raises(RecordingError, match=r"switch on 'Total Acceleration' or 'Gravity' in Sensor"):
        read(place)


@pytest.mark.parametrize(("platform", "needed"), [("android", "TotalAcceleration.csv"), ("ios", "Gravity.csv")])
def test_acceleration_without_gravity_names_the_file_that_is_needed(tmp_path: Path, platform: str, needed: str) -> None:
    place = folder(tmp_path / "w", {"Accelerometer": UP - GRAVITY_PART, "Gyroscope": TURN}, platform)
    with pytest.raises(RecordingError, match=rf"Accelerometer.csv is without gravity, and {needed}.* is needed"):
        read(place)


def test_without_metadata_the_sign_of_gravity_is_unknown(tmp_path: Path) -> None:
    place = folder(tmp_path / "w", {"Accelerometer": UP - GRAVITY_PART, "Gravity": GRAVITY_PART})
    (place / "Metadata.csv").unlink()
    with pytest.raises(RecordingError, match=r"Metadata\.csv is missing, which says whether the signs are an iPhone's"):
        read(place)


def test_a_zip_holds_one_recording(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "w.zip", "w") as archive:
        archive.writestr("notes.csv", "tea")
    with pytest.raises(RecordingError, match="this zip: no recording of Sensor Logger or phyphox is in it"):
        read(tmp_path / "w.zip")
    with zipfile.ZipFile(tmp_path / "w.zip", "a") as archive:
        for day in ("monday", "tuesday"):
            archive.writestr(f"{day}/TotalAcceleration.csv", table(T, UP))
    with pytest.raises(RecordingError, match=r"it holds several recordings \(TotalAcceleration\.csv twice\); export"):
        read(tmp_path / "w.zip")


def test_streams_of_different_rates_are_joined_on_the_gyros_clock(tmp_path: Path) -> None:
    """The accelerometer starts late, ends early and has a gap: the gyro's samples there are left out."""
    place = folder(tmp_path / "w", {})
    fine = np.arange(800) / 400.0 + 0.0003
    (place / "Gyroscope.csv").write_text(table(fine, np.column_stack((fine, -fine, fine))))
    kept = (T > 0.1) & (T < 1.8) & ~((T > 0.795) & (T < 0.9))
    (place / "TotalAcceleration.csv").write_text(table(T[kept], np.column_stack((T, 2.0 * T, GRAVITY + T))[kept]))
    got = read(place)
    at = got.acc[:, 0]  # specific force is linear in time here
    assert_allclose(not_none(got.gyr)[:, 0], at, atol=1e-9)
    assert got.t[0] == 0.0
    assert at.min() >= T[kept][0]
    assert at.max() <= T[kept][-1]
    assert not ((at > 0.7901) & (at < 0.8999)).any()
    assert len(at) == pytest.approx(400 * (1.68 - 0.11), abs=2)


def test_sensors_without_a_time_in_common_are_refused(tmp_path: Path) -> None:
    place = folder(tmp_path / "w", {"TotalAcceleration": UP})
    (place / "Gyroscope.csv").write_text(table(T + 60.0, TURN))
    with pytest.raises(RecordingError, match="its sensors have no time in common"):
        read(place)


def phyphox(place: Path, separator: str = ",", comma: bool = False, linear: bool = False) -> Path:
    """Write a folder like phyphox' exporter: quoted names, ten digits, NaN at the end of a shorter column."""
    (place / "meta").mkdir(parents=True)

    def write(name: str, header: list[str], rows: np.ndarray) -> None:
        cells = [[f"{x:.9E}" if np.isfinite(x) else "NaN" for x in row] for row in rows]
        text = separator.join(f'"{cell}"' for cell in header)
        text += "".join(
            "\n" + separator.join(cell.replace(".", ",") if comma else cell for cell in row) for row in cells
        )
        (place / f"{name}.csv").write_text(text + "\n", encoding="utf-8")

    kind = "Linear Acceleration" if linear else "Acceleration"
    rows = np.column_stack((T, UP))
    rows[-1] = np.nan
    write("Accelerometer", ["Time (s)", *(f"{kind} {axis} (m/s^2)" for axis in "xyz")], rows)
    write("Gyroscope", ["Time (s)", *(f"Gyroscope {axis} (rad/s)" for axis in "xyz")], np.column_stack((T, TURN)))
    write("Magnetometer", ["Time (s)", *(f"Magnetic field {axis} (µT)" for axis in "xyz")], np.column_stack((T, FIELD)))
    events = ["START", "PAUSE", "START"], (0.0, 1.0, 1.0), (1000.0, 1001.0, 1003.5)
    lines = [f'"{e}"{separator}{t:.9E}{separator}{s:.3f}{separator}"x"' for e, t, s in zip(*events, strict=True)]
    head = separator.join(f'"{name}"' for name in ("event", "experiment time", "system time", "system time text"))
    (place / "meta" / "time.csv").write_text(
        "\n".join((head, *(line.replace(".", ",") if comma else line for line in lines)))
    )
    return place


@pytest.mark.parametrize(("separator", "comma"), [(",", False), (";", True), ("\t", False)])
def test_phyphox_counts_its_pauses(tmp_path: Path, separator: str, comma: bool) -> None:
    got = read(packed(phyphox(tmp_path / "p", separator, comma)))
    assert_allclose(got.acc, UP[:-1], atol=1e-8)
    assert_allclose(not_none(got.gyr), TURN[:-1], atol=1e-8)
    assert_allclose(got.t, (T + 2.5 * (T > 1.0))[:-1], atol=1e-6)


@pytest.mark.parametrize(
    "saved",
    [
        lambda text: text.encode("utf-8-sig"),
        lambda text: text.encode("utf-16"),
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: f"\n{text}".encode(),
    ],
    ids=["mark", "utf-16", "returns", "blank line"],
)
def test_a_file_that_a_spreadsheet_saved_anew_is_a_phones(tmp_path: Path, saved: Callable[[str], bytes]) -> None:
    """It was read as an ordinary table: an iPhone's signs, and phyphox' pauses, were lost."""
    file = folder(tmp_path / "w", {"TotalAcceleration": -UP}, "ios") / "TotalAcceleration.csv"
    file.write_bytes(saved(file.read_text()))
    assert_allclose(read(file).acc, UP, atol=1e-9)
    file = phyphox(tmp_path / "p") / "Accelerometer.csv"
    file.write_bytes(saved(file.read_text()))
    assert_allclose(read(file).t, (T + 2.5 * (T > 1.0))[:-1], atol=1e-6)


def test_what_phyphox_says_of_the_phone_is_no_sheet(tmp_path: Path) -> None:
    place = phyphox(tmp_path / "p")
    (place / "meta" / "device.csv").write_text('"property","value"\n"version","1.1"\n')
    for each in (place, packed(place)):
        assert not import_file(each).recording.info.source.unread


def test_a_csv_of_any_other_name_is_read_alone(tmp_path: Path) -> None:
    place = phyphox(tmp_path / "p")
    alone = (place / "Accelerometer.csv").rename(place / "monday.csv")
    assert read(alone).gyr is None


def test_of_two_accelerometers_in_a_folder_of_phyphox_one_is_named(tmp_path: Path) -> None:
    place = phyphox(tmp_path / "p")
    (place / "meta" / "time.csv").write_text('"event","clock"\n"START",0\n')  # then the times are the sensors'
    shutil.copy(place / "Accelerometer.csv", place / "Acceleration.csv")
    with pytest.raises(RecordingError, match=r"'Acceleration x .*' is in Accelerometer\.csv and in another file too"):
        read(place)
    got = import_file(place / "Acceleration.csv").recording
    assert got.info.source.of("acc")[0].name.startswith("Acceleration.csv: ")
    assert_allclose(got.t, T[:-1], atol=1e-9)


def test_phyphox_files_without_rows_are_warned_of(tmp_path: Path) -> None:
    """The app writes them for a magnetometer that the phone lacks. Other sets, as an average, may be empty as well."""
    place = phyphox(tmp_path / "p")
    (place / "Magnetometer.csv").write_text('"Time (s)","X (µT)","Y (µT)","Z (µT)"\n', encoding="utf-8")
    (place / "Average.csv").write_text('"Average"\n', encoding="utf-8")
    for each in (place, packed(place)):
        with pytest.warns(
            PbdWarning, match=r"Magnetometer\.csv: a header but no rows; the recording is read without"
        ) as told:
            got = read(each)
        assert len(told) == 1
        assert got.mag is None
        assert_allclose(not_none(got.gyr), TURN[:-1], atol=1e-8)
    (place / "Gyroscope.csv").write_text('"Time (s)","X (rad/s)","Y (rad/s)","Z (rad/s)"\n', encoding="utf-8")
    with pytest.raises(RecordingError, match=r"Gyroscope\.csv: a header but no rows; .* or remove Gyroscope\.csv"):
        read(place)


def test_of_two_gyros_in_a_folder_of_phyphox_one_is_named(tmp_path: Path) -> None:
    place = phyphox(tmp_path / "p")
    shutil.copy(place / "Gyroscope.csv", place / "Turn.csv")
    with pytest.raises(RecordingError, match=r"'Gyroscope x .*' is in Turn\.csv and in another file too"):
        read(place)


def test_a_gyro_that_is_not_phyphox_s_is_not_dropped(tmp_path: Path) -> None:
    units = (
        f"{quantity} {axis} ({unit})"
        for quantity, unit in (("Acceleration", "m/s^2"), ("Gyro", "dps"))
        for axis in "XYZ"
    )
    path = tmp_path / "run.csv"
    path.write_text("\n".join((",".join(("Time (s)", *units)), "0,0,0,9.8,1,2,3", "0.01,0,0,9.8,1,2,3")))
    gyr = not_none(read(path).gyr)
    assert_allclose(gyr[0], np.radians([1.0, 2.0, 3.0]))


def test_phyphox_without_gravity_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"Linear Acceleration is without gravity, and 'Acceleration x .* is"):
        read(phyphox(tmp_path / "p", linear=True))


def test_an_iphones_simple_experiment_names_only_the_axes(tmp_path: Path) -> None:
    place = phyphox(tmp_path / "p")
    for file in place.glob("*.csv"):
        names = r'"(?:Acceleration|Gyroscope|Magnetic field) ([xyz])'
        text = re.sub(names, lambda axis: f'"{axis[1].upper()}', file.read_text(encoding="utf-8"))
        file.write_text(text, encoding="utf-8")
    for each in (place, packed(place), place / "Accelerometer.csv"):
        got = read(each)
        assert got.mag is not None
        assert_allclose(got.acc, UP[:-1], atol=1e-8)
        assert_allclose(not_none(got.gyr), TURN[:-1], atol=1e-8)
    for name in ("Gyroscope", "Magnetometer"):
        (place / f"{name}.csv").unlink()
    linear = (place / "Accelerometer.csv").rename(place / "Linear Accelerometer.csv")
    for each in (place, linear):
        with pytest.raises(RecordingError, match="Linear Acceleration is without gravity"):
            read(each)
    unknown = linear.rename(place / "monday.csv")
    with pytest.raises(RecordingError, match="no column for ax"):
        read(unknown)


def test_a_truncated_zip_and_a_zip_bomb_are_refused(tmp_path: Path) -> None:
    place = packed(folder(tmp_path / "w", {"TotalAcceleration": UP, "Gyroscope": TURN}))
    whole = place.read_bytes()
    half = tmp_path / "half.zip"
    for cut in range(1, len(whole), len(whole) // 40):
        half.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match=r"damaged or cut off .*; copy or export it again"):
            read(half)
    with zipfile.ZipFile(half, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TotalAcceleration.csv", b"0" * 60_000_000)
    with pytest.raises(RecordingError, match=r"in it of \d+ bytes decompresses to 60 MB, which is refused"):
        read(half)


def test_flipped_bytes_in_a_zip_never_give_other_numbers(tmp_path: Path) -> None:
    place = packed(folder(tmp_path / "w", {"TotalAcceleration": UP, "Gyroscope": TURN}))
    whole, rng = place.read_bytes(), np.random.default_rng(0)
    right = read(place)
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        place.write_bytes(damaged)
        try:
            got = read(place)
        except RecordingError:
            continue
        assert_allclose(got.acc, right.acc)  # the damaged byte is not read: a date, or another name


def test_a_zip_of_a_demonstration_is_told(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "tea.zip", "w") as archive:
        for name in ("imu.csv", "demo.toml"):
            archive.writestr(f"tea/{name}", "")
    with pytest.raises(
        RecordingError, match=r"it is a demonstration already; unzip it into \./demos, and use it as it is"
    ):
        import_file(tmp_path / "tea.zip")


def test_metadata_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    place = folder(tmp_path / "walk", {"TotalAcceleration": UP})
    (place / "Metadata.csv").write_text("a" * 200_000)
    with pytest.raises(RecordingError, match=r"walk: Metadata\.csv can't be read \(field larger than .*; export"):
        read(place)
