from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data import TOOL_DOWN
from pbd.errors import CalibrationError
from pbd.files.calibration import load_calibration, read_calibration
from pbd.files.find_by_name import bundled
from pbd.pose import quat_from_rpy

TOML = """\
format = 1
name = "mine"
robots = ["panda", "ur5"]
table_height = -0.1
scale = 2.0
[dock]
position = [0.4, -0.15, 0.25]
rpy_deg = [0.0, 0.0, 90.0]
any_attitude = true
[mount]
position = [0.01, 0.0, 0.02]
rpy_deg = [180.0, 0.0, 45.0]
[[obstacle]]
name = "shelf"
shape = "box"
size = [0.3, 0.2, 0.02]
position = [0.6, 0.4, 0.3]
rpy_deg = [0.0, 90.0, 0.0]
[[obstacle]]
name = "lamp"
shape = "sphere"
size = [0.1]
position = [0.0, 0.5, 0.6]
"""
DOCK = TOML[TOML.index("[dock]") : TOML.index("[mount]")]
PARTS = TOML[TOML.index("[dock]") : TOML.index("[[obstacle]]")]
MOUNT = TOML[TOML.index("[mount]") : TOML.index("[[obstacle]]")]
MIRRORED = """\
[sensor]
name = "wt901"
[sensor.gyr]
bias = [0.0, 0.0, 0.0]
matrix = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]
"""
NAV = DOCK.replace("[dock]", "[nav]").replace("any_attitude = true\n", "")


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_is_read(tmp_path: Path) -> None:
    calibration = read_calibration(write(tmp_path, TOML))
    assert calibration.name == "mine"
    assert calibration.robots == ("panda", "ur5")
    assert (calibration.table_height, calibration.scale, calibration.any_attitude) == (-0.1, 2.0, True)
    assert calibration.T_base_nav is None
    assert calibration.T_base_dock is not None
    assert_allclose(calibration.T_base_dock.p, (0.4, -0.15, 0.25))
    assert_allclose(calibration.T_base_dock.wxyz, quat_from_rpy((0, 0, np.pi / 2)))
    assert_allclose(calibration.T_sensor_tool.p, (0.01, 0.0, 0.02))
    assert_allclose(calibration.T_sensor_tool.wxyz, quat_from_rpy((np.pi, 0, np.pi / 4)))
    shelf, lamp = calibration.obstacles
    assert (shelf.name, shelf.shape, shelf.size) == ("shelf", "box", (0.3, 0.2, 0.02))
    assert_allclose(shelf.T_base_obstacle.p, (0.6, 0.4, 0.3))
    assert_allclose(shelf.T_base_obstacle.wxyz, quat_from_rpy((0, np.pi / 2, 0)))
    assert (lamp.name, lamp.shape, lamp.size) == ("lamp", "sphere", (0.1,))
    assert_allclose(lamp.T_base_obstacle.wxyz, (1, 0, 0, 0))  # without rpy_deg it is level


def test_optional_keys(tmp_path: Path) -> None:
    calibration = read_calibration(write(tmp_path, f'format = 1\nname = "mine"\n{NAV}'))
    assert calibration.T_base_dock is None
    assert calibration.T_base_nav is not None
    assert_allclose(calibration.T_base_nav.p, (0.4, -0.15, 0.25))
    assert (calibration.scale, calibration.table_height, calibration.robots) == (1.0, None, ())
    assert not calibration.any_attitude
    assert calibration.T_sensor_tool is TOOL_DOWN
    assert calibration.obstacles == ()


def test_the_bundled_default_is_for_all_robots_with_the_default_mount(elsewhere: Path) -> None:
    calibration = load_calibration("default")
    assert calibration.name == "default"
    assert calibration.T_base_dock is not None
    assert calibration.robots == ()
    metres, rad = calibration.T_sensor_tool.distance(TOOL_DOWN)  # its [mount] says that it is the default
    assert metres == 0.0
    assert rad < 1e-15


def test_keys_that_the_default_comments_out_are_valid(tmp_path: Path) -> None:
    """A user removes the number sign, so the keys must be valid."""
    text = (bundled("calibration") / "default.toml").read_text(encoding="utf-8")
    for key in ("robots", "any_attitude", "sigma_m", "sigma_deg"):
        text = text.replace(f"# {key} =", f"{key} =")
    before, obstacle = text.split("# [[obstacle]]\n")
    text = before + "[[obstacle]]\n" + obstacle.replace("\n# ", "\n").removeprefix("# ")
    calibration = read_calibration(write(tmp_path, text))
    assert calibration.robots == ("panda",)
    assert calibration.any_attitude
    assert [(thing.name, thing.shape) for thing in calibration.obstacles] == [("the shelf", "box")]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scale = 2.0", "scale = 0", ":5: scale must be above zero, got 0; correct it"),
        ("any_attitude", "any_atitude", ":9: [dock] any_atitude is unknown; the keys here are "),
        ("0.25]", "0.25, 0]", ":7: [dock] position must have 3 numbers, got 4; correct it"),
        (PARTS, "", ": dock or [nav] must be given, or at least [mount] or [sensor]; see calibration/default.toml"),
        (
            PARTS,
            PARTS.replace("[dock]", "[dok]").replace(MOUNT, ""),
            ":6: dok is unknown; the keys here are format, dock, nav",
        ),
        (
            "0.5, 0.6]",
            "50, 60]",
            ":23: [obstacle] position has 60 m, beyond any arm's reach; give metres, not cm or mm",
        ),
        ("[0.1]", "[25]", ":22: [obstacle] size has 25 m, beyond any arm's reach; give metres, not cm or mm"),
        ("0.25]", "25]", ":7: [dock] position has 25 m, beyond any arm's reach; give metres, not cm or mm"),
        (
            MOUNT,
            f"{MOUNT}covariance = {[1e-6] * 6 + [2e-6] * 30}\n",
            ":13: [mount] covariance is not a covariance (symmetric, positive); remove it, or calibrate again",
        ),
        (MOUNT, MOUNT + "sigma_m = [0, -1, 0]\n", ":13: [mount] sigma_m must not be below zero, got [0.0, -1.0, 0.0]"),
        (MOUNT, MOUNT + "sigma_deg = [0, 0, -1]\n", ":13: [mount] sigma_deg must not be below zero, got [0.0, "),
        (MOUNT, MOUNT + MIRRORED, ":17: [sensor.gyr] matrix must be near the unit matrix"),
        (
            MOUNT,
            MOUNT + MIRRORED[: MIRRORED.index("matrix")] + "bias_sigma = [0.0, -1.0, 0.0]\n",
            ":17: [sensor.gyr] bias_sigma must not be below zero, got [0.0, ",
        ),
        (DOCK, DOCK + NAV, ":6: dock and [nav] can't both be given; remove one"),
        ('"lamp"', '"shelf"', ":20: [obstacle] name 'shelf' is another obstacle's too; rename one of them"),
        ('"sphere"', '"ball"', ":21: [obstacle] shape must be one of box, cylinder, sphere, got 'ball'; correct it"),
        ("[0.1]", "[0.1, 0.2]", ":22: [obstacle] size must have 1 numbers, got 2; correct it"),
        ("position = [0.0, 0.5, 0.6]\n", "", ":19: [obstacle] position is missing; add it"),
        (
            "rpy_deg = [0.0, 90.0, 0.0]",
            "rpy = [0.0, 1.5, 0.0]",
            ":18: [obstacle] rpy is unknown; the keys here are name, ",
        ),
    ],
)
def test_a_fault_is_named_with_path_line_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TOML
    path = write(tmp_path, TOML.replace(old, new, 1))
    with pytest.raises(CalibrationError) as caught:
        read_calibration(path)
    assert caught.value.message.startswith(f"{path}{message}")
    assert caught.value.fields["path"] == path
