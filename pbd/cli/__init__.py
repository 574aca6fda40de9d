"""The command line. commands/ has the options of each command; the file or folder of its name runs it."""

import errno
import os
import re
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module

from pbd.cli.commands import parse, parser
from pbd.cli.console import say
from pbd.errors import PbdError, collected_warnings, in_words, with_notes
from pbd.io.atomic import DELETED, in_deleted_folder
from pbd.view.terminal import discard_rest, standard_streams

__all__ = ["main", "parser"]

UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""errno values that standard output gives: a full disk, a closed terminal. Errors of files are PbdErrors by then."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    with standard_streams():
        try:
            try:
                return _run(argv)
            finally:
                sys.stdout.flush()  # otherwise the interpreter reports an error of the output when it exits
        except BrokenPipeError:
            discard_rest(sys.stdout)  # its reader has gone (`pbd ... | head`)
            return 141
        except KeyboardInterrupt as stop:
            number = signal.Signals((stop.args or [signal.SIGINT])[0])
            say(with_notes(f"stopped by {'Ctrl-C' if number == signal.SIGINT else number.name}", stop))
            return 128 + number
        except OSError as reason:
            if (message := _os_error_message(reason)) is None:
                raise  # a bug
            say(message)
            return 1


def _os_error_message(reason: OSError) -> str | None:
    """Return the message for an OSError that is the user's or the machine's fault; None if it is a bug."""
    of_path = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP, *UNWRITABLE)
    if reason.filename is not None and reason.errno in of_path:
        return f"{os.fsdecode(reason.filename)}: {in_words(reason)}; check the path, and who may read and write there"
    if in_deleted_folder():
        return DELETED
    if reason.filename is not None or reason.errno not in UNWRITABLE:
        return None
    discard_rest(sys.stdout)
    return f"standard output can't be written ({in_words(reason)}); send it elsewhere"


def _run(argv: Sequence[str] | None) -> int:
    if not (sys.argv[1:] if argv is None else argv):
        parser().print_help(sys.stderr)
        return 2
    args = parse(argv)
    if getattr(args, "csv", False) and "units" in args:
        args.units = replace(args.units, exact=True)  # tables are rounded for people, CSV is not
    try:
        # A warning is said once, however often it is given.
        said = cache(lambda message: say(f"warning: {message}"))
        with collected_warnings(said) as args.warnings:
            return int(import_module(args.module).run(args) or 0)
    except PbdError as error:
        say(with_notes(str(error), error))
        return error.exit_code
    except ImportError as error:
        package = (error.name or "pbd").partition(".")[0]
        if package == "pbd":
            raise  # a bug
        library = re.match(r"(lib\S+)\.so\.(\d+): cannot open", str(error))
        what = f"Debian's package {library[1].lower()}{library[2]}" if library else "pbd-robot again"
        say(f"the Python package {package} is missing or broken ({error}); install {what}")
        return 1
