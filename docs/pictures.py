"""Make the pictures of the README and of robots.md from the real page: python docs/pictures.py.

Needs Chromium and its driver. With names of robots as arguments only those are made.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from PIL import Image

from tests.view.browser import Replay
from tests.view.chromium import Chromium, chromium

DOCS = Path(__file__).parent
SHOWN = "panda"
"""The robot of the README."""
FRAMES_PER_S = 10
POURING = 0.46
"""Of the replay's time: the bottle is being tipped."""


def main() -> None:
    """Write replay.webp and robot-NAME.webp beside this file."""
    every = sorted(path.stem for path in (DOCS.parent / "robots").glob("*.toml"))
    with tempfile.TemporaryDirectory() as folder:
        chrome = chromium(Path(folder) / "profile")
        if chrome is None:
            sys.exit("needs chromium and chromedriver on PATH")
        try:
            for name in sys.argv[1:] or every:
                page = Path(folder) / f"{name}.html"
                command = ["replay", "pouring", "--robot", name, "--html", str(page)]
                subprocess.run([sys.executable, "-m", "pbd", *command], check=True, cwd=DOCS.parent)
                robot(chrome, page, DOCS / f"robot-{name}.webp")
                if name == SHOWN:
                    moving(chrome, page, DOCS / "replay.webp")
        finally:
            chrome.quit()


def moving(chrome: Chromium, page: Path, to: Path) -> None:
    """Write the replay as it plays."""
    chrome.set_size(1000, 700)
    chrome.set_media()
    replay = Replay(chrome, page.as_uri())
    replay("pbd.page.fold('panel', true)")
    frames = []
    for i in range(int(FRAMES_PER_S * replay("return pbd.page.player.duration"))):
        replay(f"pbd.page.player.seek({i / FRAMES_PER_S})")
        frames.append(Image.fromarray(replay.picture()).resize((800, 560), Image.Resampling.LANCZOS))
    frames[0].save(
        to, save_all=True, append_images=frames[1:], duration=1000 // FRAMES_PER_S, loop=0, quality=75, method=6
    )


def robot(chrome: Chromium, page: Path, to: Path) -> None:
    """Write the scene alone, small."""
    chrome.set_size(960, 720)
    chrome.set_media()
    replay = Replay(chrome, page.as_uri())
    replay(
        "for (const id of ['bar', 'labels']) document.getElementById(id).hidden = true; pbd.page.fold('panel', true)"
    )
    replay(f"pbd.page.player.seek({POURING} * pbd.page.player.duration)")
    Image.fromarray(replay.picture()).resize((480, 360), Image.Resampling.LANCZOS).save(to, quality=85, method=6)


if __name__ == "__main__":
    main()
