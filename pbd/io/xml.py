"""Reading XML (URDF and SRDF)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from pbd.errors import RobotError
from pbd.io.read_file import read_bytes

MOST_BYTES = 100_000_000
"""Largest XML file, bytes."""


def read_xml(path: Path) -> ET.Element:
    """Parse an XML file and return its root; RobotError: it can't be read, with the line if the parser knows it."""
    data = read_bytes(path, RobotError, "correct its path, or mend the file", MOST_BYTES)
    try:
        root: ET.Element = ET.fromstring(data, parser=ET.XMLParser(target=_NoDoctype()))
    except ET.ParseError as reason:
        raise RobotError(f"{path}: not valid XML: {reason}; correct it", path=path) from None
    except (ValueError, LookupError) as reason:  # the parser does not know the encoding
        raise RobotError(f"{path}: not valid XML: {reason}; save it as UTF-8", path=path) from None
    return root


class _NoDoctype(ET.TreeBuilder):
    """Refuses a DOCTYPE: its entities can make gigabytes of a small file, and no URDF or SRDF needs one."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ET.ParseError(f"a DOCTYPE ({name[:40]}) is not allowed")
