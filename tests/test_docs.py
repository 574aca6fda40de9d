"""The documentation is true: its Python runs, its links and commands exist, its figures agree."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from pbd.cli import main, parser
from tests.docs_pages import PAGES, ROOT, blocks


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem)
@pytest.mark.usefixtures("cached_results")
def test_the_examples_run(page: Path, elsewhere: Path) -> None:
    """The blocks of a page run in order and share their names. Exports are of a shorter demonstration."""
    names: dict[str, object] = {}
    for number, block in enumerate(blocks(page, "python"), start=1):
        if page.stem == "exports":
            block = block.replace('load_demo("pouring")', 'load_demo("paper-test2")')
        exec(compile(block, f"{page.name}, block {number}", "exec"), names)


def test_the_calibrations_without_hardware_print_what_the_page_says(
    elsewhere: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each `# ...` line below a command has the numbers of one line that the command prints."""
    number, printed, compared = re.compile(r"\d+\.\d+"), [""], 0
    for line in "".join(blocks(ROOT / "docs" / "calibration.md", "sh")).splitlines():
        if line.startswith("# "):
            wanted = number.findall(line)
            assert any(all(each in row for each in wanted) for row in printed), line
            compared += 1
        else:
            assert main(shlex.split(line)[1:]) == 0
            printed = "".join(capfd.readouterr()).splitlines()
    assert compared == 6


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_ones_that_there_are(page: Path) -> None:
    """Each `pbd ...` line of a shell block, or of an indented one, is parsed; its files need not exist."""
    indented = re.findall(r"^ {4,}(pbd .*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    for line in (*"".join(blocks(page, "sh")).splitlines(), *indented):
        words = shlex.split(line, comments=True)
        if words[:1] == ["pbd"] and not any(word[0] in "|<>" for word in words):
            parser().parse_args(words[1:])


def test_what_is_installed_is_ours() -> None:
    """The name `pbd` on the package index belongs to somebody else, so nothing may tell to install or look up that."""
    assert tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["name"] == "pbd-robot"
    wrong = re.compile(r"""pip3? install [^\n`]*\bpbd\b(?!-robot)|\bpbd\[|(?:version|files|metadata)\(["']pbd["']\)""")
    named = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "Makefile", ".ci/run")
    for file in [*PAGES, *(ROOT / "pbd").rglob("*.py"), *map(ROOT.joinpath, named)]:
        assert not wrong.search(file.read_text(encoding="utf-8")), file


def benchmark_rows() -> list[tuple[str, str, str]]:
    """(what is measured, its figures, the page with details) of each row of the README's table of benchmarks."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return re.findall(r"^\| ([^|]+) \| ([^|]+) \| `\w+\.py`[^|]* \| \[\w+\]\(([^)]+)\) \|$", text, re.MULTILINE)


def test_the_benchmarks_figures_are_in_one_place() -> None:
    """Each figure of the README is on the page that it names, up to rounding; times are compared with times."""
    number, of_time = r"(?<![\w.])(\d+(?:\.\d+)?)(?![\w.]*\d)", r"(?=(?: to [\d.]+)? m?s\b)"
    rows = benchmark_rows()
    assert len(rows) > 4
    for what, figures, page in rows:
        wanted = number + (of_time if re.search(r" m?s\b", figures) else "")
        there = [float(x) for x in re.findall(wanted, (ROOT / page).read_text(encoding="utf-8"))]
        for figure in re.findall(wanted, figures):
            half = 0.5 * 10.0 ** -len(figure.partition(".")[2])
            assert any(abs(float(figure) - x) <= half + 1e-9 for x in there), f"{what}: {figure} is not in {page}"
