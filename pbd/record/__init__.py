"""Record a demonstration: decode a port's bytes, stamp and store the samples, and track the hand while it moves."""

from pbd.record.loop import record
from pbd.record.session_types import Command, Message, Outcome, RecordOptions, Status

__all__ = ["Command", "Message", "Outcome", "RecordOptions", "Status", "record"]
