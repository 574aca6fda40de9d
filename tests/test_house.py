"""The structure of the package: layers of imports, heavy imports, length of files, size of folders."""

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "pbd"
RUNGS = (
    ("errors", "lazy"),
    ("frozen_arrays", "pose", "data", "cache", "io", "lapack", "timestamps"),
    ("sensors", "simulation", "tracking", "calibration", "arm", "audit", "files", "view"),
    ("pipeline", "track_recording", "fusion", "planning", "plots", "record", "replay", "check_demos", "driving"),
    ("cli", "__main__"),
)
"""A file imports only from lower rungs, from its own folder and, except in the third rung, from its own rung."""

SEPARATE = ("sensors", "simulation", "tracking", "calibration", "arm", "audit", "files", "view")
HEAVY = {"pinocchio", "ruckig", "meshcat", "matplotlib", "serial", "filterpy", "scipy"}
MAY_BE_HEAVY = ("arm", "audit", "plots", "view")
LONGEST_FILE, FULLEST_FOLDER = 300, 20

MODULES = sorted(PACKAGE.rglob("*.py"))


def imports(path: Path) -> list[tuple[str, bool]]:
    """(module, at top level) of each import in a file; one below `if TYPE_CHECKING` is not at top level."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    top = {id(node) for node in tree.body}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in top) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            folder = PACKAGE.parent / str(node.module).replace(".", "/")
            files = [f"{node.module}.{a.name}" for a in node.names if (folder / f"{a.name}.py").is_file()]
            found += [(name, id(node) in top) for name in files or [str(node.module)]]
    return found


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def all_imports() -> dict[str, list[tuple[str, bool]]]:
    return {name_of(path): imports(path) for path in MODULES if path != PACKAGE / "__init__.py"}


def part(module: str) -> str:
    """The part of the package, a top-level folder or file, that a module belongs to."""
    return module.split(".")[1] if "." in module else ""


def test_imports_go_down() -> None:
    rung = {name: number for number, names in enumerate(RUNGS) for name in names} | {"": -1}
    unplaced = {part(name) for name in all_imports()} - rung.keys()
    assert not unplaced, "name it in RUNGS: what imports it must be on a higher rung, what it imports on a lower one"
    wrong = []
    for here, found in all_imports().items():
        for there, _ in found:
            if not there.startswith("pbd"):
                continue
            ours, theirs = part(here), part(there)
            beside = rung[ours] == rung[theirs] and ours not in SEPARATE
            if not (rung[theirs] < rung[ours] or beside or ours == theirs):
                wrong.append(f"{here} imports {there}")
    assert not wrong, "move what both need to a lower rung of RUNGS, or let the caller, on a higher one, pass it"


def test_no_command_imports_another() -> None:
    """What commands share is in a file of its own. `pbd.cli.commands` names them, and runs one."""
    commands = {name_of(path) for path in MODULES if "\ndef run(args" in path.read_text(encoding="utf-8")}
    assert len(commands) > 10
    wrong = [
        f"{here} imports {there}"
        for here, found in all_imports().items()
        for there, _ in found
        if there in commands - {here} and not here.startswith(f"{there}.")
    ]
    assert not wrong, "move what they share to a file without `run`, as pbd/cli/common.py is"


def test_no_circles() -> None:
    graph = {
        here: {there for there, at_top in found if at_top and there in all_imports()}
        for here, found in all_imports().items()
    }
    TopologicalSorter({here: found - {here} for here, found in graph.items()}).prepare()


def test_a_file_reads_in_one_sitting_and_a_folder_at_a_glance() -> None:
    long = [path for path in MODULES if len(path.read_text(encoding="utf-8").splitlines()) > LONGEST_FILE]
    counts = Counter(path.parent for path in MODULES)
    full = [folder for folder, count in counts.items() if count > FULLEST_FOLDER]
    assert not long, f"split what has more than {LONGEST_FILE} lines by subject, so that each file has one"
    assert not full, f"move some of more than {FULLEST_FOLDER} files that belong together to a folder of their own"


def test_nothing_heavy_is_loaded_early() -> None:
    """The help does not load numpy either."""
    code = "import sys\n"
    for statement, heavy in (
        ("import pbd.cli; pbd.cli.parser()", HEAVY | {"numpy"}),
        ("import pbd; pbd.track; pbd.load_robot", HEAVY),
        ("import pbd.cli.record", {"http.client"}),
    ):
        code += f"{statement}\nprint({statement!r}, *sorted(sys.modules.keys() & {heavy!r}), sep=': ')\n"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = [line for line in result.stdout.splitlines() if ": " in line]
    assert not loaded, "these statements load a package early: import it in the function that needs it"
    at_top = [
        f"{here} imports {there}"
        for here, found in all_imports().items()
        for there, is_at_top in found
        if is_at_top and there.split(".")[0] in HEAVY and part(here) not in MAY_BE_HEAVY
    ]
    assert not at_top, "import it in the function that needs it"


def test_no_unsafe_loading() -> None:
    unsafe = re.compile(r"import pickle|allow_pickle=True|(?<!def )\b(eval|exec)\(")
    found = [path for path in MODULES if unsafe.search(path.read_text(encoding="utf-8"))]
    assert not found, "a file of somebody else's could run code: read it with orjson, tomlkit or numpy without pickle"


NO_NAMES = {"again", "args.take + 1", "by", "columns", "members", "options", "rate", "separator", "' '.join(takes)"}
"""What commands in messages contain beside names: numbers, letters, and words that are quoted already."""


def test_the_names_in_advised_commands_are_quoted() -> None:
    """A person pastes them into a shell, which would run a folder that is called `$(command)`."""
    bare = []
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            before = ""
            for each in node.values if isinstance(node, ast.JoinedStr) else []:
                if isinstance(each, ast.FormattedValue) and re.search(r"\bpbd (?!run drives)[a-z]+ [^`;]*$", before):
                    said = ast.unparse(each.value)
                    bare += [] if said in NO_NAMES or re.search(r"quote\(|shell_word\(", said) else [(path, said)]
                before += str(each.value) if isinstance(each, ast.Constant) else ""
    assert not bare, "quote it with shlex.quote; if it can be no name, add it to NO_NAMES"
