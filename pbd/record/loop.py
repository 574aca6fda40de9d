"""The verb: record until told to end, the time is over, or the sensor is gone."""

from __future__ import annotations

import time
from collections.abc import Callable

from pbd.errors import SensorError
from pbd.record.session import Session
from pbd.record.told import Command, Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import Port
from pbd.sensors.reader import Reader

SILENT_S = 3.0
"""No byte for this long is silence: a plug was pulled, or the device is off."""

SHOWN_S = 0.1
"""The screen is brought up to date this often."""

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
    session, reader = Session(decoder, options), Reader(open_port)
    try:
        ended_by = _run(session, reader, poll, show, every_s)
    finally:
        reader.close()
        session.close()
    if not session.discarded:
        show(session.status())
    return session.outcome(ended_by)


def _run(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None], every_s: float) -> str:
    options, shown = session.options, 0.0
    while True:
        pieces, gone = reader.take()
        for data, arrival in pieces:
            session.take(data, arrival)
        session.flush()
        now = time.monotonic()
        if not session.samples and (gone or now - reader.opened > SILENT_S):
            raise gone or _nothing(reader, options.sensor)
        if gone or now - reader.latest > SILENT_S:
            why = "the sensor was unplugged" if gone else f"the sensor has been silent for {SILENT_S:g} s"
            if not options.reconnect:
                return why
            session.coach.say(session.t, f"{why}; waiting for it", bell=True)
            show(session.status())
            if not reader.reopen(lambda: poll() in (Command.END, Command.DISCARD)):
                return why
            session.coach.say(session.t, "the sensor is back", bell=True)
        command = poll()
        if command is Command.END:
            return "you"
        if command is Command.DISCARD:
            session.discard()
            return "you"
        if command is Command.GRIP:
            session.grip()
        if options.duration_s is not None and session.t >= options.duration_s:
            return f"the time of {options.duration_s:g} s"
        if now - shown >= every_s and session.demo is not None:
            show(session.status())
            shown = now


def _nothing(reader: Reader, sensor: str) -> SensorError:
    """Say why no sample has come."""
    port = reader.port
    if not reader.bytes_seen:
        message = (
            f"{port.device} is silent at {port.baud} baud: nothing came in {SILENT_S:g} s; check that the sensor is on "
            "and sends by itself, or look with `pbd sensors --probe`"
        )
    else:
        message = (
            f"{reader.bytes_seen} bytes came from {port.device} at {port.baud} baud, but no whole packet of {sensor}: "
            "the baud rate or the kind of sensor is another; look with `pbd sensors --probe`"
        )
    return SensorError(message, path=port.device, baud=port.baud)
