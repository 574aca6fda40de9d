"""Six emulated STS3215 servos on a pseudo-terminal: registers, checksums, a first-order motion, and faults.

By hand: python -m tests.driving.emulator so101 prints a port and a calibration for `pbd run --port P --servos F`.
"""

import argparse
import math
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np

from pbd.driving.encoders import Encoders, servo_names
from pbd.driving.packets import checksum, decode_word, encode_word
from pbd.driving.stream import Clock
from pbd.files.robot import load_robot
from pbd.files.servo_calibration import ServoCalibration, write_servo_calibration

FOLLOWS_S, FASTEST = 0.05, 3550.0
"""Time constant of a servo, s (assumed), and its speed without load, counts/s: 52 rpm at 7.4 V."""

LEFT = (0.3, -0.2, 0.5, 0.9, -1.0)
"""Joints of a so101 that was left somewhere, rad."""

LOAD_A_COUNT = 4
"""Load in thousandths for each count between position and goal (assumed): P gain 32 saturates after 20 degrees."""


class Servo:
    """Registers, and a motor that follows its goal. `misread` falsifies its position in one answer, counts."""

    def __init__(self, calibration: ServoCalibration, counts: float) -> None:
        self.registers = bytearray(128)
        self.place = counts + calibration.homing_offset
        self.blocked = self.silent = self.snaps = self.deaf = False
        self.flags = self.misread = 0
        self.put(3, (777).to_bytes(2, "little"))
        self.put(5, bytes([calibration.id]))
        self.put(9, encode_word(calibration.range_min) + encode_word(calibration.range_max))
        self.put(13, bytes([70, 80, 40]) + encode_word(1000))
        self.put(31, encode_word(calibration.homing_offset, 11))
        self.put(42, encode_word(1000))  # an old goal: who switches torque on without another makes the arm jump
        self.put(55, b"\x01")
        self.put(62, bytes([74, 30]))

    def put(self, address: int, data: bytes) -> None:
        self.registers[address : address + len(data)] = data

    def number(self, address: int, sign_bit: int = 15) -> int:
        return decode_word(bytes(self.registers), address, sign_bit)

    @property
    def counts(self) -> float:
        return self.place - self.number(31, 11)

    def move(self, dt: float) -> None:
        """Follow the goal for `dt` s, and update the present registers. Without torque, `snaps` changes the goal."""
        if self.snaps and not self.registers[40]:
            self.put(42, encode_word(round(self.counts) + 1))
        goal = min(max(self.number(42), self.number(9)), self.number(11))
        off = goal - self.counts
        if self.registers[40] and not self.blocked:
            step = off * (1.0 - math.exp(-dt / FOLLOWS_S))
            self.place += min(max(step, -FASTEST * dt), FASTEST * dt)
        load = min(1000, int(LOAD_A_COUNT * abs(off))) if self.registers[40] else 0
        self.put(56, encode_word(round(self.counts)) + encode_word(0) + encode_word(load if off >= 0 else -load, 10))

    def write(self, address: int, data: bytes) -> None:
        """Write registers, as the servo does: its EEPROM may be locked."""
        if not self.deaf and (address >= 40 or not self.registers[55]):
            self.put(address, data)


class Emulator:
    """The bus with its servos, in a thread.

    Attributes:
        device: the pseudo-terminal.
        servos: by id.
        goals: when goals came (real s), and the goals by id. `places`: the servos' positions at those times.
        drop, corrupt, repeat: probability that a byte is lost, changed or doubled, in either direction.
        chatter: bytes that another device would send all the time.
        echo: whether the adapter sends back what it receives.
        at_goal, fault: a call after that many goals. `fault_t`: when it was made (real s).
    """

    def __init__(self, calibration: Mapping[str, ServoCalibration], counts: Mapping[str, float], clock: Clock) -> None:
        self.servos = {each.id: Servo(each, counts[name]) for name, each in calibration.items()}
        self.goals: list[tuple[float, dict[int, int]]] = []
        self.places: list[dict[int, float]] = []
        self.drop = self.corrupt = self.repeat = 0.0
        self.chatter, self.echo = b"", False
        self.at_goal, self.fault_t = 0, math.nan
        self.fault: Callable[[], object] | None = None
        self._clock, self._last, self._random = clock, clock.now(), np.random.default_rng(0)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.device = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="emulated servos", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()
        self.unplug()

    def wear_out(self, rate: float, seed: int) -> None:
        """Lose, change and double each byte with this probability from now on."""
        self._random, self.drop, self.corrupt, self.repeat = np.random.default_rng(seed), rate, rate, rate

    def unplug(self) -> None:
        """Pull the plug."""
        for handle in (self._master, self._slave):
            with suppress(OSError):
                os.close(handle)

    def _serve(self) -> None:
        buffer = bytearray()
        while not self._ended.is_set():
            try:
                if self.chatter:
                    os.write(self._master, self.chatter)
                if not select.select([self._master], [], [], 0.005)[0]:
                    continue
                came = os.read(self._master, 4096)
                if self.echo:
                    os.write(self._master, came)
                buffer += self._worn(came)
                self._take(buffer)
            except (OSError, ValueError):  # unplugged
                return

    def _worn(self, data: bytes) -> bytes:
        """Damage data as a bad cable does."""
        if not (self.drop or self.corrupt or self.repeat):
            return data
        worn = bytearray()
        for byte, (lost, changed, doubled) in zip(data, self._random.random((len(data), 3)), strict=True):
            byte ^= 0x10 if changed < self.corrupt else 0
            worn += b"" if lost < self.drop else bytes([byte, byte]) if doubled < self.repeat else bytes([byte])
        return bytes(worn)

    def _take(self, buffer: bytearray) -> None:
        while (start := buffer.find(b"\xff\xff")) >= 0 and len(buffer) >= start + 4:
            end = start + 4 + buffer[start + 3]
            if len(buffer) < end:
                if buffer[start + 3] > 250:
                    del buffer[: start + 1]
                    continue
                return
            body = bytes(buffer[start + 2 : end])
            if checksum(body[:-1]) == body[-1]:
                del buffer[:end]
                self._obey(body[0], body[2], body[3:-1])
            else:
                del buffer[: start + 1]

    def _obey(self, id_: int, instruction: int, data: bytes) -> None:
        now = self._clock.now()
        for servo in self.servos.values():
            servo.move(now - self._last)
        self._last = now
        if instruction == 0x83:
            address, length = data[0], data[1]
            parts = [data[i : i + 1 + length] for i in range(2, len(data), 1 + length)]
            for part in parts:
                if part[0] in self.servos:
                    self.servos[part[0]].write(address, part[1:])
            if address == 42:
                self.goals.append((time.monotonic(), {part[0]: decode_word(part, 1) for part in parts}))
                self.places.append({id_: servo.counts for id_, servo in self.servos.items()})
                if len(self.goals) == self.at_goal and self.fault is not None:
                    self.fault_t = time.monotonic()
                    self.fault()
        elif instruction == 0x82:
            for each in data[2:]:
                self._answer(each, data[0], data[1])
        elif instruction == 1:
            self._answer(id_, 0, 0)
        elif instruction == 2:
            self._answer(id_, data[0], data[1])
        elif instruction == 3 and id_ in self.servos:
            self.servos[id_].write(data[0], data[1:])
            self._answer(id_, 0, 0)

    def _answer(self, id_: int, address: int, length: int) -> None:
        servo = self.servos.get(id_)
        if servo is None or servo.silent:
            return
        data = bytes(servo.registers[address : address + length])
        if servo.misread and address == 56:
            data, servo.misread = encode_word(decode_word(data) + servo.misread) + data[2:], 0
        body = bytes([id_, length + 2, servo.flags]) + data
        os.write(self._master, self._worn(b"\xff\xff" + body + bytes([checksum(body)])))


def calibration_of(robot_name: str) -> dict[str, ServoCalibration]:
    """A plausible calibration: ranges a little wider than the model's, and any offsets."""
    ranges = ((884, 3320), (756, 3353), (868, 3061), (805, 3153), (0, 4095), (1899, 3363))
    offsets = (120, -85, 1020, -1400, 3, 0)
    names = servo_names(load_robot(robot_name))
    return {
        name: ServoCalibration(i, 0, offset, low, high)
        for i, (name, offset, (low, high)) in enumerate(zip(names, offsets, ranges, strict=True), start=1)
    }


def resting(robot_name: str, q: tuple[float, ...] | None = None) -> dict[str, float]:
    """Counts of the servos with the arm at joints q (home), the gripper half open."""
    robot = load_robot(robot_name)
    encoders = Encoders(robot, calibration_of(robot_name))
    at = encoders.from_joints(np.array([robot.home if q is None else q]), np.array([0.5]))[0]
    return dict(zip(encoders.names, at.tolist(), strict=True))


def main() -> None:
    """Serve until Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m tests.driving.emulator", description=__doc__)
    parser.add_argument("robot", nargs="?", default="so101")
    robot = parser.parse_args().robot
    calibration = calibration_of(robot)
    with tempfile.TemporaryDirectory() as folder, Emulator(calibration, resting(robot), Clock()) as emulator:
        file = Path(folder) / "servos.json"
        write_servo_calibration(calibration, file)
        print(f"pbd run pouring --robot {robot} --port {emulator.device} --servos {file}", flush=True)
        with suppress(KeyboardInterrupt):
            threading.Event().wait()


if __name__ == "__main__":
    main()
