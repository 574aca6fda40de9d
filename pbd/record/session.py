"""A recording session: it takes bytes, writes rows to disk, and gives the status for the screen."""

from collections import deque
from contextlib import suppress
from math import hypot
from pathlib import Path

import numpy as np

from pbd.data import GripEvent, Recording, RecordingInfo
from pbd.data.recording import DEVICE_CLOCK
from pbd.errors import PbdError, RecordingError, collected_warnings
from pbd.files.demo import read_demo
from pbd.files.recording_writer import RecordingWriter
from pbd.record.diagnostics import Diagnostics
from pbd.record.person_messages import Feedback
from pbd.record.replaced_demo import Backup, set_aside
from pbd.record.session_types import (
    FEWEST_STOPS,
    TOO_FEW_STOPS,
    Outcome,
    RecordOptions,
    Status,
    recording_from_samples,
)
from pbd.sensors.decoding import Decoder, Sample
from pbd.timestamps.sample_clock import SampleClock
from pbd.tracking.online.tracker import LiveTracker
from pbd.tracking.taps import TapDetector

FIRST_BYTES = 4096
"""Number of first bytes that are kept to identify the sensor if they can't be decoded."""


class Session:
    """Decodes, stamps, stores and tracks samples. It writes nothing to disk before the first samples.

    Attributes:
        demo: writes the demonstration; None until the recording has begun.
        t: time of the latest sample, s.
        heard: arrival of the latest sample on the host's clock, s; 0 before the first.
        closed: whether the grip is closed.
        discarded: whether the person discarded the recording.
        first_bytes: the first FIRST_BYTES bytes or more.
        backup: the demonstration that this one replaces, or None.
    """

    def __init__(self, decoder: Decoder, options: RecordOptions) -> None:
        self.decoder, self.options = decoder, options
        self.feedback = Feedback(options.tolerance_m, options.errors, options.sensor)
        self.demo: RecordingWriter | None = None
        self.t = self.heard = 0.0
        self.closed = False
        self.discarded = False
        self.first_bytes = b""
        self.backup: Backup | None = None
        self._folder, self._backup_note, self._why_failed = options.folder, "", ""
        self._diagnostics = Diagnostics()
        self._taps = TapDetector() if options.taps else None
        self._presses = 0
        self._raw = bytearray()
        self._new: list[tuple[float, Sample]] = []  # neither written nor tracked yet
        self._recent: deque[tuple[float, float]] = deque()
        self._clock: SampleClock[Sample] = SampleClock()

    def take(self, data: bytes, arrival: float) -> None:
        """Decode bytes that arrived at `arrival` s; stamp and store their samples."""
        for decoded in self.decoder.feed(data):
            if decoded.acc is not None:
                self.heard = arrival
                self._add(self._clock.take(decoded, decoded.t_device, arrival))
        while self._presses < self.decoder.tally.grip_presses:
            self._presses += 1
            self.toggle_grip(arrival)
        if len(self.first_bytes) < FIRST_BYTES:
            self.first_bytes += data
        if self.t >= 0.2:  # the samples have shown the sensor's channels
            self.begin()
        if self.options.raw:
            self._raw += data

    def _add(self, stamped: list[tuple[float, Sample]]) -> None:
        self._new += stamped
        self.t = stamped[-1][0] if stamped else self.t

    @property
    def samples(self) -> int:
        """Number of samples that came and count."""
        return len(self._clock.times)

    @property
    def clock_stands(self) -> bool:
        """Whether samples came, all with the same time of the device."""
        return self._clock.stands

    @property
    def decodable(self) -> bool:
        """Whether the bytes are certainly of this protocol: a few samples also come by chance, among bad packets."""
        return self.samples > 0 and self.decoder.tally.packets > self.decoder.tally.bad_packets

    def flush(self) -> None:
        """Write the new samples and raw bytes to disk; then, because it may take long, track and check them."""
        if self.demo is None:
            return
        if self._raw:
            self.demo.add_raw(bytes(self._raw))
            self._raw.clear()
        if self._new:
            self.demo.add(self._new_recording())
        new, self._new = self._new, []
        for t, sample in new:
            assert sample.acc is not None
            self._recent.append((t, hypot(*sample.acc)))
            if self._taps is not None and (tapped_t := self._taps.feed(t, sample.acc)) is not None:
                self._toggle_grip(tapped_t, "two taps: ")
            self.feedback.feed(t, sample)
            for line in self._diagnostics.feed(t, sample):
                self.feedback.say(t, line, bell=True)

    def toggle_grip(self, pressed: float) -> None:
        """Toggle the grip, at `pressed` s on the host's clock; in bursts, the samples of that time come later."""
        if self.demo is not None:
            self._toggle_grip(self._clock.time_at(pressed))

    def _toggle_grip(self, at: float, by: str = "") -> None:
        assert self.demo is not None
        self.closed = not self.closed
        self.demo.mark(GripEvent(at, self.closed))
        self.feedback.mark_grip(at)
        self.feedback.say(self.t, f"{by}grip {'closed' if self.closed else 'open'}", bell=bool(by))

    def warn(self, what: str) -> None:
        """Add a message with a bell."""
        self.feedback.say(self.t, what, bell=True)

    def discard(self) -> None:
        """Remove the recording from disk."""
        self.discarded = True
        if self.demo is not None:
            self.demo.discard()

    def settle_backup(self) -> None:
        """After all is written, remove or restore the demonstration that this one replaces."""
        if self.backup is None:
            return
        if self.discarded:
            self._backup_note = self.backup.put_back()
        elif not self._why_failed:
            self._backup_note = self.backup.replace()
        elif self.feedback.tracker.waiting:
            self._folder, self._backup_note = self.backup.swap_back()
        else:
            self._backup_note = self.backup.keep()

    def backup_message(self) -> str:
        """Say after an error where the demonstration is that this one replaces; "" for none."""
        if self.backup is None:
            return self._backup_note
        return f"the demonstration before it is in {self.backup.aside}"

    def begin(self) -> None:
        """Begin to write, with the samples so far. Nothing happens if it has begun, was discarded, or can't be decoded.

        Raises:
            RecordingError: the folder exists or can't be written.
        """
        if self.demo is None:
            self._add(self._clock.release())
        if self.demo is not None or self.discarded or not self.decodable:
            return
        channels = self._new_recording().channels
        options = self.options
        self.feedback.tracker = LiveTracker(options.sensor, options.errors, straightened=self._clock.is_straightened)
        info = RecordingInfo(sensor=options.sensor, created=options.created, clock=self._clock_name)
        if options.force:
            self.backup = set_aside(options.folder)
        try:
            self.demo = RecordingWriter(options.folder, info, channels, options.closed)
        except PbdError:
            self._put_back()
            raise
        if self.backup is not None:
            self.feedback.say(self.t, self.backup.notice)
        self.flush()

    def close(self) -> None:
        """Write the rest, and what is known at the end only: the rate, and times fitted to the whole recording."""
        self._add(self._clock.release())
        self._clock.count_lost()
        if self.demo is None or self.discarded:
            return
        try:
            self.flush()
        except RecordingError:
            if self.demo.rows == 0:
                self.demo.discard()
                self._put_back()
            else:
                with suppress(PbdError):  # a full disk: reported already
                    self._finish(self.demo)
            raise
        self._finish(self.demo)

    def _put_back(self) -> None:
        if self.backup is not None:
            self._backup_note, self.backup = self.backup.put_back(), None

    def _finish(self, demo: RecordingWriter) -> None:
        times = self._clock.straightened if demo.rows == len(self._clock.times) else None
        duration = self.t if times is None else float(times[-1])
        rows = demo.rows + self._clock.lost
        interval = duration / max(rows - 1, 1) if times is None else float(np.median(np.diff(times)))  # the usual one
        rate_hz = float(f"{1.0 / interval:.5g}") if duration > 0.0 else None
        demo.finish(rate_hz, self._clock_name, times)
        self._why_failed = self._find_failure(demo.folder)
        if self._why_failed:
            demo.mark_failed()

    def _find_failure(self, folder: Path) -> str:
        """Track the recording as commands will; return why nothing can be replayed, or ""."""
        from pbd.pipeline import track

        try:
            with collected_warnings():  # the person was told while it was recorded
                stops = len(track(read_demo(folder)).stops)
        except PbdError as error:
            return error.message
        return "" if stops >= FEWEST_STOPS else TOO_FEW_STOPS

    def status(self) -> Status:
        """Return the status, with the messages since the last one."""
        self._clock.count_lost(if_due=True)
        while self._recent and self._recent[0][0] < self.t - 1.0:
            self._recent.popleft()
        span = self.t - self._recent[0][0] if self._recent else 0.0
        norms = [norm for t, norm in self._recent if t > self.t - 0.5]
        tracker = self.feedback.tracker
        return Status(
            t=self.t,
            rate_hz=(len(self._recent) - 1) / span if span > 0.0 else 0.0,
            samples=self.samples,
            lost=self._clock.lost,
            bad_packets=self.bad_packets,
            waiting=tracker.waiting,
            moving=tracker.moving,
            stops=self.feedback.stops,
            keyframes=tracker.keyframes,
            p_nav_sensor=tracker.p_nav_sensor,
            v_nav_sensor=tracker.v_nav_sensor,
            wxyz_nav_sensor=tracker.wxyz_nav_sensor,
            sigma_m=tracker.sigma_now,
            sigma_of_move_m=tracker.sigma_of_move,
            tremor=float(np.std(norms)) if norms else 0.0,
            closed=self.closed,
            messages=self.feedback.take_messages(),
        )

    def outcome(self, ended_by: str) -> Outcome:
        """Return how the recording ended."""
        return Outcome(
            folder=None if self.discarded or self.demo is None else self._folder,
            samples=self.samples,
            duration_s=self.t,
            lost=self._clock.lost,
            bad_packets=self.bad_packets,
            stops=self.feedback.stops,
            ended_by=ended_by,
            backup_note=self._backup_note,
            why_bad=self.decoder.tally.last_fault,
            why_failed=self._why_failed,
        )

    @property
    def bad_packets(self) -> int:
        """Number of packets that were broken, and of samples that were rejected for their times."""
        return self.decoder.tally.bad_packets + self._clock.doubted

    @property
    def _clock_name(self) -> str:
        return DEVICE_CLOCK if self._clock.is_device else "host: arrival times, straightened"

    def _new_recording(self) -> Recording:
        t, samples = zip(*self._new, strict=True)
        return recording_from_samples(np.array(t), samples)
