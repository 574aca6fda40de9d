"""Record a demonstration: a port's bytes, decoded, stamped, written at once, and tracked while the hand moves."""

from pbd.record.loop import record
from pbd.record.values import Command, Outcome, RecordOptions, Say, Status

__all__ = ["Command", "Outcome", "RecordOptions", "Say", "Status", "record"]
