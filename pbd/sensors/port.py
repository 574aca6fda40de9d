"""Serial ports: the only place that imports pyserial."""

from __future__ import annotations

import errno
import os
import stat
import termios
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from pbd.errors import SensorError
from pbd.sensors.reader import READ_TIMEOUT_S, Source


class PortInfo(NamedTuple):
    """A serial port: its device file, what its maker calls it, and its USB ids (vendor:product) or ""."""

    device: str
    title: str
    usb: str


def list_ports() -> tuple[PortInfo, ...]:
    """List the serial ports of this machine that something is plugged into, USB first."""
    from serial.tools.list_ports import comports

    found = []
    for port in comports():
        usb = f"{port.vid:04x}:{port.pid:04x}" if port.vid is not None else ""
        title = " ".join(word for word in (port.manufacturer, port.product) if word) or port.description or ""
        found.append(PortInfo(port.device, "" if title == "n/a" else title, usb))
    return tuple(sorted(found, key=lambda port: (not port.usb, port.device)))


class Port(Source):
    """An open serial port."""

    def __init__(self, serial: Any, device: str, baud: int, what: str = "sensor") -> None:
        self._serial, self.device, self.baud, self._what = serial, device, baud, what

    def read(self) -> bytes:
        """Return the bytes that came, after READ_TIMEOUT_S (or as opened) at the latest; SensorError: it is gone."""
        try:
            first = self._serial.read(1)
            waiting = self._serial.in_waiting if first else 0
            return bytes(first + self._serial.read(waiting)) if waiting else bytes(first)
        except (OSError, TypeError) as reason:  # SerialException too is an OSError; TypeError: closed meanwhile
            raise self._gone() from reason

    def _gone(self) -> SensorError:
        what = f"{self.device} is gone: the {self._what} was unplugged; plug it in again"
        return SensorError(what, path=self.device, lost=True)

    def write(self, data: bytes) -> None:
        """Send a command to the device; SensorError: it was unplugged, or takes nothing."""
        try:
            self._serial.write(data)
            self._serial.flush()
        except (OSError, termios.error) as reason:
            raise SensorError(
                f"{self.device} takes no command ({reason}); unplug the {self._what} and plug it in again",
                path=self.device,
            ) from reason

    def clear(self) -> None:
        """Drop what has come and was not read; SensorError: the sensor was unplugged."""
        try:
            self._serial.reset_input_buffer()
        except (OSError, ValueError, TypeError, termios.error) as reason:
            raise self._gone() from reason

    def set_baud(self, baud: int) -> None:
        """Change the rate of the open port (SensorError: there is none): to open it again would reset an Arduino."""
        try:
            self._serial.baudrate = baud
            self._serial.reset_input_buffer()
        except (OSError, ValueError) as reason:
            raise SensorError(_why(self.device, baud, reason, self._what), path=self.device, baud=baud) from None
        self.baud = baud

    def close(self) -> None:
        """Close it; closing twice is nothing."""
        with suppress(Exception):
            self._serial.close()


def open_port(device: str, baud: int, what: str = "sensor", wait_s: float = READ_TIMEOUT_S) -> Port:
    """Open a port for us alone, 8N1: for `what`, whose reads wait `wait_s` at most; a SensorError says why it can't."""
    from serial import Serial

    try:
        if baud <= 0:
            raise ValueError("0 would hang up")
        return Port(Serial(device, baud, timeout=wait_s, write_timeout=1.0, exclusive=True), device, baud, what)
    except (OSError, ValueError) as reason:
        raise SensorError(_why(device, baud, reason, what), path=device, baud=baud) from None


def _why(device: str, baud: int, reason: Exception, what: str) -> str:
    number = getattr(reason, "errno", None)
    if number == errno.ENOENT or not Path(device).exists():
        here = ", ".join(port.device for port in list_ports()) or "none"
        return f"there is no port {device} (plugged in are: {here}); plug the {what} in, or name another"
    if number == errno.EACCES:
        return f"no permission for {device}: {_permission(device)}"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(reason):
        return f"{device} is in use by another program; close that one (a terminal, another recording)"
    if isinstance(reason, ValueError):
        return f"{device} can't be set to {baud} baud; give another --baud"
    if number in (errno.ENOTTY, errno.EINVAL) or os.strerror(errno.ENOTTY) in str(reason):
        return f"{device} is not a serial port; name another, `pbd sensors` lists them"
    return f"{device} can't be opened ({reason}); unplug the {what} and plug it in again"


def _permission(device: str) -> str:
    """Who may use it, and how to become one of them."""
    status, user = Path(device).stat(), os.environ.get("USER", "$USER")
    try:
        group = Path(device).group()
    except KeyError:
        group = str(status.st_gid)
    if group == "root" or not status.st_mode & stat.S_IWGRP:
        return f"only its owner may use it; give it to yourself with `sudo chown {user} {device}`"
    return f"it belongs to the group '{group}'; add yourself with `sudo usermod -aG {group} {user}`, then log in again"
