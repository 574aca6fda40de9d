"""Makes a folder of files and demonstrations with one fault each, for tests/test_messages.py."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration, Recording
from pbd.files.demo import write_demo
from pbd.simulation.simulate import simulate
from tests.cli.run_command import HEADER, write_recording
from tests.scenarios import broken, with_channel, with_rows

LOW_DOCK = 'format = 1\nname = "low"\ntable_height = 0.2\n[dock]\nposition = [0.45, -0.15, 0.1]\nrpy_deg = [0, 0, 0]\n'

OBSTACLE = """format = 1
name = "bench"
[dock]
position = [0.45, -0.15, 0.25]
rpy_deg = [0, 0, 0]
[[obstacle]]
name = "the shelf"
shape = "box"
size = [0.6, 0.6, 0.02]
position = [0.45, 0.0, 0.3]
"""

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

SAMPLE = "0,0,0,0,0,0,9.81\n"
POINTS = "name,x_m,y_m,z_m\na,0.4,0,0\nb,0.5,0,0\nc,0.6,0,0\n"

FILES = {
    "bad/empty.csv": "",
    "bad/header.csv": HEADER,
    "bad/columns.csv": "t,gx,gy,gz,ax,ay\n0,0,0,0,0,0\n",
    "bad/word.csv": f"{HEADER}{SAMPLE}0.01,0,0,zero,0,0,9.81\n",
    "bad/short.csv": f"{HEADER}{SAMPLE}0.01,0,0,0,0,9.81\n",
    "bad/back.csv": f"{HEADER}1,0,0,0,0,0,9.81\n{SAMPLE}",
    "bad/bare.csv": SAMPLE + SAMPLE,
    "bad/one.csv": HEADER + SAMPLE,
    "bad/sheet.xlsx": "",
    "bad/line.csv": POINTS,
    "bad/no-number.csv": "x_m,y_m,z_m\n0,left,0\n",
    "bad/no-unit.csv": "name,x,y,z\na,0,0,0\n",
    "bad/syntax.toml": "format = = 1\n",
    "bad/key.toml": 'format = 1\nname = "c"\ntabel_height = 0.0\n[dock]\nposition = [0, 0, 0]\nrpy_deg = [0, 0, 0]\n',
    "bad/both.toml": 'format = 1\nname = "c"\n[dock]\nposition = [0, 0, 0]\nrpy_deg = [0, 0, 0]\n[nav]\n'
    "position = [0, 0, 0]\nrpy_deg = [0, 0, 0]\n",
    "bad/shelf.toml": OBSTACLE,
    "bad/low.toml": LOW_DOCK,
    "bad/joints.json": "[0, 0, 0]",
    "robots/link.toml": TOML.replace('"mine"', '"link"').replace('body = "tip"', 'body = "top"'),
    "robots/limits.toml": TOML.replace('"mine"', '"limits"').replace("[5.0, 5.0]", "[5.0, 0.0]"),
    "robots/home.toml": TOML.replace('"mine"', '"home"').replace("home = [0.0, 0.0]", "home = [0.0, 3.0]"),
    "robots/roots.toml": TOML.replace('"mine"', '"roots"').replace("mine.urdf", "roots.urdf"),
    "robots/mine.urdf": URDF.replace("{mesh}", ""),
    "robots/roots.urdf": URDF.replace("{mesh}", "").replace('<link name="tip"/>', '<link name="tip"/><link name="x"/>'),
}


def write_faulty_inputs(folder: Path) -> None:
    """Write them into a folder."""
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    write_recording(folder / "bad" / "still.csv")
    write_recording(folder / "bad" / "g.csv", norm=1.0)
    pour = simulate("pour", "modern", 1)
    for name, recording in spoilt(pour.recording).items():
        write_demo(Demonstration(recording), folder / "demos" / name)
    write_demo(pour, folder / "demos" / "tea")


def spoilt(tea: Recording) -> dict[str, Recording]:
    """Copies of `tea` with one fault each, by the name of the demonstration."""
    assert tea.gyr is not None
    moving = int(np.argmax(np.linalg.norm(tea.gyr, axis=1)))
    row = np.arange(len(tea))
    return {
        "gap": with_rows(tea, (row < moving) | (row >= moving + 40)),
        "lost": with_rows(tea, row % 50 != 7),
        "degrees": with_channel(tea, "gyr", np.degrees(tea.gyr)),
        "dead": with_channel(tea, "gyr", np.zeros_like(tea.gyr)),
        "blind": broken(tea, "acc", slice(None), np.nan),
        "head": with_channel(tea, "acc", -tea.acc),
        "milliseconds": replace(tea, t=1e3 * tea.t),
        "restless": with_rows(tea, row >= moving),
    }
