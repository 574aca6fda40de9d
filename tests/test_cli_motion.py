"""The motion options of the command line, and the messages when no motion is possible."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pbd
from pbd.arm.tool_deviation import ToolDeviation
from pbd.cli.plan_report import remarks
from pbd.files.demo import load_demo, write_demo
from pbd.files.find_by_name import bundled
from pbd.files.robot import load_robot
from pbd.pipeline import track
from pbd.planning import plan_path
from tests.arm.bundled import FOLDER
from tests.cli.run_command import Capture, refused, run, run_json
from tests.faulty_inputs import LOW_DOCK, OBSTACLE
from tests.scenarios import with_long_stays

pytestmark = pytest.mark.usefixtures("elsewhere", "cached_results", "unadvised")

PANDA = ("--robot", "panda")

POST = """format = 1
name = "post"
table_height = 0.0
[dock]
position = [0.4, -0.15, 0.25]
rpy_deg = [0, 0, 30]
[[obstacle]]
name = "post"
shape = "box"
size = [0.03, 0.03, 0.3]
position = [0.52, 0.05, 0.15]
"""


def test_the_hands_path_is_exported_with_its_pieces_kept(capsys: Capture) -> None:
    result = run_json(
        capsys, "export", "paper-test1", *PANDA, "--path", "demo", "--time", "demo", "--format", "npz", "-o", "out.npz"
    )
    assert any("are slower than the hand's" in warning for warning in result["warnings"])
    with np.load("out.npz", allow_pickle=False) as file:
        np.testing.assert_allclose(np.diff(file["q"], axis=0) / 1e-3, file["dq"][:-1], atol=0.02)
        assert (file["dq"][[0, -1]] == 0.0).all()


def test_replay_says_how_each_move_is_made(capsys: Capture) -> None:
    code, out, err = run(capsys, "replay", "paper-test1", *PANDA, "--json")
    assert code == 0
    free = json.loads(out)
    assert [move["keyframe"] for move in free["moves"]] == list(range(1, 5))
    assert {move["kind"] for move in free["moves"]} == {"straight"}
    worst = max(free["moves"], key=lambda move: float(move["off_line_m"]))
    off_cm = 100 * worst["off_line_m"]
    between = f"between keyframes {worst['keyframe'] - 1} and {worst['keyframe']}"
    assert f"{between} the tool strays {off_cm:.1f} cm from a straight line" in err
    kept = run_json(capsys, "replay", "paper-test1", *PANDA, "--path-tolerance", "0.01")
    assert max(move["off_line_m"] for move in kept["moves"]) <= 0.01
    assert "line" in {move["kind"] for move in kept["moves"]}
    assert free["collision"] is None
    assert free["stretched"] == []
    assert free["off_deg"] == [0.0, 0.0]


def test_the_arms_present_joints(capsys: Capture, elsewhere: Path) -> None:
    q = [0.1, -0.5, 0.1, -2.0, 0.1, 1.5, 0.5]
    named = {f"panda_joint{i + 1}": value for i, value in enumerate(q)}
    (elsewhere / "now.json").write_text(json.dumps(named))
    for given in (json.dumps(q), json.dumps(named), "now.json"):
        assert start_of(capsys, given) == q


ECHOED = """\
header:
  stamp:
    sec: 12
    nanosec: 5
  frame_id: ''
name:
- panda_finger_joint1
{names}
position:
- 0.04
{positions}
velocity: []
effort:
- 0.0
---
name:
- of the next message
"""


def test_joint_states_are_read_as_they_come(capsys: Capture, elsewhere: Path) -> None:
    """With finger joints, in any order, in rad whatever --units says; as JSON or as `ros2 topic echo` prints it."""
    q = [0.1, -0.5, 0.1, -2.0, 0.1, 1.5, 0.5]
    names = [f"panda_joint{i + 1}" for i in range(7)]
    message = {
        "name": [*names[::-1], "panda_finger_joint1"],
        "position": [*q[::-1], 0.04],
        "velocity": [],
        "effort": [],
    }
    (elsewhere / "now.json").write_text(json.dumps(message, indent=1))
    columns = {"names": "\n".join(f"- {n}" for n in names[::-1]), "positions": "\n".join(f"- {x}" for x in q[::-1])}
    echoed = ECHOED.format(**columns)
    (elsewhere / "now.yaml").write_text(echoed)
    for given in (json.dumps(message), "now.json", echoed, "now.yaml"):
        for units in ((), ("--units", "deg")):
            assert start_of(capsys, given, *units) == q


@pytest.mark.parametrize("named", [False, True])
def test_units_say_in_what_the_joints_are(capsys: Capture, named: bool) -> None:
    degrees = [6.0, -30.0, 6.0, -115.0, 6.0, 86.0, 30.0]
    given = json.dumps({f"panda_joint{i + 1}": x for i, x in enumerate(degrees)} if named else degrees)
    assert start_of(capsys, given, "--units", "deg") == pytest.approx(np.radians(degrees))
    assert start_of(capsys, given, "--units", "deg,mm") == pytest.approx(np.radians(degrees))
    line = refused(capsys, 3, "replay", "paper-test2", *PANDA, "--from", given, "--units", "cm")
    assert line.startswith("pbd: the start has panda_joint1 at 6 rad, outside its limits of ")
    assert line.endswith("; give the arm's present joints in rad, or in degrees with --units deg")


def test_a_table_in_degrees_does_not_turn_what_was_given_in_rad(capsys: Capture) -> None:
    """`pbd keyframes` prints degrees by default, but --from is in rad by default."""
    q = [0.1, -0.5, 0.1, -2.0, 0.1, 1.5, 0.5]
    command = ("keyframes", "paper-test2", *PANDA)
    rad = run_json(capsys, *command, "--from", json.dumps(q))
    deg = run_json(capsys, *command, "--from", json.dumps(np.degrees(q).tolist()), "--units", "deg")
    for one, other in zip(rad["keyframes"], deg["keyframes"], strict=True):
        assert one["joints"] == pytest.approx(other["joints"], abs=1e-6)
    line = refused(capsys, 3, *command, "--from", json.dumps(np.degrees(q).tolist()))
    assert " rad, outside its limits" in line


def start_of(capsys: Capture, given: str, *options: str) -> list[float]:
    """The first joints of the exported motion."""
    run_json(capsys, "export", "paper-test2", *PANDA, "--from", given, *options, "--format", "npz", "-o", "out.npz")
    with np.load("out.npz", allow_pickle=False) as file:
        start: list[float] = file["q"][0].tolist()
    return start


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (f"[{'9' * 400}, 0, 0, -2, 0, 1, 0]", "pbd: --from: needs 7 numbers"),
        (f"[{'9' * 5000}]", "pbd: --from: not JSON ("),
        ("[" * 100_000, "pbd: --from: not JSON ("),
    ],
)
def test_a_start_that_no_parser_can_take(capsys: Capture, given: str, message: str) -> None:
    line = refused(capsys, 2, "replay", "pouring", *PANDA, "--from", given)
    assert line.startswith(message)


def test_a_collision_that_is_allowed_is_shown_marked_and_never_exported(capsys: Capture, elsewhere: Path) -> None:
    (elsewhere / "c.toml").write_text(OBSTACLE)
    calibration = ("--calibration", "c.toml", "--allow-collision")
    result = run_json(capsys, "replay", "paper-test2", *PANDA, *calibration, "--html", "out.html")
    found = result["collision"]
    assert found["bodies"][1] == "the shelf"
    assert found["depth_m"] > 0.0
    assert 0.0 <= found["t_s"][0] <= found["t_s"][1] <= result["duration_s"]
    assert any("collision: " in warning for warning in result["warnings"])
    assert (elsewhere / "out.html").exists()
    line = refused(capsys, 3, "export", "paper-test2", *PANDA, *calibration, "--format", "csv", "-o", "out.csv")
    assert "would touch the shelf" in line
    assert line.endswith("; no such motion is exported: --allow-collision is for pbd replay, which shows it")
    assert not (elsewhere / "out.csv").exists()


def test_a_line_is_followed_where_something_bars_the_way_back_alone(capsys: Capture, elsewhere: Path) -> None:
    """The held object would touch the post only on the way home. The moves stay lines; a warning names the detour."""
    pytest.importorskip("ompl")
    (elsewhere / "c.toml").write_text(POST)
    run(capsys, "simulate", "pick-and-place-stops", "s")
    line = ("replay", "s", "--robot", "ur5", "--calibration", "c.toml", "--path", "line")
    around = run_json(capsys, *line)
    assert [(move["keyframe"], move["kind"]) for move in around["moves"]] == [
        *((k, "line") for k in (1, 2, 3, 4)),
        (None, "detour"),
    ]
    assert around["warnings"] == ["on its way back the arm goes around post: --no-detour forbids that"]
    result = run_json(capsys, *line, "--no-detour")
    assert {move["kind"] for move in result["moves"]} == {"line"}
    (told,) = [warning for warning in result["warnings"] if "no collision-free way back" in warning]
    assert " would touch post, " in told


def test_a_home_in_collision_with_the_arm_itself(capsys: Capture, elsewhere: Path) -> None:
    (elsewhere / "robots").mkdir()
    text = re.sub(
        r"(?m)^home.*$",
        "home = [0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]",
        (FOLDER / "panda.toml").read_text(encoding="utf-8"),
    )
    (elsewhere / "robots" / "mine.toml").write_text(text)
    line = refused(capsys, 3, "replay", "paper-test2", "--robot", "mine")
    said = r"pbd: home of panda: panda_\w+ would touch panda_\w+, [\d.]+ c?m+ deep; if these links touch by design, "
    assert re.match(said + r'add \["panda_\w+", "panda_\w+"\] to may_touch in its \[arm\]; else ', line), line


def test_what_stands_in_the_table_is_told(capsys: Capture, elsewhere: Path) -> None:
    """A table up to the shoulder: links that are always inside it are not checked against it."""
    (elsewhere / "c.toml").write_text(LOW_DOCK.replace("0.2\n", "0.05\n").replace("0.1]", "0.3]"))
    result = run_json(capsys, "replay", "paper-test2", "--robot", "ur5", "--calibration", "c.toml")
    (told,) = result["warnings"]
    assert told.startswith("not checked against the table, since it nearly always touches it: shoulder_link")
    assert told.endswith("; if that is wrong, correct table_height in the calibration or in the robot's [dock]")


def test_a_motion_without_a_table_says_that_none_is_checked(capsys: Capture, elsewhere: Path) -> None:
    """An arm of one's own has no dock, and `pbd calibrate dock` writes no table: the tool may go through the bench."""
    (elsewhere / "robots").mkdir()
    text = (FOLDER / "ur5.toml").read_text(encoding="utf-8")
    (elsewhere / "robots" / "mine.toml").write_text(text.partition("[dock]")[0].replace('"ur5"', '"mine"'))
    run(capsys, "calibrate", "dock", "low", "--position", "0.4", "-0.15", "-0.2", "--robot", "mine")
    command = ("export", "paper-test2", "--robot", "mine", "--calibration", "low", "-o", "x.npz", "--json")
    (told,) = json.loads(run(capsys, *command)[1])["warnings"]
    assert told.startswith("no table is checked: write table_height in the calibration or in the robot's [dock] (m")
    file = elsewhere / "calibration" / "low.toml"
    file.write_text(f"table_height = -0.5\n{file.read_text(encoding='utf-8')}")
    code, out, err = run(capsys, *command)
    assert (code, json.loads(out)["warnings"]) == (0, [])
    assert "pbd: checked against a table whose top is at -0.500 m in base (table_height)\n" in err


def test_a_robot_that_hides_a_bundled_one_is_told_once(capsys: Capture, elsewhere: Path) -> None:
    Path("robots").mkdir()
    for name in ("panda", "mine"):
        shutil.copy(bundled("robots") / "panda.toml", f"robots/{name}.toml")
    for name, count in (("panda", 1), ("mine", 0)):
        _, _, err = run(capsys, "export", "pouring", "--robot", name, "-o", "out.csv")
        assert err.count("pbd: robots/panda.toml hides the bundled robot of that name\n") == count
    files = {row["name"]: row["file"] for row in run_json(capsys, "robots")["robots"]}
    assert {name: files[name] for name in ("mine", "panda", "ur5")} == {
        "mine": "robots/mine.toml",
        "panda": "robots/panda.toml",
        "ur5": "bundled",
    }
    assert run(capsys, "robots", "panda")[1].splitlines()[0].split()[-1] == "file"


def test_the_json_says_what_the_motion_was_made_from(capsys: Capture, elsewhere: Path) -> None:
    bundled_ones = {"robot": "bundled", "calibration": "panda's own dock", "demo": "bundled"}
    made = run_json(capsys, "export", "paper-test1", *PANDA, "--speed", "0.5", "-o", "out.csv")["made_from"]
    assert made == {"pbd": pbd.__version__, **bundled_ones, "options": {"speed": 0.5}}
    shutil.copytree(bundled("demos") / "paper-test1", "demos/tea")
    shutil.copy(bundled("robots") / "panda.toml", "mine.toml")
    shutil.copy(bundled("calibration") / "default.toml", "bench.toml")
    own = {"robot": "mine.toml", "calibration": "bench.toml", "demo": "demos/tea"}
    words = [word for name in ("robot", "calibration") for word in (f"--{name}", own[name])]
    made = run_json(capsys, "replay", "tea", *words, "--html", "out.html")["made_from"]
    assert made == {"pbd": pbd.__version__, **own, "options": {}}


def test_no_retreat_and_no_approach(capsys: Capture) -> None:
    whole = run_json(capsys, "replay", "paper-test2", *PANDA)["duration_s"]
    short = run_json(capsys, "replay", "paper-test2", *PANDA, "--no-retreat")["duration_s"]
    shortest = run_json(capsys, "replay", "paper-test2", *PANDA, "--no-retreat", "--no-approach")["duration_s"]
    assert whole > short + 0.3 > shortest + 0.6


def test_keyframes_have_the_joints_of_the_motion_that_was_asked_for(capsys: Capture) -> None:
    """Where the arm needs not go back home, other joints travel least."""
    arm = ("pouring", "--robot", "xarm7")
    joints = {}
    for options in ((), ("--no-retreat",)):
        rows = run_json(capsys, "keyframes", *arm, *options)["keyframes"]
        run_json(capsys, "export", *arm, *options, "--format", "keyframes", "-o", "k.json")
        joints[options] = np.array([row["joints"] for row in rows])
        written = json.loads(Path("k.json").read_text())["keyframes"]
        assert joints[options] == pytest.approx(np.array([row["joints"] for row in written]), abs=1e-9)
    assert np.abs(joints[()] - joints["--no-retreat",]).max() > 0.1


def test_a_program_learns_that_a_stay_is_cut(capsys: Capture) -> None:
    write_demo(with_long_stays(), Path("demos/stay"))
    for command in (["replay", "--html", "stay.html"], ["export", "-o", "stay.csv"]):
        (told,) = run_json(capsys, *command, "stay", *PANDA)["warnings"]
        assert told.startswith("the hand stayed 4.0 s at keyframe 1, the arm 0.5 s; ")


def test_keyframes_of_an_arm_of_five_joints_say_the_size_and_how_far_off_the_tool_is(capsys: Capture) -> None:
    _, out, err = run(capsys, "keyframes", "paper-test1", "--robot", "so101", "--json")
    assert "pbd: played at 0.3 of its size (scale 0.3 of so101's own dock)\n" in err
    rows = json.loads(out)["keyframes"]
    assert all(len(row["off_deg"]) == 2 for row in rows)
    assert max(row["off_deg"][1] for row in rows) > 0.1
    exact = run_json(capsys, "keyframes", "paper-test1", *PANDA)["keyframes"]
    assert all(row["off_deg"] == [0.0, 0.0] for row in exact)


def test_what_is_remarked_of_a_move_that_is_a_line_and_of_unknown_torques() -> None:
    path, robot = track(load_demo("paper-test2")), load_robot("ur5")
    assert robot.dock is not None
    plan = plan_path(path, robot.dock, robot)
    place = next(i for i, move in enumerate(plan.segments) if i)
    wide = replace(plan.segments[place], kind="line", wide=ToolDeviation(0.1, 0.1, 0.31, 0.2), avoided=None)
    segments = tuple(wide if i == place else move for i, move in enumerate(plan.segments))
    found = remarks(replace(plan, segments=segments, report=replace(plan.report, torque=None)), None)
    how = "is made as a line: straight in joint space the tool would stray 31 cm from a line of 20 cm"
    assert f"the move to keyframe {place} {how}" in found
    assert "torques are not checked: ur5 has no `effort` in its [limits]" in found
