"""A robot of two joints whose hand has given shapes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Robot
from tests.arm.bundled import arm_of


def simple(tmp_path: Path, shapes: str) -> Robot:
    """Return a robot of two joints about z, whose hand has the given shapes."""
    path = tmp_path / "arm.urdf"
    path.write_text(SIMPLE_URDF.format(shapes), encoding="utf-8")
    panda = arm_of("panda").robot
    limits: Any = {name: np.ones(2) for name in ("upper", "velocity", "acceleration", "jerk")}
    return replace(
        panda,
        urdf=path,
        srdf=None,
        package_dirs=(tmp_path,),
        base="foot",
        body="hand",
        joints=("pan", "turn"),
        home=np.zeros(2),
        gripper=None,
        limits=replace(panda.limits, lower=-np.ones(2), effort=None, **limits),
    )


SIMPLE_URDF = """<robot name="simple"><link name="foot"/><link name="arm"/><link name="hand">{}</link>
<joint name="pan" type="revolute"><parent link="foot"/><child link="arm"/><origin xyz="0 0 0.5"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.5 0 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
