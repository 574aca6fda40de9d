"""How large the replay page is, and how soon it plays: python tests/benchmarks/page.py [--json] [--quick].

robots.NAME.size_mb: the file of `pbd replay pouring --robot NAME --html FILE`. robots.NAME.first_frame_s, and
.firefox_first_frame_s where there is a Firefox: from opening the file to the first drawn frame, without a graphics
card, as the page itself takes it; the median of a few openings, at 1400 x 900.
"""

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.report import arguments, finish
from tests.view.browser import Page
from tests.view.chromium import chromium
from tests.view.firefox import firefox

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    names = ["panda"] if args.quick else sorted(path.stem for path in (ROOT / "robots").glob("*.toml"))
    openings = 3 if args.quick else 5
    robots: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        files = {name: Path(folder) / f"{name}.html" for name in names}
        for name, file in files.items():
            command = ["replay", "pouring", "--robot", name, "--html", str(file)]
            subprocess.run([sys.executable, "-m", "pbd", *command], check=True, capture_output=True, cwd=ROOT)
            robots[name] = {"size_mb": file.stat().st_size / 1e6}
        for key, start in (("first_frame_s", chromium), ("firefox_first_frame_s", firefox)):
            browser = start(Path(folder) / start.__name__)
            if browser is None:
                print(f"no {start.__name__} here", file=sys.stderr)
                continue
            try:
                browser.set_size(1400, 900)
                for name, file in files.items():
                    took = [float(Page(browser, file.as_uri())("return pbd.startup")) for _ in range(openings)]
                    robots[name][key] = statistics.median(took) / 1e3
            finally:
                browser.quit()
    finish({"robots": robots}, args.json)


if __name__ == "__main__":
    main()
