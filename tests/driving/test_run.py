"""`pbd run` on emulated servos: the whole demonstration ten times as fast, and a person at a terminal."""

import json
import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pbd.cli.common import plan_demonstration
from pbd.cli.recording.keys import Keys
from pbd.cli.run import _show_ranges
from pbd.cli.run.drive import _preview_table, timetable
from pbd.data import JointTrajectory
from pbd.driving import bus, stream
from pbd.driving.encoders import Encoders
from pbd.driving.packets import encode_word
from pbd.driving.servo_arm import ServoArm
from pbd.driving.stream import Clock
from pbd.errors import PbdError
from pbd.files.demo import load_demo, write_demo
from pbd.files.robot import load_robot
from pbd.files.servo_calibration import write_servo_calibration
from pbd.pipeline import track
from pbd.planning import Plan, PlanOptions, plan_path
from pbd.pose import Array
from pbd.view.terminal_tables import print_table
from tests.cli.pbd_process import Terminal
from tests.cli.run_command import Capture, refused, run, run_json
from tests.driving.emulator import LEFT, Emulator, calibration_of, resting
from tests.driving.relaxed_timing import PATIENT_PBD, PATIENT_S, UNHURRIED_S, FastClock
from tests.scenarios import with_long_stays

pytestmark = pytest.mark.usefixtures("cached_results", "unadvised")

HOME = load_robot("so101").home


@pytest.fixture
def words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The options that name the calibration; the folder is empty but for it."""
    write_servo_calibration(calibration_of("so101"), tmp_path / "servos.json")
    monkeypatch.setattr("tests.cli.pbd_process.PBD", PATIENT_PBD)
    monkeypatch.chdir(tmp_path)
    return ["--robot", "so101", "--servos", "servos.json"]


@pytest.fixture
def emulator(monkeypatch: pytest.MonkeyPatch) -> Iterator[Emulator]:
    """An arm that somebody left somewhere, ten times as fast as a real one."""
    monkeypatch.setattr("pbd.cli.run.drive.Clock", FastClock)
    monkeypatch.setattr(bus, "ANSWER_S", PATIENT_S)
    monkeypatch.setattr(bus, "ANSWER_AT_REST_S", PATIENT_S)
    monkeypatch.setattr(stream, "STALL_S", UNHURRIED_S)
    with Emulator(calibration_of("so101"), resting("so101", LEFT), FastClock()) as emulator:
        yield emulator


def model_degrees(counts: Array) -> Array:
    """Degrees of the model's joints, worked out apart from the product: the middle of the range is zero."""
    middles = [(c.range_min + c.range_max) / 2 for c in calibration_of("so101").values()][:5]
    degrees: Array = (counts - middles) * 360 / 4096 + (0, 0, 0, 0, math.degrees(0.0486795))
    return degrees


def test_the_whole_demonstration(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    result = run_json(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes")
    robot = load_robot("so101")
    assert robot.dock is not None
    path = track(load_demo("pouring"), calibration=robot.dock)
    trajectory = plan_path(path, robot.dock, robot, PlanOptions(start=LEFT)).trajectory
    assert result["duration_s"] == pytest.approx(trajectory.duration, abs=0.2)  # counts are rounded
    goals = np.array([[goal[i] for i in range(1, 6)] for _, goal in emulator.goals[2:]], np.float64)
    assert result["goals"] == len(goals)
    at = model_degrees(goals)
    np.testing.assert_allclose(at[0], np.degrees(LEFT), atol=0.1)
    np.testing.assert_allclose(at[-1], np.degrees(HOME), atol=0.1)
    for q in np.degrees(trajectory.keyframe_q):  # each keyframe is reached
        assert np.abs(at - q).max(axis=1).min() < 0.1
    assert np.abs(np.diff(at, axis=0)).max() * 50.0 < math.degrees(2.2) * 1.05  # rounded to counts
    stands = model_degrees(np.array([servo.counts for servo in emulator.servos.values()][:5]))
    np.testing.assert_allclose(stands, np.degrees(HOME), atol=0.5)
    assert all(servo.registers[40] for servo in emulator.servos.values())  # it holds
    assert result["stopped"] is None
    assert result["asked_again"] == 0


def test_a_fault_is_one_line_and_an_exit_code(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    emulator.at_goal, emulator.fault = 100, lambda: emulator.servos[2].put(63, bytes([68]))
    code, out, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes", "--json")
    says = "shoulder_lift is at 68 °C, and switches off at 70: let it cool down"
    assert code == 1
    lets_go = f"`pbd run --release --robot so101 --port {emulator.device}` lets go of it"
    assert err.splitlines()[-1] == f"pbd: stopped after 1.96 s: {says}; the arm holds where it stopped; {lets_go}"
    assert json.loads(out)["stopped"] == says
    assert json.loads(out)["held"]


def test_the_preview_shows_the_lowest_place_below_the_highest(capsys: Capture) -> None:
    """Of a joint that falls where its servo's counts rise, as so100's base does, and of such a gripper."""
    robot = load_robot("so100")
    servos = calibration_of("so100")
    encoders = Encoders(robot, servos | {"gripper": replace(servos["gripper"], drive_mode=1)})
    q, opening = np.array([robot.home, robot.home]), np.array([0.2, 0.7])
    q[1, 0] += 0.5
    goals = encoders.from_joints(q, opening)
    state: Any = SimpleNamespace(counts=goals[0])
    trajectory: Any = SimpleNamespace(keyframe_t=np.array([1.0]))
    print_table(_preview_table(encoders, state, goals, np.array([0.0, 1.0]), trajectory), sys.stdout)
    rows = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines() if line.strip()}
    first = [f"{math.degrees(value):.1f}°" for value in (q[0, 0], q[1, 0])]
    assert rows[robot.joints[0]][:4] == [*first, *first]
    now, start = (int(value) for value in rows["gripper"][:4:2])
    assert now < start
    assert [int(value) for value in rows["gripper"][4:8:2]] == [now, start]
    assert rows["gripper"][8:] == ["0", "to", "100", "%"]


def test_a_dry_run(emulator: Emulator, words: list[str], capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def begun(arm: ServoArm, goals: Array, *rest: Any, **more: Any) -> stream.StreamResult:
        return stream.stream(arm, goals[:30], *rest, **more)

    monkeypatch.setattr("pbd.cli.run.drive.stream", begun)
    write_demo(with_long_stays(), Path("demos/stay"))
    code, _, err = run(capsys, "run", "stay", *words, "--port", emulator.device, "--dry-run")
    assert code == 0
    assert emulator.goals == []
    assert not any(servo.registers[40] for servo in emulator.servos.values())
    shown = [line.split() for line in err.splitlines() if line.startswith("shoulder_lift")]
    assert shown[0][1] == "-11.5°"  # where it stands: -0.2 rad
    assert "warning: the hand stayed 4.0 s at keyframe 1, the arm 0.5 s" in err
    assert "dry run done: the servos answered 30 times" in err


def test_an_arm_that_opens_its_gripper_at_the_end_is_not_said_to_go_home() -> None:
    moves = [1.0, 0.0, 1.0, 0.0]  # rad/s: to the first keyframe, a stay, to the last one, the gripper's stroke
    coefficients = np.array([[[at], [speed], [0.0], [0.0]] for at, speed in zip((0, 1, 1, 2), moves, strict=True)])
    gripper, ends = (np.array([3.0, 4.0]), np.array([0.0, 1.0])), np.array([1.0, 3.0])
    trajectory = JointTrajectory(("joint",), np.arange(5.0), coefficients, *gripper, ends, np.array([[1.0], [2.0]]))
    t = np.linspace(-0.5, 4.3, 49)
    said = "to the start 1.5 s, the demonstration 3.3 s: 4.8 s in all, then the arm holds"
    assert timetable(trajectory, t, retreats=False) == said
    assert "the demonstration 2.0 s, back home 1.3 s" in timetable(trajectory, t, retreats=True)


def test_a_dry_run_that_a_person_stops_holds_nothing(
    emulator: Emulator, words: list[str], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Keys, "next", lambda keys: "x")
    code, _, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--dry-run")
    assert (code, err.splitlines()[-1]) == (130, "pbd: stopped by hand after 0.00 s: nothing moved")


def test_it_lets_go_only_when_told(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    for servo in emulator.servos.values():
        servo.registers[40] = 1
    told = refused(capsys, 2, "run", *words, "--port", emulator.device, "--release")
    assert told == "pbd: pbd run asks before the arm moves: start it at a terminal, or with --yes"
    assert all(servo.registers[40] for servo in emulator.servos.values())
    ended = run(capsys, "run", *words, "--port", emulator.device, "--release", "--yes")
    assert ended == (0, "", "pbd: the servos have let go\n")
    assert not any(servo.registers[40] for servo in emulator.servos.values())
    assert run_json(capsys, "run", *words, "--port", emulator.device, "--release", "--yes")["released"]
    emulator.servos[5].put(3, (1284).to_bytes(2, "little"))
    assert "says it is model 1284" in refused(capsys, 1, "run", *words, "--port", emulator.device, "--release", "--yes")


def test_those_that_answer_let_go(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    for servo in emulator.servos.values():
        servo.registers[40] = 1
    emulator.servos[3].silent = True
    told = refused(capsys, 1, "run", *words, "--port", emulator.device, "--release", "--yes")
    assert "no answer from servo 3 (elbow_flex)" in told
    assert told.endswith("; shoulder_pan, shoulder_lift, wrist_flex, wrist_roll, gripper have let go")
    assert [id_ for id_, servo in emulator.servos.items() if servo.registers[40]] == [3]


def test_the_reason_is_said_to_a_reader_that_has_gone(
    emulator: Emulator, words: list[str], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(result: object) -> None:
        raise BrokenPipeError

    monkeypatch.setattr("pbd.cli.run.drive.print_json", gone)
    emulator.at_goal, emulator.fault = 100, lambda: emulator.servos[2].put(63, bytes([68]))
    code, _, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes", "--json")
    assert code == 141
    assert "shoulder_lift is at 68 °C, and switches off at 70: let it cool down; the arm holds" in err


def test_a_termination_is_no_answer(words: list[str]) -> None:
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as real:
        real.servos[1].registers[40] = 1
        terminal = Terminal("run", "--release", *words, "--port", real.device, cwd=Path.cwd())
        terminal.until("any other key cancels.")
        os.kill(terminal.process, signal.SIGTERM)
        terminal.until("stopped by SIGTERM; the servos are as they were: stiff ones still hold")
        assert terminal.exit_code() == 143
        assert real.servos[1].registers[40]


@pytest.mark.parametrize(
    ("key", "says"), [("\x03", "stopped by Ctrl-C"), ("x", "cancelled: run it again when you are")]
)
def test_a_calibration_that_a_person_stops_says_how_it_leaves_the_arm(words: list[str], key: str, says: str) -> None:
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as real:
        real.servos[1].registers[40] = 1
        terminal = Terminal("run", "--calibrate", *words, "--port", real.device, cwd=Path.cwd())
        terminal.until("any other key cancels.")
        terminal.type("\n")
        terminal.until("Enter when it stands there.")
        terminal.type(key)
        terminal.until(says)
        assert "; the servos have their old calibration again; the arm is loose" in terminal.rest().replace("\r\n", "")
        assert not real.servos[1].registers[40]


@pytest.mark.parametrize(
    ("robot", "way"),
    [
        ("ur5", "--format npz -o motion.npz`, and ur_rtde as"),
        ("z1", "--format ros2-json -o motion.json`, and ros2_control as"),
    ],
)
def test_other_arms_have_other_programs(robot: str, way: str, capsys: Capture) -> None:
    told = refused(capsys, 2, "run", "--robot", robot, "--yes")
    assert f"pbd run drives so100 and so101 alone; for {robot}: `pbd export DEMO --robot {robot} " in told
    assert way in told


def test_an_arm_that_was_moved_while_it_was_planned_for(
    emulator: Emulator, words: list[str], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def planned(*given: Any) -> Plan:
        emulator.servos[2].place += 60.0
        return plan_demonstration(*given)

    monkeypatch.setattr("pbd.cli.run.drive.plan_demonstration", planned)
    code, _, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes")
    says = "the arm was moved by 5.3 degrees since it was measured, so the motion doesn't begin there: run it again"
    assert (code, err.splitlines()[-1]) == (1, f"pbd: {says}")
    assert emulator.goals == []


def test_an_adapter_that_is_too_slow_to_stop_the_arm(
    emulator: Emulator, words: list[str], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bus, "ANSWER_S", 1e-6)
    line = refused(capsys, 1, "run", "pouring", *words, "--port", emulator.device, "--yes")
    assert "pbd: the servos' answers take " in line
    assert line.endswith(": lower the adapter's latency timer (docs/running.md), or close other programs")


def test_an_arm_that_may_not_hold_is_to_be_supported(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    emulator.at_goal, emulator.fault = 30, lambda: emulator.servos[3].put(40, b"\x00")
    code, out, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes", "--json")
    assert (code, json.loads(out)["held"]) == (1, False)
    says = "its servos did not confirm that they hold: support the arm, switch their power off if it still moves"
    assert err.splitlines()[-1].endswith(f"; {says}")


def test_no_arm_moves_unasked_by_whatever_demonstration_is_the_newest(
    emulator: Emulator, words: list[str], capsys: Capture
) -> None:
    told = refused(capsys, 2, "run", *words, "--port", emulator.device, "--yes")
    assert "with --yes the arm moves unasked: name the demonstration" in told
    assert emulator.goals == []


def test_an_arm_that_stands_outside_the_model(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    emulator.servos[2].place -= 1400.0
    told = refused(capsys, 3, "run", "pouring", *words, "--port", emulator.device, "--yes")
    assert "shoulder_lift stands at -135 degrees, outside the model's -100 to 100" in told
    assert emulator.goals == []


def test_a_motion_beyond_the_calibrated_range(emulator: Emulator, words: list[str], capsys: Capture) -> None:
    servos = calibration_of("so101")
    elbow = servos["elbow_flex"]
    narrow = replace(elbow, range_min=elbow.range_min + 420, range_max=elbow.range_max - 420)
    emulator.servos[3].put(9, encode_word(narrow.range_min) + encode_word(narrow.range_max))
    write_servo_calibration(servos | {"elbow_flex": narrow}, Path("servos.json"))
    code, _, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes")
    assert code == 3
    assert "elbow_flex would go" in err
    assert "degrees beyond the range that its calibration found" in err
    assert emulator.goals == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGQUIT])
def test_a_signal_stops_the_arm(emulator: Emulator, words: list[str], capsys: Capture, number: int) -> None:
    """As Ctrl-C and Ctrl-\\ are."""
    emulator.at_goal, emulator.fault = 20, lambda: os.kill(os.getpid(), number)
    code, _, err = run(capsys, "run", "pouring", *words, "--port", emulator.device, "--yes")
    assert code == 128 + number
    assert "stopped by hand after" in err
    assert "lets go of it" in err
    assert 20 < len(emulator.goals) < 250  # of 1100
    assert all(servo.registers[40] for servo in emulator.servos.values())


def test_a_person_at_a_terminal(words: list[str]) -> None:
    """In real time: asked, started with Enter, stopped with a key."""
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as real:
        terminal = Terminal("run", "paper-test2", *words, "--port", real.device, cwd=Path.cwd())
        terminal.until("the first time, take --speed 0.2. Enter starts it; any other key cancels.")
        assert real.goals == []
        terminal.type("\n")
        terminal.until("any key stops it")
        while len(real.goals) < 20:
            time.sleep(0.01)
        terminal.type("x")
        terminal.until("stopped by hand after")
        terminal.until("lets go of it")
        assert terminal.exit_code() == 130
        assert len(real.goals) < 250  # of 380
        assert all(servo.registers[40] for servo in real.servos.values())


def test_a_person_calibrates(words: list[str]) -> None:
    """Middles, then every joint from stop to stop; the file is LeRobot's, and the servos agree with it."""
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as real:
        for servo in real.servos.values():
            servo.registers[40] = 1
        words[-2:] = []
        terminal = Terminal("run", "--calibrate", *words, "--port", real.device, "--json", cwd=Path.cwd())
        terminal.until("Enter lets go; any other key cancels.")
        terminal.type("\n")
        terminal.until("Enter when it stands there.")
        assert not any(servo.registers[40] for servo in real.servos.values())
        middles = {id_: 1000.0 + 300.0 * id_ for id_ in real.servos}
        for id_, servo in real.servos.items():
            servo.place = middles[id_]
        terminal.type("\n")
        terminal.until("Enter when all are done")
        for id_, servo in real.servos.items():
            for way in (-1100 - id_, 1050 + id_) if id_ < 6 else (-700, 650):
                servo.place = middles[id_] + way
                terminal.until(str(2047 + way))
        terminal.type("\n")
        terminal.until("the arm is loose\r\n")
        shown = json.loads(terminal.rest())
        assert terminal.exit_code() == 0
        written = json.loads(Path("calibration/so101-servos.json").read_text())
        assert list(written) == [*load_robot("so101").joints, "gripper"]
        assert (shown["written"], shown["servos"]) == ("calibration/so101-servos.json", written)
        assert written["elbow_flex"] == {
            "id": 3,
            "drive_mode": 0,
            "homing_offset": round(middles[3]) - 2047,
            "range_min": 944,
            "range_max": 3100,
        }
        assert (written["wrist_roll"]["range_min"], written["wrist_roll"]["range_max"]) == (0, 4095)
        for name, each in written.items():
            servo = real.servos[each["id"]]
            has = (servo.number(31, 11), servo.number(9), servo.number(11))
            assert has == (each["homing_offset"], each["range_min"], each["range_max"]), name
            assert servo.registers[55] == 1  # locked again


@pytest.mark.parametrize(("key", "told"), [("\n", nullcontext()), ("x", pytest.raises(PbdError, match="cancelled: "))])
def test_joints_are_followed_until_a_key_where_nothing_is_shown(key: str, told: Any) -> None:
    pressed, followed = iter(("", "", key)), list[int]()
    keys: Any = SimpleNamespace(next=lambda: next(pressed), signal=0, ENTER=Keys.ENTER)
    keys.require_enter = partial(Keys.require_enter, keys)

    def follow() -> tuple[Array, Array]:
        followed.append(1)
        return np.zeros(6), np.ones(6)

    session: Any = SimpleNamespace(follow=follow)
    with told:
        _show_ranges(keys, session, {})
    assert len(followed) == 2


def test_a_calibration_that_is_given_up_changes_nothing(words: list[str]) -> None:
    """Not even the wheel mode, and the way of counting, in which it can't be made."""
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as real:
        real.servos[2].put(33, b"\x01")
        real.servos[3].put(18, b"\x1c")
        before = {id_: bytes(servo.registers[9:34]) for id_, servo in real.servos.items()}
        words[-1] = "new.json"
        terminal = Terminal("run", "--calibrate", *words, "--port", real.device, cwd=Path.cwd())
        terminal.until("Enter lets go")
        terminal.type("\n")
        terminal.until("Enter when it stands there.")
        terminal.type("\n")
        terminal.until("Enter when all are done")
        assert (real.servos[2].registers[33], real.servos[3].registers[18]) == (0, 0x0C)
        terminal.type("\n")  # nothing was moved
        terminal.until("move it from stop to stop")
        assert terminal.exit_code() == 1
        assert {id_: bytes(servo.registers[9:34]) for id_, servo in real.servos.items()} == before
        assert not Path("new.json").exists()
