"""Find robots, calibrations and demonstrations by name: first in the user's own folder, then among the bundled ones."""

import os
from pathlib import Path

from pbd.errors import PbdError, listed, nearest, require_kind
from pbd.io.atomic import exists, is_folder

SUFFIXES = {"robots": ".toml", "calibration": ".toml", "demos": ""}
"""Kind of a thing that has a name, which is also its folder's name -> suffix of its file; "": it is a folder itself."""


def bundled(kind: str) -> Path:
    """Return the folder that comes with pbd: inside the package of a wheel, or beside the package in a checkout."""
    package = Path(__file__).parent.parent
    inside = package / "bundled" / kind
    return inside if inside.is_dir() else package.parent / kind


def names(kind: str, *folders: Path) -> list[str]:
    """List the names of a kind in these folders, sorted; by default in the user's own and the bundled one."""
    entries = (entry for folder in folders or (Path(kind), bundled(kind)) for entry in _entries(folder, kind))
    return sorted({entry.name.removesuffix(SUFFIXES[kind]) for entry in entries})


def origin(kind: str, path: Path) -> str:
    """Return where a file or folder of a kind comes from: "bundled", or its path."""
    return "bundled" if path.resolve().parent == bundled(kind).resolve() else str(path)


def hides_bundled(kind: str, path: Path) -> bool:
    """Whether a file or folder of the user's own folder is used in place of a bundled one of its name."""
    hidden = any(entry.name == path.name for entry in _entries(bundled(kind), kind))
    return path.parent == Path(kind) and hidden and origin(kind, path) != "bundled"


def find(kind: str, name: str | Path, error: type[PbdError]) -> Path:
    """Find a name in ./KIND, then among the bundled ones, then as a path; `error` lists the valid names."""
    what = {"demos": "demonstration", "robots": "robot"}.get(kind, kind)
    require_kind(f"the {what}", name, "a name or a path", isinstance(name, str | Path))
    suffix = SUFFIXES[kind]
    if not (name := os.fspath(name)):
        raise error(f"the {what}'s name is empty: give one", value=name)
    for folder in (Path(kind), bundled(kind)):
        for entry in _entries(folder, kind):
            if entry.name in (name, name + suffix):
                return entry
    given = Path(os.path.expanduser(name))  # noqa: PTH111 (pathlib's raises where there is no such user)
    if exists(given) and not (suffix and is_folder(given)):
        return given
    if not suffix and is_folder(Path(kind) / name):
        return Path(kind) / name  # not a demonstration: reading it tells what is missing
    valid = names(kind)
    hint = nearest(name, valid)
    if kind == "robots" and name.lower() not in map(str.lower, valid):  # such as ur5 for UR5e
        hint = f"{hint or ';'} `pbd robots` says which arms they are"
    known = f"known are {listed(valid)}{hint}" if valid else f"none is known; put one into ./{kind}"
    if is_folder(given):
        raise error(f"{name} is a folder: give a name, or a file; {known}", value=name, valid=valid)
    known = f"nor a file or folder of that path; {known}"
    raise error(f"no {what} named '{name}' in ./{kind}, {known}", value=name, valid=valid)


def _entries(folder: Path, kind: str) -> list[Path]:
    found = folder.glob("*.toml") if SUFFIXES[kind] else (path.parent for path in folder.glob("*/demo.toml"))
    return sorted(found)
