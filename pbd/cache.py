"""Results that take long and follow from files alone, kept in the user's cache folder as named arrays.

A file is an .npz behind the SHA-256 of its bytes, so a damaged one is found out and made anew. It appears whole or not
at all: several processes may write the same one. Where nothing can be written, the work is done again each time.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

from pbd.errors import PbdError
from pbd.io.atomic import atomic_file

_DIGEST_BYTES = hashlib.sha256().digest_size


def recall(kind: str, key: str) -> dict[str, NDArray[Any]] | None:
    """Return the arrays that were kept under a kind ("hulls") and a key (a hash of what they follow from), or None."""
    try:
        kept = _place(kind, key).read_bytes()
    except OSError:
        return None
    digest, content = kept[:_DIGEST_BYTES], kept[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def remember(kind: str, key: str, arrays: Mapping[str, Any]) -> None:
    """Keep arrays under a kind and a key."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    with suppress(PbdError), atomic_file(_place(kind, key), parents=True) as file:
        file.write_bytes(hashlib.sha256(content.getvalue()).digest() + content.getvalue())


def _place(kind: str, key: str) -> Path:
    return Path(platformdirs.user_cache_dir("pbd")) / kind / f"{key}.npz"
