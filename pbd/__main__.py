"""Entry point of `python -m pbd` and of the script `pbd`."""

import os
import signal
import sys

# The matrices are small: several threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class Terminated(KeyboardInterrupt):
    """A termination or a hang-up, which ends a command as Ctrl-C does. Its argument is the signal's number.

    It is a type of its own because the interpreter may end as if by Ctrl-C after any KeyboardInterrupt.
    """


def main() -> int:
    """Run a command and return its exit code: 130 after Ctrl-C, also while the modules are being imported."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores hang-ups
            signal.signal(number, _stop)
    try:
        import uuid  # noqa: F401 (orjson imports it too, and crashes if Ctrl-C comes then)

        from pbd.cli import main as run_command

        return run_command()
    except RuntimeError as error:
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        return 130  # Python 3.11 wraps a Ctrl-C that comes while a class is being made
    except KeyboardInterrupt as stop:
        return 128 + (stop.args or [signal.SIGINT])[0]


def _stop(number: int, _: object) -> None:
    raise Terminated(number)


if __name__ == "__main__":
    sys.exit(main())
