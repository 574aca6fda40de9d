"""Shell completion: `pbd --print-completion bash` prints the script that shtab makes from the parser."""

import argparse
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

SHELLS = ("bash", "zsh", "fish", "tcsh")

_CALIBRATIONS = "ls calibration 2>/dev/null | sed -n 's/[.]toml$//p'"

COMPLETED = {
    "DEMO": ("demos", "ls demos 2>/dev/null"),
    "R": ("robots", "ls robots 2>/dev/null | sed -n 's/[.]toml$//p'"),
    "C": ("calibrations", _CALIBRATIONS),
    "CALIBRATION": ("calibrations", _CALIBRATIONS),
    "SENSOR": ("sensors", ":"),
    "TASK": ("tasks", ":"),
    "M": ("models", ":"),
    "P": ("ports", "ls /dev | sed -n 's,^tty[AU][CS][MB],/dev/&,p'"),
}
"""Metavar -> how to complete it: the name of a shell function, and a command that lists the user's own values."""


class PrintCompletion(argparse.Action):
    """Prints the completion script of a shell, and exits."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> NoReturn:
        """Print the script and exit."""
        import shtab

        for argument in _arguments(parser):
            if argument.metavar in COMPLETED:
                function = f"_pbd_{COMPLETED[str(argument.metavar)][0]}"
                argument.complete = {"bash": function, "zsh": function, "fish": f"({function})"}  # type: ignore[attr-defined]
            elif argument.metavar in ("FILE", "DIR"):
                argument.complete = shtab.FILE if argument.metavar == "FILE" else shtab.DIRECTORY  # type: ignore[attr-defined]
        template = {
            "bash": '_pbd_{name}() {{ compgen -W "{known} $({own})" -- "$1"; }}\n',
            "zsh": "_pbd_{name}() {{ compadd -- {known} $({own}); }}\n",
            "fish": "function _pbd_{name}\n  string split -n ' ' -- '{known}'\n  {own}\nend\n",
        }.get(str(values), "")
        bundled = _bundled()
        functions = (
            template.format(name=name, own=own, known=" ".join(bundled[name]))
            for name, own in dict.fromkeys(COMPLETED.values())
        )
        print(shtab.complete(parser, str(values), preamble="".join(functions)))
        parser.exit()


def _arguments(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for said in action._choices_actions:
                action.choices[said.dest].description = said.help  # zsh shows the first line of a description
            for below in action.choices.values():
                yield from _arguments(below)


def _bundled() -> dict[str, Sequence[str]]:
    """Return the name of a shell function -> the bundled names that complete its argument."""
    from pbd.files.find_by_name import bundled, names
    from pbd.sensors.protocols import PROTOCOLS
    from pbd.simulation.simulate import CALIBRATION_TASKS, SENSOR_MODELS, TASKS

    return {
        **{kind: names(kind, bundled(kind)) for kind in ("demos", "robots")},
        "calibrations": names("calibration", bundled("calibration")),
        "sensors": ["sim", *PROTOCOLS],
        "tasks": [*TASKS, *CALIBRATION_TASKS],
        "models": list(SENSOR_MODELS),
        "ports": (),
    }
