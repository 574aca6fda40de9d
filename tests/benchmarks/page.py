"""How large the replay page is, and how soon it plays: python tests/benchmarks/page.py [--json] [--quick].

robots.NAME.size_mb: the file of `pbd replay pouring --robot NAME --html FILE`. robots.NAME.first_frame_s: from opening
the file to the first drawn frame, in headless Chromium without a graphics card, as the page itself takes it; the median
of a few openings, at 1400 x 900.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.report import arguments, finish
from tests.view.browser import Page
from tests.view.chromium import chromium, set_size

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    names = ["panda"] if args.quick else sorted(path.stem for path in (ROOT / "robots").glob("*.toml"))
    openings = 3 if args.quick else 5
    with tempfile.TemporaryDirectory() as folder:
        chrome = chromium(Path(folder) / "profile")
        if chrome is None:
            sys.exit("needs chromium and chromedriver on PATH")
        try:
            set_size(chrome, 1400, 900)
            robots: dict[str, Any] = {}
            for name in names:
                file = Path(folder) / f"{name}.html"
                command = ["replay", "pouring", "--robot", name, "--html", str(file)]
                subprocess.run([sys.executable, "-m", "pbd", *command], check=True, capture_output=True, cwd=ROOT)
                took = [float(Page(chrome, file.as_uri())("return pbd.startup")) for _ in range(openings)]
                robots[name] = {
                    "size_mb": file.stat().st_size / 1e6,
                    "first_frame_s": statistics.median(took) / 1e3,
                }
        finally:
            chrome.quit()
    finish({"robots": robots}, args.json)


if __name__ == "__main__":
    main()
