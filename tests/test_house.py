"""The house keeps its order: who may import whom, what is heavy, how long a file is."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "pbd"
FOLDERS = ("sensors", "tracking", "calibration", "arm", "audit", "files", "view")
HEAVY = {"pinocchio", "ruckig", "meshcat", "matplotlib", "serial", "filterpy", "scipy"}
MODULES = sorted(PACKAGE.rglob("*.py"))


def rung(module: str) -> int:
    """The rung of a module by its dotted name (DESIGN: five rungs, imports only go down)."""
    parts = module.split(".")[1:]
    if not parts:
        return 0  # pbd itself: the version
    if parts[0] == "errors":
        return 1
    if parts[0] in ("pose", "data", "paths", "cache", "doors"):
        return 2
    if parts[0] in FOLDERS:
        return 3
    if parts[0] in ("pipeline", "planning", "plotting", "record", "replay"):
        return 4
    return 5


def imports(path: Path) -> list[tuple[str, bool]]:
    """All modules that a file imports, and whether at its top level outside `if TYPE_CHECKING`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    top = {id(node) for node in tree.body}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in top) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            package = PACKAGE.parent / str(node.module).replace(".", "/")
            inside = package.is_dir() and node.module != "pbd.data"  # from pbd.cli import export
            names = [f"{node.module}.{a.name}" for a in node.names if inside and (package / f"{a.name}.py").is_file()]
            found += [(name, id(node) in top) for name in names or [str(node.module)] if name != "pbd.__version__"]
    return found


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_go_down(path: Path) -> None:
    here = name_of(path)
    if here == "pbd":
        return  # its names are found lazily
    for module, _ in imports(path):
        if module.split(".")[0] != "pbd":
            continue
        same_folder = rung(module) == rung(here) == 3 and module.split(".")[1] == here.split(".")[1]
        same_rung = rung(module) == rung(here) in (2, 4, 5)
        assert rung(module) < rung(here) or same_folder or same_rung, f"{here} imports {module}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_file_reads_in_one_sitting(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if name_of(path).split(".")[1:2] not in (["arm"], ["audit"], ["view"])],
    ids=name_of,
)
def test_heavy_imports_are_made_where_they_are_used(path: Path) -> None:
    heavy = [module for module, at_top in imports(path) if at_top and module.split(".")[0] in HEAVY]
    assert not heavy


@pytest.mark.parametrize("statement", ["import pbd.cli; pbd.cli.parser()", "import pbd; pbd.track; pbd.load_robot"])
def test_nothing_heavy_is_loaded_early(statement: str) -> None:
    code = f"{statement}\nimport sys\nprint(*sorted(m for m in sys.modules if m in {sorted(HEAVY)!r}))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


def test_help_needs_no_numpy() -> None:
    code = "import pbd.cli, sys; pbd.cli.parser(); print('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_no_circles() -> None:
    graph = {
        name_of(path): {module for module, at_top in imports(path) if at_top and module.startswith("pbd.")}
        for path in MODULES
        if name_of(path) != "pbd"
    }
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join((*trail, module))
        if module in done:
            return
        for other in graph.get(module, ()):
            visit(other, (*trail, module))
        done.add(module)

    for module in graph:
        visit(module, ())


def test_no_unsafe_loading() -> None:
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        for word in ("import pickle", "allow_pickle=True", "eval(", "exec("):
            found = [line for line in text.splitlines() if word in line and "def " not in line]
            assert not found, f"{path}: {found}"
