"""A live tracker that was fed with a recording."""

from pbd.data import Recording
from pbd.tracking.online.tracker import LiveEvent, LiveTracker, StopBegan
from tests.scenarios import with_rows


def fed(recording: Recording, sizes: list[int] | None = None) -> tuple[LiveTracker, list[LiveEvent]]:
    """Feed a recording as a whole, or in pieces of these sizes, repeated."""
    tracker, start = LiveTracker(recording.info.sensor), 0
    events: list[LiveEvent] = []
    while start < len(recording):
        size = len(recording) if sizes is None else sizes[start % len(sizes)]
        rows = slice(start, start + size)
        part = with_rows(recording, rows)
        events += tracker.feed(part.t, part.acc, part.gyr, part.mag, part.device_rpy)
        start += size
    return tracker, events


def began(events: list[LiveEvent]) -> list[StopBegan]:
    return [event for event in events if isinstance(event, StopBegan)]
