"""Caches the results of tracking and planning by input, for tests of what commands print and write."""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Robot
from pbd.errors import collected_warnings, warn

FUNCTIONS = (
    ("pbd.pipeline", "track_recording"),
    ("pbd.fusion.takes", "track_recording"),
    ("pbd.planning.plan", "plan_keyframes"),
    ("pbd.planning.plan", "_works"),
)
"""The functions that take most of the time. Each is deterministic (tests/test_same_bytes.py)."""

ROBOTS = Path(__file__).parents[1] / "robots"

MOST = 60
"""Largest number of cached results per function: they take about 100 MB."""


def key(value: object) -> object:
    """A value as nested tuples, equal if the values are equal bit by bit; a path includes its modification time."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Path):
        return value, value.stat().st_mtime_ns if value.is_file() else None
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(key(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, partial):  # the covariance of a path that was closed
        return value.func, key(value.args), key(value.keywords)
    if isinstance(value, Mapping):
        return tuple((name, key(each)) for name, each in value.items())
    return tuple(map(key, value)) if isinstance(value, tuple | list) else value


@cache
def remembering(module: str, function: str) -> Callable[..., Any]:
    """A cached version of a function, which repeats the warnings and the exception of the first call."""
    asked: Callable[..., Any] = getattr(importlib.import_module(module), function)
    answers: dict[object, tuple[Any, Exception | None, list[str]]] = {}

    def remembered(*args: object, **options: object) -> Any:
        question = key((args, options))
        if question not in answers:
            answer, error = None, None
            with collected_warnings() as told:
                try:
                    answer = asked(*args, **options)
                except Exception as refusal:
                    error = refusal
            answers[question] = answer, error, told
            if len(answers) > MOST:
                del answers[next(iter(answers))]
        answer, error, messages = answers[question]
        for message in messages:
            warn(message)
        if error is not None:
            raise error.with_traceback(None)
        return answer

    return remembered


@cache
def _bundled(path: Path, read: Callable[..., Robot]) -> Robot:
    return read(path)


def reading_once(read: Callable[..., Robot]) -> Callable[..., Robot]:
    """A reader that reads each bundled robot once, so that all tests share the planner's caches of it."""

    def read_once(path: Path, *, draft: bool = False) -> Robot:
        whole = path.absolute()
        return _bundled(whole, read) if whole.parent == ROBOTS and not draft else read(path, draft=draft)

    return read_once
