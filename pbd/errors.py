"""The errors and warnings of pbd. An error's message says where the fault is and ends with what to do next.

The command line prints a `PbdError` as one line on stderr and exits with its `exit_code`. Any other exception is a bug
and keeps its traceback.
"""

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module
from math import pi
from numbers import Integral, Real
from threading import Lock
from types import FrameType
from typing import Any, ClassVar, Self


class PbdError(Exception):
    """The base class. `fields` gives programs the values in the message: keyframe, joint, value, bound, path, line."""

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, **fields: object) -> None:
        self.message: str = one_line(message)
        self.fields: dict[str, Any] = fields
        super().__init__(self.message)

    @classmethod
    def at(cls, path: object, what: str, line: object = None, **fields: object) -> Self:
        """Make the error of a file: the message begins with its path and line, which are in the fields too."""
        if line is None:
            return cls(f"{path}: {what}", path=path, **fields)
        return cls(f"{path}:{line}: {what}", path=path, line=line, **fields)


class SensorError(PbdError):
    """The device, its port or its bytes are at fault."""


class RecordingError(PbdError):
    """A recording, or the file that holds it, is not valid."""


class TrackingError(PbdError):
    """The recording is valid, but no hand path can be estimated from it."""


class CalibrationError(PbdError):
    """A calibration file, or the data to make one from, is at fault."""


class RobotError(PbdError):
    """A robot's description is at fault: its TOML, its URDF or its limits."""


class PlanError(PbdError):
    """The robot can't do the motion: a pose out of reach, a joint limit, a collision."""

    exit_code = 3


class UsageError(PbdError):
    """The caller gave an unknown name, unit or option, or options that exclude each other."""

    exit_code = 2


class WrongTypeError(UsageError, TypeError):
    """An argument of a Python function has the wrong type, such as a robot's name instead of the robot."""


class WrongValueError(UsageError, ValueError):
    """An argument of a Python function has a value that it can't have, such as a size below zero."""


class PbdWarning(UserWarning):
    """Something was repaired or assumed. The result is valid, but the user should know."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


_collect: ContextVar[Callable[[str], object] | None] = ContextVar("_collect", default=None)
"""What takes the text of each warning, in place of Python's own warnings; None: nothing does.

Python's filters are shared by all threads: two that swap them at a time can leave them swapped for good.
"""


def warn(message: str) -> None:
    """Issue a PbdWarning, at the line outside pbd that called it."""
    if collect := _collect.get():
        collect(one_line(message))
        return
    frame: FrameType | None = sys._getframe(1)
    level = 2
    # contextlib calls a function that a context manager decorates.
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in ("pbd", "contextlib"):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, PbdWarning, stacklevel=level)


@contextmanager
def collected_warnings(tell: Callable[[str], object] = str) -> Iterator[list[str]]:
    """Collect the text of each warning of this thread, and call `tell` with it, instead of showing it."""
    collected: list[str] = []

    def collect(message: str) -> None:
        collected.append(message)
        tell(message)

    before = _collect.set(collect)
    try:
        yield collected
    finally:
        _collect.reset(before)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Put a name, of one of several demonstrations, before the messages of the warnings and the PbdError inside."""
    told: list[str] = []
    try:
        with collected_warnings() as told:
            yield
    except PbdError as error:
        raise type(error)(f"{name}: {error.message}", **error.fields) from None
    finally:
        for message in told:
            warn(f"{name}: {message}")


_FILTERS = Lock()
"""Held while Python's filters are swapped."""


@contextmanager
def no_library_warnings() -> Iterator[None]:
    """Hide the warnings of the libraries that are called inside: they concern files of others, or the libraries."""
    with _FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@contextmanager
def noting(note: str) -> Iterator[None]:
    """Add a note to each exception that passes, Ctrl-C too; the command line prints it after the message."""
    try:
        yield
    except BaseException as error:
        error.add_note(note)
        raise


def with_notes(message: str, error: BaseException) -> str:
    """Return the message of an exception with its notes."""
    return "; ".join([message, *getattr(error, "__notes__", ())])


LONGEST_MESSAGE = 1000
"""Longest message, characters. A message may quote a file, whose words may be of any length."""


def one_line(message: str) -> str:
    """Make a message one line: escape control characters, and cut the middle out where it is longer than allowed."""
    if not message.isprintable():
        message = "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in message)
    if len(message) <= LONGEST_MESSAGE:
        return message
    return f"{message[: LONGEST_MESSAGE // 2]} ... {message[-LONGEST_MESSAGE // 2 :]}"


LONGEST_REASON = 200
"""Longest reason that a message quotes, characters. A library's may quote a file: zipfile's quotes all of it."""


def in_words(reason: Exception) -> str:
    """Return the reason of an exception, without errno and path: the message that quotes it names the path."""
    words = (reason.strerror if isinstance(reason, OSError) else None) or str(reason) or type(reason).__name__
    return words if len(words) <= LONGEST_REASON else f"{words[:LONGEST_REASON]}..."


def require_package(module: str, extra: str, what: str) -> None:
    """Raise PbdError if a module that `what` needs can't be imported; pbd-robot[`extra`] installs it."""
    try:
        import_module(module)
    except ImportError:
        package, how = module.partition(".")[0], f"pip install 'pbd-robot[{extra}]'"
        raise PbdError(f"{what} needs the package {package}; install it with: {how}") from None


def require_type(function: str, value: object, source: str, *types: type, optional: bool = False) -> None:
    """Raise WrongTypeError unless `value` has one of the types that `function` takes; `source` returns such a value.

    `optional`: it may be None.
    """
    if not (isinstance(value, types) or (optional and value is None)):
        wanted = " or ".join(f"a {each.__name__}" for each in types)
        raise WrongTypeError(f"{function} takes {wanted}, got {value!r:.60}; {source} returns one")


def require_kind(name: str, value: object, kind: str, valid: bool) -> None:
    """Raise WrongTypeError unless the argument `name` is `valid`, which means that it is of a `kind`: "a number"."""
    if not valid:
        raise WrongTypeError(f"{name} must be {kind}, got {value!r:.60}")


def is_number(value: object) -> bool:
    """Whether a value is a real number, of Python or of numpy; True and False are none."""
    return isinstance(value, Real) and not isinstance(value, bool)


def is_whole_number(value: object) -> bool:
    """Whether a value is a whole number, of Python or of numpy; True and False are none."""
    return isinstance(value, Integral) and not isinstance(value, bool)


MOST_LISTED = 12
"""Largest number of names that a message lists."""

LONGEST_WORD = 80
"""Longest word of a file that a message quotes uncut, characters."""


MOST_SUGGESTED = 3
"""Largest number of equally similar names that a message suggests."""

SIMILAR = 0.65
"""Least similarity (difflib's ratio) of a suggested name: `cub` to `cup` has 0.67, `position` to `orientation` 0.63."""


def printable(text: str) -> str:
    """Quote a word of a file for a message: control characters are escaped, a long word is cut."""
    shown = text if text.isprintable() else repr(text)[1:-1]
    return shown if len(shown) <= LONGEST_WORD else f"{shown[:LONGEST_WORD]}..."


def listed(names: Iterable[str]) -> str:
    """Join names with commas for a message; of many, only the first ones and the number of the others."""
    given = [printable(name) for name in names]
    more = f" and {len(given) - MOST_LISTED} more" if len(given) > MOST_LISTED else ""
    return ", ".join(given[:MOST_LISTED]) + more or "(none)"


def amount(number: float, unit: str, form: str = "") -> str:
    """Write a number with its unit for a message: `1 degree`, `2 degrees`, `1.0 degrees`. `form` formats the number."""
    shown = f"{number:{form}}"
    return f"{shown} {unit}{'' if shown in ('1', '-1') else 's'}"


def in_degrees(rad: float) -> str:
    """Write an angle for a message, in whole degrees."""
    return amount(180.0 / pi * rad, "degree", ".0f")


def in_mm_or_cm(metres: float) -> str:
    """Write a length for a message: in mm below 1 cm, so that a small one does not read 0.0 cm."""
    return f"{1e3 * metres:.2g} mm" if metres < 0.01 else f"{1e2 * metres:.1f} cm"


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the known names that are most similar to this one; "" if none is similar."""
    from difflib import SequenceMatcher

    wanted = name.lower().lstrip("-")
    likeness = {each: SequenceMatcher(None, each.lower().lstrip("-"), wanted).ratio() for each in known}
    best = max(likeness.values(), default=0.0)
    near = [each for each, like in likeness.items() if like == best][:MOST_SUGGESTED]
    return f"; did you mean {' or '.join(near)}?" if best >= SIMILAR else ""
