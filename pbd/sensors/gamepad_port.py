"""A gamepad's input devices as a port: its motion sensors, and the buttons of the same pad, in one stream of events."""

from __future__ import annotations

import fcntl
import os
import re
import select
import struct
from contextlib import suppress
from pathlib import Path

from pbd.errors import SensorError, in_words
from pbd.sensors.gamepad import AXES, EV_ABS, EV_KEY, EV_MSC, EV_SYN, EVENT, MSC_RAW, PADS, SYN_DROPPED, event
from pbd.sensors.reader import READ_TIMEOUT_S, Source

SENSORS = re.compile(r"(.+) (?:Motion Sensors|IMU|\(IMU\))")
"""How hid-playstation and hid-nintendo call a pad's motion sensors; what stands first is the name of its buttons."""

CLASS = Path("/sys/class/input")

ABSINFO = struct.Struct("@6i")
"""struct input_absinfo of linux/input.h: value, least, most, fuzz, flat, resolution."""

MOST_AT_ONCE = 256 * EVENT.size


def _request(write: bool, number: int) -> int:
    """An ioctl's number: direction, size, the letter E, number (asm-generic/ioctl.h)."""
    return ((1 if write else 2) << 30) | (ABSINFO.size << 16) | (ord("E") << 8) | number


def find_gamepads() -> dict[str, tuple[str, str | None]]:
    """The motion sensors that are there: device -> the pad's name, and the device of its buttons."""
    names = {}
    for file in sorted(CLASS.glob("event*/device/name")):
        with suppress(OSError):
            pad = (file.parent / "device").resolve()  # the same for all input devices of a pad, and for no other's
            names[f"/dev/input/{file.parts[-3]}"] = file.read_text(encoding="utf-8").strip(), pad
    found = {}
    for device, (name, pad) in names.items():
        if match := SENSORS.fullmatch(name):
            buttons = (other for other, its in names.items() if its == (match[1], pad))
            found[device] = match[1], next(buttons, None)
    return found


def only_gamepad() -> str:
    """The motion sensors of the only pad; SensorError: there is none, or there are several."""
    found = find_gamepads()
    if len(found) == 1:
        return next(iter(found))
    if not found:
        raise SensorError(
            "no gamepad with motion sensors is there: connect a DualSense, DualShock 4, Joy-Con or Switch Pro "
            "Controller (Linux 5.16 or newer shows it as '... Motion Sensors' or '... IMU' in "
            "/proc/bus/input/devices), or name its --port /dev/input/eventN"
        )
    named = ", ".join(f"{device} ({title})" for device, (title, _) in found.items())
    raise SensorError(f"several gamepads are there: {named}; name a --port")


class GamepadPort(Source):
    """Reads both devices of a pad."""

    def __init__(self, device: str, buttons: str | None = None) -> None:
        """Open the pad; SensorError: no such device, no permission, or it is no pad that is known."""
        self.device = device
        self._fuzz: dict[int, bytes] = {}
        self._motion = _opened(device)
        self._fds = [self._motion]
        try:
            self._pending = self._prepared()
            if buttons is not None:
                self._fds.append(_opened(buttons))
        except BaseException:
            self.close()
            raise

    def read(self) -> bytes:
        """Return the events that have come, after READ_TIMEOUT_S at the latest; SensorError: the pad is gone."""
        data, self._pending = self._pending, b""
        try:
            for fd in select.select(self._fds, (), (), 0.0 if data else READ_TIMEOUT_S)[0]:
                if not (read := os.read(fd, MOST_AT_ONCE)):
                    raise OSError("end of file")
                events = list(EVENT.iter_unpack(read[: len(read) // EVENT.size * EVENT.size]))
                if fd != self._motion:  # the sticks have the same axes
                    data += b"".join(event(*each[2:]) for each in events if each[2] == EV_KEY)
                    continue
                data += read
                if any(each[2:4] == (EV_SYN, SYN_DROPPED) for each in events):
                    data += self._axes()  # what changed meanwhile is not sent again
        except (OSError, ValueError) as reason:  # ENODEV; ValueError: closed meanwhile
            if data:
                return data
            raise SensorError(
                f"{self.device} is gone: the gamepad was unplugged, or fell asleep; connect it again",
                path=self.device,
                lost=True,
            ) from reason
        return data

    def close(self) -> None:
        """Close it, with the kernel's filter as it was; closing twice is nothing."""
        for axis, info in self._fuzz.items():
            with suppress(OSError):
                fcntl.ioctl(self._motion, _request(True, 0xC0 + axis), info)
        self._fuzz = {}
        fds, self._fds = self._fds, []
        for fd in fds:
            with suppress(OSError):
                os.close(fd)

    def _prepared(self) -> bytes:
        """Switch the kernel's filter off and return the axes as they are.

        It holds an axis back until it changes by more than half its fuzz of 16 counts, 2 mg (Joy-Con 10): a hysteresis.
        """
        acc_per_g = 0
        for axis in AXES:
            try:
                info = self._info(axis)
            except OSError:
                return b""  # no input device: a pipe
            *values, fuzz, flat, resolution = ABSINFO.unpack(info)
            acc_per_g = acc_per_g or resolution
            pad = PADS.get(acc_per_g)
            if pad is None or resolution != (acc_per_g if axis < 3 else pad.gyro_per_deg_s):
                raise SensorError(
                    f"{self.device} counts {resolution} for a unit of axis {axis}: it is the motion sensor of no "
                    "DualSense, DualShock 4, Joy-Con or Switch Pro Controller; name another --port",
                    path=self.device,
                    value=resolution,
                )
            if fuzz:
                self._fuzz[axis] = info
                fcntl.ioctl(self._motion, _request(True, 0xC0 + axis), ABSINFO.pack(*values, 0, flat, resolution))
        return event(EV_MSC, MSC_RAW, acc_per_g) + self._axes()

    def _axes(self) -> bytes:
        events = b""
        for axis in AXES:
            with suppress(OSError):
                events += event(EV_ABS, axis, ABSINFO.unpack(self._info(axis))[0])
        return events

    def _info(self, axis: int) -> bytes:
        return fcntl.ioctl(self._motion, _request(False, 0x40 + axis), bytes(ABSINFO.size))


def _opened(device: str) -> int:
    try:
        return os.open(device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError:
        what = f"no permission for {device}: add yourself with `sudo usermod -aG input $USER`, then log in again"
    except OSError as reason:
        what = f"{device} can't be opened ({in_words(reason)}); connect the gamepad, or name another --port"
    raise SensorError(what, path=device)
