"""The column of a table that says whether the hand's grip is closed: numbers from 0 to 1, or words."""

import math
import re
import shlex
from contextlib import suppress

from pbd.data import GripEvent
from pbd.errors import RecordingError, listed, printable, warn
from pbd.files.importers.header_names import plain
from pbd.files.table import Sheet, refuse_missing
from pbd.io.numbers import NO_NUMBER, number
from pbd.pose import Array

WORDS = {"closed": 1.0, "close": 1.0, "open": 0.0, "opened": 0.0}
"""Words, in lower case, that say how far the grip is closed, from 0 to 1, whatever the column is called."""

HALF_CLOSED = 0.5
"""A grip is closed if it is closed further than this, from 0 to 1: halfway."""

_SAYS = r"(?:is_)?(?:grip|gripper|hand)(?:_is)?_(?P<state>closed?|open(?:ed)?)"
"""Names that say what 1 means. A bare `gripper` doesn't: it may go from 0, closed, to 1, open."""

_MAY_SAY = r"(?:.*_)?grip(?:per)?(?:_(?:state|cmd|command|status|pos|position))?"


def read_grip(sheet: Sheet, given: str, t: Array) -> tuple[dict[str, str], tuple[GripEvent, ...]]:
    """Return the column of the grip, if there is one, with how it was read, and the events of closing and opening.

    An empty cell leaves the grip as it is. It is open before the first row.

    Args:
        given: the caller's column, in which 1 is closed; -NAME: in which 1 is open; "": none.
        t: (rows,) s from the first row.

    Raises:
        RecordingError: there is no such column, or a cell says neither open nor closed.
    """
    if given:
        name = given if given in sheet.header else given.removeprefix("-")
        reverse = name != given
        refuse_missing(sheet.path, sheet.header, [name], RecordingError)
    else:
        name, reverse = _find_column(sheet)
    if not name:
        return {}, ()
    sheet.refuse_duplicates((name,))
    events, closed = [], False
    levels: set[float] = set()
    for row, word in enumerate(map(str.lower, sheet.words(name))):
        state = word.strip('"')
        if state in NO_NUMBER:
            continue
        level = _level(state)
        if level is None:
            what = f"'{printable(word)}' in column '{printable(name)}' is no state of a grip"
            known = f"give one of {listed(('true', 'false', *WORDS))}, or a number from 0 to 1"
            raise RecordingError.at(sheet.path, f"{what}; {known}", sheet.cell(name, row)[0])
        levels.add(level)
        now = (level > HALF_CLOSED) is not (reverse and state not in WORDS)
        if now is not closed and math.isfinite(t[row]):  # else it counts from the next row with a time
            events.append(GripEvent(float(t[row]), now))
            closed = now
    if not levels <= {0.0, 1.0}:
        column = f"the column '{printable(name)}'"
        if not min(levels) <= HALF_CLOSED < max(levels):
            what = f"{column} goes from {min(levels):g} to {max(levels):g}, and does not cross {HALF_CLOSED:g}"
            raise RecordingError.at(sheet.path, f"{what}; scale it, so that it goes from 0 to 1")
        warn(f"{column} has fractions: the grip is {'open' if reverse else 'closed'} above {HALF_CLOSED:g}")
    does = (f"{'closes' if event.closed else 'opens'} at {event.t:.1f} s" for event in events)
    return {name: f"read as the grip: {listed(does) or 'always open'}"}, tuple(events)


def _find_column(sheet: Sheet) -> tuple[str, bool]:
    """Return the grip's column by its name or words ("": none), and whether 1 is open in it; warn of likely ones."""
    for name in sheet.header:
        if says := re.fullmatch(_SAYS, plain(name)):
            return name, says["state"].startswith("open")
        if re.fullmatch(_MAY_SAY, plain(name)):
            words = {word.strip('"').lower() for word in sheet.words(name)} - NO_NUMBER
            if words <= WORDS.keys():
                return name, False
            if None not in (likely := set(map(_level, words))):
                option = f"--column {shlex.quote(f'grip={printable(name)}')}"
                what = f"the column '{printable(name)}' seems to be the gripper's, and is not read"
                high = max(words) if likely <= {0.0, 1.0} else f"above {HALF_CLOSED:g}"
                warn(f"{what}: import it with {option} if {high} is closed, or with grip=- and its name if open")
    return "", False


def _level(word: str) -> float | None:
    """Return how far a word or a number, in lower case, says that the grip is closed; None if it doesn't."""
    level = {"true": 1.0, "false": 0.0, **WORDS}.get(word)
    with suppress(ValueError):
        level = number(word) if level is None else level
    return level if level is not None and 0.0 <= level <= 1.0 else None
