"""Access to scipy's LAPACK without loading all of scipy.linalg, and a limit on the number of BLAS threads."""

import sys
from contextlib import ContextDecorator
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from threading import Lock
from typing import Any

FLAPACK = "scipy.linalg._flapack"


@cache
def lapack() -> Any:
    """Return the module of LAPACK's routines. It is loaded alone: all of scipy.linalg takes 0.15 s to import."""
    import scipy

    stem = Path(scipy.__path__[0], *FLAPACK.split(".")[1:])
    file = next((path for suffix in EXTENSION_SUFFIXES if (path := Path(f"{stem}{suffix}")).is_file()), None)
    spec = None if file is None or "scipy.linalg" in sys.modules else spec_from_file_location(FLAPACK, file)
    if spec is None or spec.loader is None:  # scipy.linalg is loaded already, or scipy was built in another way
        from scipy.linalg import lapack as public

        return public
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def _thread_pools() -> Any:
    """Return a controller of the BLAS libraries that numpy and scipy use."""
    from threadpoolctl import ThreadpoolController

    lapack()
    return ThreadpoolController()


class _OneBlasThread(ContextDecorator):
    """Limits BLAS to one thread: the matrices here are small, and idle threads use the cores while they wait for work.

    Callers on several threads share the limit. When the last of them leaves, the former number is restored.
    """

    def __init__(self) -> None:
        self._lock, self._callers = Lock(), 0
        self._limits: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if not self._callers:
                self._limits = _thread_pools().limit(limits=1, user_api="blas")
            self._callers += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._callers -= 1
            if not self._callers:
                self._limits.restore_original_limits()


one_blas_thread = _OneBlasThread()
