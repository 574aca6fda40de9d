"""Completion for shells: `pbd --print-completion bash` writes the script, shtab makes it from the parser."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, NoReturn

SHELLS = ("bash", "zsh", "tcsh")

DEMOS = {"bash": "_pbd_demos", "zsh": "_pbd_demos"}
ROBOTS = {"bash": "_pbd_robots", "zsh": "_pbd_robots"}
"""What an argument's `complete` is set to: shell functions below, as names come and go."""

_BASH = """\
_pbd_demos() {{ compgen -W "{demos} $(ls demos 2>/dev/null)" -- "$1"; compgen -f -- "$1"; }}
_pbd_robots() {{ compgen -W "{robots} $(ls robots 2>/dev/null | sed -n 's/[.]toml$//p')" -- "$1"; compgen -f -- "$1"; }}
"""
_ZSH = """\
_pbd_demos() {{ compadd -- {demos} $(ls demos 2>/dev/null); _files; }}
_pbd_robots() {{ compadd -- {robots} $(ls robots 2>/dev/null | sed -n 's/[.]toml$//p'); _files; }}
"""


class PrintCompletion(argparse.Action):
    """Print the script for a shell, and end."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> NoReturn:
        """Print it."""
        import shtab

        from pbd.files.library import bundled_names

        known = {"demos": " ".join(bundled_names("demos", "")), "robots": " ".join(bundled_names("robots", ".toml"))}
        functions = {"bash": _BASH, "zsh": _ZSH}.get(str(values), "").format(**known)
        print(shtab.complete(parser, str(values), preamble=functions))
        parser.exit()
