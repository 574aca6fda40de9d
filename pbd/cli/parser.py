"""argparse with errors of one line, which name what is nearest to a word that nobody knows."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from pbd.errors import PbdError, nearest

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


class UsageError(PbdError):
    """Options that are each well formed and don't go together."""

    exit_code = 2


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and where the help is."""

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(2, f"{self.prog}: {message}{'' if message.endswith('?') else ';'} see {self.prog} --help\n")

    def _print_message(self, message: str, file: SupportsWrite[str] | None = None) -> None:
        """As argparse does, which passes over an output that can't be written."""
        if file is not None and file is sys.stdout:
            file.write(message)
        else:
            super()._print_message(message, file)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(
                action, f"unknown value '{value}'; choose one of {', '.join(known)}{nearest(str(value), known)}"
            )


def parse(top: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command; what is too much is told by the command's own parser."""
    args, unknown = top.parse_known_args(argv)
    if unknown:
        command: argparse.ArgumentParser = getattr(args, "parser", top)
        word = unknown[0].partition("=")[0]
        if not word.startswith("-"):
            command.error(f"unexpected argument '{word}'")
        options = [option for action in command._actions for option in action.option_strings]
        command.error(f"unknown option {word}{nearest(word, options)}")
    return args
