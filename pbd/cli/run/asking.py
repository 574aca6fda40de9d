"""Ask a person before something moves."""

from __future__ import annotations

import argparse
import sys
import time

from pbd.cli.recording.keys import Keys
from pbd.errors import PbdError, UsageError

POLL_S = 0.02
"""How often a key is looked for, s."""


def refuse_nobody(args: argparse.Namespace) -> None:
    """Refuse, before anything is done, to ask where nobody can answer."""
    if not (args.yes or sys.stdin.isatty()):
        raise UsageError("pbd run asks before the arm moves: start it at a terminal, or with --yes")


def ask(keys: Keys, question: str) -> None:
    """Wait for Enter.

    Raises:
        PbdError: any other key.
    """
    print(question, file=sys.stderr, flush=True)
    if not entered(keys):
        raise PbdError("cancelled: nothing was changed, run it again when you are ready")


def entered(keys: Keys) -> bool:
    """Wait for a key; whether it was Enter."""
    while not (key := keys.next()):
        time.sleep(POLL_S)
    return key in "\r\n"
