"""Which files pbd made. An output replaces those and empty files, but no file of a person or of another program."""

import re
from pathlib import Path
from zlib import crc32

from pbd.errors import PbdError
from pbd.io.read_file import read_bytes

PICTURE_MADE_BY = "pbd, with "
"""Prefix of the program's name in the metadata of pictures that pbd writes."""

_KINDS = {
    rb"\x89PNG|%PDF|<\?xml": PICTURE_MADE_BY.encode(),
    rb"<!doctype html": b'id="viewer-code"',
    rb"t,q_": b",gripper",  # csv
    rb"PK\x03\x04.{26}joints\.npy": b"gripper.npy",
    rb'\{"header": \{"stamp"': b'"gripper_commands": [',  # ros2-json
    rb"index,t_s,dwell_s,grip,label,q_": b"",  # keyframes
    rb'\{"demo": "': b'"base_wxyz"',
    rb"0\.0( -?\d\S*){7}\n": b"",  # tum, from t = 0, with numbers as Python prints them
    rb"\x89MCAP": b"pbd_tool",
    rb"glTF": b'"generator":"pbd"',
    rb"<phyphox": b"<title>pbd</title>",
    rb'\{\s+"\w+": \{\s+"id"': b'"homing_offset"',  # the servos' calibration, LeRobot's too
}
"""For each kind of file that pbd writes: pattern of its beginning -> bytes that it contains somewhere."""

_TO_EDIT = rb"# .+ planned and audited by pbd"
"""The beginning, as a pattern, of files that people are asked to edit: pbd ends them with a seal."""

SEAL = "# as pbd wrote it: "
"""The beginning of a seal; a checksum of what is above follows."""


def sealed(text: str) -> str:
    """Append a comment with a checksum, by which `refuse_others_file` sees whether somebody has edited the text."""
    return f"{text}{SEAL}{crc32(text.encode(errors='surrogateescape')):08x}\n"


def refuse_others_file(file: Path) -> None:
    """Refuse (PbdError) to write over a file that pbd did not make, or that was edited where people are asked to.

    An empty file may be replaced: nobody loses anything.
    """
    old = read_bytes(file, PbdError, "give another place")
    ours = any(re.match(start, old, re.DOTALL) and mark in old for start, mark in _KINDS.items())
    if re.match(_TO_EDIT, old):
        text = old.rpartition(SEAL.encode())[0].decode(errors="replace")
        if sealed(text).encode() != old:
            raise PbdError(f"{file} was edited, so it is not overwritten; give another place", path=file)
    elif old and not ours:
        what = f"{file} is not an earlier output of pbd, so it is not overwritten; give another place"
        raise PbdError(what, path=file)
