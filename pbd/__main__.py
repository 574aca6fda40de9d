"""python -m pbd, and the script `pbd`."""

from __future__ import annotations

import os
import sys

# Its matrices are small: more threads would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> int:
    """Run a command; return its exit code. Ctrl-C while the command line is being loaded ends it as later on."""
    try:
        from pbd.cli import main as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
