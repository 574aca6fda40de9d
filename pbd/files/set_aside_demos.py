"""Demonstrations that were set aside under another name, because `--force` replaced them: which, and why."""

import re
from contextlib import suppress
from pathlib import Path

from pbd.errors import RecordingError, listed
from pbd.files.keyframes import KEYFRAMES_FILE
from pbd.io.atomic import DEMONSTRATION_FILES
from pbd.io.toml import read_toml

SIMULATED = ("sim", "simulated")
"""First word of the sensor's name in a simulated recording: of `pbd record --sensor sim`, and of `pbd simulate`."""

_GENERATED = re.compile(
    r"""
      (format | created | sensor | clock | rate_hz | bundled | closed | failed | t_s)[ ]=[ ][^#]*
    | (name | demo)[ ]=[ ]".*" | \[\[(grip | take)\]\]
    | notes[ ]=[ ]"Simulated[ ]\(sensor[ ]model[ ]\S+,[ ]seed[ ]\d+\)\.[ ]([^.] | \.\d)*\."
    | \[object\] | shape[ ]=[ ]"cylinder" | size[ ]=[ ]\[0\.06,[ ]0\.2\]
    | """,
    re.VERBOSE,
)
"""A line that pbd itself writes into the demo.toml of a simulated or a fused demonstration."""


def is_set_aside(folder: Path) -> bool:
    """Whether a demonstration has the name of one that was set aside (`name_aside`), such as tea.before."""
    return re.fullmatch(r".+\.(before|new)(-\d+)?", folder.name) is not None


def why_kept(old: Path, new: Path | None = None) -> str:
    """Say why the demonstration `old` is kept when `new` replaces it; "" if no work of a person would be lost.

    Nothing is lost of an unedited demonstration that is simulated, fused, a link, or the same as the new one.
    """
    if old.is_symlink():
        return ""
    with suppress(OSError, RecordingError):  # one that can't be read may be a recording
        names = {path.name for path in old.iterdir()}
        if KEYFRAMES_FILE in names:
            return "whose keyframes were edited"
        if others := sorted(names.difference(DEMONSTRATION_FILES)):
            return f"with {listed(others)} in it"
        if new is not None and all(_content(old / name) == _content(new / name) for name in names):
            return ""
        top = read_toml(old / "demo.toml", RecordingError)
        if "take" in top or top.text("sensor").split()[0] in SIMULATED:
            lost = _lines(old) - (_lines(new) if new is not None else set())
            return "" if all(map(_GENERATED.fullmatch, lost)) else "whose demo.toml was edited"
    return "a recording"


def _lines(folder: Path) -> set[str]:
    return set((folder / "demo.toml").read_text(encoding="utf-8").splitlines())


def _content(file: Path) -> bytes:
    """Return a file's bytes, without the date in a demo.toml; b"" if there is none."""
    content = file.read_bytes() if file.is_file() else b""
    return re.sub(rb"(?m)^created = .*$", b"", content) if file.name == "demo.toml" else content
