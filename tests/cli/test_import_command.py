"""`pbd import` refuses a recording that can't be tracked, before it stores it."""

import argparse
import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.cli.import_ import _print_columns
from pbd.data import GRAVITY, Demonstration, Place
from pbd.data.source_columns import Column, SourceColumns
from pbd.data.units import UNITS
from pbd.files.demo import newest_demo, read_demo, write_demo
from pbd.files.importers.columns import WHY_UNUSED
from pbd.pipeline import track
from pbd.simulation.simulate import simulate
from tests.cli.run_command import HEADER, write_recording
from tests.record.emulated_sensors import SPEAKERS, random_hand
from tests.tracking.tapping import tapped


@pytest.fixture
def in_g(elsewhere: Path) -> Path:
    """A table whose acceleration is in g without saying so."""
    demo = simulate("pick-and-place-stops", "modern", 0)
    write_demo(replace(demo, recording=replace(demo.recording, acc=demo.recording.acc / GRAVITY)), elsewhere / "g")
    return elsewhere / "g" / "imu.csv"


def test_printed_lines_that_share_a_time_are_all_read(elsewhere: Path) -> None:
    """One line of each batch was kept, without a word."""
    recording = simulate("pour", "modern", 1).recording
    assert recording.gyr is not None
    rows = np.column_stack((0.25 * (np.arange(1000) // 25), recording.acc[:1000], recording.gyr[:1000]))
    np.savetxt("log.txt", rows, "%.5f", ",")
    assert main(["import", "log.txt", "tea", "--sensor", "lines", "--columns", "t,ax,ay,az,gx,gy,gz"]) == 0
    assert len(read_demo(Path("demos/tea")).recording) == 1000


def test_acceleration_in_g_is_told_at_once_and_what_it_says_to_do_helps(
    in_g: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", str(in_g), "tea"]) == 1
    assert "the values are likely in g: import the file with --unit acc=g" in capsys.readouterr().err
    assert not Path("demos").exists()
    assert main(["import", str(in_g), "tea", "--unit", "acc=g"]) == 0
    imported = read_demo(Path("demos/tea"))
    assert imported.recording.acc[:, 2].max() > GRAVITY
    stops = f"stops after the first rest: {len(track(imported).stops) - 1}\n"
    assert capsys.readouterr().out.endswith(f"{stops}next: pbd keyframes tea\n")


@pytest.mark.parametrize(
    ("unit", "given"), [("g", "mg"), ("g", "cm/s2"), ("g", "m/s2"), ("mg", "g"), ("m/s2", "g"), ("m/s2", "mg")]
)
def test_a_wrong_unit_that_was_given_is_not_answered_with_another(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], unit: str, given: str
) -> None:
    noise = np.random.default_rng(0).normal(scale=0.01, size=(400, 3))
    acc = (np.array((0.0, 0.0, 9.8)) + noise) / UNITS["acc"][unit]
    rows = [f"{k / 100},{x},{y},{z}" for k, (x, y, z) in enumerate(acc.tolist())]
    Path("still.csv").write_text("\n".join(["t,ax,ay,az", *rows]))
    assert main(["import", "still.csv", "tea", "--unit", f"acc={given}"]) == 1
    says = f"the values are likely in {unit}: import the file with --unit acc={unit}\n"
    assert capsys.readouterr().err.endswith(says)


@pytest.mark.parametrize("attitude", [True, False])
def test_a_sign_that_was_turned_is_not_advised_again(
    in_g: Path, capsys: pytest.CaptureFixture[str], attitude: bool
) -> None:
    """The device's attitude contradicts it: an error. Without one it may lie upside down: a warning."""
    rows = list(csv.reader(in_g.read_text().splitlines()))
    kept = [k for k, name in enumerate(rows[0]) if attitude or name not in ("roll", "pitch", "yaw")]
    Path("g.csv").write_text("\n".join(",".join(row[k] for k in kept) for row in rows))
    assert main(["import", "g.csv", "tea", "--unit", "acc=-g"]) == int(attitude)
    err = capsys.readouterr().err
    assert "import the file with --unit acc=g" in err
    assert "acc=-g" not in err


@pytest.fixture
def pulled(elsewhere: Path) -> Path:
    """A table with the opposite sign: a level sensor reads -g on z. Nothing in the table says so."""
    demo = simulate("pick-and-place-stops", "ideal", 0)
    write_demo(replace(demo, recording=replace(demo.recording, acc=-demo.recording.acc)), elsewhere / "pulled")
    return elsewhere / "pulled" / "imu.csv"


def test_a_sensor_on_its_head_is_told_and_what_it_says_to_do_helps(
    pulled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in (("import", str(pulled), "tea"), ("keyframes", str(pulled)), ("keyframes", "tea")):
        assert main([*command]) == 0
        said = capsys.readouterr().err
        assert said.count("at the first rest the sensor lies upside down (z reads -9.8 m/s2), or") == 1
    for remedy in (["--unit", "acc=-m/s2"], [word for a in "xyz" for word in ("--column", f"a{a}=-a{a}")]):
        assert main(["import", str(pulled), "tea", "--force", *remedy]) == 0
        assert main(["keyframes", "tea"]) == 0
        assert "upside down" not in capsys.readouterr().err
        assert read_demo(Path("demos/tea")).recording.acc[0, 2] > 0.0


def test_a_unit_that_reverses_the_signs_is_corrected_by_one_that_does(
    pulled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", str(pulled), "tea", "--unit", "acc=-g"]) == 1
    assert "likely in m/s2: import the file with --unit acc=-m/s2\n" in capsys.readouterr().err


def test_a_wrong_rate_is_not_blamed_on_a_column(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No --unit t and, in an npz, no --rate would help."""
    acc = np.tile((0.0, 0.0, 9.8), (200, 1))
    path, advice = tmp_path / "run.csv", "; correct the rate (--rate, or an npz's rate_hz)"
    ends = {5e5: f"closer than any sensor's{advice}\n", 2.0: f"{advice}, or record faster, 4 a second at least\n"}
    path.write_text("ax,ay,az\n" + "0,0,9.8\n" * 200)
    for rate_hz, end in ends.items():
        np.savez(tmp_path / "run.npz", rate_hz=rate_hz, acc=acc)
        for file, rate in ((path, ["--rate", str(rate_hz)]), (tmp_path / "run.npz", [])):
            assert main(["import", str(file), str(tmp_path / "new"), *rate]) == 1
            assert end in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "factor", "says"),
    [
        (" (mg)", 1.0, "likely in g: import the file with --unit acc=g"),
        (" (mg)", GRAVITY, "likely in m/s2: import the file with --unit acc=m/s2"),
        ("", 3.0 * GRAVITY, "check the unit of the columns Acc-X, Acc-Y, Acc-Z"),
    ],
)
def test_every_command_knows_the_files_columns(
    in_g: Path, capsys: pytest.CaptureFixture[str], unit: str, factor: float, says: str
) -> None:
    rows = [[float(cell) for cell in row[:7]] for row in list(csv.reader(in_g.read_text().splitlines()))[1:]]
    values = np.array(rows) * np.repeat((1.0, factor), (4, 3))
    header = ",".join(("t", "gx", "gy", "gz", *(f"Acc-{axis}{unit}" for axis in "XYZ")))
    np.savetxt("run.csv", values, delimiter=",", header=header, comments="")
    for command in (["import", "run.csv", "tea"], ["keyframes", "run.csv"]):
        assert main(command) == 1
        assert says in capsys.readouterr().err


def test_a_recording_does_not_replace_the_folder_that_it_is_in(in_g: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The raw.bin or the edited keyframes.toml would be lost."""
    before = in_g.read_bytes()
    assert main(["import", str(in_g), str(in_g.parent), "--unit", "acc=g", "--force"]) == 1
    assert f"imu.csv is in {in_g.parent}, which it would replace; give another name\n" in capsys.readouterr().err
    assert in_g.read_bytes() == before


def test_a_recording_that_is_imported_anew_keeps_what_its_demo_toml_says(
    in_g: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Such as what the grip did, which is not in imu.csv; the grip's times hold no longer if the recording's change."""
    told = replace(read_demo(in_g.parent), closed=True, places=(Place((1.0,), (0.4, 0.0, 0.1)),))
    write_demo(told, in_g.parent, force=True)
    assert main(["import", str(in_g), "tea", "--unit", "acc=g"]) == 0
    again = read_demo(Path("demos/tea"))
    assert again.recording.info.sensor == told.recording.info.sensor == "simulated modern"
    assert again.recording.grip == told.recording.grip != ()
    assert (again.closed, repr(again.places)) == (True, repr(told.places))
    assert main(["import", str(in_g), "slow", "--unit", "acc=g", "--rate", "99"]) == 0
    assert "its times may differ from demo.toml's, whose [[grip]], [[place]]" in capsys.readouterr().err
    assert read_demo(Path("demos/slow")).recording.grip == ()
    in_g.write_text(in_g.read_text().replace("t,", "seconds,", 1))  # only the import reads it now
    assert main(["import", str(in_g), "named", "--unit", "acc=g", "--column", "t=seconds"]) == 0


@pytest.fixture
def swapped(elsewhere: Path) -> Path:
    """A WT901's table with x and y swapped, whose columns have names of their own."""
    demo = simulate("pick-and-place-stops", "wt901", 0)
    recording = replace(demo.recording, mag=None, device_rpy=None)
    write_demo(replace(demo, recording=recording), elsewhere / "plain")
    header, _, rows = (elsewhere / "plain" / "imu.csv").read_text().partition("\n")
    assert header == "t,gx,gy,gz,ax,ay,az"
    (elsewhere / "log.csv").write_text(f"t,gx,gy,gz,acc Y,acc X,acc Z,battery\n{rows.replace(chr(10), ',7' + chr(10))}")
    return elsewhere / "log.csv"


def test_swapped_axes_are_said_and_what_it_says_to_do_helps(swapped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(swapped), "tea"]) == 1
    said = capsys.readouterr().err
    assert (
        "ax and ay are swapped: import the file with --column 'ax=acc Y' --column 'ay=acc X' (the hand turned too"
        in said
    )
    assert not Path("demos").exists()
    assert main(["import", str(swapped), "tea", "--column", "ax=acc Y", "--column", "ay=acc X", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["decided_by"] for row in told["columns"] if row["read_as"] in ("ax", "az")] == [
        "--column; no unit given",
        "its name; no unit given",
    ]
    assert told["unread"] == {"battery": "nothing inertial"}
    assert told["duration_s"] == float(swapped.read_text().splitlines()[-1].partition(",")[0])


def test_the_table_has_every_column(swapped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["import", str(swapped), "tea"])
    rows = {line.partition("  ")[0].strip(): line for line in capsys.readouterr().out.splitlines()}
    assert "specific force" in rows["acc Y"]
    assert "not read" in rows["battery"]


def test_without_a_gyro_it_says_what_that_costs(swapped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [",".join(line.split(",")[i] for i in (0, 4, 5, 6)) for line in swapped.read_text().splitlines()]
    swapped.write_text("\n".join(lines))
    assert main(["import", str(swapped), "tea"]) == 0
    assert "no gyro was found: attitude is then the device's own, which lags" in capsys.readouterr().err


@pytest.mark.parametrize("given", ["us", "ms", "0.1ms"])
def test_a_wrong_unit_of_time_is_not_answered_with_another_wrong_one(
    in_g: Path, capsys: pytest.CaptureFixture[str], given: str
) -> None:
    header, *rows = in_g.read_text().splitlines()
    cells = [row.partition(",") for row in rows]
    Path("other.csv").write_text("\n".join([header, *(f"{1e9 * float(t):.0f},{rest}" for t, _, rest in cells)]))
    assert main(["import", "other.csv", "tea", "--unit", "acc=g", "--unit", f"t={given}"]) == 1
    remedy = capsys.readouterr().err.rpartition("--unit t=")[2].strip()
    assert remedy == "ns"
    assert main(["import", "other.csv", "tea", "--unit", "acc=g", "--unit", f"t={remedy}"]) == 0


@pytest.mark.parametrize("option", [("--separator", ";"), ("--prefix", "$"), ("--wrap", "65536")])
def test_options_of_lines_are_refused_for_a_table(
    in_g: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, str]
) -> None:
    assert main(["import", str(in_g), "tea", "--unit", "acc=g", *option]) == 2
    assert "are for --sensor lines; leave them out for a file with a header" in capsys.readouterr().err
    assert not Path("demos/tea").exists()


@pytest.mark.parametrize("option", [("--column", "ax=-ax"), ("--topic", "/imu")])
def test_options_of_other_files_are_refused_for_bytes(
    in_g: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, str]
) -> None:
    in_g.rename("raw.bin")
    assert main(["import", "raw.bin", "tea", "--sensor", "ximu3", *option]) == 2
    assert "a file with a header, and --topic for a bag; leave them out" in capsys.readouterr().err


def test_lines_without_names_are_decoded_as_a_port_would_be(in_g: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("log.txt").write_text(in_g.read_text().partition("\n")[2])
    names = in_g.read_text().partition("\n")[0]
    columns = names.replace("heading,pitch,roll", "_,_,_")
    assert main(["import", "log.txt", "tea", "--sensor", "lines", "--columns", columns, "--unit", "acc=g"]) == 0
    recording = read_demo(Path("demos/tea")).recording
    assert recording.acc[:, 2].max() > GRAVITY
    assert len(recording) == len(Path("log.txt").read_text().splitlines())  # the first line too
    Path("cols.toml").write_text(f'columns = "{columns}"\n[units]\nacc = "g"\n')
    assert main(["import", "log.txt", "tea2", "--sensor", "lines", "--columns", "cols.toml"]) == 0
    np.testing.assert_array_equal(read_demo(Path("demos/tea2")).recording.acc, recording.acc)


@pytest.mark.usefixtures("in_g")
def test_a_column_of_lines_that_runs_to_and_fro_is_no_time(capsys: pytest.CaptureFixture[str]) -> None:
    Path("log.txt").write_text("".join(f"{k % 5},0,0,9.8\n" for k in range(100)))
    assert main(["import", "log.txt", "tea", "--sensor", "lines", "--columns", "t,ax,ay,az"]) == 1
    assert "; in a text of lines, name another column t, or none and add --rate HZ" in capsys.readouterr().err


def test_lines_that_were_printed_twice_count_once(in_g: Path) -> None:
    columns, *lines = in_g.read_text().replace("heading,pitch,roll", "_,_,_").splitlines(keepends=True)
    Path("log.txt").write_text("".join(2 * line for line in lines))
    assert main(["import", "log.txt", "tea", "--sensor", "lines", "--columns", columns.strip(), "--unit", "acc=g"]) == 0
    assert len(read_demo(Path("demos/tea")).recording) == len(lines)


@pytest.mark.usefixtures("in_g")
def test_raw_bytes_need_their_sensor_and_where_it_has_no_clock_its_rate(capsys: pytest.CaptureFixture[str]) -> None:
    hand = random_hand(50, seed=1)
    for name in ("razor", "xsens"):
        Path(f"{name}.bin").write_bytes(b"".join(SPEAKERS[name].encode(hand, row) for row in range(50)))
    for words, told in (
        ((), "razor.bin holds a sensor's raw bytes; name the sensor with --sensor"),
        (("--sensor", "witmotion"), "no samples of witmotion in its "),
        (("--sensor", "razor"), "razor.bin: the sensor has no clock, and nothing tells its rate; give --rate"),
    ):
        assert main(["import", "razor.bin", "tea", *words]) == 1
        assert told in capsys.readouterr().err
    assert main(["import", "xsens.bin", "tea", "--sensor", "razor"]) == 1
    assert capsys.readouterr().err.endswith("bytes; they are xsens's: give --sensor xsens\n")
    Path("empty.bin").touch()
    assert main(["import", "empty.bin", "tea", "--sensor", "razor"]) == 1
    assert capsys.readouterr().err.endswith("in its 0 bytes; name the sensor that it came from\n")
    main(["import", "razor.bin", "tea", "--sensor", "razor", "--rate", "50"])
    recording = read_demo(Path("demos/tea")).recording
    np.testing.assert_allclose(recording.t, np.arange(len(recording)) / 50.0, atol=1e-9)
    assert recording.info.clock == "none: evenly spaced at 50 Hz"


@pytest.mark.usefixtures("in_g")
def test_taps_in_a_recording_become_grips(capsys: pytest.CaptureFixture[str]) -> None:
    hand = simulate("pour", "modern", 1).recording
    for recording, told in (
        (tapped(hand, ((0.8, 60.0), (1.05, 60.0))), "1 pair of taps found: 0.8 s"),
        (hand, "0 pairs of taps found: the grip"),
    ):
        write_demo(Demonstration(recording), Path("tapped"), force=True)
        assert main(["import", "tapped/imu.csv", "tea", "--grip", "tap", "--force"]) == 0
        assert told in capsys.readouterr().err


@pytest.mark.usefixtures("in_g")
def test_column_is_refused_for_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """It had no effect."""
    Path("log.txt").write_text("0,0,9.8\n")
    options = ["--sensor", "lines", "--columns", "ax,ay,az", "--rate", "9", "--column", "az=-az"]
    assert main(["import", "log.txt", "tea", *options]) == 2
    assert "turn or swap names in --columns itself, as ax,ay,-az" in capsys.readouterr().err


@pytest.mark.usefixtures("in_g")
def test_an_import_that_cant_be_replayed_is_not_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    still, restless = write_recording(Path("still.csv")), Path("restless.csv")
    rows = [[float(cell) for cell in line.split(",")] for line in still.read_text().splitlines()[1:]]
    turning = (
        f"{t},{gx + 2.0},{gy},{gz + (t % 0.3)},{ax + (t % 0.2) * 20},{ay},{az}" for t, gx, gy, gz, ax, ay, az in rows
    )
    restless.write_text("\n".join([HEADER.strip(), *turning]))
    off = Path("off.csv")  # `pbd calibrate sensor` can't be told of its errors unless it is stored
    off.write_text("\n".join([HEADER.strip(), *(",".join(map(str, (*row[:-1], 1.2 * row[-1]))) for row in rows)]))
    for file, why in ((still, "it has fewer than two stops"), (restless, ""), (off, "measure it with pbd calibrate")):
        assert main(["import", str(file), file.stem]) == 0
        err = capsys.readouterr().err
        assert why in err.split("stored, but not as a default demonstration: ")[1]
        assert read_demo(Path("demos") / file.stem).failed
    assert newest_demo() == "pouring"


def test_the_rate_of_samples_that_come_in_batches_is_not_that_of_a_batch(
    in_g: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A computer stamps the samples of a radio packet as it takes them, one shortly after another."""
    header, *rows = list(csv.reader(in_g.read_text().splitlines()))
    t = np.array([float(row[header.index("t")]) for row in rows])
    batch = np.arange(len(t)) // 4 * 4
    stamps = t[batch] + 1e-4 * (np.arange(len(t)) - batch)
    for row, stamp in zip(rows, stamps, strict=True):
        row[header.index("t")] = f"{stamp:.6f}"
    Path("batches.csv").write_text("\n".join(map(",".join, [header, *rows])))
    assert main(["import", "batches.csv", "tea", "--unit", "acc=g"]) == 0
    rate_hz = 1.0 / float(np.median(np.diff(t)))
    assert read_demo(Path("demos/tea")).recording.info.rate_hz == pytest.approx(rate_hz, rel=0.01)
    assert f"s at {rate_hz:.0f} Hz, into" in capsys.readouterr().err
    assert main(["segments", "tea"]) == 0
    assert "the sensor is set to" not in capsys.readouterr().err


def test_files_that_are_not_used_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    column = Column("aX", "ax", 1.0, "g", "its name", "its name")
    unread = {"a.csv": WHY_UNUSED, "b.csv": WHY_UNUSED, "battery": "nothing inertial"}
    _print_columns(argparse.Namespace(json=False), SourceColumns((column,), unread, "x-IMU3 GUI"))
    program, *table = capsys.readouterr().out.splitlines()
    assert program == "written by x-IMU3 GUI"
    assert [line.split("  ")[0] for line in table[2:]] == ["aX", "battery", "2 files"]
    assert table[-1].rstrip().endswith("not used; --json names them")
