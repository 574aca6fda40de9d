"""`pbd robots --suggest` finds a home and a dock; `--for` says which arms can do a demonstration."""

import re
import shutil
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.ik.solver import solve
from pbd.audit.arm import AuditArm
from pbd.cli.robots import _ranked_table
from pbd.data import Calibration
from pbd.errors import PlanError
from pbd.files.find_by_name import names
from pbd.files.robot import read_robot
from pbd.planning import PlanOptions, arm_of
from pbd.planning.choose_joints import PlanRefusal
from pbd.planning.suggest_dock import (
    DOCKS,
    MORE_DOCKS,
    TABLE_STEP_M,
    _highest_table,
    _plan_at_dock,
    _possible_docks,
    _sampled_tool_poses,
    _search_order,
    _solve_all,
    _tool_poses_at,
)
from pbd.planning.task import PlanningTask
from pbd.pose import Pose, quat_exp, quat_multiply, quat_rotate
from pbd.view.units import Units
from tests.arm.bundled import keyframes_of
from tests.arm.own_robot import own_toml, own_urdf
from tests.cli.run_command import Capture, refused, run, run_json
from tests.docs_pages import ROOT

TOML = Path("robots") / "mine.toml"
TIAGO = """
format = 1
name = "tiago"
description = "An arm that hangs on a lift, which is locked"
[model]
urdf = "tiago_description/robots/tiago_no_hand.urdf"
base = "torso_lift_link"
body = "arm_tool_link"
T_body_tool = { xyz = [0.15, 0.0, 0.0], rpy_deg = [180.0, -90.0, 0.0] }
[gripper]
joints = []
open = []
closed = []
stroke_s = 0.8
[limits]
acceleration = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
jerk = [30.0, 30.0, 30.0, 30.0, 30.0, 30.0, 30.0]
source = "assumed"
"""


@pytest.fixture
def guide(elsewhere: Path) -> str:
    """The TOML of docs/robots.md, with its URDF in ./robots."""
    (elsewhere / "robots").mkdir()
    (elsewhere / "robots" / "mine.urdf").write_text(own_urdf(), encoding="utf-8")
    return own_toml()


def test_what_is_suggested_replays_as_it_says(capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names of joints that would break out of a comment or a string of TOML stay in it."""
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 5)
    named = own_urdf().replace('name="joint', 'name="&#10;[evil]&#10;\N{ROBOT FACE}')
    TOML.with_suffix(".urdf").write_text(named, encoding="utf-8")
    bare = guide.split("[arm]")[0] + "[gripper]" + guide.split("[gripper]")[1].split("[dock]")[0]
    TOML.write_text(bare, encoding="utf-8")
    code, lines, _ = run(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")
    assert code == 0
    assert run(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")[1] == lines
    warned = run_json(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")["warnings"]
    TOML.write_text(bare + lines, encoding="utf-8")
    replayed = run_json(capsys, "replay", "paper-test2", "--robot", "mine")
    assert f"the fastest: {replayed['duration_s']:.1f} s" in lines
    assert warned
    assert set(warned) == set(replayed["warnings"])


@pytest.mark.parametrize(("manipulability", "near"), [(0.04, True), (1.2, False)])
def test_a_home_near_a_singularity_is_said_to_be(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch, manipulability: float, near: bool
) -> None:
    TOML.write_text(guide, encoding="utf-8")
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 3)
    monkeypatch.setattr("pbd.arm.ik.starts.relative_manipulability", lambda arm, q: np.array([manipulability]))
    code, lines, _ = run(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")
    assert code == 0
    assert f"manipulability is {manipulability:.1f} times the lower quartile of all configurations" in lines
    assert ("home is near a singularity" in lines) == near


def test_tables_are_tried_at_zero_first_where_the_arm_reaches_it_and_then_anywhere() -> None:
    at_zero, anywhere = (0.0, 0.0), (-np.inf, 0.3)
    reaches, hangs = (list(_search_order(anywhere, np.linspace(low, low + 0.6, 9), 0.0)) for low in (-0.1, -0.9))
    assert [within for within, _, _ in reaches[:4]] == [at_zero, at_zero, at_zero, anywhere]
    assert hangs == reaches[3:]
    assert [scale for _, scale, count in hangs if count == DOCKS] == [1.0, 0.7, 0.5, 0.35, 0.25]
    assert {(within, scale) for within, scale, count in hangs if count == MORE_DOCKS} == {
        (within, scale) for within in (at_zero, anywhere) for scale in (0.5, 0.35, 0.25)
    }


def test_a_dock_out_of_reach_is_said_to_be() -> None:
    panda = arm_of(read_robot(ROOT / "robots" / "panda.toml")).robot
    far = Calibration("far", Pose.from_rpy((3.0, 0.0, 0.5), (0.0, 0.0, 0.0)), robots=("panda",))
    said = _plan_at_dock(PlanningTask(keyframes_of("paper-test2"), far, panda, None, None, PlanOptions()))
    assert said == "the place over the dock is out of reach; correct base or T_body_tool"


def test_an_arm_of_five_joints_is_given_no_pose_that_it_cannot_approach() -> None:
    arm = arm_of(read_robot(ROOT / "robots" / "so101.toml"))
    pose = arm.forward(np.array([0.3, 0.2, 0.4, 0.1, 0.0]))
    aside = Pose(pose.p, quat_multiply(quat_exp((0.0, 0.0, 0.3)), pose.wxyz))
    assert _solve_all(arm, [pose]) is not None
    assert solve(arm, aside, None).reached
    assert _solve_all(arm, [aside]) is None


def test_at_each_dock_an_arm_of_five_joints_can_tilt_its_tool_the_way_the_demonstration_does() -> None:
    """Its tool tilts in the plane of the arm alone, so each sampled pose gives the dock's yaw, to a degree."""
    arm, keyframes = arm_of(read_robot(ROOT / "robots" / "so101.toml")), keyframes_of("pouring")
    p, R = _sampled_tool_poses(arm)
    for dock in islice(_possible_docks(arm, (p, R), keyframes, (-np.inf, np.inf), 0.3), 20):
        place, way = max(
            ((pose.p, quat_rotate(pose.wxyz, (0.0, 0.0, 1.0))) for pose in _tool_poses_at(dock, keyframes)),
            key=lambda tool: float(tool[1][2]),
        )
        near = np.linalg.norm(p - place, axis=1) < 0.02
        off = np.arctan2(R[near, 1, 2], R[near, 0, 2]) - np.arctan2(way[1], way[0])
        assert np.abs((off + np.pi) % (2.0 * np.pi) - np.pi).min() < np.radians(0.51)


def test_the_users_own_table_is_kept(capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 3)
    TOML.write_text(guide.replace("table_height = 0.0", "table_height = 0.1").replace("0.97", "97.0"), encoding="utf-8")
    dock = run_json(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")["dock"]
    assert dock["table_height"] == 0.1
    assert dock["position"][2] == pytest.approx(0.25)


def test_where_few_docks_will_do_more_are_weighed(capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch) -> None:
    TOML.write_text(guide, encoding="utf-8")
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 0)
    monkeypatch.setattr("pbd.planning.suggest_dock.MORE_DOCKS", 4)
    code, lines, told = run(capsys, "robots", "--suggest", TOML)
    assert code == 0
    assert " of 0 docks" not in told
    assert "scale = 0.5" in lines


def test_links_that_touch_by_design_are_found_and_may(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The spheres of the flange and of link4 overlap in seven of ten configurations."""
    urdf = own_urdf()
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 3)
    for link, x, radius in (("link4", 0.05, 0.0536), ("link5", 0.0, 0.01), ("flange", 0.0, 0.06)):
        solid = f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision>'
        urdf = urdf.replace(f"<link name='{link}'/>", f"<link name='{link}'>{solid}</link>")
    TOML.with_name("mine.urdf").write_text(urdf, encoding="utf-8")
    bare = guide.split("[arm]")[0] + "[gripper]" + guide.split("[gripper]")[1].split("[dock]")[0]
    TOML.write_text(bare, encoding="utf-8")
    code, lines, _ = run(capsys, "robots", "--suggest", TOML)
    assert code == 0
    assert 'may_touch = [["link4", "flange"]]' in lines
    TOML.write_text(bare + lines, encoding="utf-8")
    assert run_json(capsys, "replay", "paper-test2", "--robot", "mine")["collision"] is None


def test_no_table_is_put_through_a_link_that_moves(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ball below link1 touches any table above its lowest point, whatever the configuration."""
    ball = '<collision><origin xyz="0 0 -0.25"/><geometry><sphere radius="0.105"/></geometry></collision>'
    urdf = own_urdf().replace("<link name='link1'/>", f"<link name='link1'>{ball}</link>")
    TOML.with_name("mine.urdf").write_text(urdf, encoding="utf-8")
    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 3)
    TOML.write_text(guide.partition("[dock]")[0], encoding="utf-8")
    arm = arm_of(read_robot(TOML, draft=True))
    low = arm.full.jointPlacements[1].translation[2] - 0.355
    highest = _highest_table(arm, np.array([-1.0, 1.0]))
    assert low - TABLE_STEP_M < highest < low
    found = run_json(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")
    assert found["dock"]["table_height"] <= highest + 1e-9
    assert not any("nearly always touches" in words for words in found["warnings"])
    TOML.write_text(guide, encoding="utf-8")  # the user's own table, at 0
    found = run_json(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")
    assert any("nearly always touches it: link1; if" in words for words in found["warnings"])


def test_each_dock_is_planned_once_without_detours_and_no_other_options_are(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Advice on a trial that nobody sees, and ways around that no good dock needs, took most of a search's time."""
    docks = []

    def refuse(task: PlanningTask) -> PlanRefusal:
        assert task.calibration.T_base_dock is not None
        assert not task.options.detour
        docks.append((task.calibration.scale, *task.calibration.T_base_dock.p, *task.robot.home))
        return PlanRefusal(PlanError("it is in the way"), (("use another option", task.options),))

    monkeypatch.setattr("pbd.planning.suggest_dock.DOCKS", 3)
    monkeypatch.setattr("pbd.planning.suggest_dock.MORE_DOCKS", 3)
    monkeypatch.setattr("pbd.planning.suggest_dock.plan_task", refuse)
    TOML.write_text(guide, encoding="utf-8")
    code, _, told = run(capsys, "robots", "--suggest", TOML, "--for", "paper-test2")
    assert code == 1
    assert told.endswith("no home and dock found: it is in the way\n")
    assert len(docks) > 3
    assert len(set(docks)) == len(docks)


def test_a_mesh_that_cannot_be_read_is_refused_before_the_search(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("pbd.planning.suggest_dock._sampled_tool_poses")
    solid = "<collision><geometry><mesh filename='a.stl'/></geometry></collision>"
    urdf = own_urdf().replace("<link name='flange'/>", f"<link name='flange'>{solid}</link>")
    TOML.with_name("mine.urdf").write_text(urdf, encoding="utf-8")
    TOML.with_name("a.stl").write_text("solid\n", encoding="utf-8")
    TOML.write_text(guide, encoding="utf-8")
    code, _, told = run(capsys, "robots", "--suggest", TOML)
    assert code == 1
    assert "a.stl" in told
    assert "docks" not in told


def test_a_tool_that_never_points_down_is_named(capsys: Capture, guide: str) -> None:
    fixed = guide.replace("[arm]", '[arm]\njoints = ["joint1"]').replace("home = [0.0, -0.3, 0.9, 0.0, 0.97, 0.0]", "")
    TOML.write_text(re.sub(r"\[(\d+\.0, ){5}\d+\.0\]", "[1.0]", fixed), encoding="utf-8")
    assert "points down in only 0 of 20000 random configurations" in refused(capsys, 1, "robots", "--suggest", TOML)


def test_an_arm_that_cannot_tilt_its_tool_is_offered_another_demonstration(capsys: Capture, guide: str) -> None:
    fixed = guide.replace("[arm]", '[arm]\njoints = ["joint1"]').replace("home = [0.0, -0.3, 0.9, 0.0, 0.97, 0.0]", "")
    fixed = fixed.replace("rpy_deg = [180.0, -90.0, 0.0]", "rpy_deg = [180.0, 0.0, 0.0]")
    TOML.write_text(re.sub(r"\[(\d+\.0, ){5}\d+\.0\]", "[1.0]", fixed), encoding="utf-8")
    code, _, told = run(capsys, "robots", "--suggest", TOML)
    assert code == 1
    assert "or take a demonstration that tilts the tool less (--for)" in told


def test_an_arm_without_a_dock_is_told_where_the_hand_starts(capsys: Capture, guide: str) -> None:
    TOML.write_text(guide.partition("[dock]")[0], encoding="utf-8")
    _, _, told = run(capsys, "replay", "paper-test2", "--robot", "mine", "--html", "page.html")
    assert "pbd: the hand starts at the default dock, (0.400, -0.150, 0.250) m in base; for yours give" in told
    _, _, told = run(capsys, "replay", "paper-test2", "--robot", "mine", "--html", "p.html", "--calibration", "default")
    assert "the hand starts at" not in told


def test_all_remarks_on_an_arm_are_shown() -> None:
    row: dict[str, object] = dict.fromkeys(("duration_s", "farthest_m", "reach_m", "torque", "scale", "why"))
    table = _ranked_table(
        [{**row, "name": "mine", "warnings": ["it ends there; see", "61 degrees off; move"]}], Units()
    )
    assert list(table.columns[-1].cells) == ["it ends there; 61 degrees off"]


def test_an_arm_that_holds_the_poses_comes_first(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = {
        "slow": (9.0, True, None),
        "tilted": (5.0, False, None),
        "quick": (7.0, True, None),
        "no": (None, None, ""),
    }

    def row(name: str, *_: object) -> dict[str, object]:
        figures = dict.fromkeys(("farthest_m", "reach_m", "torque", "scale"))
        return (
            figures
            | {"name": name, "warnings": []}
            | dict(zip(("duration_s", "holds_poses", "why"), rows[name], strict=True))
        )

    monkeypatch.setattr("pbd.cli.robots.names", lambda *_: [*rows])
    monkeypatch.setattr("pbd.cli.robots._ranked_row", row)
    ranked = run_json(capsys, "robots", "--for", "paper-test2")["robots"]
    assert [row["name"] for row in ranked] == ["quick", "slow", "tilted", "no"]


def test_the_fastest_arm_comes_first_and_the_others_say_why(
    capsys: Capture, guide: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {"mine", "panda", "ur5"}
    monkeypatch.setattr("pbd.cli.robots.names", lambda *args: [name for name in names(*args) if name in few])
    TOML.write_text(guide.replace("0.38, -0.12, 0.3", "3.8, -0.12, 0.3"), encoding="utf-8")
    mine = run_json(capsys, "robots", "mine", "--for", "paper-test2")["robots"]
    assert [row["duration_s"] for row in mine] == [None]
    assert "keyframe 0 is out of reach" in mine[0]["why"]
    assert "keyframe 0 is out of reach" in run(capsys, "robots", "mine", "--for", "paper-test2")[1]
    rows = run_json(capsys, "robots", "--for", "paper-test2")["robots"]
    able = [row["duration_s"] for row in rows if row["why"] is None]
    assert {row["name"] for row in rows} == few
    assert able == sorted(able)
    assert all(row["holds_poses"] for row in rows if row["why"] is None)
    Path("low.toml").write_text((ROOT / "calibration" / "default.toml").read_text().replace("0.25", "0.15"))
    low = run_json(capsys, "robots", "panda", "--for", "paper-test2", "--calibration", "low.toml")["robots"][0]
    assert low["duration_s"] != next(row["duration_s"] for row in rows if row["name"] == "panda")
    told = refused(capsys, 2, "robots", "panda", "--calibration", "low.toml")
    assert told.endswith("--calibration is for ranking the robots by --for: leave it out")
    assert [row["name"] for row in rows[len(able) :]] == ["mine"]
    panda = next(row for row in rows if row["name"] == "panda")
    replayed = run_json(capsys, "replay", "paper-test2", "--robot", "panda")
    assert panda["duration_s"] == replayed["duration_s"]
    assert panda["farthest_m"] < panda["reach_m"]


def test_a_place_in_base_counts_with_the_calibration_that_is_named(capsys: Capture, elsewhere: Path) -> None:
    shutil.copytree(ROOT / "demos" / "paper-test2", "demos/tea")
    with Path("demos/tea/demo.toml").open("a") as file:
        file.write("[[place]]\nt_s = [0.5]\nposition_m = [0.4, -0.15, 0.25]\n")  # the default dock
    assert run(capsys, "robots", "panda", "--for", "tea", "--calibration", "default")[2] == ""


def test_the_list_is_short_and_one_robot_has_its_notes(capsys: Capture) -> None:
    notes = run_json(capsys, "robots", "panda")["robots"][0]["notes"]
    assert notes
    _, listed, told = run(capsys, "robots")
    assert len(listed.splitlines()) == 2 + len(names("robots"))
    assert "`pbd robots NAME`" in told
    assert run(capsys, "robots", "panda")[1].endswith("\n\n".join(notes) + "\n")
    assert "--suggest takes the file itself" in refused(capsys, 2, "robots", "panda", "--suggest", "x.toml")


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_an_arm_of_the_e_series_is_told_apart(capsys: Capture, name: str) -> None:
    assert refused(capsys, 1, "robots", f"{name}e").endswith(
        f"did you mean {name}? `pbd robots` says which arms they are"
    )
    code, out, _ = run(capsys, "robots", name)
    assert code == 0
    assert f"(CB3, not {name.upper()}e)" in out
    assert f"\nA {name.upper()}e has other link lengths: with this file its tool would be off by" in out


def test_a_base_may_be_carried_by_a_locked_joint(tmp_path: Path) -> None:
    """The audit agrees on the pose of the base."""
    (tmp_path / "tiago.toml").write_text(TIAGO, encoding="utf-8")
    robot = read_robot(tmp_path / "tiago.toml", draft=True)
    q = robot.home + 0.1
    seen = AuditArm(replace(robot, home=q)).tool_pose(np.append(q, 1.0))
    np.testing.assert_allclose(seen.p, arm_of(robot).forward(q).p, atol=1e-12)
