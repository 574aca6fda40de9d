"""numba, where it is installed (`pip install "pbd-robot[fast]"`): kernel.py compiled, once a program asks for enough.

Loading what numba compiled on an earlier day takes about as long as LOADED_AFTER descents without it; compiling it for
the first time, COMPILED_AFTER. So that is when it is done, and a program that plans one motion waits for neither.

numba reads what it kept back with pickle, which can run anything. So that lies in a folder that nobody but the user can
enter; where there can be none, nothing is compiled.
"""

from __future__ import annotations

import importlib
import os
import warnings
from pathlib import Path
from typing import Any

import platformdirs

from pbd.errors import PbdWarning

LOADED_AFTER, COMPILED_AFTER = 3_000, 40_000
"""Descents without numba: 0.3 s and 5 s of them."""


class Compiled:
    """The compiled kernel, once it is there.

    Attributes:
        kernel: the module kernel.py, or None.
        settled: it was tried, or isn't wanted.
    """

    def __init__(self, folder: Path) -> None:
        self.kernel: Any = None
        self._folder = folder
        self._left: int | None = None
        self.settled = False

    def count(self, descents: int) -> None:
        """Say that so many descents were made without it."""
        if self.settled:
            return
        if self._left is None:
            self._left = LOADED_AFTER if any(self._folder.glob("*/kernel.*.nbi")) else COMPILED_AFTER
        self._left -= descents
        if self._left < 0:
            self.load()

    def load(self) -> bool:
        """Load it now, or compile it, for a program that knows that it will ask for much; return whether it is there.

        Warns:
            PbdWarning: numba is installed, but fails.
        """
        if not self.settled:
            self.settled = True
            self.kernel = _load(self._folder)
        return self.kernel is not None


def _load(folder: Path) -> Any:
    if not _is_safe(folder):
        return None
    try:
        import numba
    except ImportError:  # not there, or not for this version of numpy
        return None
    # numba asks for the folder when it decorates; others in this program may want another for theirs.
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        return importlib.import_module("pbd.arm.kernel")
    except Exception as reason:  # whatever it found in its folder, plain Python does as well
        message = f"numba can't be used ({type(reason).__name__}: {reason}); remove {folder} to have it start afresh"
        warnings.warn(message, PbdWarning, stacklevel=2)
        return None
    finally:
        numba.config.CACHE_DIR = before


def _is_safe(folder: Path) -> bool:
    """Make a folder; say whether the user can write to it and nobody else can enter it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.stat()
    except OSError:
        return False
    return state.st_uid == os.getuid() and not state.st_mode & 0o077 and os.access(folder, os.W_OK | os.X_OK)


FOLDER = Path(platformdirs.user_cache_dir("pbd")) / "numba"
COMPILED = Compiled(FOLDER)
"""This program's."""
