"""`pbd calibrate sensor` and `mount`, and their effect on tracking and recording."""

import re
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.calibration.accelerometer import NAMES
from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import tool_poses
from pbd.cli import main
from pbd.cli.record import _errors
from pbd.data import Demonstration, LinearErrors, RecordingInfo, SensorErrors
from pbd.errors import PbdWarning
from pbd.files.calibration import read_calibration
from pbd.files.demo import load_demo, write_demo
from pbd.pipeline import track
from pbd.pose import quat_exp, quat_log, quat_multiply, quat_rotate
from pbd.record.person_messages import Feedback
from pbd.sensors.decoding import Sample
from pbd.simulation.calibration_tasks import SIDES, pivoting, sides, turning_through
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task, random_task
from pbd.tracking.keyframes import find_keyframes
from tests.calibration.device_errors import BAD
from tests.cli.run_command import Capture, refused, run, run_json
from tests.not_none import not_none
from tests.scenarios import keyframes_and_errors

pytestmark = pytest.mark.usefixtures("elsewhere")

TIP = (0.03, -0.02, 0.0928)


def refused_by(capsys: Capture, *args: str) -> str:
    return refused(capsys, 1, *args).removeprefix("pbd: ")


def save(name: str, demo: Demonstration) -> None:
    write_demo(demo, Path("demos") / name)


# --- sensor -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of one bad sensor: `sides`, put down in twelve orientations, and the demonstration `tea`."""
    folder = tmp_path_factory.mktemp("recorded") / "demos"
    write_demo(simulate(sides(1, rest_s=1.5), BAD, 1), folder / "sides")
    write_demo(simulate("pick-and-place-stops", BAD, 1), folder / "tea")
    return folder


@pytest.fixture
def bench(recorded: Path, capsys: Capture) -> Path:
    """The calibration of that sensor."""
    Path("demos").symlink_to(recorded)
    run(capsys, "calibrate", "dock", "bench", "--position", "0.45", "-0.15", "0.25")
    assert run(capsys, "calibrate", "sensor", "bench", "sides", "--gravity", "9.81", "--temperature", "22")[0] == 0
    return Path("calibration/bench.toml")


def test_a_calibrated_sensor_tracks_better(bench: Path) -> None:
    demo = simulate("pour", BAD, 1)
    truth = not_none(demo.truth)
    worst = []
    for calibration in (None, read_calibration(bench)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PbdWarning)  # of the field, which the iron disturbs
            keyframes = find_keyframes(track(demo.recording, calibration=calibration))
        at = [[np.interp(keyframe.t, truth.t, axis) for axis in truth.p_nav_sensor.T] for keyframe in keyframes]
        off = np.linalg.norm(np.array([keyframe.T_nav_sensor.p for keyframe in keyframes]) - at, axis=1)
        worst.append(off.max())
    assert worst[1] < 0.02
    assert worst[1] < 0.2 * worst[0]


@pytest.mark.parametrize(("count", "only"), [(6, ()), (4, ()), (12, ("--only", "acc"))])
def test_a_partial_calibration_is_not_taken_for_whole(capsys: Capture, count: int, only: tuple[str, ...]) -> None:
    """Its sigmas tell tracking what it left open; taken for a whole one it sends the hand astray, by up to a metre."""
    model = replace(BAD, mag=None)
    save("sides", simulate(sides(4, SIDES[:count]), model, 4))
    assert run(capsys, "calibrate", "sensor", "part", "sides", *only)[0] == 0
    demo = simulate(random_task(81), model, 4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)
        _, off = keyframes_and_errors(demo, read_calibration(Path("calibration/part.toml")))
    assert off.max() < 0.015


def test_the_calibration_is_applied_where_it_is_used(bench: Path, capsys: Capture) -> None:
    rows = run_json(capsys, "keyframes", "tea", "--calibration", "bench")["keyframes"]
    expected = find_keyframes(track(load_demo("tea").recording, calibration=read_calibration(bench)))
    assert len(rows) == len(expected)
    assert rows[-2]["position_m"] == pytest.approx(expected[-2].T_nav_sensor.p, abs=0.01)
    assert run(capsys, "calibrate", "show", "bench", "tea")[0] == 0
    code, _, err = run(capsys, "keyframes", "tea", "--calibration", "bench", "--method", "paper")
    assert (code, "Traceback" in err) == (0, False)


def test_show_says_of_which_recording_a_warning_is(recorded: Path, capsys: Capture) -> None:
    Path("demos").symlink_to(recorded)
    run(capsys, "calibrate", "dock", "bench", "--position", "0.45", "-0.15", "0.25")
    _, _, err = run(capsys, "calibrate", "show", "bench", "tea")
    assert "pbd: warning: tea: the gyro" in err


def test_a_nav_of_the_sensor_as_it_was_is_warned_of(recorded: Path, capsys: Capture) -> None:
    """Its heading is the magnetometer's, which has another hard iron now; a dock, or the gyro's bias, has no such."""
    Path("demos").symlink_to(recorded)
    Path("calibration").mkdir()
    for part, only, warned in (("nav", (), True), ("nav", ("--only", "gyr"), False), ("dock", (), False)):
        start = f"[{part}]\nposition = [0.0, 0.0, 0.0]\nrpy_deg = [0.0, 0.0, 0.0]\n"
        Path(f"calibration/{part}.toml").write_text(f'format = 1\nname = "{part}"\n{start}', encoding="utf-8")
        _, _, err = run(capsys, "calibrate", "sensor", part, "sides", *only)
        assert ("holds for the sensor as it was read before" in err) == warned


def test_an_import_whose_sensor_is_not_named_takes_any_calibration(bench: Path, capsys: Capture) -> None:
    shutil.copy("demos/tea/imu.csv", "log.csv")
    assert len(run_json(capsys, "keyframes", "log.csv", "--calibration", "bench")["keyframes"]) > 1


def test_another_sensor_is_refused(bench: Path, capsys: Capture) -> None:
    line = refused_by(capsys, "keyframes", "pouring", "--calibration", "bench")
    assert line == (
        "'pouring' is of the sensor 'simulated modern', but the calibration's [sensor] is of 'simulated bad wt901'; "
        "name a calibration of that sensor, or remove [sensor]; if they are one device, import its recordings with "
        "--sensor 'simulated bad wt901'"
    )
    assert "of 'simulated bad wt901'" in refused_by(capsys, "calibrate", "sensor", "bench", "pouring", "--only", "gyr")
    assert "of 'simulated bad wt901'" in refused_by(capsys, "record", "x", "--sensor", "sim", "--calibration", "bench")
    assert not Path("demos/x").exists()


def test_six_sides_are_told_from_twelve(capsys: Capture) -> None:
    save("six", simulate(sides(1, SIDES[:6]), BAD, 1))
    code, out, err = run(capsys, "calibrate", "sensor", "bench", "six")
    assert code == 0
    assert err.startswith(
        "pbd: warning: 6 orientations can't determine misalignment yz, misalignment xz, misalignment xy: they are"
    )
    assert out.count("unknown") == 3
    assert "assumed gravity is 9.80665 m/s2" in err


def test_its_json_is_what_the_file_says(bench: Path, capsys: Capture) -> None:
    told = run_json(capsys, "calibrate", "sensor", "bench", "sides", "--gravity", "9.81")
    found = read_calibration(bench)
    assert found.sensor is not None
    for kind in ("gyr", "acc", "mag"):
        assert told[kind]["bias"] == pytest.approx(getattr(found.sensor, kind).bias, rel=1e-6)
        assert np.ravel(told[kind]["matrix"]) == pytest.approx(getattr(found.sensor, kind).matrix.ravel(), abs=1e-6)
    assert {f"sensor.{name}": value for name, value in told["fit"].items()} == found.residuals
    assert (told["calibration"], told["sensor"], told["remarks"]) == (str(bench), found.sensor.sensor, [])
    assert (told["field_ut"], told["dip_rad"]) == pytest.approx((found.sensor.field, found.sensor.dip), rel=1e-3)
    assert told["told"] == list(NAMES)


def test_parts_that_are_calibrated_one_by_one_add_up_to_a_whole(bench: Path, capsys: Capture) -> None:
    """A short rest, `still`, renews the gyro's bias alone and keeps its matrix."""
    save("still", simulate(Task("still", (Waypoint(rest_s=5.0),)), BAD, 1))
    for demo, only in (("still", "gyr"), ("sides", "acc"), ("sides", "mag"), ("sides", "gyr"), ("still", "gyr")):
        args = ("calibrate", "sensor", "parts", demo, "--only", only, "--gravity", "9.81", "--temperature", "22")
        assert run(capsys, *args)[0] == 0
    parts, whole = read_calibration(Path("calibration/parts.toml")), read_calibration(bench)
    assert parts.residuals == whole.residuals
    assert parts.sensor is not None
    assert whole.sensor is not None
    assert parts.sensor.gyr is not None
    assert whole.sensor.gyr is not None
    assert parts.sensor.gyr.matrix == pytest.approx(whole.sensor.gyr.matrix, abs=1e-4)
    assert parts.sensor.gyr.matrix_sigma == pytest.approx(whole.sensor.gyr.matrix_sigma, rel=0.01)
    assert parts.sensor.gyr.bias != pytest.approx(whole.sensor.gyr.bias, abs=1e-5)


def test_what_is_wrong_with_a_recording_of_sides(capsys: Capture) -> None:
    save("three", simulate(sides(1, SIDES[:3]), BAD, 1))
    line = refused_by(capsys, "calibrate", "sensor", "bench", "three")
    assert line.startswith("3 rests show only 3 orientations 15 degrees or more apart")
    header, *rows = Path("demos/three/imu.csv").read_text().splitlines(keepends=True)
    Path("gap.csv").write_text("".join([header, *rows[:190], *rows[210:]]))
    line = refused_by(capsys, "calibrate", "sensor", "bench", "gap.csv")
    assert line == "gap.csv has a gap of 200 ms at 1.89 s; record it again"
    assert not Path("calibration").exists()
    code, _, err = run(capsys, "calibrate", "sensor", "bench", "three", "--only", "gyr")
    assert (code, err) == (0, "pbd: calibration/bench.toml: [sensor] of 'simulated bad wt901' from 3 rests\n")
    assert read_calibration(Path("calibration/bench.toml")).T_base_dock is None
    for option, wrong in (("--only", "gyro"), ("--gravity", "981"), ("--latitude", "100")):
        with pytest.raises(SystemExit, match="2"):
            main(["calibrate", "sensor", "bench", "three", option, wrong])
        assert f"argument {option}: must be" in capsys.readouterr().err


def test_fused_takes_are_not_one_recording_of_sides(capsys: Capture) -> None:
    takes = "".join(f'[[take]]\ndemo = "../take{k}"\n' for k in (1, 2))
    for k in (1, 2):
        save(f"take{k}", simulate(sides(1), BAD, k))
    Path("demos/both").mkdir()
    Path("demos/both/demo.toml").write_text(f'format = 1\nname = "both"\nsensor = "w"\n{takes}')
    line = refused_by(capsys, "calibrate", "sensor", "bench", "both")
    assert line.startswith("both is fused from 2 takes; name one of them, or use `pbd fuse TAKE... -o NEW --save-")


# --- record -----------------------------------------------------------------------------------------------------------


def said_at_rest(errors: SensorErrors | None, shaken_s: float = 0.0) -> list[str]:
    """The messages of a recording of two seconds of rest, with a perfect sensor, which was shaken elsewhere before."""
    coach = Feedback(0.01, errors)
    rng = np.random.default_rng(0)
    for k in range(round(-100.0 * shaken_s), 0):
        x, y, z = 3.0 * rng.normal(size=3)
        coach.feed(0.01 * k, Sample(acc=(x, y, 9.81 + z), gyr=(x, y, z), mag=(90.0, 0.0, 0.0)))
    for k in range(200):
        x, y = 0.01 * rng.normal(size=2).tolist()[0], 0.0
        coach.feed(0.01 * k, Sample(acc=(x, y, 9.81), gyr=(1e-4 * x, 0.0, 0.0), mag=(0.0, 19.5, -44.0)))
    return [said.text for said in coach.take_messages()]


def test_a_rest_that_disagrees_is_told_while_it_is_recorded() -> None:
    right = LinearErrors(np.zeros(3), np.eye(3), np.full(3, 0.01))
    good = SensorErrors("s", right, right, right, gravity=9.81, field=48.127, dip=np.arctan2(44.0, 19.5))
    assert said_at_rest(None) == said_at_rest(good) == ["the rest at the start is found: you may move"]
    assert said_at_rest(good, shaken_s=3.0)[-1:] == ["the rest at the start is found: you may move"]
    drifted = replace(good, gyr=replace(right, bias=np.radians((0.0, 0.0, 2.0))))
    assert said_at_rest(drifted)[1] == (
        "at rest the gyro is 2.0 degrees/s off its calibrated bias: calibrate this sensor"
    )
    assert said_at_rest(replace(good, acc=replace(right, bias=np.array((0.0, 0.0, 0.3)))))[1].startswith(
        "at rest the cal"
    )
    assert said_at_rest(replace(good, field=60.0))[1].startswith("the magnetic field is 48 uT, but was 60")


def test_a_calibration_that_says_nothing_of_the_sensor_is_told_when_recording() -> None:
    with pytest.warns(PbdWarning, match=r"'default' has no \[sensor\] to compare with; pbd calibrate sensor default"):
        assert _errors("default", "vn100") is None
    assert _errors(None, "vn100") is None


# --- mount ------------------------------------------------------------------------------------------------------------


def test_a_tip_is_pivoted_and_its_rotation_turned(capsys: Capture) -> None:
    wxyz_sensor_tool = quat_exp((2.9, 0.3, -0.2))
    x, z = (quat_rotate(wxyz_sensor_tool, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    attitudes = [quat_exp(0.8 * x), quat_exp(-0.1 * x), quat_multiply(quat_exp(-0.1 * x), quat_exp(0.9 * z))]
    save("pivot", simulate(pivoting(2, TIP), "modern", 2))
    save("turns", simulate(turning_through(attitudes, np.random.default_rng(0)), "modern", 3))
    code, out, err = run(capsys, "calibrate", "mount", "bench", "pivot", "--pivot")
    assert code == 0
    assert out.count("off its point") == 10
    assert err.startswith("pbd: calibration/bench.toml: the tool is at (")
    run_json(capsys, "calibrate", "mount", "bench", "turns", "--turns", "x,-x,z")
    _, out, err = run(capsys, "calibrate", "mount", "bench", "turns", "--turns", "x,-x,z")
    assert "turns about two axes fit wrong signs, or another two axes, just as well" in err
    shown = not_none(re.search(r"the approach \(z\) +\((\S+), (\S+), (\S+)\)", out))
    assert [float(each) for each in shown.groups()] == pytest.approx(z, abs=0.03)
    moves = re.findall(r"move (\d), about (\S+) +(\d+)° +axis (\d\.\d)° off", out)
    assert [(int(move), axis) for move, axis, *_ in moves] == [(0, "x"), (1, "-x"), (2, "z")]
    assert [int(turned) for *_, turned, _ in moves] == pytest.approx(np.degrees([0.8, 0.9, 0.9]), abs=2.0)
    assert all(float(off) < 1.0 for *_, off in moves)
    _, _, err = run(capsys, "calibrate", "mount", "grip", "turns", "--turns", "x,-x,z")
    assert "which is not measured yet: --pivot does that; its rotation is known to " in err
    calibration = read_calibration(Path("calibration/bench.toml"))
    assert calibration.T_sensor_tool.p == pytest.approx(TIP, abs=0.001)
    turn = quat_log(quat_multiply(calibration.T_sensor_tool.wxyz, quat_exp((-2.9, -0.3, 0.2))))
    assert np.degrees(np.linalg.norm(turn)) < 1.0
    sigma = np.sqrt(np.diagonal(not_none(calibration.cov_sensor_tool)))
    assert np.all(sigma[:3] > 0.0)
    assert np.all(sigma[3:] > 0.0)
    assert calibration.residuals["mount.pivot_stops"] == 10
    assert calibration.residuals["mount.turns"] == 3


def test_a_dock_that_was_found_with_another_lever_is_warned_of(capsys: Capture) -> None:
    """The tool stood at those joints, so the sensor's dock is elsewhere with another lever: the tool is 10 cm off."""
    save("pivot", simulate("pivot", "modern", 1))
    joints = ("0", "-45", "0", "-135", "0", "90", "45")
    assert run(capsys, "calibrate", "dock", "bench", "--robot", "panda", "--joints", *joints)[0] == 0
    assert (
        "the [dock] of calibration/bench.toml stays"
        in run(capsys, "calibrate", "mount", "bench", "pivot", "--pivot")[2]
    )
    assert "stays" not in run(capsys, "calibrate", "mount", "bench", "pivot", "--pivot")[2]
    later = run(capsys, "keyframes", "pivot", "--calibration", "bench")[2]
    assert "warning: the [dock] of 'bench' was found before [mount] had its lever of 100 mm; find it again, or" in later


def test_a_lever_is_found_with_the_scale_of_the_path(capsys: Capture) -> None:
    """A replay moves the tip of a pivot by scale p + R lever, which stays where it is with the lever in that scale."""
    demo = simulate("pivot", "modern", 1)
    save("pivot", demo)
    Path("calibration").mkdir()
    Path("calibration/large.toml").write_text(
        'format = 1\nname = "large"\nscale = 1.2\n[dock]\nposition = [0.4, 0.0, 0.3]\nrpy_deg = [0.0, 0.0, 0.0]\n',
        encoding="utf-8",
    )
    assert run(capsys, "calibrate", "mount", "large", "pivot", "--pivot")[0] == 0
    placed = place_in_base(find_keyframes(track(demo.recording)), read_calibration(Path("calibration/large.toml")))
    assert np.ptp([pose.p for pose in tool_poses(placed)], axis=0).max() < 0.005


def test_a_tip_that_slipped_does_not_replace_a_good_lever(capsys: Capture) -> None:
    task = pivoting(2, TIP)
    save("pivot", simulate(task, "modern", 2))
    slipped = [replace(each, p=(0.01 * (k % 2), 0.0, 0.0)) for k, each in enumerate(task.waypoints)]
    save("slipped", simulate(replace(task, waypoints=tuple(slipped)), "modern", 2))
    pivot, file = ("calibrate", "mount", "bench"), Path("calibration/bench.toml")
    assert "before" not in run(capsys, *pivot, "pivot", "--pivot")[2]
    good = file.read_text()
    line = refused_by(capsys, *pivot, "slipped", "--pivot")
    assert "so the [mount] of calibration/bench.toml stays as it is; pivot again" in line
    assert file.read_text() == good
    code, _, err = run(capsys, *pivot, "slipped", "--pivot", "--force")
    assert code == 0
    assert "pbd: before, the tool is at (" in err
    assert file.read_text() != good


# --- the heading ------------------------------------------------------------------------------------------------------


def test_a_disturbed_field_recommends_a_dock(capsys: Capture) -> None:
    from tests.calibration.touched_points import touching

    touched = touching(3, 6, "modern")
    recording = touched.demo.recording
    iron = not_none(recording.mag) + np.array((25.0, 0.0, 0.0))  # a hard iron that nobody calibrated
    save("iron", replace(touched.demo, recording=replace(recording, mag=iron)))
    save("bare", replace(touched.demo, recording=replace(recording, mag=None, info=RecordingInfo(sensor="modern"))))
    save("good", touched.demo)
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in touched.points.tolist())
    Path("points.csv").write_text(f"x_m,y_m,z_m\n{rows}")

    def points(demo: str, *args: str) -> str:
        return run(capsys, "calibrate", "points", demo, demo, "--points", "points.csv", *args)[2]

    assert "start every demonstration from a dock (--as dock)" in points("iron")
    assert "from a dock" not in points("good")
    assert "nav's heading repeats to 0.0 degrees (rms over 2 demonstrations" in points(
        "good", "--again", "good", "good"
    )
    for demo, again in (("bare", "good"), ("good", "bare")):
        assert "the magnetometer, and bare has none; leave it out" in points(demo, "--again", again)
    assert read_calibration(Path("calibration/bare.toml" if points("bare") else "")).T_base_nav is None
    assert "without a magnetometer the heading is measured from the first rest" in points(
        "bare", "--as", "nav", "--force"
    )
