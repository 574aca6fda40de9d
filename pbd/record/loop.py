"""Record until a person ends it, the time is over, or the sensor is gone."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from pbd.errors import PbdError, SensorError
from pbd.record.session import Session
from pbd.record.values import Command, Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.probe import describe_bytes, identify_protocol
from pbd.sensors.reader import Reader, Source

SILENT_S = 3.0
"""s without a byte after which the device counts as silent: unplugged, or switched off. A phone has more patience."""

SUSPENDED_S = 1.0
"""s of idle time in one round of the loop that show that this program was suspended (Ctrl-Z, a sleeping machine)."""

LATEST_S = 2.0
"""Longest time, s, that samples may wait before they are taken. Longer means that they come too fast."""

FEWEST_SAMPLES = 2
"""Least number of samples with which a recording begins."""

SCREEN_EVERY_S = 0.1
"""s between two updates of the screen."""

REOPEN_EVERY_S = 0.2
"""s between two attempts to open a port that is gone."""

Poll = Callable[[], Command | None]


def record(
    open_port: Callable[[], Source],
    decoder: Decoder,
    options: RecordOptions,
    poll: Poll,
    show: Callable[[Status], None],
    every_s: float = SCREEN_EVERY_S,
) -> Outcome:
    """Record a demonstration. Whatever ends it, its folder is complete.

    With `options.force` a demonstration of that name is renamed to NAME.before, or a free name like it, when the first
    samples are there. It is removed when the new one has ended well, with two stops or more; it takes its name back
    where the new one is discarded or has no rest in it (then that is kept as NAME.new); it stays there, whole, where
    the new one has fewer than two stops, and after a crash or an error.

    Args:
        open_port: opens the sensor's port; called again to reconnect.
        decoder: of the sensor's protocol.
        options: what and how.
        poll: what the person wants, without waiting.
        show: draws the screen.
        every_s: s between two updates.

    Raises:
        SensorError: no port, no bytes, or bytes that are no packets: then there is no folder.
        RecordingError: the folder exists or can't be written, the disk is full.
    """
    session = Session(decoder, options)
    try:
        reader = Reader(open_port)
        try:
            ended_by = _run(session, reader, poll, show, every_s)
            session.begin()
            if session.demo is None and not session.discarded:
                raise SensorError("ended before the first sample came: nothing is recorded; record again")
        except PbdError:
            raise
        except BaseException:  # a bug of ours costs no sample
            with suppress(PbdError):
                session.begin()
            raise
        finally:
            reader.close()
            session.close()
    except PbdError as error:
        note = session.failed()
        if not note:
            raise
        raise type(error)(f"{error.message}; {note}", **error.fields) from None
    session.settle()
    if not session.discarded:
        show(session.status())
    return session.outcome(ended_by)


def _run(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None], every_s: float) -> str:
    options, shown, away, behind, watch = session.options, 0.0, False, False, _Watch()
    while True:
        pieces, gone = reader.take()
        stopped_s = watch.look()
        now = watch.now
        if stopped_s:
            session.warn(f"this program stood still for {stopped_s:.1f} s: what the sensor sent meanwhile may be lost")
        elif pieces and now - pieces[0][1] > LATEST_S and not behind:
            behind = True
            session.warn("samples come faster than this machine takes them: lower the sensor's rate")
        silent_s = now - max(reader.latest, watch.woke)
        if pieces and away:
            away = False
            session.warn("the sensor is back")
        elif silent_s > SILENT_S and reader.port.trouble and not away and session.demo is not None:
            away = True
            session.warn(f"{reader.port.trouble} (waiting)")
        for data, arrival in pieces:
            session.take(data, arrival)
        if session.demo is None and (gone or now - max(reader.opened, watch.woke) > SILENT_S):
            if not session.believed or (session.samples < FEWEST_SAMPLES and not gone):
                raise gone or _nothing(session, reader)
            session.begin()
        session.flush()
        session.follow()
        if gone or (not pieces and silent_s > (reader.port.patience_s or SILENT_S)):
            why = f"sensor silent for {SILENT_S:g} s" if not gone else reader.port.trouble or "sensor unplugged"
            if not options.reconnect:
                return why
            if not away:
                session.warn(f"{why}; waiting for it")
            command, away, watch = _wait(session, reader, poll, show), True, _Watch()
        else:
            command = poll()
        if command is Command.DISCARD:
            session.discard()
        if command in (Command.END, Command.DISCARD):
            return "stopped by you"
        if command is Command.GRIP:
            session.grip()
        if options.duration_s is not None and session.t >= options.duration_s:
            return f"{options.duration_s:g} s recorded"
        if now - shown >= every_s and session.demo is not None:
            show(session.status())
            shown = now


class _Watch:
    """Detects that this program was suspended: silence meanwhile is not the sensor's fault.

    Attributes:
        now: s of the host's monotonic clock, at the latest look.
        woke: the same, when it last went on after a stop; 0 where it never stopped.
    """

    def __init__(self) -> None:
        self.now, self.woke = time.monotonic(), 0.0
        self._worked = time.process_time()

    def look(self) -> float:
        """Return for how many s the program was suspended since the last call; usually 0."""
        before, self.now = self.now, time.monotonic()
        worked, self._worked = self._worked, time.process_time()
        idle = self.now - before - (self._worked - worked)
        if idle < SUSPENDED_S:
            return 0.0
        self.woke = self.now
        return idle


def _wait(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None]) -> Command | None:
    reader.close()
    while not reader.reopen():
        show(session.status())
        command = poll()
        if command in (Command.END, Command.DISCARD):
            return command
        time.sleep(REOPEN_EVERY_S)
    return None


def _nothing(session: Session, reader: Reader) -> SensorError:
    port, sensor, tally = reader.port, session.options.sensor, session.decoder.tally
    whole = tally.packets > tally.bad_packets and identify_protocol(session.heard) in (None, sensor)
    at = f" at {port.baud} baud" if port.baud else ""
    if not reader.bytes_seen and port.trouble:
        message = f"nothing came from {port.device} in {SILENT_S:g} s: {port.trouble}"
    elif not reader.bytes_seen:
        message = (
            f"{port.device} is silent{at}: nothing came in {SILENT_S:g} s; check that the sensor is on "
            "and sends by itself, or look with `pbd sensors --probe`"
        )
    elif whole and not session.samples:
        message = (
            f"whole packets of {sensor} come from {port.device}, but none with an acceleration: switch that output on "
            "in the device (docs/sensors.md says how)"
        )
    elif whole:
        message = f"{port.device} sends too slowly ({session.samples} in {SILENT_S:g} s): raise the rate of the device"
    else:
        count = f"{tally.packets or 'no'} whole packet{'s' if tally.packets > 1 else ''}"
        message = (
            f"{reader.bytes_seen} bytes came from {port.device}{at}, but {count} of {sensor}: "
            f"{describe_bytes(session.heard, port.baud, sensor)}"
        )
    return SensorError(message, path=port.device, baud=port.baud)
