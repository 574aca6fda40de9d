"""The replay as one HTML file. It plays without a server or a network.

The page contains meshcat's own viewer and the scene's commands, both gzipped. Its content security policy lists the
hashes of its scripts and forbids everything else: connections, and scripts hidden in a label or a title.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import importlib.resources
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import umsgpack

from pbd.io.atomic import write_text
from pbd.view.meshcat_encoding import ScenePath, Visualizer

if TYPE_CHECKING:  # the live view makes a page too, and must not import a robot library
    from pbd.view.replay_scene import ReplayScene

SCRIPTS = (
    *("dom.js", "player.js", "render_quality.js", "ground_and_light.js", "scene_view.js", "keyframe_table.js"),
    *("timeline.js", "joints.js", "legend.js", "keys.js", "page.js", "live.js", "boot.js"),
)
"""Parts of the page's script, in their order."""
SCENE_ROOT = "pbd"
"""The node below which the scene is."""
POLICY = (
    "default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; connect-src {connect}; "
    "base-uri 'none'; form-action 'none'"
)
"""The page's content security policy."""


def write_page(scene: ReplayScene, path: str | Path) -> None:
    """Write the replay to an HTML file, atomically. The same scene gives the same bytes.

    Raises:
        RobotError: the robot's files can't be read.
        PbdError: the file can't be written.
    """
    from pbd.view.scene import build

    commands: list[Any] = []
    build(scene, Visualizer.view_into(SimpleNamespace(send=commands.append), ScenePath((SCENE_ROOT,))))
    packed = [umsgpack.packb(command.lower()) for command in commands]
    write_text(Path(path), page_html(scene.title, b"".join(len(each).to_bytes(4, "little") + each for each in packed)))


def page_html(title: str, commands: bytes, connect: str = "'none'") -> str:
    """Return the page's HTML.

    Args:
        title: the window's title until the scene is loaded.
        commands: meshcat's commands, each after its uint32 length, little-endian; empty: the page asks its server.
        connect: the addresses that the page may connect to, as in a content security policy.
    """
    script = "\n".join(_web(name) for name in SCRIPTS)
    hashes = " ".join(
        f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'" for text in (f"\n{script}\n", viewer_code())
    )
    parts = {
        "policy": POLICY.format(hashes=hashes, connect=connect),
        "title": html.escape(title),
        "style": _web("page.css"),
        "script": script,
        "viewer": _packed(viewer_code().encode()),
        "scene": _packed(commands) if commands else "",
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _web("page.html"))


@cache
def viewer_code() -> str:
    """Meshcat's page script, with its licence and those of the libraries in it."""
    folder = importlib.resources.files("meshcat") / "viewer"
    names = ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
    licences = "\n".join((folder / name).read_text(encoding="utf-8") for name in names).replace("*/", "* /")
    code = (folder / "dist/main.min.js").read_text(encoding="utf-8")
    return f"{code}\n/*! {licences} */\n".replace("\r\n", "\n")


def _web(name: str) -> str:
    return (importlib.resources.files("pbd.view") / "web" / name).read_text(encoding="utf-8").strip("\n")


def _packed(data: bytes) -> str:
    return _base64(gzip.compress(data, 9, mtime=0))


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
