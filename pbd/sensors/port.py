"""Serial ports. No other module imports pyserial."""

import errno
import os
import stat
import termios
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from pbd.errors import SensorError
from pbd.sensors.reader import READ_TIMEOUT_S, ByteSource


class PortInfo(NamedTuple):
    """A serial port: its device file, its maker's name for it, and its USB ids (vendor:product) or ""."""

    device: str
    title: str
    usb: str


def list_ports() -> tuple[PortInfo, ...]:
    """List the serial ports of this machine, USB ports first."""
    from serial.tools.list_ports import comports

    found = []
    for port in comports():
        usb = f"{port.vid:04x}:{port.pid:04x}" if port.vid is not None else ""
        title = " ".join(word for word in (port.manufacturer, port.product) if word) or port.description or ""
        found.append(PortInfo(port.device, "" if title == "n/a" else title, usb))
    return tuple(sorted(found, key=lambda port: (not port.usb, port.device)))


class Port(ByteSource):
    """An open serial port."""

    def __init__(self, serial: Any, device: str, baud: int, what: str = "sensor") -> None:
        self._serial, self.device, self.baud, self._what = serial, device, baud, what

    def read(self) -> bytes:
        """Return new bytes; wait at most `open_port`'s `wait_s`. SensorError: the device is gone."""
        try:
            first = self._serial.read(1)
            waiting = self._serial.in_waiting if first else 0
            return bytes(first + self._serial.read(waiting)) if waiting else bytes(first)
        except (OSError, TypeError) as reason:  # SerialException is an OSError; TypeError: another thread closed it
            raise self._unplugged() from reason

    def _unplugged(self) -> SensorError:
        what = f"{self.device} is gone: the {self._what} was unplugged; plug it in again"
        return SensorError(what, path=self.device, lost=True)

    def write(self, data: bytes) -> None:
        """Send a command to the device; SensorError: it was unplugged, or takes nothing."""
        try:
            self._serial.write(data)
            self._serial.flush()
        except (OSError, termios.error) as reason:
            what = f"{self.device} takes no command ({reason.args[-1]})"
            raise SensorError(f"{what}; unplug the {self._what} and plug it in again", path=self.device) from reason

    def clear(self) -> None:
        """Drop the bytes that have come but were not read; SensorError: the device was unplugged."""
        try:
            self._serial.reset_input_buffer()
        except (OSError, ValueError, TypeError, termios.error) as reason:
            raise self._unplugged() from reason

    def set_baud(self, baud: int) -> bool:
        """Change the baud rate without reopening, which would reset an Arduino; return whether the port can do that.

        SensorError: the device was unplugged.
        """
        try:
            self._serial.baudrate = baud
        except (ValueError, termios.error):
            return False
        except OSError as reason:
            raise self._unplugged() from reason
        self.clear()
        self.baud = baud
        return True

    def close(self) -> None:
        """Close the port. A second call has no effect."""
        with suppress(Exception):
            self._serial.close()


def open_port(device: str, baud: int, what: str = "sensor", wait_s: float = READ_TIMEOUT_S) -> Port:
    """Open a port exclusively, 8N1. Messages call the device `what`; a read waits `wait_s` at most.

    Raises:
        SensorError: why it can't be opened, and what to do.
    """
    from serial import Serial

    try:
        if baud <= 0:
            raise ValueError("a rate of 0 would close the line")
        return Port(Serial(device, baud, timeout=wait_s, write_timeout=1.0, exclusive=True), device, baud, what)
    except (OSError, ValueError, termios.error) as reason:
        raise SensorError(_cannot_open(device, baud, reason, what), path=device, baud=baud) from None


def _cannot_open(device: str, baud: int, reason: Exception, what: str) -> str:
    number = getattr(reason, "errno", None)
    if number == errno.ENOENT or not Path(device).exists():
        ports = ", ".join(port.device for port in list_ports()) or "none"
        return f"there is no port {device} (plugged in are: {ports}); plug the {what} in, or name another"
    if number == errno.EACCES:
        return f"no permission for {device}: {_permission_advice(device)}"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(reason):
        return f"{device} is in use by another program; close that one (a terminal, another recording)"
    if isinstance(reason, ValueError | termios.error):
        return f"{device} can't be set to {baud} baud; give another --baud"
    if number in (errno.ENOTTY, errno.EINVAL) or os.strerror(errno.ENOTTY) in str(reason):
        return f"{device} is not a serial port; name another, `pbd sensors` lists them"
    return f"{device} can't be opened ({reason}); unplug the {what} and plug it in again"


def _permission_advice(device: str) -> str:
    """Say who may use the device, and how to get permission."""
    status, user = Path(device).stat(), os.environ.get("USER", "$USER")
    with suppress(KeyError):  # nobody can be added to a group without a name
        group = Path(device).group()
        if group != "root" and status.st_mode & stat.S_IWGRP:
            add = f"add yourself with `sudo usermod -aG {group} {user}`, then log in again"
            return f"it belongs to the group '{group}'; {add}"
    return f"only its owner may use it; give it to yourself with `sudo chown {user} {device}`"
