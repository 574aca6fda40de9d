"""The bus on a pseudo-terminal; Feetech's own SDK as the judge of the emulator."""

import pickle
from collections.abc import Iterator

import numpy as np
import pytest
import scservo_sdk

from pbd.driving.bus import Bus, NoAnswerError
from pbd.driving.calibrating import calibrating
from pbd.driving.packets import Answer, decode_word, encode_word, take_answers
from pbd.driving.servo_arm import PRESENT, release
from pbd.driving.stream import Clock
from pbd.errors import CalibrationError, SensorError
from pbd.files.robot import load_robot
from tests.driving.emulator import Emulator, calibration_of, resting
from tests.driving.relaxed_timing import PATIENT_S, connect


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with Emulator(calibration_of("so101"), resting("so101"), Clock()) as emulator:
        yield emulator


def test_feetechs_sdk_reads_and_writes_the_emulated_servos(emulator: Emulator) -> None:
    port = scservo_sdk.PortHandler(emulator.device)
    port.setBaudRate(1_000_000)
    port.setPacketTimeout = lambda length: port.setPacketTimeoutMillis(1e3 * PATIENT_S)  # its own is 34 ms
    packets = scservo_sdk.PacketHandler(0)
    assert packets.ping(port, 3) == (777, 0, 0)
    reader = scservo_sdk.GroupSyncRead(port, packets, PRESENT, 2)
    for id_ in range(1, 7):
        reader.addParam(id_)
    assert reader.txRxPacket() == 0
    assert [reader.getData(id_, PRESENT, 2) for id_ in range(1, 7)] == [round(c) for c in resting("so101").values()]
    writer = scservo_sdk.GroupSyncWrite(port, packets, 42, 2)
    writer.addParam(2, [0x34, 0x0A])
    assert writer.txPacket() == 0
    assert packets.read2ByteTxRx(port, 2, 42) == (0x0A34, 0, 0)
    port.closePort()


def test_an_arm_is_read_stiffened_and_released(emulator: Emulator) -> None:
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        state = arm.state()
        np.testing.assert_allclose(arm.encoders.to_joints(state.counts), load_robot("so101").home, atol=2e-3)
        np.testing.assert_array_equal(state.volts, 7.4)
        np.testing.assert_array_equal(state.celsius, 30.0)
        arm.enable_torque(state.counts)
        goals = [servo.number(42) for servo in emulator.servos.values()]
        assert goals == state.counts.tolist()  # not the goal of before, to which the arm would jump
        assert all(servo.registers[40] for servo in emulator.servos.values())
        assert emulator.servos[6].number(48) == 500
        release(bus, arm.encoders.ids)
        assert not any(servo.registers[40] for servo in emulator.servos.values())


def test_an_earlier_programs_acceleration_is_lifted(emulator: Emulator) -> None:
    """Else a servo told to stop runs on: at 10 by 21 degrees from 60 degrees/s."""
    for servo in emulator.servos.values():
        servo.put(41, bytes([10]))
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        arm.enable_torque(arm.state().counts)
    assert {servo.registers[41] for servo in emulator.servos.values()} == {254}


def test_an_earlier_programs_torque_limit_is_lifted(emulator: Emulator) -> None:
    """Else an arm with torque falls. The servo's permanent limit stays, and the gripper's own."""
    for servo in emulator.servos.values():
        servo.put(48, encode_word(0))
    emulator.servos[2].put(16, encode_word(800))
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        arm.enable_torque(arm.state().counts)
    assert [servo.number(48) for servo in emulator.servos.values()] == [1000, 800, 1000, 1000, 1000, 500]


def test_no_goal_lies_outside_the_calibrated_range(emulator: Emulator) -> None:
    """As of fingers that are pressed past their end. Whether a servo takes such a goal isn't known."""
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        arm.enable_torque(arm.encoders.lower - 3.0)
        assert [servo.number(42) for servo in emulator.servos.values()] == arm.encoders.lower.tolist()
        arm.hold(arm.encoders.upper + 3.0)
        assert [servo.number(42) for servo in emulator.servos.values()] == arm.encoders.upper.tolist()


def test_loose_servos_may_keep_no_goal(emulator: Emulator) -> None:
    for servo in emulator.servos.values():
        servo.snaps = True
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        stood = arm.state().counts
        arm.enable_torque(stood)
        assert [servo.number(42) for servo in emulator.servos.values()] == stood.tolist()


def test_goals_that_do_not_arrive_leave_the_arm_loose(emulator: Emulator) -> None:
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        emulator.servos[2].deaf = True
        with pytest.raises(SensorError, match=r"did not take what was written; .* may be stiff already"):
            arm.enable_torque(arm.state().counts)
        assert not any(servo.registers[40] for servo in emulator.servos.values())


def test_a_servo_that_falls_silent_leaves_the_others_stiff(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(address: int, data: bytes) -> None:
        take(address, data)
        servo.silent = address == 40

    servo = emulator.servos[4]
    take = servo.write
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        counts = arm.state().counts
        monkeypatch.setattr(servo, "write", write)
        with pytest.raises(SensorError, match=r"servo 4 .* not answer; .*; the other servos may be stiff already"):
            arm.enable_torque(counts)
    assert all(each.registers[40] for each in emulator.servos.values())


def test_the_error_about_a_silent_servo_reaches_another_process() -> None:
    error = pickle.loads(pickle.dumps(NoAnswerError("servo 4 is silent", ids=(4,), heard=b"")))
    assert (str(error), error.fields) == ("servo 4 is silent", {"ids": (4,), "heard": b""})


def test_a_bad_cable_is_asked_again(emulator: Emulator) -> None:
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        wanted, bus.answer_s = arm.state().counts, 0.6  # what was lost is waited for in vain
        for seed in range(40):  # each its own: where this computer is busy, the others lose what they lost before
            emulator.wear_out(5e-4, seed)
            np.testing.assert_array_equal(arm.state().counts, wanted)
        assert bus.asked_again > 0


def test_an_adapter_that_echoes_does_no_harm(emulator: Emulator) -> None:
    emulator.echo = True
    with Bus.open(emulator.device, PATIENT_S) as bus:
        arm = connect(bus)
        arm.enable_torque(arm.state().counts)
        assert bus.asked_again == 0


def silence(emulator: Emulator) -> None:
    emulator.servos[4].silent = True


def silence_all(emulator: Emulator) -> None:
    for servo in emulator.servos.values():
        servo.silent = True


def chatter(emulator: Emulator) -> None:
    silence_all(emulator)
    emulator.chatter = b"#YPR=1.0,2.0,3.0\r\n"


def other_model(emulator: Emulator) -> None:
    emulator.servos[5].put(3, (1284).to_bytes(2, "little"))


def wheel_mode(emulator: Emulator) -> None:
    emulator.servos[1].put(33, b"\x01")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (silence, "no answer from servo 4 (wrist_flex) on .*; the others answer: check cable and id"),
        (
            silence_all,
            "no servo answers on .* at 1000000 baud: switch the arm's power supply on, and check that this is its port",
        ),
        (chatter, r"what answers on .* is no servo \(it sends '.*YPR.*'\); name the arm's --port"),
        (other_model, "servo 5 (wrist_roll) says it is model 1284, not an STS3215 (777); pbd run drives no other"),
        (wheel_mode, "servo 1 (shoulder_pan) is in mode 1, not in position mode; calibrate anew"),
    ],
)
def test_what_is_no_arm_is_refused(emulator: Emulator, wrong: object, says: str) -> None:
    assert callable(wrong)
    wrong(emulator)
    escaped = says if "\\" in says else says.replace("(", r"\(").replace(")", r"\)")
    with Bus.open(emulator.device, 0.2) as bus, pytest.raises(SensorError, match=escaped):
        connect(bus)


def test_another_arms_calibration_is_refused(emulator: Emulator) -> None:
    emulator.servos[3].put(31, encode_word(-77, 11))
    with (
        Bus.open(emulator.device, PATIENT_S) as bus,
        pytest.raises(
            CalibrationError,
            match=r"for elbow_flex it gives .*\(1020, 868, 3061\), but the servo has \(-77, 868, 3061\)",
        ),
    ):
        connect(bus)


def test_a_calibration_that_can_not_be_undone_says_so(emulator: Emulator) -> None:
    def begin(bus: Bus) -> None:
        with calibrating(bus, {f"servo {id_}": id_ for id_ in emulator.servos}) as session:
            session.set_middles()
            silence(emulator)
            session.follow()

    says = r"servo 4 .* did not answer; .* the servos did not all get their old calibration back: calibrate anew"
    with Bus.open(emulator.device, 0.1) as bus, pytest.raises(SensorError, match=says):
        begin(bus)


def test_a_damaged_answer_is_no_end_of_a_range(emulator: Emulator) -> None:
    with Bus.open(emulator.device, PATIENT_S) as bus, calibrating(bus, {"shoulder": 1, "elbow": 2}) as session:
        session.set_middles()
        for counts in (400, -400):
            emulator.servos[2].misread = counts
            session.follow()
            lowest, highest = session.follow()
        assert (highest - lowest).max() <= 1


def test_answers_are_found_among_what_is_broken() -> None:
    good = bytes.fromhex("ffff0103000af1")  # servo 1: one register that holds 10
    buffer = bytearray(b"\xff\x00\xff\xff\x01" + good[:-1] + b"\x00" + good + b"\xff\xff\x02")
    assert list(take_answers(buffer)) == [Answer(1, 0, b"\x0a")]
    assert bytes(buffer) == b"\xff\xff\x02"
    cut = bytearray(good[:-1])
    assert list(take_answers(cut)) == []
    assert list(take_answers(cut + good[-1:])) == [Answer(1, 0, b"\x0a")]


@pytest.mark.parametrize("value", [0, 1, -1, 2047, -2047])
def test_a_number_with_its_own_sign_bit(value: int) -> None:
    assert decode_word(encode_word(value, 11), sign_bit=11) == value
