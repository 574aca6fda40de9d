"""`pbd plot`: its files, messages and JSON."""

import csv
import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from pbd.cli import main
from pbd.files.demo import load_demo
from pbd.plots import compare_figures, figures
from tests.cli.run_command import Capture, run, run_json

pytestmark = pytest.mark.usefixtures("elsewhere", "cached_results")


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw one figure only, for tests that are not about the figures."""
    monkeypatch.setattr(figures, "FIGURES", {"position": figures.FIGURES["position"]})
    monkeypatch.setattr(compare_figures, "COMPARISONS", {"paths": compare_figures.COMPARISONS["paths"]})


def test_the_bundled_demonstration_is_drawn_where_none_is_named(
    capsys: Capture, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two figures of two sizes; tests/plots/test_figures.py draws all of them."""
    drawn = {name: figures.FIGURES[name] for name in ("view-yx", "summary")}
    monkeypatch.setattr(figures, "FIGURES", drawn)
    code, out, err = run(capsys, "plot")
    assert (code, out) == (0, "")
    assert "using 'pouring'" in err
    assert err.endswith("pbd: wrote 2 files into plots/pouring\n")
    sizes = {}
    for file in (elsewhere / "plots" / "pouring").iterdir():
        assert file.suffix == ".png"
        assert file.stat().st_size > 10_000
        with Image.open(file) as image:
            image.verify()
            assert image.format == "PNG"
            sizes[file.stem] = image.size
    assert set(sizes) == set(drawn)
    assert sizes["summary"] == pytest.approx((11.69 * 110, 8.27 * 110), abs=1.0)  # A4, landscape
    assert sizes["view-yx"][0] < 1100


@pytest.mark.usefixtures("few")
def test_json_lists_the_files_and_a_second_time_replaces_them_but_no_other_program_s(
    capsys: Capture, elsewhere: Path
) -> None:
    words = ("--save", "a/b", "--format", "svg")
    result = run_json(capsys, "plot", "paper-test1", *words, "--method", "paper")
    assert set(result) == {"demo", "method", "files", "findings"}
    assert (result["demo"], result["method"]) == ("paper-test1", "paper")
    assert result["files"] == ["a/b/position.svg"]
    file = elsewhere / "a" / "b" / "position.svg"
    first = file.read_bytes()
    assert first.startswith(b"<?xml")
    assert list(file.parent.iterdir()) == [file]
    assert any("adds an uncertainty of" in finding for finding in result["findings"])  # the paper's method in the turn
    assert any("at the end of the range" in finding for finding in result["findings"])  # a warning of the tracker's
    told = run(capsys, "plot", "paper-test2", *words)[2]
    assert told.endswith("wrote 1 file into a/b, 1 of them over older ones\n")
    assert file.read_bytes() != first
    file.write_text("another program's")
    code, _, err = run(capsys, "plot", "paper-test2", *words)
    assert (code, file.read_text()) == (1, "another program's")
    assert err.endswith("is not an earlier output of pbd, so it is not overwritten; give another place\n")


def test_two_are_compared(capsys: Capture, elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two figures; tests/plots/test_compare.py draws all of them."""
    drawn = {name: compare_figures.COMPARISONS[name] for name in ("paths", "spread")}
    monkeypatch.setattr(compare_figures, "COMPARISONS", drawn)
    code, out, err = run(capsys, "plot", "paper-test1", "paper-test2", "paper-test1")
    assert code == 0
    folder = elsewhere / "plots" / "paper-test1+paper-test2"
    assert {file.name for file in folder.iterdir()} == {"paths.png", "spread.png"}
    assert "in (of 3)" in out.splitlines()[0]
    assert "spread x (cm)" in out.splitlines()[0]
    assert out.splitlines()[2].split()[1] == "3"
    for said in (
        "tracking 'paper-test1'",
        "tracking 'paper-test2'",
        "tracking 'paper-test1 (2)'",
        "warning: paper-test1: 3 samples of the gyro's x axis are at the end of the range",
        "warning: paper-test1 (2): 3 samples of the gyro's x axis are at the end of the range",
        "paper-test2 has no keyframes 1 (2.6 s in paper-test1), 2 (",
        f"wrote 2 files into {folder.relative_to(elsewhere)}",
    ):
        assert f"pbd: {said}" in err


@pytest.mark.usefixtures("few")
def test_comparison_as_json(capsys: Capture) -> None:
    result = run_json(capsys, "plot", "paper-test1", "paper-test2", "--save", "out")
    assert set(result) == {"demos", "method", "matched_by", "remarks", "keyframes", "files"}
    assert result["demos"] == ["paper-test1", "paper-test2"]
    assert result["matched_by"] == "place"
    assert [row["keyframes"] for row in result["keyframes"]] == [[0, 0], [1, None], [2, None], [3, None], [4, 1]]
    assert result["keyframes"][1]["spread_m"] == [None, None, None]
    # Both end at one place, after one move and after four.
    assert max(result["keyframes"][4]["spread_m"]) < 0.03


@pytest.mark.usefixtures("few")
def test_comparison_as_csv(capsys: Capture) -> None:
    code, out, _ = run(capsys, "plot", "paper-test1", "paper-test2", "paper-test1", "--csv", "--units", "mm")
    assert code == 0
    rows = list(csv.DictReader(out.splitlines()))
    keyframes = run_json(capsys, "plot", "paper-test1", "paper-test2", "paper-test1")["keyframes"]
    assert [int(row["in (of 3)"]) for row in rows] == [3, 2, 2, 2, 3]
    for row, keyframe in zip(rows, keyframes, strict=True):
        spread = [float(row[f"spread {axis} (mm)"]) for axis in "xyz"]
        assert spread == pytest.approx([1e3 * x for x in keyframe["spread_m"]], abs=0.051)
    _, out, _ = run(capsys, "plot", "paper-test1", "paper-test2", "--csv")
    assert list(csv.DictReader(out.splitlines()))[1]["spread x (cm)"] == ""  # of one alone nothing is known


@pytest.mark.usefixtures("few")
def test_what_cannot_be_known_is_drawn_all_the_same(capsys: Capture, elsewhere: Path) -> None:
    """A demonstration whose known places contradict it is drawn without them, so that the user sees why."""
    main(["simulate", "pick-and-place-stops", "tea", "--seed", "1"])  # it ends 15 cm away
    toml = elsewhere / "demos" / "tea" / "demo.toml"
    toml.write_text("closed = true\n" + toml.read_text().replace("closed = false\n", "", 1))
    result = run_json(capsys, "plot", "tea")
    (finding, *_) = (each for each in result["findings"] if "closed = true" in each)
    assert finding.endswith("drawn without it")
    code, out, err = run(capsys, "plot", "tea", "paper-test1", "--json")
    assert code == 0
    assert finding in err
    assert len(json.loads(out)["keyframes"]) == 5


@pytest.mark.usefixtures("few")
def test_a_folder_of_many_demonstrations_has_a_short_name(capsys: Capture, elsewhere: Path) -> None:
    names, folder = [letter * 30 for letter in "abc"], load_demo("paper-test2").folder
    assert folder is not None
    for name in names:
        shutil.copytree(folder, elsewhere / "demos" / name)
    run_json(capsys, "plot", *names)
    assert [path.name for path in (elsewhere / "plots").iterdir()] == ["a" * 30 + "+2"]


@pytest.mark.usefixtures("few")
def test_a_name_leads_nowhere_else(capsys: Capture, elsewhere: Path) -> None:
    main(["simulate", "pick-and-place-direct", "tea"])
    toml = elsewhere / "demos" / "tea" / "demo.toml"
    toml.write_text(toml.read_text().replace('name = "tea"', 'name = "../../../tea"'))
    run_json(capsys, "plot", "tea")
    assert sorted(path.name for path in elsewhere.iterdir()) == ["demos", "plots"]
    assert [path.name for path in (elsewhere / "plots").iterdir()] == ["tea"]
