"""Helpers for tests of driving: emulated servos, and a clock that runs faster."""

import sys
import time

from pbd.driving.bus import Bus
from pbd.driving.encoders import Encoders
from pbd.driving.servo_arm import ServoArm
from pbd.driving.stream import Clock
from pbd.files.robot import load_robot
from tests.driving.emulator import calibration_of

PATIENT_S = 1.0
"""Answer time of sound servos, s. It is long, so that no test fails on a busy machine."""

UNHURRIED_S = 50.0
"""How late a goal may be, s, for the same reason."""


PATIENT_PBD = [
    sys.executable,
    "-c",
    "import sys; from pbd.driving import bus, stream; from pbd.cli import main; "
    f"bus.ANSWER_S = bus.ANSWER_AT_REST_S = {PATIENT_S}; stream.STALL_S = {UNHURRIED_S}; sys.exit(main(sys.argv[1:]))",
]
"""The command `pbd` with these times."""


class FastClock(Clock):
    """A clock that runs ten times as fast."""

    def now(self) -> float:
        return 10.0 * time.monotonic()

    def sleep_until(self, t: float) -> None:
        if (left := 0.1 * (t - self.now())) > 0.0:
            time.sleep(left)


def connect(bus: Bus) -> ServoArm:
    return ServoArm(bus, Encoders(load_robot("so101"), calibration_of("so101")))
