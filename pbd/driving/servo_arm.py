"""The arm's servos on the bus: identity, state, goals, torque."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import eq

import numpy as np

from pbd.driving.bus import BAUD, Bus, NoAnswerError
from pbd.driving.encoders import Encoders
from pbd.driving.packets import decode_word, encode_word
from pbd.errors import CalibrationError, SensorError, listed, printable
from pbd.pose import Array

STS3215 = 777
"""The servos' model number."""

# Registers: first address, and number of bytes to read. Source: Feetech's memory table of the STS series, as in
# lerobot/motors/feetech/tables.py.
IDENTITY, IDENTITY_LENGTH = 3, 31
"""The servo's permanent memory. It begins with the model number."""
RANGE, MAX_CELSIUS, MAX_VOLTS, MIN_VOLTS, MAX_TORQUE, PHASE, OFFSET, MODE = 9, 13, 14, 15, 16, 18, 31, 33
"""Addresses in it: position limits (two words), highest temperature (°C), highest and lowest voltage (0.1 V), torque
limit at power-on (0 to 1000), phase (COUNTS_TURNS is one of its bits), homing offset, mode (0: position)."""
COUNTS_TURNS = 0x10
"""Bit of the phase with which a position doesn't pass from 4095 to 0 but goes on, and after a power cycle may differ by
a turn. Some servos come from the factory with it. LeRobot clears it (lerobot/motors/feetech/feetech.py,
`configure_motors`)."""
TORQUE_ENABLE, ACCELERATION, GOAL, TORQUE_LIMIT, LOCK = 40, 41, 42, 48, 55
"""Addresses outside the permanent memory: torque (0: off), acceleration (100 counts/s2), goal position (counts), torque
limit (0 to 1000), lock of the permanent memory (1: locked)."""
PRESENT, PRESENT_LENGTH = 56, 8
"""The present state: position at address 56, speed at 58, load at 60, voltage (0.1 V) at 62, temperature (°C) at 63."""

OFFSET_SIGN, LOAD_SIGN = 11, 10
"""Sign bits of a homing offset and of a load."""

GRIPPER_TORQUE = 500
"""Largest torque limit of the gripper, which closes on things, while pbd drives, 0 to 1000. Source:
so101_follower.py."""

FASTEST_ACCELERATION = 254
"""Acceleration with which a servo follows its goals, 100 counts/s2: the largest that the register takes, 39 rad/s2. A
servo keeps what an earlier program wrote, and with a low one it runs far past a goal that should stop it. Source:
lerobot/motors/feetech/feetech.py, `configure_motors`."""

GOAL_TOLERANCE = 20
"""Largest distance of a goal from the servo's position when torque is switched on, counts: 1.8 degrees, no jump."""

WRITE_TRIES = 3
"""Largest number of attempts to write registers until they read back as written."""


class LostTorqueError(SensorError):
    """A servo has no torque, as after a moment without power."""


@dataclass(frozen=True, eq=False)
class ServoState:
    """State of all servos at one instant, base to gripper.

    Attributes:
        counts: (n,) positions, encoder counts.
        load: (n,) signed share of each servo's strength, -1 to 1.
        volts, celsius: (n,).
        flags: (n,) the servos' error flags.
    """

    counts: Array
    load: Array
    volts: Array
    celsius: Array
    flags: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ServoLimits:
    """The servos' own limits of temperature and supply voltage, (n,) each."""

    celsius: Array
    min_volts: Array
    max_volts: Array


class ServoArm:
    """An arm whose servos answer and agree with the calibration.

    Attributes:
        encoders: convert joints to encoder counts and back.
        bounds: the servos' own limits.
    """

    def __init__(self, bus: Bus, encoders: Encoders) -> None:
        """Identify the servos and compare them with the calibration.

        Raises:
            SensorError: they do not answer, are of another model, or are not in position mode.
            CalibrationError: their stored calibration differs.
        """
        self._bus, self.encoders = bus, encoders
        found = identify(bus, dict(zip(encoders.names, encoders.ids, strict=True)))
        self.bounds = ServoLimits(
            celsius=np.array([data[MAX_CELSIUS - IDENTITY] for data in found]),
            min_volts=0.1 * np.array([data[MIN_VOLTS - IDENTITY] for data in found]),
            max_volts=0.1 * np.array([data[MAX_VOLTS - IDENTITY] for data in found]),
        )
        self._torque = [decode_word(data, MAX_TORQUE - IDENTITY) for data in found]
        self._torque[-1] = min(self._torque[-1], GRIPPER_TORQUE)
        for (name, servo), data in zip(encoders.servos.items(), found, strict=True):
            low, high = (decode_word(data, address - IDENTITY) for address in (RANGE, RANGE + 2))
            stored = (decode_word(data, OFFSET - IDENTITY, OFFSET_SIGN), low, high)
            wanted = (servo.homing_offset, servo.range_min, servo.range_max)
            if stored != wanted:
                what = (
                    f"the calibration is another arm's, or an old one: for {name} it gives the homing offset and range"
                )
                raise CalibrationError(
                    f"{what} {wanted}, but the servo has {stored}; name the right --servos, or calibrate anew"
                )
            if mode := data[MODE - IDENTITY]:
                what = f"servo {servo.id} ({name}) is in mode {mode}, not in position mode"
                raise SensorError(f"{what}; calibrate anew with `pbd run --calibrate --robot R`")

    def state(self) -> ServoState:
        """Read all servos; raises as `Bus.read`."""
        found = self._bus.read(self.encoders.ids, PRESENT, PRESENT_LENGTH)
        answers = [found[id_] for id_ in self.encoders.ids]
        return ServoState(
            counts=np.array([decode_word(a.data) for a in answers], np.float64),
            load=np.array([decode_word(a.data, 4, LOAD_SIGN) / 1000.0 for a in answers]),
            volts=np.array([a.data[6] / 10.0 for a in answers]),
            celsius=np.array([a.data[7] for a in answers], np.float64),
            flags=tuple(a.error for a in answers),
        )

    def send_goals(self, counts: Array) -> None:
        """Send each servo its goal, unverified."""
        self._bus.write(GOAL, dict(zip(self.encoders.ids, self._goals(counts), strict=True)))

    def hold(self, counts: Array) -> None:
        """Send goals; verify that they arrived, and that the servos have torque.

        Raises:
            SensorError: they did not arrive, so the servos hold their previous goals; or a servo has no torque.
        """
        self._write_verified(GOAL, self._goals(counts))
        self.check_torque()

    def check_torque(self) -> None:
        """Refuse (LostTorqueError) servos without torque."""
        found = self._bus.read(self.encoders.ids, TORQUE_ENABLE, 1)
        if loose := [name for name, servo in self.encoders.servos.items() if not found[servo.id].data[0]]:
            what = f"{listed(loose)} lost torque, as after a moment without power"
            raise LostTorqueError(f"{what}: check the cables and the arm's power supply", joint=loose[0])

    def enable_torque(self, counts: Array) -> None:
        """Switch torque on with the arm's present position as goals, so that nothing jumps.

        With torque, a servo goes to its old goal at full speed, so the goals are set and verified first. The firmware
        of a servo without torque may change its goal, so GOAL_TOLERANCE is allowed. What an earlier program left is
        lifted: limits of time, speed, acceleration, and a torque limit with which the arm would fall.
        """
        goals = [goal + encode_word(0) + encode_word(0) for goal in self._goals(counts)]  # time and speed: no limit
        try:
            self._write_verified(
                GOAL, goals, lambda has, wanted: abs(decode_word(has) - decode_word(wanted)) <= GOAL_TOLERANCE
            )
            self._write_verified(ACCELERATION, [bytes([FASTEST_ACCELERATION])] * len(goals))
            self._write_verified(TORQUE_LIMIT, [encode_word(limit) for limit in self._torque])
            self._write_verified(TORQUE_ENABLE, [b"\x01"] * len(goals))
            self.hold(counts)
        except SensorError as error:
            raise SensorError(f"{error.message}; the other servos may be stiff already (--release)") from None

    def _goals(self, counts: Array) -> list[bytes]:
        """Encode goals, inside the calibrated range: a servo goes to none outside it."""
        within = np.clip(np.round(counts), self.encoders.lower, self.encoders.upper)
        return [encode_word(int(value)) for value in within]

    def _write_verified(self, address: int, values: list[bytes], matches: Callable[[bytes, bytes], bool] = eq) -> None:
        write_verified(self._bus, address, dict(zip(self.encoders.ids, values, strict=True)), matches)


def write_verified(
    bus: Bus, address: int, values: dict[int, bytes], matches: Callable[[bytes, bytes], bool] = eq
) -> None:
    """Write registers (servo id -> bytes) until what is read back `matches` them.

    Raises:
        SensorError: they did not arrive.
    """
    silent: NoAnswerError | None = None
    for _ in range(WRITE_TRIES):
        bus.write(address, values)
        try:
            found = bus.read(tuple(values), address, len(next(iter(values.values()))))
        except NoAnswerError as error:
            silent = error
            continue
        if all(matches(found[id_].data, data) for id_, data in values.items()):
            return
        silent = None
    raise silent or SensorError(f"the servos on {bus.device} did not take what was written; check their cables")


def release(bus: Bus, ids: Sequence[int]) -> None:
    """Switch torque off: the arm sinks."""
    write_verified(bus, TORQUE_ENABLE, dict.fromkeys(ids, b"\x00"))


def identify(bus: Bus, ids: Mapping[str, int]) -> list[bytes]:
    """Read the identity of servos; `ids`: joint -> servo id.

    Returns:
        For each servo its IDENTITY_LENGTH registers from IDENTITY on.

    Raises:
        SensorError: a servo does not answer, or is not an STS3215.
    """
    names = {id_: name for name, id_ in ids.items()}
    try:
        found = bus.read(tuple(names), IDENTITY, IDENTITY_LENGTH)
    except NoAnswerError as error:
        missing = error.fields["ids"]
        if len(missing) == len(ids):
            raise SensorError(_no_servo(bus.device, error.fields["heard"]), path=bus.device) from None
        silent = ", ".join(f"{id_} ({names[id_]})" for id_ in missing)
        what = f"no answer from servo {silent} on {bus.device}; the others answer: check cable and id"
        raise SensorError(what, path=bus.device, silent=missing) from None
    for id_, name in names.items():
        if (model := decode_word(found[id_].data)) != STS3215:
            what = f"servo {id_} ({name}) says it is model {model}, not an STS3215 ({STS3215}); pbd run drives no other"
            raise SensorError(what, path=bus.device)
    return [found[id_].data for id_ in names]


def _no_servo(device: str, heard: bytes) -> str:
    if not heard:
        what = f"no servo answers on {device} at {BAUD} baud"
        return f"{what}: switch the arm's power supply on, and check that this is its port"
    text = printable(heard.decode("ascii", errors="replace")[:40])
    return f"what answers on {device} is no servo (it sends {text!r}); name the arm's --port, `pbd sensors` lists them"
