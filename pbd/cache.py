"""Caches: on disk, in the user's cache folder, for slow results that depend on files alone; in memory by thread.

Each cache file holds the SHA-256 of its key and content, then an .npz. A file that is damaged, or that another user may
have written, counts as absent: collisions are checked with what is in it. Files are written atomically, so several
processes may write the same one. A folder that is not writable is no error.
"""

import hashlib
import io
import os
import stat
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache, wraps
from pathlib import Path
from threading import get_ident
from typing import Any, TypeVar, cast

import numpy as np
import platformdirs
from numpy.typing import NDArray

from pbd.errors import PbdError
from pbd.io.atomic import atomic_file

Function = TypeVar("Function", bound=Callable[..., Any])

CACHED_BY_THREAD = 16
"""Largest number of results of one function that `cached_by_thread` keeps."""

_DIGEST_BYTES = hashlib.sha256().digest_size


def recall(kind: str, key: str) -> dict[str, NDArray[Any]] | None:
    """Load arrays by kind ("hulls") and key (a hash of the inputs); None where they are absent or not to be trusted."""
    try:
        with _cache_file(kind, key).open("rb") as file:
            status, stored = os.fstat(file.fileno()), file.read()
    except OSError:
        return None
    digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    others = status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if others or hashlib.sha256(key.encode() + content).digest() != digest:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def remember(kind: str, key: str, arrays: Mapping[str, Any]) -> None:
    """Store arrays by kind and key, for `recall`."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    path = _cache_file(kind, key)
    with suppress(PbdError, OSError):
        path.unlink(missing_ok=True)  # else a link's target would be replaced, or an old file's permissions kept
        with atomic_file(path, parents=True) as file:
            file.write_bytes(hashlib.sha256(key.encode() + content.getvalue()).digest() + content.getvalue())
            file.chmod(0o600)


def _cache_file(kind: str, key: str) -> Path:
    return Path(platformdirs.user_cache_dir("pbd")) / kind / f"{key}.npz"


def cached_by_thread(function: Function) -> Function:
    """Keep a function's latest results, for each thread its own: pinocchio's buffers serve one thread at a time."""

    @lru_cache(maxsize=CACHED_BY_THREAD)
    def cached(_thread: int, *args: Any) -> Any:
        return function(*args)

    @wraps(function)
    def of_this_thread(*args: Any) -> Any:
        return cached(get_ident(), *args)

    return cast(Function, of_this_thread)
