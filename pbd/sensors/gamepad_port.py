"""A gamepad as a port: reads its motion sensors' device and its buttons' device as one stream of events."""

import fcntl
import os
import re
import select
import struct
from contextlib import suppress
from pathlib import Path

from pbd.errors import SensorError, in_words
from pbd.sensors.gamepad import AXES, EV_ABS, EV_KEY, EV_MSC, EV_SYN, EVENT, MSC_RAW, PADS, SYN_DROPPED, make_event
from pbd.sensors.reader import READ_TIMEOUT_S, ByteSource

MOTION_SENSORS_NAME = re.compile(r"(.+) (?:Motion Sensors|IMU|\(IMU\))")
"""Device name that hid-playstation and hid-nintendo give the motion sensors. Group 1 is the buttons' device name."""

SYSFS_INPUT = Path("/sys/class/input")

ABSINFO = struct.Struct("@6i")
"""struct input_absinfo of linux/input.h: value, minimum, maximum, fuzz, flat, resolution."""


def _ioctl_request(write: bool, number: int) -> int:
    """Build an ioctl request: direction, size, the letter E, number (asm-generic/ioctl.h)."""
    return ((1 if write else 2) << 30) | (ABSINFO.size << 16) | (ord("E") << 8) | number


def find_gamepads() -> dict[str, tuple[str, str | None]]:
    """Find connected pads: motion sensors' device -> the pad's name, and its buttons' device or None."""
    names = {}
    for file in sorted(SYSFS_INPUT.glob("event*/device/name")):
        with suppress(OSError):
            pad = (file.parent / "device").resolve()  # shared by the input devices of one pad, and by no others
            name = file.read_text(encoding="utf-8", errors="replace").strip()  # over Bluetooth, any bytes
            names[f"/dev/input/{file.parts[-3]}"] = name, pad
    found = {}
    for device, (name, pad) in names.items():
        if match := MOTION_SENSORS_NAME.fullmatch(name):
            buttons = (other for other, its in names.items() if its == (match[1], pad))
            found[device] = match[1], next(buttons, None)
    return found


class GamepadPort(ByteSource):
    """Reads the motion sensors and the buttons of a pad."""

    def __init__(self, device: str, buttons: str | None = None) -> None:
        """Open both devices; SensorError: no such device, no permission, or an unknown kind of pad."""
        self.device = device
        self._fuzz: dict[int, bytes] = {}
        self._motion = _open_device(device)
        self._fds = [self._motion]
        try:
            self._pending = self._set_up()
            if buttons is not None:
                self._fds.append(_open_device(buttons))
        except BaseException:
            self.close()
            raise

    def read(self) -> bytes:
        """Return new events; wait READ_TIMEOUT_S at most. SensorError: the pad is gone."""
        data, self._pending = self._pending, b""
        try:
            for fd in select.select(self._fds, (), (), 0.0 if data else READ_TIMEOUT_S)[0]:
                if not (read := os.read(fd, 256 * EVENT.size)):
                    raise OSError("end of file")
                events = list(EVENT.iter_unpack(read[: len(read) // EVENT.size * EVENT.size]))
                if fd != self._motion:  # keys only: the sticks use the axis codes of the accelerometer
                    data += b"".join(make_event(*each[2:]) for each in events if each[2] == EV_KEY)
                    continue
                data += read
                if any(each[2:4] == (EV_SYN, SYN_DROPPED) for each in events):
                    data += self._axis_events()  # the kernel does not send the dropped changes again
        except (OSError, ValueError) as reason:  # OSError: ENODEV; ValueError: another thread closed the device
            if data:
                return data
            what = f"{self.device} is gone: the gamepad was unplugged, or fell asleep; connect it again"
            raise SensorError(what, path=self.device, lost=True) from reason
        return data

    def close(self) -> None:
        """Restore the kernel's filter and close the devices. A second call has no effect."""
        for axis, info in self._fuzz.items():
            with suppress(OSError):
                fcntl.ioctl(self._motion, _ioctl_request(True, 0xC0 + axis), info)
        self._fuzz = {}
        fds, self._fds = self._fds, []
        for fd in fds:
            with suppress(OSError):
                os.close(fd)

    def _set_up(self) -> bytes:
        """Switch the kernel's filter off; return the kind of pad and the present axes as events.

        The filter is a hysteresis: an axis is not sent until it changes by more than half its fuzz of 16 counts, 2 mg
        (Joy-Con: 10 counts).
        """
        acc_per_g = 0
        for axis in AXES:
            try:
                info = self._absinfo(axis)
            except OSError:  # no input device, or one without axes
                info = bytes(ABSINFO.size)
            *values, fuzz, flat, resolution = ABSINFO.unpack(info)
            acc_per_g = acc_per_g or resolution
            pad = PADS.get(acc_per_g)
            if pad is None or resolution != (acc_per_g if axis < 3 else pad.gyro_per_deg_s):
                what = f"{self.device} counts {resolution} for a unit of axis {axis}: it is the motion sensor of no"
                what = f"{what} DualSense, DualShock 4, Joy-Con or Switch Pro Controller; name another --port"
                raise SensorError(what, path=self.device, value=resolution)
            if fuzz:
                self._fuzz[axis] = info
                fcntl.ioctl(self._motion, _ioctl_request(True, 0xC0 + axis), ABSINFO.pack(*values, 0, flat, resolution))
        return make_event(EV_MSC, MSC_RAW, acc_per_g) + self._axis_events()

    def _axis_events(self) -> bytes:
        return b"".join(make_event(EV_ABS, axis, ABSINFO.unpack(self._absinfo(axis))[0]) for axis in AXES)

    def _absinfo(self, axis: int) -> bytes:
        return fcntl.ioctl(self._motion, _ioctl_request(False, 0x40 + axis), bytes(ABSINFO.size))


def open_gamepad(device: str | None) -> GamepadPort:
    """Open a pad with its buttons: this motion sensors' device, or else that of the only connected pad.

    SensorError: there is none, or several; or it can't be opened.
    """
    found = find_gamepads()
    if device is None and not found:
        raise SensorError(
            "no gamepad with motion sensors is there: connect a DualSense, DualShock 4, Joy-Con or Switch Pro "
            "Controller (Linux 5.16 or newer shows it as '... Motion Sensors' or '... IMU' in "
            "/proc/bus/input/devices), or name its --port /dev/input/eventN"
        )
    if device is None and len(found) > 1:
        named = ", ".join(f"{each} ({title})" for each, (title, _) in found.items())
        raise SensorError(f"several gamepads are there: {named}; name a --port")
    device = device or next(iter(found))
    return GamepadPort(device, found.get(device, ("", None))[1])


def _open_device(device: str) -> int:
    try:
        return os.open(device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError:
        what = f"no permission for {device}: add yourself with `sudo usermod -aG input $USER`, then log in again"
    except OSError as reason:
        what = f"{device} can't be opened ({in_words(reason)}); connect the gamepad, or name another --port"
    raise SensorError(what, path=device)
