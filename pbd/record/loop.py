"""The recording loop: it runs until a person ends it, the time is over, or the sensor is gone."""

import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace

from pbd.errors import PbdError, SensorError, amount
from pbd.record.session import Session
from pbd.record.session_types import ENDED_BY, Command, Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.probe import describe_bytes, identify_protocol
from pbd.sensors.reader import Reader, Source
from pbd.tracking.repair.clock import CLOCK_JUMP_S

SILENT_S = 3.0
"""Time without a byte after which a serial device counts as unplugged or switched off, s. A phone gets longer."""

SUSPENDED_S = 1.0
"""Idle time in one round of the loop which shows that this program was suspended (Ctrl-Z, a sleeping machine), s."""

MAX_BACKLOG_S = 2.0
"""Longest time that samples may wait to be taken, s. If they wait longer, they come faster than this machine can take
them."""

MIN_SAMPLES = 2
"""Smallest number of samples in the first SILENT_S. With fewer, the device sends too slowly to be recorded."""

SCREEN_EVERY_S = 0.1
"""Time between two updates of the screen, s."""

REOPEN_EVERY_S = 0.2
"""Time between two attempts to reopen a lost port, s."""

Poll = Callable[[], Command | None]


def record(
    open_port: Callable[[], Source],
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
    options, shown, disconnected, behind, watch = session.options, 0.0, False, False, _SuspendDetector()
    while True:
        pieces, gone = reader.take()
        stopped_s = watch.suspended_s()
        now = watch.now
        if session.demo is not None and _is_over(session, reader, pieces[0][1] if pieces else now):
            return f"no sample for {CLOCK_JUMP_S:g} s"
        if stopped_s:
            session.warn(f"this program was suspended for {stopped_s:.1f} s: samples of that time may be lost")
        elif pieces and now - pieces[0][1] > MAX_BACKLOG_S and not behind:
            behind = True
            session.warn("samples come faster than this machine takes them: lower the sensor's rate")
        silent_s = now - max(reader.latest, watch.resumed)
        if pieces and disconnected:
            disconnected = False
            session.warn("the sensor is back")
        elif silent_s > SILENT_S and reader.port.trouble and not disconnected and session.demo is not None:
            disconnected = True
            session.warn(f"{reader.port.trouble} (waiting)")
        for data, arrival in pieces:
            session.take(data, arrival)
        if session.demo is None and (gone or now - max(reader.opened, watch.resumed) > SILENT_S):
            if not session.decodable or (session.samples < MIN_SAMPLES and not gone):
                raise gone or _no_samples_error(session, reader)
            session.begin()
        session.flush()
        unheard_s = reader.latest - max(session.heard, reader.opened, watch.resumed)
        if reader.port.baud and session.demo is not None and unheard_s > SILENT_S:
            return (
                f"no sample of {options.sensor} in the bytes of {SILENT_S:g} s: does it now send at another baud rate?"
            )
        if gone or (not pieces and silent_s > (reader.port.patience_s or SILENT_S)):
            why = f"sensor silent for {SILENT_S:g} s" if not gone else reader.port.trouble or "sensor unplugged"
            if not options.reconnect:
                return why
            if not disconnected:
                session.warn(f"{why}; waiting for {reader.port.device}")
            command, disconnected, watch = _wait_for_port(session, reader, poll, show), True, _SuspendDetector()
        else:
            command = poll()
        if command is Command.DISCARD:
            session.discard()
        if command in ENDED_BY:
            return ENDED_BY[command]
        if command is Command.GRIP:
            session.toggle_grip()
        if options.duration_s is not None and session.t >= options.duration_s:
            return f"{options.duration_s:g} s recorded"
        if now - shown >= every_s and session.demo is not None:
            show(session.status())
            shown = now


class _SuspendDetector:
    """Detects that this program was suspended, in which case a silence is not the sensor's fault.

    Attributes:
        now: the host's monotonic clock at the last call, s.
        resumed: when the program last resumed, s; 0: it was never suspended.
    """

    def __init__(self) -> None:
        self.now, self.resumed = time.monotonic(), 0.0
        self._worked = time.process_time()

    def suspended_s(self) -> float:
        """Return how long the program was suspended since the last call, s; usually 0."""
        before, self.now = self.now, time.monotonic()
        worked, self._worked = self._worked, time.process_time()
        idle = self.now - before - (self._worked - worked)
        if idle < SUSPENDED_S:
            return 0.0
        self.resumed = self.now
        return idle


def _wait_for_port(session: Session, reader: Reader, poll: Poll, show: Callable[[Status], None]) -> Command | None:
    reader.close()
    waiting = f"waiting for {reader.port.device}"
    while not (_is_over(session, reader, time.monotonic()) or reader.reopen()):
        show(replace(session.status(), waiting=waiting))
        command = poll()
        if command in ENDED_BY:
            return command
        time.sleep(REOPEN_EVERY_S)
    return None


def _is_over(session: Session, reader: Reader, now: float) -> bool:
    """Whether the gap up to now is longer than any that can be tracked. A phone keeps the samples of a gap."""
    return reader.port.patience_s is None and now - session.heard > CLOCK_JUMP_S


def _no_samples_error(session: Session, reader: Reader) -> SensorError:
    port, sensor, tally = reader.port, session.options.sensor, session.decoder.tally
    whole = tally.packets > tally.bad_packets and identify_protocol(session.first_bytes) in (None, sensor)
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
            f"{amount(reader.bytes_seen, 'byte')} came from {port.device}{at}, but {count} of {sensor}: "
            f"{describe_bytes(session.first_bytes, port.baud, sensor, tally.why)}"
        )
    return SensorError(message, path=port.device, baud=port.baud)
