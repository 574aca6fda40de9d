"""What can go wrong, by whose fault: every error says where it is and ends with what to do next.

The command line prints a `PbdError` as one line on stderr and leaves with its `exit_code`; any other exception is a bug
and keeps its traceback.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, ClassVar, Self


class PbdError(Exception):
    """The root. `fields` holds what the message is about (keyframe, joint, value, bound, path, line), for programs."""

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, **fields: object) -> None:
        self.message = one_line(message)
        self.fields = fields
        super().__init__(self.message)

    @classmethod
    def at(cls, path: object, what: str, line: object = None, **fields: object) -> Self:
        """Say what is wrong with a file: its path and line stand first in the message, and in the fields."""
        if line is None:
            return cls(f"{path}: {what}", path=path, **fields)
        return cls(f"{path}:{line}: {what}", path=path, line=line, **fields)


class SensorError(PbdError):
    """The device, its port or its bytes."""


class RecordingError(PbdError):
    """A recording, or the file it stands in, can't be read as one."""


class TrackingError(PbdError):
    """The recording is sound but no hand path follows from it."""


class CalibrationError(PbdError):
    """A calibration file, or the data that one would be made from."""


class RobotError(PbdError):
    """A robot description: its TOML, its URDF, its limits."""


class PlanError(PbdError):
    """The robot can't do it: out of reach, limits, collision."""

    exit_code = 3


class UsageError(PbdError):
    """A name, a unit or an option that the caller gave is not known, or doesn't go with another."""

    exit_code = 2


class WrongTypeError(UsageError, TypeError):
    """An argument of a Python function has the wrong type, such as a robot's name instead of the robot."""


class PbdWarning(UserWarning):
    """Something was mended or assumed on the way; the result is sound but the reader should know."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def warn(message: str) -> None:
    """Give a PbdWarning."""
    warnings.warn(message, PbdWarning, stacklevel=3)


@contextmanager
def collected_warnings(tell: Callable[[str], object] = str) -> Iterator[list[str]]:
    """Collect the text of each PbdWarning that is given inside, and `tell` it, instead of showing it."""
    collected: list[str] = []
    as_usual = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, PbdWarning):
            collected.append(str(message))
            tell(str(message))
        else:
            as_usual(message, category, *where, **more)

    with warnings.catch_warnings():
        warnings.simplefilter("always", PbdWarning)
        warnings.showwarning = collect
        yield collected


LONGEST_MESSAGE = 1000
"""Longest message, characters: what a file says may be in it."""


def one_line(message: str) -> str:
    """Write a message on one line, in print that no terminal obeys, without the middle where it is very long."""
    if not message.isprintable():
        message = "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in message)
    if len(message) <= LONGEST_MESSAGE:
        return message
    return f"{message[: LONGEST_MESSAGE // 2]} ... {message[-LONGEST_MESSAGE // 2 :]}"


def in_words(reason: Exception) -> str:
    """Say what the system or a parser refused, without an error number and the path, which the message has."""
    return reason.strerror if isinstance(reason, OSError) and reason.strerror else str(reason)


def require_package(module: str, extra: str, what: str) -> None:
    """Refuse (PbdError) `what` needs a package that is not there; pbd-robot[`extra`] brings it."""
    try:
        import_module(module)
    except ImportError:
        package, how = module.partition(".")[0], f"pip install 'pbd-robot[{extra}]'"
        raise PbdError(f"{what} needs the package {package}; install it with: {how}") from None


def require_type(function: str, value: object, source: str, *types: type) -> None:
    """Raise WrongTypeError unless `value` has one of the types that `function` takes; `source` returns such a value."""
    if not isinstance(value, types):
        wanted = " or ".join(f"a {each.__name__}" for each in types)
        raise WrongTypeError(f"{function} takes {wanted}, got {value!r:.60}; {source} returns one")


MOST_LISTED = 12
"""Most names that a message lists."""

LONGEST_WORD = 80
"""Longest word of a file that a message shows whole, characters."""


def printable(text: str) -> str:
    """Write a word of a file for a message: cut where it is long, in print that no terminal obeys."""
    shown = text if text.isprintable() else repr(text)[1:-1]
    return shown if len(shown) <= LONGEST_WORD else f"{shown[:LONGEST_WORD]}..."


def listed(names: Iterable[str]) -> str:
    """Write names for a message, the first of them where there are many."""
    given = [printable(name) for name in names]
    more = f" and {len(given) - MOST_LISTED} more" if len(given) > MOST_LISTED else ""
    return ", ".join(given[:MOST_LISTED]) + more or "(none)"


def nearest(name: str, known: Iterable[str]) -> str:
    """Ask "; did you mean ...?" where one that is known is much like this name; "" elsewhere."""
    from difflib import get_close_matches

    folded = {each.lower(): each for each in known}
    near = get_close_matches(name.lower(), folded, n=1)
    return f"; did you mean {folded[near[0]]}?" if near else ""
