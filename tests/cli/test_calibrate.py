"""`pbd calibrate dock`, `points` and `show`."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.arm.model import load_model
from pbd.calibration.points import POOR_CHI2
from pbd.data.calibration import DOCK_SIGMA_M, DOCK_SIGMA_RAD
from pbd.errors import PlanError
from pbd.files.calibration import read_calibration
from pbd.files.demo import write_demo
from pbd.files.robot import load_robot
from pbd.pipeline import track
from pbd.planning import plan
from pbd.pose import Pose, quat_exp, quat_rotate
from pbd.simulation.simulate import simulate
from tests.calibration.touched_points import Touching, touching
from tests.cli.run_command import Capture, refused, run, run_json
from tests.not_none import not_none

pytestmark = pytest.mark.usefixtures("elsewhere")

DOCK = ("calibrate", "dock", "bench", "--position", "0.45", "-0.15", "0.25")


def test_a_calibration_without_a_table_has_the_robots_own(capsys: Capture) -> None:
    """A motion through the table is refused."""
    assert run(capsys, "calibrate", "dock", "low", "--position", "0.45", "-0.15", "-0.02")[0] == 0
    low, path = read_calibration(Path("calibration/low.toml")), track(simulate("pick-and-place-stops").recording)
    assert low.table_height is None
    with pytest.raises(PlanError, match="would touch the table"):
        plan(path, low, load_robot("panda"))


# --- dock -------------------------------------------------------------------------------------------------------------


def test_a_dock_is_written_and_replayed_from(capsys: Capture) -> None:
    code, out, err = run(capsys, *DOCK, "--rpy", "0", "0", "90", "--robot", "panda")
    assert (code, out) == (0, "")
    assert err == (
        "pbd: calibration/bench.toml: the sensor's dock is at (0.450, -0.150, 0.250) m, roll, pitch, yaw "
        "(0.0, 0.0, 90.0) degrees, as given; panda reaches it\n"
    )
    rows = run_json(capsys, "keyframes", "pouring", "--calibration", "bench")["keyframes"]
    assert rows[0]["base_position_m"] == pytest.approx([0.45, -0.15, 0.25])


def test_a_dock_for_a_small_arm_tells_that_the_arms_own_has_another_scale(capsys: Capture) -> None:
    err = run(capsys, "calibrate", "dock", "bench", "--position", "0.2", "0", "0", "--robot", "so101")[2]
    assert err.endswith("bench.toml has scale = 1, so101's own dock 0.3: edit it if keyframes are out of reach\n")


def test_a_dock_that_is_moved_stays_turned_as_it_was(capsys: Capture) -> None:
    assert run(capsys, *DOCK, "--rpy", "1", "-2", "30")[0] == 0
    moved = ("calibrate", "dock", "bench", "--position", "0.5", "0.1", "0.2")
    err = run(capsys, *moved)[2]
    assert "(1.0, -2.0, 30.0) degrees, as given, with its former rotation (--rpy changes it); " in err
    dock = not_none(read_calibration(Path("calibration/bench.toml")).T_base_dock)
    asked = Pose.from_rpy((0.5, 0.1, 0.2), np.radians((1.0, -2.0, 30.0)))
    assert dock.distance(asked) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert "(0.0, 0.0, 0.0) degrees, as given; " in run(capsys, *moved, "--rpy", "0", "0", "0")[2]
    assert "(0.0, 0.0, 0.0) degrees, as given; " in run(capsys, *moved)[2]


def test_a_dock_where_the_robot_stands(capsys: Capture) -> None:
    """The tool at the dock is where forward kinematics puts it, with the mount of the file."""
    Path("calibration").mkdir()
    Path("calibration/bench.toml").write_text(
        'format = 1\nname = "bench"\n[mount]\nposition = [0.01, 0.02, 0.1]\nrpy_deg = [180, 10, 20]\n'
    )
    joints = ["10", "-45", "5", "-135", "0", "95", "-45"]
    told = run_json(capsys, "calibrate", "dock", "bench", "--robot", "panda", "--joints", *joints)
    T_base_tool = load_model(load_robot("panda")).forward(np.radians(np.array(joints, dtype=float)))
    assert told["tool"]["position_m"] == pytest.approx(T_base_tool.p)
    calibration = read_calibration(Path("calibration/bench.toml"))
    metres, rad = (not_none(calibration.T_base_dock) @ calibration.T_sensor_tool).distance(T_base_tool)
    assert metres < 1e-4
    assert rad < 1e-4


def test_a_dock_where_a_demonstration_stopped(capsys: Capture) -> None:
    run(capsys, *DOCK)
    run(capsys, "calibrate", "dock", "shelf", "--from-keyframe", "pouring", "4", "--calibration", "bench")
    rows = run_json(capsys, "keyframes", "pouring", "--calibration", "bench")["keyframes"]
    shelf = read_calibration(Path("calibration/shelf.toml"))
    assert shelf.cov_base is not None
    assert not_none(shelf.T_base_dock).p == pytest.approx(rows[4]["base_position_m"], abs=2e-5)
    sigma = np.sqrt(np.diagonal(shelf.cov_base)[:3])  # of that keyframe, and of putting it down: the tool is the sensor
    assert sigma == pytest.approx(np.hypot(rows[4]["base_sigma_m"], 0.003), rel=1e-3)
    line = refused(
        capsys, 1, "calibrate", "dock", "shelf", "--from-keyframe", "pouring", "11", "--calibration", "bench"
    )
    assert line == "pbd: pouring has the keyframes 0 to 10, not '11'; `pbd keyframes pouring` lists them"


@pytest.mark.parametrize("itself", [(), ("--calibration", "bench")])
def test_a_dock_is_not_measured_from_itself(capsys: Capture, itself: tuple[str, ...]) -> None:
    """The same command twice would move it twice."""
    run(capsys, *DOCK)
    line = refused(capsys, 1, "calibrate", "dock", "bench", "--from-keyframe", "pouring", "4", *itself)
    assert line.startswith("pbd: 'bench' is to be written, so it can't say where the hand started in pouring; ")


def test_a_measured_dock_says_where_the_pendants_base_points(capsys: Capture) -> None:
    """The pendant's Base of a UR has -x and -y: such a dock is in reach as well, so only words can help."""
    place = ("calibrate", "dock", "bench", "--position", "-0.4", "0.15", "0.2", "--rpy", "0", "0", "180")
    assert "the teach pendant's Base is turned by half a turn about z" in run(capsys, *place, "--robot", "ur5")[2]
    at_joints = ("calibrate", "dock", "stand", "--robot", "ur5", "--joints", "-50", "-110", "110", "-90", "-90", "-140")
    assert "pendant" not in run(capsys, *at_joints)[2]  # no pose was read there
    assert "pendant" not in run(capsys, *DOCK)[2]


def test_joints_that_may_be_rad_are_doubted(capsys: Capture) -> None:
    command = ("calibrate", "dock", "bench", "--robot", "ur5", "--joints")
    rad = ("-0.9", "-1.92", "1.91", "-1.57", "-1.57", "-2.47")
    code, _, err = run(capsys, *command, *rad)
    assert code == 0
    assert "pbd: warning: no joint is beyond 2.47 degrees; --joints takes degrees, so if they are rad," in err
    degrees = [f"{np.degrees(float(q)):.1f}" for q in rad]
    assert "warning" not in run(capsys, *command, *degrees)[2]


def test_a_docks_angles_that_may_be_rad_are_doubted(capsys: Capture) -> None:
    """A yaw of a quarter turn in rad put a keyframe half a metre away 0.7 m off, in silence."""
    err = run(capsys, *DOCK, "--rpy", "0", "0", "1.5708")[2]
    assert (
        "pbd: warning: no angle is beyond 1.57 degrees; --rpy takes degrees, so if they are rad, convert them\n" in err
    )
    assert "warning" not in run(capsys, *DOCK, "--rpy", "0", "0", "90")[2]
    for yaw in ("0", "4", "-2.5"):  # an angle in rad has more decimals
        assert "warning" not in run(capsys, *DOCK, "--rpy", "0", "0", yaw)[2]


def test_a_dock_out_of_reach_is_refused_with_exit_3(capsys: Capture) -> None:
    line = refused(capsys, 3, "calibrate", "dock", "far", "--position", "1.4", "0", "0.3", "--robot", "panda")
    assert line.startswith(
        "pbd: the dock puts the tool at (1.400, 0.000, 0.300) m, out of panda's reach: it gets no nearer"
    )
    assert not Path("calibration").exists()


def test_keyframes_tells_how_sure_the_tool_is_in_base(capsys: Capture) -> None:
    run(capsys, *DOCK)
    rows = run_json(capsys, "keyframes", "pouring", "--calibration", "bench")["keyframes"]
    shown = run_json(capsys, "calibrate", "show", "bench", "pouring")["keyframes"]
    assert [row["base_sigma_m"] for row in rows] == [row["base_sigma_m"] for row in shown]
    assert rows[0]["base_sigma_m"] == pytest.approx([0.003] * 3)  # what is assumed of a dock
    assert all(np.all(np.array(row["base_sigma_m"]) >= 0.003) for row in rows)
    still = run_json(capsys, "keyframes", "pouring", "--calibration", "bench", "--orientation", "fixed")["keyframes"]
    assert [row["base_sigma_deg"][:2] for row in still] == [[0.0, 0.0]] * len(rows)  # a fixed tool is never tilted
    assert "the tool in base, one sigma" in run(capsys, "keyframes", "pouring", "--calibration", "bench")[1]
    assert "in base" not in run(capsys, "keyframes", "pouring")[1]


# --- points -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def touched() -> Touching:
    """A demonstration `touches` and its six points in points.csv."""
    found = touching(3, 6, "modern")
    write_demo(found.demo, Path("demos/touches"))
    write_points(found.points)
    return found


def write_points(points: Any, name: str = "points.csv") -> None:
    rows = (f"{letter},{x:.5f},{y:.5f},{z:.5f}\n" for letter, (x, y, z) in zip("ABCDEF", points, strict=False))
    Path(name).write_text("name,x_m,y_m,z_m\n" + "".join(rows))


POINTS = ("calibrate", "points", "bench", "touches", "--points", "points.csv")


def test_points_put_the_demonstration_into_base(capsys: Capture, touched: Touching) -> None:
    result = run_json(capsys, *POINTS)
    assert [row["stop"] for row in result["points"]] == [1, 2, 3, 4, 5, 6]
    assert all(row["used"] for row in result["points"])
    T_base_nav = not_none(read_calibration(Path("calibration/bench.toml")).T_base_nav)
    metres, rad = T_base_nav.distance(touched.T_base_nav)
    assert metres < 4.0 * np.linalg.norm(result["nav"]["sigma_m"])
    assert rad < np.radians(1.0)
    rows = run_json(capsys, "calibrate", "show", "bench", "touches")["keyframes"]
    assert rows[0]["base_sigma_m"] == pytest.approx(np.hypot(result["nav"]["sigma_m"], DOCK_SIGMA_M), rel=1e-3)
    assumed = "has no lever in [mount]: assuming that the sensor itself touched the points"
    assert assumed in run(capsys, *POINTS)[2]
    with Path("calibration/bench.toml").open("a", encoding="utf-8") as file:
        file.write("\n[mount]\nposition = [0, 0, 0.0002]\nrpy_deg = [180, 0, 0]\n")
    assert assumed not in run(capsys, *POINTS)[2]


def test_fused_takes_that_touch_points_are_all_used(capsys: Capture) -> None:
    for take in (1, 2):
        run(capsys, "simulate", "touch", f"touch{take}", "--seed", str(take))
    assert run(capsys, "fuse", "touch1", "touch2", "-o", "both")[0] == 0
    points = ("--points", "demos/touch1/points.csv")
    one, both = (run_json(capsys, "calibrate", "points", name, name, *points)["nav"] for name in ("touch1", "both"))
    assert max(both["sigma_m"]) < 0.9 * max(one["sigma_m"])
    assert np.linalg.norm(np.subtract(both["position_m"], (0.45, -0.15, 0.25))) < 0.003


def test_points_in_any_order(capsys: Capture, touched: Touching) -> None:
    write_points(touched.points[[4, 2, 0, 5, 1, 3]])
    result = run_json(capsys, *POINTS, "--any-order")
    assert [row["stop"] for row in result["points"]] == [5, 3, 1, 6, 2, 4]
    assert [row["stop"] for row in run_json(capsys, *POINTS, "--stops", "5,3,1,6,2,4")["points"]] == [5, 3, 1, 6, 2, 4]


def test_a_wrong_point_is_told_by_its_name(capsys: Capture, touched: Touching) -> None:
    points = touched.points.copy()
    points[2] += (0.0, 0.08, 0.06)
    write_points(points)
    code, out, err = run(capsys, *POINTS)
    assert code == 0
    assert err.startswith("pbd: warning: the point 'C' (stop 3) is wrong: it lies ")
    assert "; check its coordinates and the order (--any-order finds it), or touch it again" in err
    assert [line.split()[0] for line in out.splitlines() if "wrong, left out" in line] == ["C"]
    T_base_nav = not_none(read_calibration(Path("calibration/bench.toml")).T_base_nav)
    assert T_base_nav.distance(touched.T_base_nav)[0] < 0.01


def test_what_a_file_says_against_itself_is_told_at_each_use(capsys: Capture, touched: Touching) -> None:
    """It was told once, when the file was written; demonstrations were 10 cm off in silence."""
    write_points(0.95 * touched.points)
    run(capsys, *POINTS)
    poor = "warning: the [nav] of 'bench' fits its recording 6.4 times worse than the tracker's uncertainty predicts"
    for command in (("keyframes", "touches", "--calibration", "bench"), ("calibrate", "show", "bench", "touches")):
        assert run(capsys, *command)[2].count(poor) == 1
    write_points(touched.points)
    run(capsys, *POINTS)
    assert "warning" not in run(capsys, *command)[2]
    with Path("calibration/bench.toml").open("a", encoding="utf-8") as file:
        file.write("\n[mount]\nposition = [0, 0, 0.097]\nrpy_deg = [180, 0, 0]\nfit = { pivot_chi2 = 4.0 }\n")
    err = run(capsys, *command)[2]
    assert "warning: the [nav] of 'bench' was found before [mount] had its lever of 97 mm; find it again, or" in err
    doubtful = (
        "warning: the [mount] of 'bench' fits its recording 2.0 times worse than the tracker's uncertainty predicts"
    )
    assert doubtful in err
    assert doubtful in run(capsys, *POINTS, "--force")[2]
    assert run(capsys, *DOCK, "--force")[0] == 0
    assert "[dock]" not in run(capsys, *command)[2]  # measured anew, so the points no longer count


def test_a_poor_fit_is_warned_of_in_json_too(capsys: Capture, touched: Touching) -> None:
    write_points(0.95 * touched.points)
    code, _, err = run(capsys, *POINTS, "--json")
    assert code == 0
    assert (
        "worse than the tracker's uncertainty predicts, so do not use the [nav] of calibration/bench.toml yet; touch"
        in err
    )


def test_a_dock_is_not_replaced_unasked(capsys: Capture, touched: Touching) -> None:
    run(capsys, *DOCK)
    before = Path("calibration/bench.toml").read_text()
    line = refused(capsys, 1, *POINTS)
    assert "bench.toml has a [dock], and a calibration can't have [nav] too; replace it with --force" in line
    assert Path("calibration/bench.toml").read_text() == before
    assert run(capsys, *POINTS, "--as", "dock")[0] == 0
    calibration = read_calibration(Path("calibration/bench.toml"))
    assert not_none(calibration.T_base_dock).p == pytest.approx(touched.T_base_nav.p, abs=0.01)
    assert run(capsys, *POINTS, "--force")[0] == 0
    assert read_calibration(Path("calibration/bench.toml")).T_base_dock is None


def test_points_that_fit_badly_do_not_replace_a_good_fit(capsys: Capture, touched: Touching) -> None:
    run(capsys, *POINTS)
    write_points(touched.points + np.outer((0, 0, 1, 0, 1, 1), (0.0, 0.02, 0.0)))
    code, _, err = run(capsys, *POINTS)
    assert code == 1
    assert "so the [nav] of calibration/bench.toml stays as it is" in err
    assert run(capsys, *POINTS, "--force")[0] == 0
    assert run(capsys, *POINTS)[0] == 0  # the former fit is as poor


def test_the_dock_and_nav_say_the_same_of_their_demonstration(capsys: Capture, touched: Touching) -> None:
    """With either part, the keyframes of the same demonstration are at the same places in base."""
    run(capsys, *POINTS)
    run(capsys, "calibrate", "points", "other", *POINTS[3:], "--as", "dock")
    from pbd.calibration.dock import nav_in_base
    from pbd.pipeline import track
    from pbd.tracking.keyframes import find_keyframes

    first = find_keyframes(track(touched.demo.recording))[0].T_nav_sensor.wxyz
    nav, dock = (nav_in_base(read_calibration(Path(f"calibration/{name}.toml")), first) for name in ("bench", "other"))
    metres, rad = nav.distance(dock)
    assert metres < 1e-4
    assert rad < 1e-4


def test_a_magnetic_nav_is_not_for_a_demonstration_without_a_magnetometer(capsys: Capture, touched: Touching) -> None:
    """Their navs differ by the heading of the sensor at the dock: the arm would go elsewhere by any angle."""
    blind = replace(touched.demo, recording=replace(touched.demo.recording, mag=None))
    dead = replace(blind.recording, mag=np.full((len(blind.recording), 3), 20.0))
    write_demo(blind, Path("demos/blind"))
    write_demo(replace(blind, recording=dead), Path("demos/dead"))
    run(capsys, *POINTS)
    blind_points = ("calibrate", "points", "other", "blind", *POINTS[4:], "--as", "nav")
    run(capsys, *blind_points)
    wrong = "registered with a magnetometer, and this demonstration has none", "registered without a magnetometer"
    for name, calibration, message in (
        ("blind", "bench", wrong[0]),
        ("dead", "bench", wrong[0]),
        ("touches", "other", wrong[1]),
    ):
        by = ("--calibration", calibration)
        assert message in refused(capsys, 1, "keyframes", name, *by)
        assert message in refused(capsys, 1, "calibrate", "show", calibration, name)
        assert message in refused(capsys, 1, "calibrate", "dock", "next", "--from-keyframe", name, "2", *by)
        assert message in refused(capsys, 1, "export", name, "--robot", "panda", "-o", "no.json", *by)
        assert message in refused(capsys, 1, "touch", name, "2", "--robot", "panda", "--by", "0", "0", "0.001", *by)
        with (Path("demos") / name / "demo.toml").open("a") as file:
            file.write("[[contact]]\nt_s = 1.0\n")
        assert message in refused(capsys, 1, "segments", name, *by)  # a place in base would be used
    run(capsys, "calibrate", "dock", "plain", *DOCK[3:])
    for name, calibration in (("touches", "bench"), ("blind", "other"), ("blind", "plain"), ("touches", "plain")):
        assert run(capsys, "keyframes", name, "--calibration", calibration)[0] == 0
    assert run(capsys, *blind_points, "--force")[0] == 0  # can be registered anew


def test_a_magnetic_nav_is_not_for_another_field(capsys: Capture, touched: Touching) -> None:
    """A field at the first rest that is not the registered one may turn all keyframes in base, by an unknown angle."""
    run(capsys, *POINTS)
    sigma = {}
    for name, uT in (("same", 0.0), ("weak", 0.5), ("magnet", 5.0)):
        mag = not_none(touched.demo.recording.mag)
        other = replace(touched.demo.recording, mag=mag + uT * np.array([0.6, 0.0, 0.8]))
        write_demo(replace(touched.demo, recording=other), Path("demos") / name)
        by = ("--calibration", "bench")
        if name != "magnet":
            sigma[name] = run_json(capsys, "keyframes", name, *by)["keyframes"][0]["base_sigma_deg"][2]
            continue
        for command in (("keyframes", name), ("export", name, "--robot", "panda", "-o", "no.json")):
            line = refused(capsys, 1, *command, *by)
            assert "the magnetic field differs by" in line
            assert "from that in which the [nav] of 'bench' was registered, so the whole motion may be turned" in line
    assert np.hypot(sigma["same"], 0.5) < sigma["weak"] < np.hypot(sigma["same"], 2.0)  # 0.5 uT of 19.5 are 1.5 degrees
    bench = Path("calibration/bench.toml")
    edited, count = re.subn(r", field_up = [-0-9.]+", "", bench.read_text())
    bench.write_text(edited)
    assert count == 1
    assert run(capsys, "keyframes", "magnet", "--calibration", "bench")[0] == 0  # without both figures none is compared


def test_how_precisely_the_sensor_is_put_down_again_is_in_the_sigma(capsys: Capture, touched: Touching) -> None:
    """Also after points: a dock in the file says where a later demonstration starts, as one that was measured does."""
    for part, turned in (("nav", 0.0), ("dock", 1.0)):
        cov = []
        for k, sigmas in enumerate((("--sigma-mm", "0.01", "--sigma-deg", "0.001"), ())):
            name = f"{part}{k}"
            run(capsys, "calibrate", "points", name, *POINTS[3:], "--as", part, *sigmas)
            cov.append(read_calibration(Path(f"calibration/{name}.toml")).cov_start)
        added = np.square([*[DOCK_SIGMA_M] * 3, 0.0, 0.0, turned * DOCK_SIGMA_RAD])
        assert cov[1] - cov[0] == pytest.approx(np.diag(added), rel=1e-4, abs=1e-9)


def test_points_are_fitted_with_the_scale_that_a_replay_uses(capsys: Capture, touched: Touching) -> None:
    """The touched points are where the tool is in base, though the calibration had a scale before."""
    run(capsys, *DOCK)
    file = Path("calibration/bench.toml")
    file.write_text(file.read_text().replace('name = "bench"', 'name = "bench"\nscale = 1.1'))
    line = refused(capsys, 1, *POINTS, "--force")
    assert "check their coordinates and their order, and the calibration's scale of 1.1 (--find-scale finds it)" in line
    write_points(1.1 * touched.points)
    result = run_json(capsys, *POINTS, "--force")
    assert result["fit"]["chi2"] < POOR_CHI2
    rows = run_json(capsys, "keyframes", "touches", "--calibration", "bench")["keyframes"]
    assert np.abs([row["base_position_m"] for row in rows[1:]] - 1.1 * touched.points).max() < 0.01
    for options in ["--find-scale"], []:  # then it is kept, as the scale is
        found = run_json(capsys, *POINTS, "--force", *options)["fit"]["scale_sigma"]
        assert 0.0 < found < 0.05
        assert read_calibration(file).scale_sigma == found
    run(capsys, *DOCK, "--force")
    assert read_calibration(file).scale_sigma == found


def test_a_tilted_base_has_no_dock(capsys: Capture, touched: Touching) -> None:
    """A dock keeps position and yaw, so the tool would be off by the tilt times its distance from the dock."""
    tilted = quat_rotate(quat_exp(np.radians((4.0, 0.0, 0.0))), touched.points)
    write_points(tilted)
    args = (*POINTS, "--free")
    assert "the base is tilted by 3.9 degrees" in refused(capsys, 1, *args, "--as", "dock")
    assert not Path("calibration").exists()
    run(capsys, *args)
    rows = run_json(capsys, "keyframes", "touches", "--calibration", "bench")["keyframes"]
    assert np.abs([row["base_position_m"] for row in rows[1:]] - tilted).max() < 0.01
    line = refused(capsys, 1, "calibrate", "dock", "shelf", "--from-keyframe", "touches", "4", "--calibration", "bench")
    assert "and a dock has no tilt; pbd calibrate points --free --as nav keeps it" in line


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--stops", "1,2,3,4,5"), "--stops names 5 stops for 6 points; name one stop per point"),
        (("--stops", "1,2,3,4,5,5"), "--stops must name different stops from 0 to 6"),
        (("--stops", "1,2,3,4,5,7"), "--stops must name different stops from 0 to 6"),
        (("--points", "few.csv"), "2 points are too few; touch 3 or more"),
    ],
)
def test_what_is_wrong_with_points(capsys: Capture, touched: Touching, args: tuple[str, ...], message: str) -> None:
    Path("few.csv").write_text("x_m,y_m,z_m\n0,0,0\n1,0,0\n")
    assert refused(capsys, 1, *POINTS, *args).startswith(f"pbd: {message}")
    assert not Path("calibration").exists()


# --- show -------------------------------------------------------------------------------------------------------------


def test_show_adds_the_parts_up(capsys: Capture) -> None:
    run(capsys, *DOCK, "--sigma-mm", "4", "--sigma-deg", "2")
    result = run_json(capsys, "calibrate", "show", "bench", "pouring", "--save", "bench.png")
    assert result["dock"]["position_m"] == pytest.approx([0.45, -0.15, 0.25])
    for row in result["keyframes"]:
        parts = row["base_sigma_parts_m"]
        assert parts["mount"] is None  # it was never calibrated
        total = np.sqrt(np.square(parts["start"]) + np.square(parts["tracking"]))
        assert row["base_sigma_m"] == pytest.approx(total)
    assert result["keyframes"][0]["base_sigma_m"] == pytest.approx([0.004] * 3)
    assert Path("bench.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = run(capsys, "calibrate", "show", "bench", "pouring")
    assert code == 0
    assert "the sensor in base" in out
    assert "of the tool's uncertainty" in err


def test_show_without_a_start(capsys: Capture) -> None:
    Path("mount.toml").write_text('format = 1\nname = "m"\n[mount]\nposition = [0, 0, 0.1]\nrpy_deg = [0, 0, 0]\n')
    assert run_json(capsys, "calibrate", "show", "mount.toml")["keyframes"] == []
    line = refused(capsys, 1, "calibrate", "show", "mount.toml", "--save", "x.png")
    assert line.endswith("does not say where the hand starts, so there is nothing to plot; add a dock")
    code, _, err = run(capsys, "calibrate", "show", "mount.toml", "pouring")
    assert (code, err.count("\n")) == (0, 1)
    assert "does not say where the hand starts, so the tool's uncertainty is unknown; add a dock" in err
    line = refused(capsys, 1, "replay", "pouring", "--robot", "panda", "--calibration", "mount.toml", "--no-open")
    assert "does not say where the hand starts in the robot's base; add a dock" in line


def test_show_without_a_demonstration_of_this_sensor(capsys: Capture) -> None:
    """The default demonstration, which was not named, can't be used: everything else is shown all the same."""
    run(capsys, *DOCK)
    with Path("calibration/bench.toml").open("a", encoding="utf-8") as file:
        file.write('\n[sensor]\nname = "witmotion"\ngravity = 9.81\n')
    code, out, err = run(capsys, "calibrate", "show", "bench")
    assert code == 0
    assert "witmotion" in out
    assert "is left out: 'pouring' is of the sensor" in err
    assert "pbd calibrate show bench DEMO" in err
    line = refused(capsys, 1, "calibrate", "show", "bench", "pouring")
    assert line.startswith("pbd: 'pouring' is of the sensor")
    code, _, err = run(capsys, "calibrate", "show", "bench", "--save", "x.png")
    assert code == 1
    assert "a plot shows the tool at a demonstration's keyframes; name one after 'bench'" in err


def test_a_programs_view_of_a_calibration_has_the_sigmas_of_the_table(capsys: Capture) -> None:
    run(capsys, *DOCK, "--sigma-mm", "1.5", "--robot", "panda")
    shown = run_json(capsys, "calibrate", "show", "bench", "pouring")
    assert shown["dock"]["sigma_m"] == pytest.approx([0.0015] * 3)
    assert shown["dock"]["sigma_deg"] == [None, None, pytest.approx(1.0)]
    assert shown["mount"]["sigma_m"] == [None] * 3  # nobody stated it
    assert (shown["robots"], shown["table_height_m"]) == (["panda"], None)


def test_show_has_a_row_for_each_part(capsys: Capture) -> None:
    Path("all.toml").write_text(
        'format = 1\nname = "all"\nscale = 1.25\nrobots = ["panda", "ur5"]\ntable_height = 0.01\n'
        "[nav]\nposition = [0.4, 0, 0.3]\nrpy_deg = [0, 0, 90]\n"
        '[[obstacle]]\nname = "lamp"\nshape = "box"\nsize = [0.1, 0.2, 0.3]\nposition = [1, 1, 0]\n'
        '[sensor]\nname = "witmotion"\ngravity = 9.81\n'
        "[sensor.gyr]\nbias = [0.01, 0, 0]\nmatrix = [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    )
    _, out, _ = run(capsys, "calibrate", "show", "all.toml")
    rows = [" ".join(line.split()) for line in out.splitlines()]
    for row in (
        "nav nav in base (0.4000, 0.0000, 0.3000) m not stated",
        "scale of the hand's path 1.2500",
        "robots only for panda, ur5",
        "obstacle lamp box 0.1, 0.2, 0.3 m",
        "gyro bias (0.573, 0.000, 0.000) °/s",
    ):
        assert row in rows
    assert "gyro scale" not in out  # only the bias was measured
