"""The HTML file's content; tests/view/test_browser.py opens it in a browser."""

import base64
import gzip
import hashlib
import importlib.resources
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.errors import PbdError, RobotError
from pbd.pose import Array
from pbd.view.page import page_html, viewer_code, write_page
from tests.view import scenes


def block(page: str, name: str) -> bytes:
    (text,) = re.findall(rf'<script type="application/gzip" id="{name}">([^<]*)</script>', page)
    return gzip.decompress(base64.b64decode(text)) if text else b""


def test_it_is_small(replay_file: Path) -> None:
    assert 0.5e6 < replay_file.stat().st_size < 2.5e6


def test_the_same_scene_gives_the_same_bytes(replay_file: Path, tmp_path: Path) -> None:
    write_page(scenes.pouring(), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == replay_file.read_bytes()


def test_it_names_nothing_outside_itself(replay_file: Path) -> None:
    page = replay_file.read_text()
    assert not re.findall(r"""(?:src|href)\s*=(?!"data:)|@import|url\(""", page)
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", page)
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    assert "unsafe-eval" not in policy


def test_the_policy_knows_the_scripts(replay_file: Path) -> None:
    page = replay_file.read_text()
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert block(page, "viewer-code").decode() == viewer_code()
    for text in (script, viewer_code()):
        assert f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" in page


def test_the_licences_go_with_the_viewer() -> None:
    assert "Three.js Authors" in viewer_code()
    assert "MIT License" in viewer_code()


def test_a_title_is_text() -> None:
    page = page_html("</title><script>alert(1)</script>", b"")
    assert "<script>alert" not in page
    assert block(page, "scene") == b""


def luminance(colour: Array) -> float:
    """Relative luminance of an sRGB colour, each in 0 to 1 (WCAG 2.2)."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_words_can_be_read(scheme: int) -> None:
    """Contrast of 4.5 (WCAG 2.2, AA) on a card, and on a card's part that the pointer is over."""
    style = (importlib.resources.files("pbd.view") / "web/page.css").read_text(encoding="utf-8")
    roots = re.findall(r":root \{(.*?)\}", style, re.DOTALL)[: scheme + 1]
    hexes = dict(re.findall(r"--([\w-]+): #(\w{6});", "".join(roots)))
    colours = {name: np.array(list(bytes.fromhex(value))) / 255.0 for name, value in hexes.items()}
    red, green, blue, alpha = map(float, re.findall(r"--tint: rgb\((\d+) (\d+) (\d+) / ([\d.]+)\)", roots[-1])[0])
    tinted = alpha * np.array((red, green, blue)) / 255.0 + (1.0 - alpha) * colours["card"]
    for name in ("ink", "soft", "accent", "warm", "detour", "good", "alarm-ink"):
        for ground in (colours["card"], tinted):
            dark, light = sorted(map(luminance, (colours[name], ground)))
            assert (light + 0.05) / (dark + 0.05) >= 4.5, name
    (bars,) = re.findall(r"#moves i \{ background: var\(--([\w-]+)\)", style)
    dark, light = sorted(map(luminance, (colours[bars], colours["card"])))
    assert (light + 0.05) / (dark + 0.05) >= 3.0, "graphics need less, as the bars of moves to come"


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "replay.html"
    path.write_text("old")
    scene = scenes.ur5_moves()
    with pytest.raises(RobotError):
        write_page(replace(scene, robot=replace(scene.robot, package_dirs=())), path)
    assert path.read_text() == "old"
    (tmp_path / "folder").mkdir()
    with pytest.raises(PbdError, match="is a folder: give a file's name"):
        write_page(scene, tmp_path / "folder")
    assert {entry.name for entry in tmp_path.iterdir()} == {"replay.html", "folder"}
