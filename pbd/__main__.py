"""python -m pbd, and the script `pbd`."""

from __future__ import annotations

import sys


def main() -> int:
    """Run a command; return its exit code. Ctrl-C while the command line is being loaded ends it as later on."""
    try:
        from pbd.cli import main as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
