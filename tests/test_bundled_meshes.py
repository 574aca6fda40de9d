"""The bundled arms' meshes are read as they were when bundled_meshes.txt was written.

To write that file anew, once a change of it is meant: python -m tests.test_bundled_meshes > tests/bundled_meshes.txt
"""

from pathlib import Path

import numpy as np
import pytest

from pbd.io.meshes import mesh_file
from pbd.io.urdf import read_urdf_xml
from tests.arm.bundled import NAMES, arm_of
from tests.reading_meshes import read_mesh
from tests.view.scenes import share

FILE = Path(__file__).with_name("bundled_meshes.txt")
HEADER = "# mesh; triangles; lower and upper corner, m; area, m2; triangles of each colour (nan: it has none)"
FOLDER = (share() / "example-robot-data" / "robots").resolve()


def meshes() -> list[Path]:
    """All visual and collision meshes of the bundled arms."""
    robots = [arm_of(name).robot for name in NAMES]
    return sorted(
        {
            mesh_file(mesh.attrib["filename"], robot.urdf, robot.package_dirs).resolve()
            for robot in robots
            for mesh in read_urdf_xml(robot.urdf).iterfind(".//mesh")
        }
    )


def described(path: Path) -> list[str]:
    soup = read_mesh(path)
    corners = soup.corners
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    bounds = (*corners.min(axis=(0, 1)), *corners.max(axis=(0, 1)), area)
    rgb = np.rint(255.0 * np.nan_to_num(soup.rgb, nan=-1.0)).astype(int)
    codes, counts = np.unique(rgb @ (1 << 16, 1 << 8, 1), return_counts=True)  # rows take long to sort
    colours = [(code >> 16, code >> 8 & 255, code & 255) if code >= 0 else None for code in codes]
    named = [
        f"{'nan' if each is None else ','.join(map(str, each))}:{count}"
        for each, count in zip(colours, counts, strict=True)
    ]
    return [str(len(corners)), *(f"{bound:.6g}" for bound in bounds), *named]


def written() -> dict[str, list[str]]:
    rows = [line.split() for line in FILE.read_text(encoding="utf-8").splitlines()[1:]]
    return {row[0]: row[1:] for row in rows}


def test_all_are_there() -> None:
    strange = {str(path.relative_to(FOLDER)) for path in meshes()} ^ written().keys()
    assert not strange, "write the file anew, as the top of this one says"


@pytest.mark.parametrize("name", written() if FILE.is_file() else {})
def test_a_mesh_is_read_as_it_was(name: str) -> None:
    found, before = described(FOLDER / name), written()[name]
    assert found[:1] == before[:1]
    assert list(map(float, found[1:8])) == pytest.approx(list(map(float, before[1:8])), rel=1e-4, abs=1e-7)
    assert found[8:] == before[8:]


if __name__ == "__main__":
    print(HEADER)
    for path in meshes():
        print(path.relative_to(FOLDER), *described(path))
