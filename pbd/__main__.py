"""Entry point of `python -m pbd` and of the script `pbd`."""

from __future__ import annotations

import os
import sys

# The matrices are small: several threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> int:
    """Run a command and return its exit code: 130 after Ctrl-C, also while the modules are being imported."""
    try:
        from pbd.cli import main as run_command

        return run_command()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
