"""`pbd fuse`, and the advice of `pbd record --take`."""

import re
from pathlib import Path

import numpy as np
import pytest

from pbd.cli.record import how_to_hold
from pbd.data import FusedTake
from pbd.files.calibration import load_calibration
from pbd.files.demo import load_demo, write_demo
from pbd.files.keyframes import read_keyframes
from pbd.fusion.tables import held_alike
from pbd.pipeline import track
from pbd.pose import Pose, quat_exp
from tests.benchmarks.fuse import Scenario, takes_of
from tests.cli.run_command import Capture, refused, run, run_json
from tests.not_none import not_none


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three takes of one task, and one of another."""
    folder = tmp_path_factory.mktemp("fuse")
    for k, demo in enumerate(takes_of(Scenario("wt901", 3), 3)[0]):
        write_demo(demo, folder / "demos" / f"tea{k + 1}")
    write_demo(takes_of(Scenario("wt901", 2, turned=False), 3)[0][1], folder / "demos" / "alike")
    write_demo(takes_of(Scenario("wt901", 1), 4)[0][0], folder / "demos" / "other")
    return folder


@pytest.fixture(autouse=True)
def there(bench: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(bench)
    return bench


def test_a_fused_demonstration_is_one_like_any_other(capsys: Capture) -> None:
    told = run_json(
        capsys, "fuse", "tea1", "tea2", "tea3", "-o", "tea", "--save-calibration", "mine", "--plot", "plots"
    )
    assert [take["keyframes"] for take in told["takes"]] == [list(range(7))] * 3
    assert np.shape([take["off_m"] for take in told["takes"]]) == (3, 7, 3)
    assert sorted(path.name for path in Path("plots").iterdir()) == ["match.png", "scatter.png"]
    assert load_calibration("mine").sensor is not None
    turned = [(take["sensor_turned_deg"], take["sensor_turned_sigma_deg"]) for take in told["takes"]]
    assert all(abs(found - 90.0) < 3.0 * sigma < 6.0 for found, sigma in turned[1:])
    assert [take.recording.info.name for take in load_demo("tea").takes] == ["tea1", "tea2", "tea3"]
    assert not Path("demos/tea/imu.csv").exists()
    found = run_json(capsys, "keyframes", "tea", "--save")["keyframes"]
    np.testing.assert_allclose([one["position_m"] for one in found], [one["position_m"] for one in told["keyframes"]])
    saved = read_keyframes(Path("demos/tea/keyframes.toml"))
    learned = [one["tolerance_m"] for one in told["keyframes"]]
    assert saved[0].tolerance_m is None
    np.testing.assert_allclose([not_none(one.tolerance_m) for one in saved[1:]], learned[1:], atol=5e-5)


def test_a_calibrations_nav_is_said_to_need_the_new_sensor_errors(capsys: Capture) -> None:
    Path("calibration").mkdir(exist_ok=True)
    Path("calibration/points.toml").write_text(
        'format = 1\nname = "points"\n[nav]\nposition = [0.4, 0.0, 0.2]\nrpy_deg = [0, 0, 0]\n'
    )
    _, _, err = run(capsys, "fuse", "tea1", "tea2", "-o", "navs", "--save-calibration", "points")
    assert "the [nav] of calibration/points.toml holds for the sensor as it was read before" in err


def test_nothing_is_written_if_the_calibration_can_not_be(capsys: Capture) -> None:
    Path("calibration").mkdir(exist_ok=True)
    Path("calibration/broken.toml").write_text("format = ")
    assert run(capsys, "fuse", "tea1", "tea2", "-o", "half", "--save-calibration", "broken")[0] == 1
    assert not Path("demos/half").exists()


def test_a_sensor_that_was_never_turned_is_said_to_keep_its_errors(capsys: Capture) -> None:
    told = "the sensor was held alike in all takes, so fusing can't remove its own errors"
    assert told in run(capsys, "fuse", "tea1", "alike", "-o", "unturned")[2]
    assert told not in run(capsys, "fuse", "tea1", "alike", "tea2", "-o", "turned")[2]


def test_a_thing_that_stood_elsewhere_is_told_with_the_command_that_says_so(capsys: Capture) -> None:
    for k, demo in enumerate(takes_of(Scenario("wt901", 3, thing=(3, 4)), 3)[0]):
        write_demo(demo, Path(f"demos/cups{k + 1}"))
    _, _, err = run(capsys, "fuse", "cups1", "cups2", "cups3", "-o", "cups")
    told = r"keyframes 3\.\.4 move together against the others, .* \(0 cm in cups1, .* cm in cups3\); if so: pbd (.*)"
    (command,) = re.findall(told, err)
    assert command == "keyframes cups --frame NAME=3..4"
    assert run(capsys, *command.replace("NAME", "cup").split())[0] == 0


def test_only_the_takes_that_were_used_are_counted(capsys: Capture) -> None:
    assert "pbd: wrote demos/mixed: 2 of 3 takes, " in run(capsys, "fuse", "tea1", "tea2", "other", "-o", "mixed")[2]


def test_a_take_is_added_by_a_line_in_demo_toml(capsys: Capture) -> None:
    run_json(capsys, "fuse", "tea1", "tea2", "-o", "two")
    file = Path("demos/two/demo.toml")
    before = run_json(capsys, "keyframes", "two")["keyframes"]
    file.write_text(file.read_text() + '\n[[take]]\ndemo = "../tea3"\n')
    after = run_json(capsys, "keyframes", "two")["keyframes"]
    assert after[3]["sigma_m"][0] < before[3]["sigma_m"][0]
    (checked,) = run_json(capsys, "check", "two")["demos"]
    assert checked["duration_s"] == pytest.approx(track(load_demo("two")).t[-1])  # not as long as the first take


@pytest.mark.parametrize(
    ("takes", "says"),
    [
        (
            "tea1 tea9",
            "demos/odd/demo.toml:7: [take] demo names demos/odd/../tea9, where there is no demonstration; copy it",
        ),
        (
            "tea1 odd",
            "demos/odd/demo.toml:7: [take] demo names demos/odd/../odd, which is made of takes itself; list",
        ),
        ("tea1 tea2 tea1", "demos/odd/demo.toml: 'tea1' is the same recording as 'tea1'; name each take once"),
        (
            "tea1",
            "demos/odd/demo.toml:5: [take] demo is the only [[take]]; add another, or use that demonstration as it is",
        ),
    ],
)
def test_a_take_that_cannot_be_one_is_named_with_its_line(capsys: Capture, takes: str, says: str) -> None:
    folder = Path("demos/odd")
    folder.mkdir(exist_ok=True)
    listed = "".join(f'[[take]]\ndemo = "../{take}"\n' for take in takes.split())
    (folder / "demo.toml").write_text(f'format = 1\nname = "odd"\nsensor = "wt901"\n{listed}')
    assert says in refused(capsys, 1, "keyframes", "odd")


def test_a_file_is_no_take(capsys: Capture) -> None:
    """It is refused before the takes are tracked, and before figures are drawn."""
    said = refused(capsys, 1, "fuse", "tea1", "demos/tea2/imu.csv", "-o", "both", "--plot", "figures")
    assert "'imu' is no demonstration's folder, so it can't be a take; `pbd import` it first" in said
    assert not Path("figures").exists()


def test_what_a_person_did_that_is_not_used_is_said(capsys: Capture) -> None:
    """A [[grip]] of the fused demonstration, and edited keyframes of a take."""
    run_json(capsys, "keyframes", "tea1", "--save")
    told = run(capsys, "fuse", "tea1", "tea2", "-o", "edited")[2]
    Path("demos/tea1/keyframes.toml").unlink()
    assert "pbd: fused as recorded: tea1, without keyframes.toml; correct the fused keyframes instead" in told
    file = Path("demos/edited/demo.toml")
    file.write_text(file.read_text() + "\n[[grip]]\nt_s = 2.0\nclosed = true\n")
    assert "[grip] t_s is not used, only its takes' are; remove it" in refused(capsys, 1, "keyframes", "edited")


def test_a_take_is_never_replaced_by_what_is_made_of_it(capsys: Capture) -> None:
    link = Path("demos/link")
    link.symlink_to("tea1")
    for name in ("tea1", "demos/../demos/tea1", "link"):
        for force in ((), ("--force",)):  # it is no advice where it doesn't help
            words = ("fuse", "tea1", "tea2", "-o", name, *force)
            assert "a recording, which would be lost" in refused(capsys, 1, *words)
    link.unlink()
    assert Path("demos/tea1/imu.csv").exists()


def test_takes_of_two_tasks_are_refused_and_nothing_is_written(capsys: Capture) -> None:
    assert "are of different tasks" in refused(capsys, 1, "fuse", "tea1", "other", "-o", "both")
    assert not Path("demos/both").exists()


@pytest.mark.parametrize("output", [("--plot", "demos/new"), ("--save-calibration", "demos/new/bench.toml")])
def test_no_output_is_in_the_new_folder(capsys: Capture, output: tuple[str, str]) -> None:
    told = refused(capsys, 2, "fuse", "tea1", "tea2", "-o", "new", *output)
    assert told.endswith(f"{output[1]} is in demos/new, which is written as a whole; give another place")
    assert not Path("demos/new").exists()


def test_the_guide_says_how_to_hold_the_sensor_and_why() -> None:
    assert "as you like" in how_to_hold(1)
    assert "quarter about the vertical" in how_to_hold(2)
    assert "level axis" in how_to_hold(3)
    assert "its own errors then point elsewhere" in how_to_hold(3)
    assert [how_to_hold(take).partition(": ")[2] for take in (5, 6, 7)] == [
        how_to_hold(k).partition(": ")[2] for k in (2, 3, 4)
    ]


@pytest.mark.parametrize(("degrees", "alike"), [(15.0, True), (25.0, False)])
def test_a_sensor_turned_by_twenty_degrees_was_not_held_alike(degrees: float, alike: bool) -> None:
    held = [Pose(np.zeros(3), quat_exp((0.0, np.radians(angle), 0.0))) for angle in (0.0, degrees)]
    assert held_alike([FusedTake("tea", (), np.empty((0, 3)), np.empty(0), T_hand=pose) for pose in held]) == alike
