"""The command line: output streams, exit codes, and the JSON that other programs rely on."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.run_command import Capture, refused, run, run_json

pytestmark = pytest.mark.usefixtures("elsewhere", "cached_results", "unadvised")

POSE_KEYS = {"index", "t_s", "dwell_s", "position_m", "wxyz", "sigma_m", "sigma_deg", "weight", "grip"}


def test_keyframes_json(capsys: Capture) -> None:
    rows = run_json(capsys, "keyframes", "pouring")["keyframes"]
    assert len(rows) == 11
    for index, row in enumerate(rows):
        assert set(row) >= POSE_KEYS
        assert row["index"] == index
        assert [len(row[key]) for key in ("position_m", "wxyz", "sigma_m", "sigma_deg")] == [3, 4, 3, 3]
        assert row["wxyz"][0] >= 0.0
    assert [row["grip"] for row in rows if row["grip"] is not None] == [True, False]


def test_keyframes_json_with_a_robot(capsys: Capture) -> None:
    rows = run_json(capsys, "keyframes", "pouring", "--robot", "panda")["keyframes"]
    for row in rows:
        assert [len(row[key]) for key in ("base_position_m", "base_wxyz", "joints")] == [3, 4, 7]
    assert rows[0]["base_position_m"] == pytest.approx([0.45, -0.15, 0.25])


def test_segments_json(capsys: Capture) -> None:
    segments = run_json(capsys, "segments", "paper-test1")["segments"]
    assert [s["kind"] for s in segments] == ["rest", "move"] * 4 + ["rest"]
    assert all(set(s) == {"start", "stop", "kind", "ms", "description"} for s in segments)
    assert [s["stop"] for s in segments[:-1]] == [s["start"] for s in segments[1:]]
    assert segments[-1]["stop"] == 251


def test_replay_json(capsys: Capture, elsewhere: Path) -> None:
    result = run_json(capsys, "replay", "--robot", "panda", "--html", "page.html")
    promised = {"demo", "robot", "keyframes", "duration_s", "ik", "limits", "warnings", "html"}
    more = {"scale", "dock_tilt_deg", "moves", "stretched", "off_deg", "collision", "made_from"}
    assert set(result) == promised | more
    assert (result["demo"], result["robot"], result["keyframes"]) == ("pouring", "panda", 11)
    assert result["ik"]["max_position_error_m"] < 1e-5
    assert result["ik"]["max_rotation_error_rad"] < 1e-5
    assert all(0.5 < result["limits"][key] <= 1.0 for key in ("velocity", "acceleration", "jerk"))
    assert result["warnings"] == []
    w, _, _, z = run_json(capsys, "keyframes", "pouring")["keyframes"][0]["wxyz"]  # panda's dock is level
    assert result["dock_tilt_deg"] == pytest.approx(np.degrees(2.0 * np.arccos(np.hypot(w, z))), abs=1e-5)
    assert (elsewhere / result["html"]).stat().st_size < 5e6


def test_replay_is_served_where_no_file_is_named(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[tuple[str, bool]] = []
    show = "pbd.cli.replay.show_replay"
    monkeypatch.setattr(show, lambda scene, open_browser: served.append((scene.robot.name, open_browser)))
    assert run(capsys, "replay", "paper-test2", "--robot", "ur5", "--no-open")[0] == 0
    run_json(capsys, "replay", "paper-test2", "--robot", "ur5")
    assert served == [("ur5", False)]


def test_a_motion_of_another_size_says_so_and_why(capsys: Capture, elsewhere: Path) -> None:
    command = ("replay", "paper-test2", "--robot", "so101", "--scale", "1.1", "--json")
    code, out, err = run(capsys, *command)
    assert code == 0
    assert json.loads(out)["scale"] == pytest.approx(0.33)
    assert "pbd: played at 0.33 of its size (scale 0.3 of so101's own dock, --scale 1.1)\n" in err


def test_a_motion_on_the_robots_own_dock_says_where_it_starts(capsys: Capture, elsewhere: Path) -> None:
    command = ("export", "paper-test2", "--robot", "ur5", "-o", "motion.csv", "--rate", "100")
    own = (
        "pbd: the hand starts at ur5's own dock, (0.300, -0.200, 0.250) m in base; for yours give --calibration NAME\n"
    )
    assert own in run(capsys, *command)[2]
    assert run(capsys, "calibrate", "dock", "bench", "--position", "0.4", "-0.15", "0.2", "--robot", "ur5")[0] == 0
    assert own in run(capsys, *command)[2]  # a calibration that is not named is not used
    code, _, err = run(capsys, *command, "--calibration", "bench")
    assert code == 0
    assert "the hand starts at" not in err


@pytest.mark.parametrize("format_name", ["csv", "npz", "ros2-json"])
def test_export(capsys: Capture, elsewhere: Path, format_name: str) -> None:
    result = run_json(
        capsys, "export", "paper-test2", "--robot", "panda", "--format", format_name, "-o", "out", "--rate", "100"
    )
    samples = int(np.ceil(result["duration_s"] * 100.0)) + 1
    if format_name == "ros2-json":  # the motion's own knots, and samples between them
        assert result["samples"] == len(json.loads((elsewhere / "out").read_text())["points"]) > samples
        assert set(result["receiver"]) == {"cubic", "quintic"}
    else:
        assert result["samples"] == samples
    assert (elsewhere / "out").stat().st_size > 1000


def test_a_real_walk_replays_as_a_scaled_loop(capsys: Capture, data_folder: Path) -> None:
    assert run(capsys, "import", data_folder / "walks" / "short_walk.csv", "walk")[0] == 0
    result = run_json(
        capsys, "replay", "walk", "--robot", "panda", "--scale", "0.03", "--orientation", "fixed", "--html", "walk.html"
    )
    assert result["keyframes"] >= 14
    assert any("tilted by 33 degrees" in warning for warning in result["warnings"])


# --- bad input ---


def test_a_calibration_for_another_robot(capsys: Capture, elsewhere: Path) -> None:
    (elsewhere / "c.toml").write_text(
        'format = 1\nname = "c"\nrobots = ["ur5"]\n[dock]\nposition = [0.4, 0.0, 0.2]\nrpy_deg = [0, 0, 0]\n'
    )
    line = refused(capsys, 1, "replay", "pouring", "--robot", "panda", "--calibration", "c.toml")
    assert line == ("pbd: the calibration 'c' is for ur5, not for panda; choose another, or add the robot to it")


def test_tables_have_no_colour_in_a_pipe(capsys: Capture) -> None:
    code, out, err = run(capsys, "keyframes", "pouring")
    assert code == 0
    assert "\x1b" not in out
    assert max(len(line) for line in out.splitlines()) < 130
    assert err.startswith("pbd: using: the hand returned to its start (off by ")
    assert err.count("\n") == 1


def test_an_unsure_keyframe_is_told(capsys: Capture, data_folder: Path) -> None:
    (file,) = (data_folder / "broad").glob("10*.npz")
    asked = ("replay", str(file), "--robot", "panda", "--scale", "0.2", "--orientation", "fixed", "--html", "page.html")
    said = refused(capsys, 1, *asked)
    assert re.search(r"is uncertain by \d+ cm .*, more than the whole path .* s move to keyframe ", said)


def test_a_broken_robot_does_not_hide_the_others(capsys: Capture, elsewhere: Path) -> None:
    (elsewhere / "robots").mkdir()
    (elsewhere / "robots" / "mine.toml").write_text("format = 1\nnme = 'mine'\n")
    code, out, err = run(capsys, "robots")
    assert code == 0
    assert "panda" in out
    assert "pbd: warning: robots/mine.toml: name is missing" in err
