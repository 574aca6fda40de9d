"""The connection to the sensor while a demonstration is recorded: silence, a pulled plug, a suspended program."""

import time
from collections.abc import Sequence

from pbd.errors import SensorError, amount
from pbd.record.session import Session
from pbd.sensors.probe import describe_bytes, identify_protocol, look_at
from pbd.sensors.reader import Reader, host_clock
from pbd.tracking.repair.clock import CLOCK_JUMP_S

SILENT_S = 3.0
"""Time without a byte after which a serial device counts as unplugged or switched off, s. A phone gets longer."""

SUSPENDED_S = 1.0
"""Idle time in one round of the loop which shows that this program did not run (Ctrl-Z, a sleeping machine), s."""

MAX_BACKLOG_S = 2.0
"""Longest time that samples may wait to be taken, s. If they wait longer, they come faster than this machine can take
them."""


class SensorConnection:
    """Watches the port that a session is recorded from, and warns the person of what happens to it.

    A suspended program (Ctrl-Z, a sleeping machine) hears nothing either, so its silence is not the sensor's fault.

    Attributes:
        now: `host_clock` at the last `check`, s.
    """

    def __init__(self, session: Session, reader: Reader) -> None:
        self._session, self._reader = session, reader
        self._told_lost = self._told_behind = False
        self._start_clocks()

    def _start_clocks(self) -> None:
        self.now, self._worked, self._resumed = host_clock(), time.process_time(), 0.0

    def check(self, pieces: Sequence[tuple[bytes, float]]) -> None:
        """Look at the clock and at the pieces that `Reader.take` returned, and warn of what they show."""
        before, self.now = self.now, host_clock()
        worked, self._worked = self._worked, time.process_time()
        idle_s = self.now - before - (self._worked - worked)
        trouble, now = self._reader.port.trouble, self.now
        if idle_s >= SUSPENDED_S:
            self._resumed = now
            self._session.warn(f"this program did not run for {idle_s:.1f} s: samples of that time may be lost")
        elif pieces and now - pieces[0][1] > MAX_BACKLOG_S and not self._told_behind:
            self._told_behind = True
            self._session.warn("samples come faster than this machine takes them: lower the sensor's rate")
        if pieces and self._told_lost:
            self._told_lost = False
            self._session.warn("the sensor is back")
        elif self._silent_s > SILENT_S and trouble and not self._told_lost and self._session.demo is not None:
            self._told_lost = True
            self._session.warn(f"{trouble} (waiting)")

    @property
    def _silent_s(self) -> float:
        return self.now - max(self._reader.latest, self._resumed)

    def may_begin(self, ended: SensorError | None) -> bool:
        """Whether the recording may begin: SILENT_S have passed and times are known, or the port was lost.

        Of one or two long bursts, as Bluetooth sends, the times are not known.

        Raises:
            SensorError: what came is not this sensor's stream; or `ended`, the error that ended reading.
        """
        if ended is None and self.now - max(self._reader.opened, self._resumed) <= SILENT_S:
            return False
        too_few = self._session.samples < 2 or self._session.clock_stands
        if not self._session.decodable or (too_few and ended is None):
            raise ended or _no_samples_error(self._session, self._reader)
        return ended is not None or self._session.t > 0.0

    def why_lost(self, heard_now: bool, ended: SensorError | None) -> str:
        """Say why the sensor counts as gone, or ""."""
        port = self._reader.port
        if ended is None and (heard_now or self._silent_s <= (port.patience_s or SILENT_S)):
            return ""
        return f"sensor silent for {SILENT_S:g} s" if ended is None else port.trouble or "sensor unplugged"

    def why_undecodable(self) -> str:
        """Say why the latest bytes of a serial port were no samples, if they were none for SILENT_S, or ""."""
        since = max(self._session.heard, self._reader.opened, self._resumed)
        if not self._reader.port.baud or self._session.demo is None or self._reader.latest - since <= SILENT_S:
            return ""
        sensor = self._session.options.sensor
        return f"no sample of {sensor} in the bytes of {SILENT_S:g} s: does it now send at another baud rate?"

    def why_over(self, now: float) -> str:
        """Say why the gap up to `now` is longer than any that can be tracked, or "". A phone keeps its samples."""
        patient = self._reader.port.patience_s is not None
        if patient or self._session.demo is None or now - self._session.heard <= CLOCK_JUMP_S:
            return ""
        return f"no sample for {CLOCK_JUMP_S:g} s"

    def close(self, why: str) -> None:
        """Close the port of a sensor that is gone; the person is told `why` once."""
        if not self._told_lost:
            self._session.warn(f"{why}; waiting for {self.device}")
        self._told_lost = True
        self._reader.close()

    @property
    def device(self) -> str:
        """The device file, or the phone's address."""
        return self._reader.port.device

    def reopen(self) -> bool:
        """Try to open the port again; return whether it is open."""
        self._start_clocks()
        return self._reader.reopen()


def _no_samples_error(session: Session, reader: Reader) -> SensorError:
    port, sensor, tally = reader.port, session.options.sensor, session.decoder.tally
    whole = tally.packets > tally.bad_packets and identify_protocol(session.first_bytes) in (None, sensor)
    at = f" at {port.baud} baud" if port.baud else ""
    if not reader.bytes_seen and port.trouble:
        message = f"nothing came from {port.device} in {SILENT_S:g} s: {port.trouble}"
    elif not reader.bytes_seen:
        message = (
            f"{port.device} is silent{at}: nothing came in {SILENT_S:g} s; check that the sensor is on "
            f"and sends by itself, or {look_at(port.device)}"
        )
    elif whole and not session.samples:
        message = (
            f"whole packets of {sensor} come from {port.device}, but none with an acceleration: switch that output on "
            "in the device (docs/sensors.md says how)"
        )
    elif whole and session.samples > 1:
        message = f"the samples from {port.device} have all the same time: correct --columns, or the device's program"
    elif whole:
        message = f"{port.device} sends too slowly ({session.samples} in {SILENT_S:g} s): raise the rate of the device"
    else:
        count = f"{tally.packets or 'no'} whole packet{'s' if tally.packets > 1 else ''}"
        message = (
            f"{amount(reader.bytes_seen, 'byte')} came from {port.device}{at}, but {count} of {sensor}: "
            f"{describe_bytes(session.first_bytes, port.baud, sensor, tally.last_fault, port.device)}"
        )
    return SensorError(message, path=port.device, baud=port.baud)
