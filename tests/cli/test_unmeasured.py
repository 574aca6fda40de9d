"""A quantity that was not measured has no sigma, rather than a sigma of zero: in tables, files and JSON."""

import json
from pathlib import Path

import numpy as np
import pytest

import pbd
from pbd.cli import main
from pbd.files.keyframes import read_keyframes

pytestmark = pytest.mark.usefixtures("elsewhere")

Capture = pytest.CaptureFixture[str]

TYPED = """ # between the first two
t_s = 3.0
dwell_s = 0.2
position_m = [0.02, 0.03, 0.04]
rpy_deg = [0, 0, 30]
"""


def run(capsys: Capture, *args: str) -> tuple[str, str]:
    capsys.readouterr()
    assert main(args) == 0
    out, err = capsys.readouterr()
    return out, err


def test_a_lever_found_by_pivoting_says_nothing_of_the_rotation(capsys: Capture) -> None:
    assert main(["simulate", "pivot", "tip"]) == 0
    _, err = run(capsys, "calibrate", "mount", "bench", "tip", "--pivot")
    assert "degrees" not in err
    assert err.endswith("mm (one sigma); its rotation is not measured yet: --turns does that\n")
    assert "sigma_deg" not in Path("calibration/bench.toml").read_text(encoding="utf-8")
    out, _ = run(capsys, "calibrate", "show", "bench")
    assert [line.split()[-2:] for line in out.splitlines() if "roll, pitch, yaw" in line] == [["not", "stated"]]
    mount = json.loads(run(capsys, "calibrate", "mount", "bench", "tip", "--pivot", "--json")[0])["mount"]
    assert mount["sigma_deg"] == [None, None, None]
    assert all(0.0 < x < 0.01 for x in mount["sigma_m"])


def test_a_keyframe_that_a_person_typed_has_no_sigma(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    from pbd.plots import compare_figures  # loads slowly, and few of the processes that collect this need it
    from pbd.plots.compare import compare

    assert main(["simulate", "pour", "tea"]) == 0
    assert main(["keyframes", "tea", "--save"]) == 0
    file = Path("demos/tea/keyframes.toml")
    head, first, *others = file.read_text(encoding="utf-8").split("\n[[keyframe]]")
    file.write_text("\n[[keyframe]]".join([head, first, TYPED, *others]), encoding="utf-8")
    assert not read_keyframes(file)[1].cov.any()
    assert "sigma" not in repr(read_keyframes(file)[1])

    rows = json.loads(run(capsys, "keyframes", "tea", "--calibration", "default", "--json")[0])["keyframes"]
    assert (rows[1]["sigma_m"], rows[1]["sigma_deg"]) == ([None] * 3, [None] * 3)
    assert (rows[0]["sigma_m"], rows[0]["sigma_deg"][2]) == ([0.0] * 3, 0.0)  # nav's origin and heading are fixed there
    assert [row["base_sigma_parts_m"]["tracking"] is None for row in rows] == [k == 1 for k in range(len(rows))]
    assert {row["base_sigma_parts_m"]["mount"] for row in rows} == {None}  # it was never calibrated
    table = run(capsys, "keyframes", "tea", "--csv")[0].splitlines()
    header, typed = table[0].split(","), table[2].split(",")
    assert [typed[column] for column, name in enumerate(header) if name.startswith("σ")] == ["", ""]

    path = pbd.track(pbd.load_demo("tea"))
    keyframes = read_keyframes(file)
    assert np.isnan(compare([(name, path, keyframes) for name in "ab"]).keyframes[1].sigma).all()
    with monkeypatch.context() as one_figure:
        one_figure.setattr(compare_figures, "COMPARISONS", {"spread": compare_figures.COMPARISONS["spread"]})
        assert main(["plot", "tea", "tea"]) == 0  # it is drawn all the same
    assert main(["replay", "tea", "--robot", "panda", "--html", "tea.html"]) == 0
