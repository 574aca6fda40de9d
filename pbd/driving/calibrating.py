"""Calibrate the servos as LeRobot does: a person moves each joint to its middle, then to both ends.

Source: lerobot/robots/so101_follower/so101_follower.py, `calibrate`, and lerobot/motors/motors_bus.py.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from pbd.driving.bus import Bus
from pbd.driving.packets import decode_word, encode_word
from pbd.driving.servo_arm import (
    COUNTS_TURNS,
    IDENTITY,
    LOCK,
    MODE,
    OFFSET,
    OFFSET_SIGN,
    PHASE,
    PRESENT,
    RANGE,
    identify,
    release,
    write_verified,
)
from pbd.errors import SensorError, noting
from pbd.files.servo_calibration import COUNTS, LARGEST_OFFSET_COUNTS, ServoCalibration
from pbd.pose import Array

MIDDLE = COUNTS // 2 - 1
"""Count of a servo in the middle of its joint's range."""

CALIBRATED = ((PHASE, 1), (RANGE, 4), (OFFSET, 2), (MODE, 1))
"""The registers that a calibration writes: address and number of bytes."""

FULL_TURN_JOINT = "wrist_roll"
"""The joint that LeRobot lets rotate by a full turn, so its ends are not calibrated."""


class Calibrating:
    """A calibration under way, while the servos' permanent memory is unlocked."""

    def __init__(self, bus: Bus, ids: Mapping[str, int]) -> None:
        self._bus, self._ids = bus, dict(ids)
        self._lowest = np.full(len(ids), MIDDLE)
        self._highest = self._latest = self._lowest

    def set_middles(self) -> None:
        """Set the homing offsets so that the arm's present position is the middle of every joint's range."""
        found = self._bus.read(tuple(self._ids.values()), PHASE, 1)
        write_verified(self._bus, PHASE, {i: bytes([each.data[0] & ~COUNTS_TURNS]) for i, each in found.items()})
        full_range = encode_word(0) + encode_word(COUNTS - 1)
        for address, data in ((RANGE, full_range), (OFFSET, encode_word(0)), (MODE, b"\x00")):
            write_verified(self._bus, address, dict.fromkeys(self._ids.values(), data))
        offsets = np.clip(self.counts() - MIDDLE, -LARGEST_OFFSET_COUNTS, LARGEST_OFFSET_COUNTS).tolist()
        words = (encode_word(offset, OFFSET_SIGN) for offset in offsets)
        write_verified(self._bus, OFFSET, dict(zip(self._ids.values(), words, strict=True)))

    def counts(self) -> Array:
        """Read the servos' positions (n,), counts."""
        found = self._bus.read(tuple(self._ids.values()), PRESENT, 2)
        return np.array([decode_word(found[id_].data) for id_ in self._ids.values()])

    def follow(self) -> tuple[Array, Array]:
        """Read the servos' positions; return the lowest and the highest so far, (n,) counts each.

        A position counts once the next one confirms it: a damaged answer may pass its checksum.
        """
        before, self._latest = self._latest, self.counts()
        self._lowest = np.minimum(self._lowest, np.maximum(before, self._latest))
        self._highest = np.maximum(self._highest, np.minimum(before, self._latest))
        return self._lowest, self._highest

    def result(self) -> dict[str, ServoCalibration]:
        """Return the calibration."""
        found = self._bus.read(tuple(self._ids.values()), OFFSET, 2)
        servos = {}
        for (name, id_), low, high in zip(self._ids.items(), self._lowest, self._highest, strict=True):
            ends = (0, COUNTS - 1) if name == FULL_TURN_JOINT else (max(0, int(low)), min(COUNTS - 1, int(high)))
            offset = decode_word(found[id_].data, sign_bit=OFFSET_SIGN)
            servos[name] = ServoCalibration(id_, 0, offset, *ends)
        return servos

    def store(self, servos: Mapping[str, ServoCalibration]) -> None:
        """Write the ranges into the servos."""
        ranges = {each.id: encode_word(each.range_min) + encode_word(each.range_max) for each in servos.values()}
        write_verified(self._bus, RANGE, ranges)


@contextmanager
def calibrating(bus: Bus, ids: Mapping[str, int]) -> Iterator[Calibrating]:
    """Switch torque off and unlock the servos' permanent memory; lock it at the end.

    An error inside restores the old CALIBRATED registers. Notes on it say so, and that the arm is loose.

    Raises:
        SensorError: the servos do not answer, or are of another model; or their old values could not be restored.
    """
    before, locked = identify(bus, ids), dict.fromkeys(ids.values(), b"\x01")
    release(bus, tuple(ids.values()))
    with noting("the arm is loose"):
        write_verified(bus, LOCK, dict.fromkeys(ids.values(), b"\x00"))
        try:
            yield Calibrating(bus, ids)
        except BaseException as stop:
            try:
                for address, length in CALIBRATED:
                    old = (data[address - IDENTITY :][:length] for data in before)
                    write_verified(bus, address, dict(zip(ids.values(), old, strict=True)))
                write_verified(bus, LOCK, locked)
            except SensorError as error:
                what = f"{error.message}; the servos did not all get their old calibration back: calibrate anew"
                raise SensorError(what, **error.fields) from error
            stop.add_note("the servos have their old calibration again")
            raise
        write_verified(bus, LOCK, locked)
