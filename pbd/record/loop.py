"""The verb: record until told to end, the time is over, or the sensor is gone."""

from __future__ import annotations

import time
from collections.abc import Callable

from pbd.errors import RecordingError, SensorError
from pbd.record.session import Session
from pbd.record.told import Command, Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import Port
from pbd.sensors.probe import recognise, what_it_is
from pbd.sensors.reader import Reader

SILENT_S = 3.0
"""No byte for this long is silence: a plug was pulled, or the device is off."""

SHOWN_S = 0.1
"""The screen is brought up to date this often."""

AGAIN_S = 0.2
"""A port that is gone is tried again after so long."""

Poll = Callable[[], Command | None]


def record(
    open_port: Callable[[], Port],
    decoder: Decoder,
    options: RecordOptions,
    poll: Poll,
    show: Callable[[Status], None],
    every_s: float = SHOWN_S,
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
        every_s: so often.

    Raises:
        SensorError: no port, no bytes, or bytes that are no packets: then there is no folder.
        RecordingError: the folder exists or can't be written, the disk is full.
    """
    session = Session(decoder, options)
    try:
        ended_by = _whole(session, Reader(open_port), poll, show, every_s)
    except RecordingError as error:
        if session.before is None:
            raise
        where = f"{error.message}; the demonstration before it is in {session.before.aside}"
        raise RecordingError(where, **error.fields) from None
    session.settle()
    if not session.discarded:
        show(session.status())
    return session.outcome(ended_by)


def _whole(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None], every_s: float) -> str:
    """From the first byte to the last row on disk; return what ended it."""
    try:
        ended_by = _run(session, reader, poll, show, every_s)
        session.end()
        if session.demo is None and not session.discarded:
            raise SensorError("ended before the first sample came: nothing is recorded; record again")
    finally:
        reader.close()
        session.close()
    return ended_by


def _run(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None], every_s: float) -> str:
    options, shown, away = session.options, 0.0, False
    while True:
        pieces, gone = reader.take()
        if pieces and away:
            away = False
            session.coach.say(session.t, "the sensor is back", bell=True)
        for data, arrival in pieces:
            session.take(data, arrival)
        session.flush()
        session.follow()
        now = time.monotonic()
        if session.demo is None and (gone or now - reader.opened > SILENT_S) and not (gone and session.believed):
            raise gone or _nothing(session, reader)
        if gone or now - reader.latest > SILENT_S:
            why = "sensor unplugged" if gone else f"sensor silent for {SILENT_S:g} s"
            if not options.reconnect:
                return why
            if not away:
                session.coach.say(session.t, f"{why}; waiting for it", bell=True)
            command, away = _wait(session, reader, poll, show), True
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


def _wait(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None]) -> Command | None:
    """Wait until the port can be opened again, or a person ends or discards the recording."""
    reader.close()
    while not reader.reopened():
        show(session.status())
        command = poll()
        if command in (Command.END, Command.DISCARD):
            return command
        time.sleep(AGAIN_S)
    return None


def _nothing(session: Session, reader: Reader) -> SensorError:
    """Say why no recording has begun."""
    port, sensor, tally = reader.port, session.options.sensor, session.decoder.tally
    whole = tally.packets > tally.bad_packets and recognise(session.heard) in (None, sensor)
    if not reader.bytes_seen:
        message = (
            f"{port.device} is silent at {port.baud} baud: nothing came in {SILENT_S:g} s; check that the sensor is on "
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
            f"{reader.bytes_seen} bytes came from {port.device} at {port.baud} baud, but {count} of {sensor}: "
            f"{what_it_is(session.heard, port.baud, sensor)}"
        )
    return SensorError(message, path=port.device, baud=port.baud)
