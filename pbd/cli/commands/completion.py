"""Shell completion: `pbd --print-completion bash` prints the script that shtab makes from the parser."""

import argparse
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

SHELLS = ("bash", "zsh", "fish", "tcsh")

_PLAIN = "grep -x '[[:alnum:]_][[:alnum:]_.,+@-]*'"
"""A command that passes on the names that mean nothing to a shell: bash would run a folder called `$(command)`."""


class PrintCompletion(argparse.Action):
    """Prints the completion script of a shell, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, name: Any = None) -> NoReturn:
        """Print the script and exit."""
        import shtab

        completed = _completed()
        for argument in _arguments(parser):
            if argument.metavar in completed:
                function = f"_pbd_{argument.metavar}"
                argument.complete = {"bash": function, "zsh": function, "fish": f"({function})"}  # type: ignore[attr-defined]
            elif argument.metavar in ("FILE", "DIR"):
                argument.complete = shtab.FILE if argument.metavar == "FILE" else shtab.DIRECTORY  # type: ignore[attr-defined]
        template = {
            "bash": '_pbd_{name}() {{ compgen -W "{known} $({own})" -- "$1"; }}\n',
            "zsh": "_pbd_{name}() {{ compadd -- {known} $({own}); }}\n",
            "fish": "function _pbd_{name}\n  string split -n ' ' -- '{known}'\n  {own}\nend\n",
        }.get(values, "")
        functions = (
            template.format(name=metavar, known=" ".join(known), own=own) for metavar, (known, own) in completed.items()
        )
        print(shtab.complete(parser, values, preamble="".join(functions)))
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


def _completed() -> dict[str | tuple[str, ...] | None, tuple[Sequence[str], str]]:
    """Return metavar -> how to complete it: the bundled names, and a command that lists the user's own."""
    from pbd.files.find_by_name import bundled, names
    from pbd.sensors.protocols import PROTOCOLS
    from pbd.simulation.simulate import CALIBRATION_TASKS, SENSOR_MODELS, TASKS

    own = f"ls {{}} 2>/dev/null | sed -n 's/[.]toml$//p' | {_PLAIN}"
    calibrations = names("calibration", bundled("calibration")), own.format("calibration")
    return {
        "DEMO": (names("demos", bundled("demos")), f"ls demos 2>/dev/null | {_PLAIN}"),
        "R": (names("robots", bundled("robots")), own.format("robots")),
        "C": calibrations,
        "CALIBRATION": calibrations,
        "SENSOR": (["sim", *PROTOCOLS], ":"),
        "TASK": ([*TASKS, *CALIBRATION_TASKS], ":"),
        "M": (list(SENSOR_MODELS), ":"),
        "P": ((), "ls /dev | sed -n 's,^tty[AU][CS][MB],/dev/&,p'"),
    }
