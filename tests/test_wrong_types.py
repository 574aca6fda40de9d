"""A name instead of the value it names is a WrongTypeError with a clear message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import pbd
from pbd.data import Calibration
from pbd.errors import UsageError, WrongTypeError

WRONG: dict[str, Callable[[Any], object]] = {
    "track takes a Recording or a Demonstration, got 'tea'; pbd.load_demo returns one": pbd.track,
    "fuse takes a Demonstration, got 'tea'; pbd.load_demo returns one": lambda name: pbd.fuse([name]),
    "plan takes a HandPath, got 'tea'; pbd.track returns one": lambda name: pbd.plan(name, name, name),
    "check_all takes a list of demonstrations: check_all(['tea'])": pbd.check_all,
}


@pytest.mark.parametrize("message", WRONG)
def test_a_name_is_refused_and_the_function_that_loads_it_is_named(message: str) -> None:
    with pytest.raises(TypeError) as caught:
        WRONG[message]("tea")
    assert isinstance(caught.value, UsageError)
    assert str(caught.value) == message


@pytest.mark.usefixtures("remembered")
def test_plan_refuses_a_robots_name_and_a_robot_without_a_dock() -> None:
    plan: Callable[..., object] = pbd.plan
    path = pbd.track(pbd.load_demo("pouring"))
    with pytest.raises(WrongTypeError, match=r"^plan takes a Robot, got 'ur5'; pbd\.load_robot returns one$"):
        plan(path, Calibration("x"), "ur5")
    with pytest.raises(
        WrongTypeError, match=r"^plan takes a Calibration, got None; pbd\.load_calibration returns one$"
    ):
        plan(path, None, pbd.load_robot("ur5"))
