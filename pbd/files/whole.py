"""Files appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pbd.errors import PbdError


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a file to write beside `path`; it takes `path`'s place when all went well, and is gone else.

    Raises:
        PbdError: the place can't be written, or holds something that is no file (a folder, a device).
    """
    if not path.name or path.is_dir():
        raise PbdError(f"{path} can't be written (it is a folder); give another place", path=path)
    if path.exists() and not path.is_file():
        raise PbdError(f"{path} can't be written (it is no regular file); give another place", path=path)
    target = path.resolve()  # what a link leads to is replaced, not the link
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        yield unfinished
        unfinished.replace(target)
    except OSError as reason:
        raise PbdError(f"{path} can't be written ({reason.strerror}); give another place", path=path) from None
    finally:
        with suppress(OSError):  # it may never have come to be
            unfinished.unlink(missing_ok=True)
