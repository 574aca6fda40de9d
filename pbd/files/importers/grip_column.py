"""The column of a table that says whether the hand's grip is closed: 0 and 1, true and false, or open and closed."""

from __future__ import annotations

import re
from collections.abc import Mapping

from pbd.data import GripEvent
from pbd.errors import RecordingError, listed, printable, warn
from pbd.files.importers.header_names import plain
from pbd.files.table import Sheet, refuse_missing
from pbd.io.numbers import NO_NUMBER
from pbd.pose import Array

CLOSED, OPEN = ("1", "true", "closed", "close"), ("0", "false", "open", "opened")
"""Words of a closed and of an open grip, in lower case."""

_SAYS = r"(?:is_)?(?:grip|gripper|hand)(?:_is)?_(?P<state>closed?|open(?:ed)?)"
"""Names that say what 1 means. A bare `gripper` doesn't: it may go from 0, closed, to 1, open."""

_MAY_SAY = r"(?:.*_)?grip(?:per)?(?:_(?:state|cmd|command|status|pos|position))?"


def read_grip(sheet: Sheet, columns: Mapping[str, str], t: Array) -> tuple[str, tuple[GripEvent, ...]]:
    """Return the column of the grip, or "", and the events at which it closes or opens.

    An empty cell leaves the grip as it is. It is open before the first row.

    Args:
        columns: the caller's; `grip` is a column in which 1 is closed, -NAME one in which 1 is open.
        t: (rows,) s from the first row.

    Raises:
        RecordingError: there is no such column, or a cell says neither open nor closed.
    """
    given = columns.get("grip", "")
    name = given if given in sheet.header else given.removeprefix("-")
    reverse = name != given
    if given:
        refuse_missing(sheet.path, sheet.header, [name], RecordingError)
    for each in () if given else sheet.header:
        if says := re.fullmatch(_SAYS, plain(each)):
            name, reverse = each, says["state"].startswith("open")
            break
        if re.fullmatch(_MAY_SAY, plain(each)):
            words = {word.strip('"').lower() for word in sheet.words(each)} - NO_NUMBER
            if words <= {*CLOSED[2:], *OPEN[2:]}:
                name = each
                break
            if words <= {"0", "1", "true", "false"}:
                option = f"--column grip={printable(each)}"
                what = f"the column '{printable(each)}' seems to be the gripper's, and is not read"
                warn(f"{what}: import it with {option} if {max(words)} is closed, or with grip=- and its name if open")
    if not name:
        return "", ()
    events, closed = [], False
    for row, word in enumerate(map(str.lower, sheet.words(name))):
        state = word.strip('"').removesuffix(".0")
        if state in NO_NUMBER:
            continue
        if state not in (*CLOSED, *OPEN):
            what = f"'{printable(word)}' in column '{printable(name)}' is no state of a grip"
            raise RecordingError.at(
                sheet.path, f"{what}; give one of {listed((*CLOSED, *OPEN))}", sheet.cell(name, row)[0]
            )
        now = (state in CLOSED) is not (reverse and state in ("0", "1", "true", "false"))
        if now is not closed:
            events.append(GripEvent(float(t[row]), now))
        closed = now
    return name, tuple(events)
