"""Record a demonstration: decode a port's bytes, stamp and store the samples, and track the hand while it moves."""

from pbd.record.loop import record
from pbd.record.session_types import Command, Outcome, RecordOptions, Say, Status

__all__ = ["Command", "Outcome", "RecordOptions", "Say", "Status", "record"]
