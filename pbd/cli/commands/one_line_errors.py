"""The parser whose errors are one line."""

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from pbd.cli.options import DRIVEN
from pbd.errors import listed, nearest
from pbd.files.find_by_name import names


class Parser(argparse.ArgumentParser):
    """An argparse parser whose errors are one line that says where the help is."""

    words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and keep the words."""
        self.words = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2. An unknown option is named first: because of it others, or files, seem to be missing.

        If --robot is missing, the message names the robots.
        """
        known = [option for action in self._actions for option in action.option_strings]
        unknown, before = self._unknown_option(known)
        if before:
            message = f"{unknown} begins like an option; if it is the value of {before}, write {before}={unknown}"
        elif "." in unknown:
            message = f"{unknown} begins like an option; if it is a file, write ./{unknown}"
        elif unknown:
            message = f"unknown option {unknown}{nearest(unknown, known)}"
        elif "required: " in message and "--robot" in message:
            robots = DRIVEN if self.prog == "pbd run" else names("robots")
            message = f"{message} (one of {listed(robots)}, or a file)"
        self.exit(2, f"{self.prog}: {message}{'' if message.endswith('?') else ';'} see {self.prog} --help\n")

    def _unknown_option(self, known: Sequence[str]) -> tuple[str, str]:
        """Return the first unknown option, and the option before it where it may be its value; "" if there is none."""
        before = ""
        for word in self.words:
            if word == "--" or (self._subparsers is not None and not word.startswith("-")):
                break  # files follow, or a command's own options
            name = word.partition("=")[0]
            is_known = name[:2] in known or any(option.startswith(name) for option in known)  # -oFILE, --rob
            if re.fullmatch(r"--?[A-Za-z]\S*", name) and not is_known:
                return name, before if "," in name else ""
            before = word if word in known else ""
        return "", ""

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help and version; an output that can't be written is an error here, and is ignored by argparse."""
        if file is not None and file is sys.stdout:
            file.write(message)
        else:
            super()._print_message(message, file)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Refuse "", which an unset variable of a shell gives: it would count as left out."""
        value = super()._get_value(action, arg_string)
        if arg_string == "" != action.default and action.nargs != argparse.PARSER:  # a command's words are its parser's
            raise argparse.ArgumentError(action, "is empty: give a value, or leave it out")
        return value

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(
                action, f"unknown value '{value}'; choose one of {', '.join(known)}{nearest(str(value), known)}"
            )
