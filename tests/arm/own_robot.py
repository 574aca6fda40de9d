"""The robot of a user's own that docs/robots.md describes."""

from collections.abc import Sequence
from pathlib import Path

LENGTHS = (0.2, 0.1, 0.4, 0.35, 0.0, 0.08)  # m, from each joint back to the one before


AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")


ALONG = ("z", "z", "z", "x", "x", "x")


def own_urdf(axes: Sequence[str] = AXES) -> str:
    links = ("base_link", *(f"link{i}" for i in range(1, 6)), "flange")
    joints = []
    for i, (length, axis, along) in enumerate(zip(LENGTHS, axes, ALONG, strict=True)):
        xyz = f"0 0 {length}" if along == "z" else f"{length} 0 0"
        joints.append(
            f'<joint name="joint{i + 1}" type="revolute"><parent link="{links[i]}"/><child link="{links[i + 1]}"/>'
            f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            '<limit effort="9" lower="-3" upper="3" velocity="2"/></joint>'
        )
    return f'<robot name="mine">{"".join(f"<link name={link!r}/>" for link in links)}{"".join(joints)}</robot>'


GUIDE = Path(__file__).parents[2] / "docs" / "robots.md"


def own_toml() -> str:
    """The TOML that docs/robots.md gives."""
    return GUIDE.read_text(encoding="utf-8").partition("```toml\n")[2].partition("```")[0]
