"""What ends a motion: each fault in a stop of the arm, and one line that says what to do."""

import re
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from pbd.driving.bus import Bus
from pbd.driving.encoders import Encoders
from pbd.driving.motion_monitor import MotionMonitor, check_health
from pbd.driving.servo_arm import WRITE_TRIES, ServoLimits, ServoState
from pbd.driving.stream import Clock, StreamResult, planned_start, stream
from pbd.errors import CalibrationError, PlanError, SensorError
from pbd.files.robot import load_robot
from pbd.pose import Array
from tests.driving.emulator import Emulator, calibration_of, resting
from tests.driving.relaxed_timing import PATIENT_S, UNHURRIED_S, FastClock, connect
from tests.not_none import not_none

RATE_HZ = 50.0
FAULT_AT = 20
"""The goal after which something goes wrong."""

STIFFENING = 2
"""Goals that the arm is given before the motion's."""

ELBOW = 2
SPEED = 8.0
"""Counts that the elbow is to go each period: 0.6 rad/s."""


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with Emulator(calibration_of("so101"), resting("so101"), FastClock()) as emulator:
        emulator.at_goal = FAULT_AT
        yield emulator


def swing(
    emulator: Emulator,
    goals: int = 150,
    answer_s: float = PATIENT_S,
    stop_wanted: Callable[[], bool] = lambda: False,
    clock: Clock | None = None,
    stall_s: float = UNHURRIED_S,
    dry_run: bool = False,
    speed: float = SPEED,
    tolerance_deg: float = 10.0,
) -> StreamResult:
    """Swing the elbow."""
    clock = clock or FastClock()
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        start = arm.state()
        if not dry_run:
            arm.enable_torque(start.counts)
        path = np.tile(start.counts, (goals, 1))
        path[:, ELBOW] += speed * np.arange(goals)
        fault = emulator.fault

        def impatient() -> None:
            """Sound servos have time, however busy the machine is."""
            bus.answer_s = answer_s
            if fault is not None:
                fault()

        emulator.fault = impatient
        monitor = MotionMonitor(arm.encoders.names, arm.bounds, start, tolerance_deg, RATE_HZ)
        with patch("pbd.driving.stream.STALL_S", stall_s):
            return stream(arm, path, RATE_HZ, monitor, clock, stop_wanted, dry_run)


def hot(emulator: Emulator) -> None:
    emulator.servos[2].put(63, bytes([66]))


def weak(emulator: Emulator) -> None:
    emulator.servos[5].put(62, bytes([55]))


def complaining(emulator: Emulator) -> None:
    emulator.servos[3].flags = 32


def blocked(emulator: Emulator) -> None:
    emulator.servos[3].blocked = True


def silent(emulator: Emulator) -> None:
    emulator.servos[4].silent = True


def cut(emulator: Emulator) -> None:
    emulator.drop = 0.5


FAULTS: dict[Callable[[Emulator], None], str] = {
    hot: "shoulder_lift is at 66 °C, and switches off at 70: let it cool down",
    weak: "the voltage at wrist_roll fell to 5.5 V, below 5.9 V: use a stronger power supply",
    complaining: "the servo of elbow_flex reports a fault \\(load\\): switch the arm off and on, and look at it",
    silent: "servo 4 on .* did not answer; check the cables and the arm's power supply",
    cut: "servo.* did not answer; check the cables and the arm's power supply",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_stops_the_arm_at_the_next_look(emulator: Emulator, fault: Callable[[Emulator], None]) -> None:
    emulator.fault = lambda: fault(emulator)
    slow = fault in (silent, cut)
    done = swing(emulator, answer_s=0.2 if slow else PATIENT_S)
    assert done.stopped is not None
    assert not done.by_hand
    assert done.sent == FAULT_AT - STIFFENING
    assert len(emulator.goals) <= FAULT_AT + WRITE_TRIES  # nothing but the goal that holds it
    assert done.held is not slow
    assert re.fullmatch(FAULTS[fault], done.stopped.message), done.stopped.message


def test_a_blocked_joint_is_held_where_it_is(emulator: Emulator) -> None:
    """Not at its goal, towards which it would push."""
    emulator.fault = lambda: blocked(emulator)
    done = swing(emulator)
    assert done.stopped is not None
    assert "elbow_flex is 10." in done.stopped.message
    assert "off its goal, beyond 10 (--tolerance): clear its way, or run slower (--speed)" in done.stopped.message
    before, held = emulator.goals[-2][1][3], emulator.goals[-1][1][3]
    assert held == round(emulator.servos[3].counts)
    assert before - held > 100


def test_one_wrong_answer_moves_nothing(emulator: Emulator) -> None:
    """A damaged answer may pass its checksum. The arm must not be sent to where it says."""

    def damage() -> None:
        emulator.servos[2].misread = 1024

    emulator.fault = damage
    assert swing(emulator, 40).stopped is None
    assert {goal[2] for _, goal in emulator.goals} == {round(emulator.servos[2].counts)}


@pytest.mark.parametrize(("servo", "name"), [(3, "elbow_flex"), (6, "gripper")])
def test_a_servo_that_was_without_power_does_not_hold(emulator: Emulator, servo: int, name: str) -> None:
    emulator.fault = lambda: emulator.servos[servo].put(40, b"\x00")
    done = swing(emulator)
    assert not_none(done.stopped).message.startswith(
        f"{name} lost torque, as after a moment without power: check the cables"
    )
    assert not done.held


def test_a_joint_that_pushes_too_long(emulator: Emulator) -> None:
    """Blocked a little off its goal: within the tolerance, but at the end of its strength."""

    def press() -> None:
        blocked(emulator)
        emulator.servos[3].place -= 240.0  # 1000 of load, at a tolerance that allows it

    emulator.fault = press
    done = swing(emulator, 80, speed=0.0, tolerance_deg=45.0)
    assert "elbow_flex has pushed with more than 80 % of its strength for 0.5 s" in not_none(done.stopped).message
    assert FAULT_AT + 20 < done.sent < FAULT_AT + 30


def test_the_gripper_may_press_on_what_it_holds(emulator: Emulator) -> None:
    def grip() -> None:
        emulator.servos[6].blocked = True
        emulator.servos[6].place += 300.0

    emulator.fault = grip
    assert swing(emulator, 60).stopped is None


@pytest.mark.parametrize(("flags", "sound"), [(32, True), (32 | 8, False)])
def test_an_overloaded_gripper_still_grips(emulator: Emulator, flags: int, sound: bool) -> None:
    """As it is after 2 s of grasping, where LeRobot has configured it. It has no other fault."""
    emulator.fault = lambda: setattr(emulator.servos[6], "flags", flags)
    stopped = swing(emulator, 60).stopped
    assert (stopped is None) is sound
    assert sound or "the servo of gripper reports a fault (current)" in str(stopped)


def test_a_person_stops_it(emulator: Emulator) -> None:
    wanted = iter([False] * FAULT_AT + [True] * 1000)
    done = swing(emulator, stop_wanted=lambda: next(wanted))
    assert (done.by_hand, done.stopped, done.sent) == (True, None, FAULT_AT)
    assert abs(emulator.goals[-1][1][3] - emulator.servos[3].counts) < 3 * SPEED


@pytest.mark.parametrize("dry_run", [False, True])
def test_a_person_stops_it_before_the_first_goal(emulator: Emulator, dry_run: bool) -> None:
    done = swing(emulator, stop_wanted=lambda: True, dry_run=dry_run)
    assert (done.by_hand, done.sent, done.held) == (True, 0, True)
    assert len(emulator.goals) == (0 if dry_run else STIFFENING + 1)


def test_an_arm_that_is_silent_before_the_first_goal_is_not_said_to_hold(emulator: Emulator) -> None:
    class Cutting(FastClock):
        def sleep_until(self, t: float) -> None:
            not_none(emulator.fault)()

    emulator.fault = lambda: silent(emulator)
    done = swing(emulator, answer_s=0.05, clock=Cutting())
    assert (done.sent, done.by_hand, done.held) == (0, False, False)


def test_a_pulled_plug(emulator: Emulator) -> None:
    emulator.fault = emulator.unplug
    done = swing(emulator, answer_s=0.03)
    assert re.search(r"the arm was unplugged|takes no command \(\w|did not answer", not_none(done.stopped).message)
    assert not done.held


def test_a_computer_that_was_busy(emulator: Emulator) -> None:
    class Napping(FastClock):
        naps = 0

        def sleep_until(self, t: float) -> None:
            self.naps += 1
            super().sleep_until(t + (6.0 if self.naps == FAULT_AT else 0.0))

    done = swing(emulator, clock=Napping(), stall_s=4.0)
    assert "this computer was busy for 6" in not_none(done.stopped).message
    # Meanwhile the elbow went on to its last goal. It is held there, not sent back to where it was seen before.
    assert abs(emulator.goals[-1][1][3] - emulator.servos[3].counts) <= 1.0


def test_a_late_goal_moves_all_that_follow(emulator: Emulator) -> None:
    """A goal is never skipped, so that the arm never jumps."""

    class Late(FastClock):
        naps = 0

        def sleep_until(self, t: float) -> None:
            self.naps += 1
            super().sleep_until(t + (0.5 if self.naps == FAULT_AT else 0.0))

    done = swing(emulator, 60, clock=Late())
    steps = np.diff([goal[3] for _, goal in emulator.goals[STIFFENING:]])
    assert done.sent == 60
    np.testing.assert_array_equal(steps, SPEED)


def test_a_dry_run_gives_no_goals(emulator: Emulator) -> None:
    done = swing(emulator, 10, dry_run=True)
    assert done.sent == 10
    assert emulator.goals == []
    assert not emulator.servos[1].registers[40]


@pytest.mark.parametrize(
    ("address", "value", "says"),
    [
        (63, 65, "shoulder_pan is at 65 °C, and switches off at 70"),
        (62, 120, r"shoulder_pan has 12.0 V, outside its 4 to 8 V"),
    ],
)
def test_an_arm_that_should_not_start(emulator: Emulator, address: int, value: int, says: str) -> None:
    emulator.servos[1].put(address, bytes([value]))
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        with pytest.raises(SensorError, match=says):
            check_health(arm.encoders.names, arm.bounds, arm.state())


def standing(counts: Array) -> ServoState:
    n = len(counts)
    return ServoState(counts, np.zeros(n), np.full(n, 7.4), np.full(n, 30.0), (0,) * n)


def so101() -> Encoders:
    return Encoders(load_robot("so101"), calibration_of("so101"))


def test_after_a_late_goal_none_comes_sooner_than_half_a_period() -> None:
    """Else the servos would make up for the time by going faster."""

    class Late(Clock):
        t = 0.0

        def now(self) -> float:
            return self.t

        def sleep_until(self, t: float) -> None:
            self.t = max(self.t, t) + (0.09 if 0.4 <= t < 0.41 else 0.0)

    arm: Any = SimpleNamespace(
        state=lambda: standing(np.zeros(6)), send_goals=lambda goal: None, check_torque=lambda: None
    )
    monitor: Any = SimpleNamespace(check=lambda state: None, add_goal=lambda goal: None)
    done = stream(arm, np.zeros((60, 6)), RATE_HZ, monitor, Late(), lambda: False)
    assert done.periods.max() == pytest.approx(0.11)
    assert done.periods.min() >= 0.5 / RATE_HZ - 1e-9


@pytest.mark.parametrize(("behind_s", "sound"), [(0.2, True), (0.3, False)])
def test_a_servo_may_be_a_quarter_of_a_second_behind(behind_s: float, sound: bool) -> None:
    """At 20 degrees a period, it is as many off as it is periods more behind than it may be."""
    encoders, n = so101(), 6
    bounds = ServoLimits(np.full(n, 70.0), np.full(n, 4.0), np.full(n, 8.0))
    path = np.full((40, n), 2048.0) + np.eye(n)[ELBOW] * 4096.0 / 18.0 * np.arange(40)[:, None]
    monitor = MotionMonitor(encoders.names, bounds, standing(path[0]), 10.0, RATE_HZ)
    for goal in path:
        monitor.add_goal(goal)
    with nullcontext() if sound else pytest.raises(SensorError, match=r"elbow_flex is .* degrees off its goal"):
        monitor.check(standing(path[-1 - round(behind_s * RATE_HZ)]))


@pytest.mark.parametrize(("beyond", "sound"), [(0.9, True), (1.1, False)])
def test_a_goal_may_leave_the_calibrated_range_by_a_count(beyond: float, sound: bool) -> None:
    encoders = so101()
    with nullcontext() if sound else pytest.raises(PlanError, match=r"shoulder_pan would go 0\.1 degrees beyond"):
        encoders.check_range(np.zeros(1), encoders.lower[None] - beyond * np.eye(6)[0])


@pytest.mark.parametrize(("degrees", "sound"), [(4.0, True), (6.0, False)])
def test_an_arm_five_degrees_outside_the_model_starts_at_its_limit(degrees: float, sound: bool) -> None:
    encoders, robot = so101(), load_robot("so101")
    q = robot.home + (robot.limits.upper[1] + np.radians(degrees) - robot.home[1]) * np.eye(5)[1]
    state = standing(encoders.from_joints(q[None], np.ones(1))[0])
    with nullcontext() if sound else pytest.raises(PlanError, match=r"shoulder_lift stands at .* outside the model's"):
        assert planned_start(encoders, state, robot.limits)[1] == robot.limits.upper[1]


@pytest.mark.parametrize("counts", [-1.0, 4096.0])
def test_an_arm_whose_servo_counts_turns_does_not_start(counts: float) -> None:
    """It would be told to go back by a turn."""
    encoders, robot = so101(), load_robot("so101")
    at = encoders.from_joints(np.array([robot.home]), np.ones(1))[0]
    at[4] = counts
    with pytest.raises(CalibrationError, match=r"the servo of wrist_roll counts turns: it says .*; calibrate anew"):
        planned_start(encoders, standing(at), robot.limits)
