"""Every bundled arm: its home, its limits, its calibration, and how it is listed."""

import json
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.ik.starts import sample_joints
from pbd.cli import main
from pbd.planning import PlanOptions, load_robot_and_calibration
from pbd.pose import quat_to_matrix
from tests.arm.bundled import FIVE_JOINTS, FOLDER, NAMES, arm_of
from tests.not_none import not_none


def test_each_has_its_files_name_and_is_on_the_page() -> None:
    assert all(arm_of(name).robot.name == name for name in NAMES)
    page = (FOLDER.parent / "docs" / "robots.md").read_text(encoding="utf-8")
    missing = [name for name in NAMES if f"\n| `{name}` |" not in page]
    assert not missing, "add a row to the tables of docs/robots.md"


def test_the_list_says_reach_joints_gripper_and_what_is_assumed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robots", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["robots"]}
    assert set(rows) >= set(NAMES)
    for name in NAMES:
        arm, row = arm_of(name), rows[name]
        p, _ = arm.forward_many(sample_joints(arm, 20_000))
        assert row["reach_m"] == pytest.approx(float(np.hypot(p[:, 0], p[:, 1]).max()), rel=0.03)
        assert row["joints"] == list(arm.robot.joints)
        assert row["gripper_joints"] == list(not_none(arm.robot.gripper).joints)
        assert row["assumed"] == list(arm.limits.assumed)
        assert set(row["limits_sources"]) == {"position", "velocity", "acceleration", "jerk", "effort"}
    assert main(["robots"]) == 0
    listed = capsys.readouterr().out
    assert f"{rows['ur5']['reach_m']:.2f}" in listed
    assert "velocity, acceleration, jerk" in listed  # of so100
    assert listed.count("not in the model") == sum(not rows[name]["gripper_joints"] for name in NAMES) > 0


def test_one_robot_is_shown_with_what_is_not_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robots", "panda", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["robots"]
    assert row["name"] == "panda"
    assert row["collision"]["links_without_shape"] == ["panda_link8", "panda_hand_tcp"]
    pairs = {(each["first"], each["second"]): each["why"] for each in row["collision"]["left_out"]}
    assert pairs["panda_link0", "panda_link2"] == "SRDF: Never"
    assert ("panda_link5", "panda_link7") not in pairs  # "Default" is no reason
    assert pairs["panda_link0", "panda_link1"] == "next to each other"
    assert main(["robots", "panda"]) == 0
    shown = capsys.readouterr().out
    assert "links without: panda_link8, panda_hand_tcp\n" in shown
    assert all(first in shown and second in shown and why in shown for (first, second), why in pairs.items())


@pytest.mark.parametrize("name", NAMES)
def test_home_points_down_in_front_away_from_limits_and_singularities(name: str) -> None:
    arm = arm_of(name)
    home, limits = arm.robot.home, arm.limits
    pose = arm.forward(home)
    z = quat_to_matrix(pose.wxyz)[:, 2]
    assert np.degrees(np.arccos(min(1.0, -z[2]))) < 1.0
    assert arm.robot.dock is not None
    assert pose.p[2] > not_none(arm.robot.dock.table_height) + 0.2
    dock = not_none(arm.robot.dock.T_base_dock).p
    assert pose.p[:2] @ dock[:2] > 0.0  # on the dock's side
    assert np.linalg.norm(pose.p - dock) < 0.4
    from_limits = np.degrees(np.minimum(home - limits.lower, limits.upper - home))
    assert from_limits.min() > 25.0, "choose a home farther from the joints' limits"
    # m/s of the tool, or 0.3 rad/s, for one rad/s of the joints in the worst direction that the joints span
    worst = np.linalg.svd(np.diag([1, 1, 1, 0.3, 0.3, 0.3]) @ arm.jacobian(home), compute_uv=False)
    assert worst[min(len(home), 6) - 1] > 0.05


@pytest.mark.parametrize("name", NAMES)
def test_every_limit_has_its_source_and_assumptions_are_cautious(name: str) -> None:
    limits = arm_of(name).limits
    missing = {"position", "velocity", "acceleration", "jerk", "effort"} - limits.sources.keys()
    assert not missing, "a bundled arm has all of these in [limits], each with its source"
    assert all(len(source) > 5 for source in limits.sources.values())
    assert all("http" in limits.sources[key] for key in limits.sources if key not in ("position", *limits.assumed))
    if "acceleration" in limits.assumed:
        assert (limits.velocity / limits.acceleration > 0.499).all()
    if "jerk" in limits.assumed:
        assert (limits.acceleration / limits.jerk > 0.0999).all()
    model = arm_of(name).model
    assert (limits.velocity <= model.velocityLimit + 1e-9).all()


def test_makers_figures() -> None:
    """Degrees a second and N m from the data sheets."""
    sheets = {"ur5": [180] * 6, "ur10": [120, 120, 180, 180, 180, 180], "xarm7": [180] * 7, "z1": [180] * 6,
              "kinova": [36] * 3 + [48] * 3}  # fmt: skip
    for name, sheet in sheets.items():
        velocity = np.degrees(arm_of(name).limits.velocity)
        assert (velocity <= np.array(sheet) + 1e-9).all()
        np.testing.assert_allclose(velocity, sheet, rtol=1e-3)
    xarm = arm_of("xarm7").limits
    np.testing.assert_allclose(np.degrees(xarm.acceleration), 1145, rtol=1e-3)
    np.testing.assert_allclose(np.degrees(xarm.jerk), 28647, rtol=1e-3)
    assert xarm.assumed == ("effort",)
    efforts = {"panda": [87] * 4 + [12] * 3, "ur3": [56, 56, 28, 12, 12, 12], "ur5": [150] * 3 + [28] * 3,
               "ur10": [330, 330, 150, 56, 56, 56], "so100": [1.91] * 5, "so101": [1.91] * 5}  # fmt: skip
    for name, effort in efforts.items():
        np.testing.assert_array_equal(arm_of(name).limits.effort, effort)
        assert "effort" not in arm_of(name).limits.assumed
    panda = arm_of("panda").limits  # what libfranka's rate_limiting.h keeps for three lost packets
    assert ((3e-3 * panda.acceleration + 1e-3) / panda.velocity).max() < 0.024 < PlanOptions().margin
    for name in FIVE_JOINTS:  # 42 rpm at the lowest supply
        assert (arm_of(name).limits.velocity < 0.51 * 42 * 2 * np.pi / 60).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_calibration_named_by_the_user_wins_over_the_robots_own(name: str, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('format = 1\nname = "c"\n[dock]\nposition = [0.4, 0, 0.2]\nrpy_deg = [0, 0, 0]\n')
    chosen = [load_robot_and_calibration(name, c)[1] for c in (None, str(tmp_path / "c.toml"))]
    assert [calibration.name for calibration in chosen] == [name, "c"]
    no_dock = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    (tmp_path / "free.toml").write_text(no_dock[: no_dock.index("[dock]")], encoding="utf-8")
    _, calibration = load_robot_and_calibration(str(tmp_path / "free.toml"))
    assert calibration.name == "default"
