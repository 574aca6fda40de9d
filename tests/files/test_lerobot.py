"""LeRobot datasets, read back by Hugging Face's `datasets` and by pandas; tests/benchmarks/lerobot.py uses LeRobot."""

import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.cli import main
from pbd.errors import PbdError, PlanError
from pbd.files.exporters import export, export_dataset, lerobot
from pbd.pose import Array
from tests.arm.bundled import arm_of
from tests.files.planned_motions import planned
from tests.system_failures import full_disk

NAMES = [
    f"{name}.pos" for name in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
]


def made(folder: Path, name: str, demos: tuple[str, ...] = ("paper-test1",), task: str = "") -> None:
    motions = [(plan.trajectory, source) for plan, _, source in (planned(name, demo) for demo in demos)]
    export_dataset(motions, arm_of(name).robot, folder, task)


def rows_of(folder: Path, cache: Path) -> Any:
    from datasets import Dataset, Features, Sequence, Value  # slow to import

    info = json.loads((folder / "meta/info.json").read_text())
    kinds = {
        name: Sequence(Value(column["dtype"]), length=column["shape"][0]) if column["names"] else Value(column["dtype"])
        for name, column in info["features"].items()
    }
    return Dataset.from_parquet(str(folder / "data/chunk-000/file-000.parquet"), None, Features(kinds), str(cache))


def test_datasets_reads_the_motion_in_degrees_and_percent(tmp_path: Path) -> None:
    made(tmp_path / "tea", "so101", ("paper-test1", "paper-test2"), "pour the tea")
    info = json.loads((tmp_path / "tea/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 30, "so101_follower")
    assert info["features"]["action"]["names"] == info["features"]["observation.state"]["names"] == NAMES
    rows = rows_of(tmp_path / "tea", tmp_path / "cache").with_format("numpy")[:]
    assert info["total_frames"] == len(rows["index"])
    assert rows["index"].tolist() == list(range(len(rows["index"])))
    for i, demo in enumerate(("paper-test1", "paper-test2")):
        trajectory, which = planned("so101", demo)[0].trajectory, rows["episode_index"] == i
        action, state = rows["action"][which], rows["observation.state"][which]
        points = trajectory.at(np.arange(len(action)) / 30.0)
        assert_allclose(rows["timestamp"][which], points.t, atol=1e-6)
        zero = np.array([0.0, 0.0, 0.0, 0.0, 0.0486795])  # robots/so101.toml
        assert_allclose(action[:, :5], np.degrees(points.q - zero), atol=1e-4)
        jaw = -0.17 + points.gripper * 1.17  # rad
        assert_allclose(action[:, 5], 100.0 * (jaw + 0.174533) / (1.74533 + 0.174533), atol=1e-4)
        assert_allclose(state[1:], action[:-1])
        assert_allclose(action[0], action[1], atol=0.1)  # the motion begins at rest
        assert_allclose(
            np.radians(action[[0, -1], :5]) + zero, arm_of("so101").robot.home[None].repeat(2, 0), atol=1e-5
        )


def test_episodes_tasks_and_stats(tmp_path: Path) -> None:
    import pandas as pd  # slow to import

    made(tmp_path / "tea", "so101", ("paper-test1", "paper-test2"))
    rows = rows_of(tmp_path / "tea", tmp_path / "cache").with_format("numpy")[:]
    tasks = pd.read_parquet(tmp_path / "tea/meta/tasks.parquet")
    assert tasks.loc["paper-test2", "task_index"] == 1
    episodes = pd.read_parquet(tmp_path / "tea/meta/episodes/chunk-000/file-000.parquet")
    assert [list(each) for each in episodes["tasks"]] == [["paper-test1"], ["paper-test2"]]
    stats = json.loads((tmp_path / "tea/meta/stats.json").read_text())
    actions: Array = rows["action"]
    for kind, value in (
        ("min", actions.min(0)),
        ("mean", actions.mean(0)),
        ("q99", np.quantile(actions, 0.99, axis=0)),
    ):
        assert_allclose(stats["action"][kind], value, rtol=1e-4, atol=1e-4)
    for i, row in episodes.iterrows():
        action = actions[row["dataset_from_index"] : row["dataset_to_index"]]
        assert len(action) == row["length"] == (rows["episode_index"] == i).sum()
        assert_allclose(row["stats/action/max"], action.max(axis=0), rtol=1e-6)


def test_adding_a_demonstration_equals_writing_both(tmp_path: Path) -> None:
    made(tmp_path / "both", "so101", ("paper-test1", "paper-test2"))
    made(tmp_path / "tea", "so101")
    made(tmp_path / "tea", "so101", ("paper-test2",))
    for file in (path for path in (tmp_path / "both").rglob("*") if path.is_file()):
        assert file.read_bytes() == (tmp_path / "tea" / file.relative_to(tmp_path / "both")).read_bytes()


def test_two_commands_at_once_lose_no_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `ls demos | xargs -P4` starts them. Without a lock both would read the dataset before either has written."""
    made(tmp_path / "tea", "so101")
    write = lerobot.write

    def slow(*args: Any) -> None:
        time.sleep(0.5)
        write(*args)

    monkeypatch.setattr(lerobot, "write", slow)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: made(tmp_path / "tea", "so101"), range(2)))
    assert json.loads((tmp_path / "tea/meta/info.json").read_text())["total_episodes"] == 3


def test_an_arm_unknown_to_lerobot_has_the_models_joints(tmp_path: Path) -> None:
    made(tmp_path / "tea", "ur5")
    info = json.loads((tmp_path / "tea/meta/info.json").read_text())
    assert info["robot_type"] == "ur5"
    assert info["features"]["action"]["names"][0] == "shoulder_pan_joint.pos"
    trajectory = planned("ur5")[0].trajectory
    rows = rows_of(tmp_path / "tea", tmp_path / "cache").with_format("numpy")[:]
    points = trajectory.at(np.arange(len(rows["index"])) / 30.0)
    assert_allclose(rows["action"], np.column_stack((points.q, 100.0 * points.gripper)), atol=1e-5)


def _without(table: Path, column: str) -> bytes:
    """Return the bytes of a table without one of its columns."""
    import pyarrow.parquet as pq

    less = table.with_suffix(".less")
    pq.write_table(pq.read_table(table).drop_columns([column]), less)
    data = less.read_bytes()
    less.unlink()
    return data


def test_what_it_refuses(tmp_path: Path) -> None:
    made(tmp_path / "tea", "so101")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(
        PbdError, match=r"tea holds episodes of another robot, so101_follower, not of so100_follower; g"
    ):
        made(tmp_path / "tea", "so100", ("paper-test2",))
    with pytest.raises(PbdError, match="holds something else than a LeRobot dataset; give a new folder"):
        made(tmp_path, "so101")
    plan, robot, source = planned("so101")
    with pytest.raises(PlanError, match=r"and so101 has no \[gripper\]; give it one, or take another format"):
        export(plan.trajectory, replace(robot, gripper=None), "lerobot", tmp_path / "none", source=source)
    elsewhere = replace(robot, home=robot.home + 0.1)
    with pytest.raises(PlanError, match=r"begin and end at rest, .*; leave --no-approach and --no-retreat out"):
        export(plan.trajectory, elsewhere, "lerobot", tmp_path / "none", source=source)
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    (tmp_path / "file").touch()
    with pytest.raises(PbdError, match="file is a file, and lerobot needs a folder; give another name"):
        made(tmp_path / "file", "so101")
    table = tmp_path / "tea" / lerobot.DATA
    whole = table.read_bytes()
    for damaged in (whole[:100], _without(table, "task_index"), _without(table, "action")):
        table.write_bytes(damaged)
        with pytest.raises(PbdError, match=r"tea can't be read as a dataset \(.*\); give a new folder"):
            made(tmp_path / "tea", "so101")
    table.write_bytes(whole)
    (tmp_path / "tea/videos").mkdir()
    (tmp_path / "tea/videos/top.mp4").touch()
    with pytest.raises(PbdError, match="holds a dataset that pbd did not write, or not alone"):
        made(tmp_path / "tea", "so101")


@pytest.mark.parametrize("room", [0, 3000, 20000])
def test_a_full_disk_leaves_the_old_episodes(tmp_path: Path, room: int) -> None:
    made(tmp_path / "tea", "so101")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with full_disk(room), pytest.raises(PbdError, match=r"tea can't be written \(.+\); give another place"):
        made(tmp_path / "tea", "so101", ("paper-test2",))
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_without_pyarrow_it_says_what_to_install(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    assert main(["export", "pouring", "--robot", "so101", "--format", "lerobot", "-o", "tea"]) == 1
    message = "pbd: lerobot needs the package pyarrow; install it with: pip install 'pbd-robot[lerobot]'\n"
    assert capsys.readouterr().err == message
    assert not [*elsewhere.iterdir()]
