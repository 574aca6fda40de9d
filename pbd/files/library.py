"""Where named things are: the user's own folder first, then what comes with pbd."""

from __future__ import annotations

from pathlib import Path

from pbd.errors import PbdError, nearest


def bundled(kind: str) -> Path:
    """Return the folder that comes with pbd: inside an installed wheel, or at the top of a checkout."""
    package = Path(__file__).parent.parent
    inside = package / "bundled" / kind
    return inside if inside.is_dir() else package.parent / kind


def names(kind: str, suffix: str) -> list[str]:
    """Name everything of a kind ("robots", "calibration": .toml; "demos": folders), the user's and the bundled."""
    return sorted(
        {_name(entry, suffix) for folder in (Path(kind), bundled(kind)) for entry in _entries(folder, suffix)}
    )


def bundled_names(kind: str, suffix: str) -> list[str]:
    """Name what comes with pbd."""
    return sorted(_name(entry, suffix) for entry in _entries(bundled(kind), suffix))


def find(kind: str, name: str, suffix: str, error: type[PbdError]) -> Path:
    """Find `name` of a kind: a path as it is given, else the user's ./KIND, else the bundled one.

    Raises:
        error: lists the valid names.
    """
    for folder in (Path(kind), bundled(kind)):
        for entry in _entries(folder, suffix):
            if entry.name in (name, name + suffix):
                return entry
    given = _path(name)
    if given is not None and not (suffix and given.is_dir()):
        return given
    valid = names(kind, suffix)
    what = {"demos": "demonstration", "robots": "robot"}.get(kind, kind)
    known = f"known are {', '.join(valid)}{nearest(name, valid)}" if valid else f"none is known; put one into ./{kind}"
    if given is not None:
        raise error(f"{name} is a folder: give a name, or a file; {known}", value=name, valid=valid)
    raise error(f"no {what} named '{name}', nor a file or folder of that path; {known}", value=name, valid=valid)


def _path(name: str) -> Path | None:
    """Take a name as a path to something that is there; a name that can't be a path at all is none."""
    try:
        given = Path(name).expanduser()
        return given if given.exists() else None
    except (OSError, RuntimeError, ValueError):
        return None


def _name(entry: Path, suffix: str) -> str:
    return entry.stem if suffix else entry.name


def _entries(folder: Path, suffix: str) -> list[Path]:
    """Files with the suffix, or, without one, folders that hold a demonstration."""
    if not folder.is_dir():
        return []
    wanted = folder.glob(f"*{suffix}") if suffix else (path.parent for path in folder.glob("*/demo.toml"))
    return sorted(wanted)
