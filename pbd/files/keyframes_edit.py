"""Edit keyframes.toml and keep the rest as a person wrote it, with its comments."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pbd.data import TouchUp
from pbd.errors import RecordingError, collected_warnings
from pbd.files.keyframes import parse_keyframes, read_touch_ups, touch_up_toml
from pbd.io.atomic import lock_folder, write_text
from pbd.io.made_by_pbd import SEAL, sealed
from pbd.io.read_file import read_text
from pbd.io.toml import parse_toml


def add_touch_up(path: Path, touch_up: TouchUp) -> None:
    """Append a touch-up to keyframes.toml and keep the rest as it is; raises as `read_keyframes`."""
    import tomlkit

    with _edited(path) as document:
        if "touch_up" not in document:
            document.add(tomlkit.nl())
            document["touch_up"] = tomlkit.aot()
        document["touch_up"].append(tomlkit.parse(f"{touch_up_toml(touch_up)}\n")["touch_up"][0])


def undo_touch_up(path: Path) -> tuple[TouchUp, ...]:
    """Mark the last touch-up that is not undone as undone; return all, () if the file was removed (`write_keyframes`).

    Raises as `read_keyframes`.
    """
    with _edited(path) as document:
        for table in [each for each in document.get("touch_up", []) if not each.get("undone", False)][-1:]:
            table["undone"] = True
    return read_touch_ups(path) if path.exists() else ()


def set_frames(path: Path, frames: Mapping[int, Sequence[str]]) -> None:
    """Set `frames` of some keyframes (index -> frames); raises as `read_keyframes`."""
    with _edited(path) as document:
        for number, names in frames.items():
            document["keyframe"][number]["frames"] = list(names)


@contextmanager
def _edited(path: Path) -> Iterator[Any]:
    """Yield the parsed file to be edited, then write it. A lock on the folder keeps other commands out."""
    import tomlkit

    with lock_folder(path.parent):
        document = tomlkit.parse(read_text(path, RecordingError, "give a text file"))
        yield document
        text = tomlkit.dumps(document)
        if _is_before_touch(text):
            path.unlink()
        else:
            with collected_warnings():  # they are given whenever the file is read
                parse_keyframes(parse_toml(path, text, RecordingError))
            write_text(path, text)


def _is_before_touch(text: str) -> bool:
    """Whether a file that was written `for_touch` has nothing new but touch-ups that are all undone."""
    import tomlkit

    written = sealed(text.partition(SEAL)[0])
    if not text.startswith(written):
        return False
    added = text.removeprefix(written)
    top = tomlkit.parse(added)
    touch_ups = top.get("touch_up", [])
    by_touch = set(top) <= {"touch_up"} and added.count("#") == len(touch_ups)  # one comment each
    return by_touch and all(each.get("undone", False) for each in touch_ups)
