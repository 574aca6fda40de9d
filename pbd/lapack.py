"""LAPACK as scipy wraps it, without the rest of scipy.linalg, which takes 0.15 s to load."""

from __future__ import annotations

import sys
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

NAME = "scipy.linalg._flapack"


@cache
def lapack() -> Any:
    """Return the module of its routines, which scipy.linalg.lapack hands on."""
    import scipy

    stem = Path(scipy.__path__[0], *NAME.split(".")[1:])
    file = next((path for suffix in EXTENSION_SUFFIXES if (path := Path(f"{stem}{suffix}")).is_file()), None)
    spec = None if file is None or "scipy.linalg" in sys.modules else spec_from_file_location(NAME, file)
    if spec is None or spec.loader is None:  # loaded anyway, or built otherwise
        from scipy.linalg import lapack as public

        return public
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
