"""Make the README's picture from the real page: python docs/pictures.py (needs Chromium and its driver)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from PIL import Image
from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service

from tests.view.browser import Replay
from tests.view.conftest import CHROMIUM_OPTIONS

PAGE_T = 5.0
"""The replay's time in the picture, s: the bottle is being tipped."""


def main() -> None:
    """Render replay.png beside this file."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        subprocess.run(
            [sys.executable, "-m", "pbd", "replay", "pouring", "--robot", "panda", "--html", str(page)], check=True
        )
        options = ChromeOptions()
        for option in CHROMIUM_OPTIONS:
            options.add_argument(option)
        options.add_argument("--window-size=1440,900")
        options.add_argument(f"--user-data-dir={folder}/profile")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        chrome = Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        try:
            replay = Replay(chrome, page.as_uri())
            replay(f"pbd.page.player.seek({PAGE_T})")
            picture = Image.fromarray(replay.picture())
        finally:
            chrome.quit()
    picture.save(Path(__file__).with_name("replay.png"), optimize=True)


if __name__ == "__main__":
    main()
