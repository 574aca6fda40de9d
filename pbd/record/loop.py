"""The recording loop: it runs until a person ends it, the time is over, or the sensor is gone."""

import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace

from pbd.errors import PbdError, SensorError
from pbd.record.sensor_connection import SensorConnection
from pbd.record.session import Session
from pbd.record.session_types import ENDED_BY, Command, Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.reader import ByteSource, Reader, host_clock

SCREEN_EVERY_S = 0.1
"""Time between two updates of the screen, s."""

Poll = Callable[[], Command | None]


def record(
    open_port: Callable[[], ByteSource],
    decoder: Decoder,
    options: RecordOptions,
    poll: Poll,
    show: Callable[[Status], None],
    every_s: float = SCREEN_EVERY_S,
) -> Outcome:
    """Record a demonstration. However it ends, its folder is complete.

    With `options.force`, an old demonstration of that name is renamed to NAME.before, or a free name like it, when the
    first samples have come. What becomes of it depends on the new one:
    - two stops or more: the old one is removed, unless something of a person would be lost (`why_kept`);
    - discarded: the old one gets its name back;
    - no rest in it: the same, and the new one is kept as NAME.new;
    - fewer than two stops, one that can't be tracked, a crash or an error: the old one stays in NAME.before.

    Args:
        open_port: opens the sensor's port; called again to reconnect.
        decoder: a new decoder of the sensor's protocol.
        options: what to record, and where.
        poll: returns the person's latest command, or None, without waiting.
        show: draws the screen.
        every_s: s between two calls of `show`.

    Raises:
        SensorError: no port, no bytes, or no packets among them; no folder is made.
        RecordingError: the folder exists or can't be written, or the disk is full.
    """
    import scipy.ndimage  # noqa: F401  # the count of losses needs it; a slow disk takes seconds to load it

    session = Session(decoder, options)
    try:
        with closing(session), closing(Reader(open_port)) as reader:
            try:
                ended_by = _run(session, reader, poll, show, every_s)
                session.begin()
            except PbdError:
                raise
            except BaseException:  # even a bug must not lose samples
                with suppress(PbdError):
                    session.begin()
                raise
            if not session.discarded:
                if session.demo is None:
                    raise SensorError("ended before the first sample came: nothing is recorded; record again")
                show(replace(session.status(), ended=True))
    except PbdError as error:
        note = session.backup_message()
        if not note:
            raise
        raise type(error)(f"{error.message}; {note}", **error.fields) from None
    session.settle_backup()
    if not session.discarded:
        show(session.status())
    return session.outcome(ended_by)


def _run(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None], every_s: float) -> str:
    options, connection, shown = session.options, SensorConnection(session, reader), 0.0
    while True:
        pieces, ended = reader.take()
        if why := connection.why_over(pieces[0][1] if pieces else host_clock()):
            return why
        connection.check(pieces)
        for data, arrival in pieces:
            session.take(data, arrival)
        if session.demo is None and connection.may_begin(ended):
            session.begin()
        session.flush()
        if why := connection.why_undecodable():
            return why
        if why := connection.why_lost(bool(pieces), ended):
            if not options.reconnect:
                return why
            connection.close(why)
            command = _wait_for_port(session, connection, poll, show)
        else:
            command = poll()
        if command is Command.DISCARD:
            session.discard()
        if command in ENDED_BY:
            return ENDED_BY[command]
        if command is Command.GRIP:
            session.toggle_grip(host_clock())
        if options.duration_s is not None and session.t >= options.duration_s:
            return f"{options.duration_s:g} s recorded"
        if connection.now - shown >= every_s and session.demo is not None:
            show(session.status())
            shown = connection.now


def _wait_for_port(
    session: Session, connection: SensorConnection, poll: Poll, show: Callable[[Status], None]
) -> Command | None:
    while not (connection.why_over(host_clock()) or connection.reopen()):
        show(replace(session.status(), waiting=f"waiting for {connection.device}"))
        command = poll()
        if command in ENDED_BY:
            return command
        if command is Command.GRIP:
            session.toggle_grip(host_clock())
        time.sleep(0.2)
    return None
