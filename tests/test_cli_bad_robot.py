"""Robots that can't be: each is one line that says where and what, and the right exit code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.arm.conftest import PANDA
from tests.test_cli import Capture, elsewhere, refused

__all__ = ["elsewhere"]  # every command runs in an empty folder

URDF = """<robot name="two"><link name="base"/><link name="upper">{mesh}</link><link name="tip"/>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>
"""

TOML = """format = 1
name = "mine"
description = "two joints"
[model]
urdf = "mine.urdf"
base = "base"
body = "tip"
T_body_tool = { xyz = [0, 0, 0], rpy_deg = [0, 0, 0] }
[arm]
home = [0.0, 0.0]
[limits]
source = "a test"
velocity = [1.0, 1.0]
acceleration = [5.0, 5.0]
jerk = [50.0, 50.0]
"""


@pytest.mark.parametrize(
    ("urdf", "toml", "message"),
    [
        ("<robot", TOML, r"mine\.urdf.*(no|not) .*XML"),
        ("<robot name='x'></robot>", TOML, r"mine\.urdf"),
        (
            URDF.format(mesh='<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'),
            TOML,
            r"mine\.urdf: the mesh 'gone\.stl' of link 'upper' is missing",
        ),
        (URDF, TOML.replace('body = "tip"', 'body = "top"'), r"has no link 'top'; set body to one of base, upper, tip"),
        (URDF, TOML.replace('base = "base"', 'base = "floor"'), r"has no link 'floor'; set base to one of base, upper"),
        (URDF, TOML.replace("home = [", 'joints = ["one", "three"]\nhome = ['), r"toml:10: .* joints .*one, three"),
        (URDF, TOML.replace("jerk = [50.0, 50.0]\n", ""), r"mine\.toml:\d+: \[limits\] jerk is missing; add it"),
        (URDF, TOML.replace("[5.0, 5.0]", "[5.0, 0.0]"), r"mine\.toml:14: .*acceleration .*above zero"),
        (URDF, TOML.replace("[50.0, 50.0]", "[50.0, -1.0]"), r"mine\.toml:15: .*jerk .*above zero"),
        (URDF, TOML.replace("home = [0.0, 0.0]", "home = [0.0, 3.0]"), r"mine\.toml:10: .*two at 3, outside -2\.\.2"),
        (URDF.replace('upper="2" velocity="1" effort="1"/></joint></robot>', 'upper="-2"/></joint></robot>'), TOML,
         r"mine\.urdf: joint 'two' has no room to move"),
    ],
)  # fmt: skip
def test_a_robot_that_can_not_be(capsys: Capture, elsewhere: Path, urdf: str, toml: str, message: str) -> None:
    (elsewhere / "robots").mkdir()
    (elsewhere / "robots" / "mine.urdf").write_text(urdf.replace("{mesh}", ""))
    (elsewhere / "robots" / "mine.toml").write_text(toml)
    line = refused(capsys, 1, "replay", "pouring", "--robot", "mine")
    assert re.search(message, line), line
    assert "; " in line  # what to do next


def test_a_home_in_collision_with_the_arm_itself(capsys: Capture, elsewhere: Path) -> None:
    (elsewhere / "robots").mkdir()
    text = re.sub(r"(?m)^home.*$", "home = [0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]", PANDA.read_text(encoding="utf-8"))
    (elsewhere / "robots" / "mine.toml").write_text(text)
    advice = []
    for described in (text, re.sub(r"(?m)^srdf.*$", "", text)):
        (elsewhere / "robots" / "mine.toml").write_text(described)
        advice.append(refused(capsys, 3, "replay", "pouring", "--robot", "mine").split("; ")[1])
    assert advice == [
        "if these links touch by design, see that its srdf calls this pair Adjacent or Never",
        "if these links touch by design, add srdf = to its [model], an SRDF that calls this pair Adjacent or Never",
    ]
    line = refused(capsys, 3, "replay", "pouring", "--robot", "mine")
    said = r"pbd: home of panda: panda_\w+ would touch panda_\w+, [\d.]+ c?m+ deep; if these links touch by design, "
    assert re.match(said, line), line
