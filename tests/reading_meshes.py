"""Reads a mesh's triangles without the cache."""

from pathlib import Path
from unittest.mock import patch

from pbd.io.meshes import TriangleSoup, from_mesh


def read_mesh(path: Path) -> TriangleSoup:
    soups: list[TriangleSoup] = []

    def keep(soup: TriangleSoup) -> dict[str, object]:
        soups.append(soup)
        return {}

    with patch("pbd.io.meshes.recall", return_value=None), patch("pbd.io.meshes.remember"):
        from_mesh(path, "soup", keep)
    return soups[0]
