"""A LeRobotDataset v3.0, to train, view and replay with LeRobot. Each demonstration is an episode.

Joints are in the degrees of LeRobot if the robot has [servos], else in rad or m. The action is the planned motion at
each frame; the state is one frame behind, as in a recording of an arm that follows its goals. pyarrow, which comes with
pbd-robot[lerobot], writes the files; LeRobot is not needed.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.data import Robot, Samples
from pbd.errors import PbdError, PlanError, printable, require_package
from pbd.files.exporters.controller_interpolation import set_point_samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.io.atomic import is_file, is_folder, refuse_folder
from pbd.io.read_file import read_text
from pbd.pose import Array

Rows = NDArray[Any]
"""Values of an episode in the file's unit, one row a frame."""

FPS = 30
"""Frames a second. lerobot-replay sends each frame's action at its time."""

FLOAT32_EPSILON = float(np.finfo(np.float32).eps)
"""Relative size of the last digit of the file's numbers."""

DATA, TASKS = "data/chunk-000/file-000.parquet", "meta/tasks.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
INFO, STATS = "meta/info.json", "meta/stats.json"

COLUMNS = {"timestamp": "float32", **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")}
"""LeRobot's columns for each frame, besides state and action, and their types."""


class Episode(NamedTuple):
    """The task's description; state and action (n, k + 1), float32: k joints and the gripper."""

    task: str
    state: Rows
    action: Rows


def check(robot: Robot) -> None:
    """Refuse if pyarrow is missing (PbdError) or the arm has no gripper (PlanError)."""
    require_package("pyarrow.parquet", "lerobot", "lerobot")
    if robot.gripper is None:
        what = f"a lerobot dataset has the gripper's opening in each frame, and {robot.name} has no [gripper]"
        raise PlanError(f"{what}; give it one, or take another format", robot=robot.name)


def refuse_dataset(folder: Path, robot: Robot) -> None:
    """Refuse (PbdError) a folder to which this robot's episodes can't be added, before the command starts to work."""
    if not read_episodes(folder, robot):
        refuse_folder(folder)


def first_frame_text(robot: Robot, points: Samples) -> str:
    """Return the joints of the first frame as text, in the dataset's unit."""
    first = values(robot, points.q[:1], points.gripper[:1])[0].tolist()
    unit, decimals = ("degrees", 1) if robot.servos is not None else ("rad; m where it slides", 3)
    joints = ", ".join(f"{name} {x:.{decimals}f}" for name, x in zip(robot.joints, first, strict=False))
    return f"{joints} ({unit}), gripper {first[-1]:.0f}"


def samples(request: ExportRequest) -> Samples:
    """Sample at 30 frames a second.

    Raises:
        PlanError: the motion does not begin with an approach and end at home. lerobot-replay jumps to the first frame,
            and switches the motors off after the last.
    """
    trajectory, robot = request.trajectory, request.robot
    at_home = np.abs(trajectory.at(np.array([trajectory.duration])).q[0] - robot.home).max() <= 1e-6  # rad
    if not (at_home and trajectory.keyframe_t[0] > 0.0):
        what = f"lerobot's episodes begin and end at rest, away from the task, and {request.source.name} does not"
        raise PlanError(f"{what}; leave --no-approach and --no-retreat out", robot=robot.name)
    return trajectory.sample(FPS)


def values(robot: Robot, q: Array, opening: Array) -> Rows:
    """Convert joints (n, k), rad or m, and the gripper's opening (n,) to the dataset's units, (n, k + 1) float32."""
    servos, gripper = robot.servos, robot.gripper
    if servos is None or gripper is None:
        return np.column_stack((q, 100.0 * opening)).astype(np.float32)
    fingers = servos.to_percent(gripper.positions(opening)[:, 0])
    return np.column_stack((servos.to_degrees(q), fingers)).astype(np.float32)


def episode(request: ExportRequest, points: Samples) -> Episode:
    """Make an episode: the state is one frame behind the action."""
    action = values(request.robot, points.q, points.gripper)
    return Episode(request.task or request.source.name, np.vstack((action[:1], action[:-1])), action)


def read(robot: Robot, recorded: Episode) -> Samples:
    """Convert an episode's actions to set points of the joints, rad."""
    servos, gripper, q = robot.servos, robot.gripper, recorded.action[:, :-1].astype(np.float64)
    opening = recorded.action[:, -1].astype(np.float64) / 100.0
    if servos is not None and gripper is not None:
        closed, opened = servos.to_percent(np.array([gripper.closed[0], gripper.open[0]])) / 100.0
        q, opening = servos.to_radians(q), (opening - closed) / (opened - closed)
    return set_point_samples(np.arange(len(q)) / FPS, q, opening)


def read_episodes(folder: Path, robot: Robot) -> list[Episode]:
    """Read the episodes of a dataset that `write` made; an empty list if there is no folder, or it is empty.

    Raises:
        PbdError: the folder is something else, or another robot's dataset.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if is_file(folder):
        raise PbdError(f"{folder} is a file, and lerobot needs a folder; give another name", path=folder)
    if not (is_folder(folder) and any(folder.iterdir())):
        return []
    info = None
    if is_file(folder / INFO):
        with suppress(ValueError, RecursionError):
            info = json.loads(read_text(folder / INFO, PbdError, "give a new folder"))
    if not isinstance(info, dict):
        raise PbdError(f"{folder} holds something else than a LeRobot dataset; give a new folder", path=folder)
    robot_type, features = info.get("robot_type"), info.get("features")
    if robot_type != robot_type_of(robot):
        what = f"{folder} holds episodes of another robot, {printable(str(robot_type))}, not of {robot_type_of(robot)}"
        raise PbdError(f"{what}; give another folder", path=folder, value=robot_type)
    ours = {str(path) for path in (DATA, EPISODES, TASKS, INFO, STATS)}
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    if files != ours or features != _features(robot) or info.get("fps") != FPS:
        what = f"{folder} holds a dataset that pbd did not write, or not alone (cameras, other rates, more files)"
        raise PbdError(f"{what}; give a new folder, and join the two with lerobot-edit-dataset", path=folder)
    try:
        tasks = pq.read_table(folder / TASKS).to_pydict()
        words = dict(zip(tasks["task_index"], tasks["__index_level_0__"], strict=True))
        data = pq.read_table(folder / DATA)
        column = {name: np.array(data[name].to_pylist()) for name in data.column_names}
        starts = np.flatnonzero(np.diff(column["episode_index"], prepend=-1))
        rows = [slice(a, b) for a, b in zip(starts, [*starts[1:], len(data)], strict=True)]
        state, action = (column[name].astype(np.float32) for name in ("observation.state", "action"))
        return [Episode(words[int(column["task_index"][each.start])], state[each], action[each]) for each in rows]
    except (pa.ArrowException, OSError, LookupError, ValueError, TypeError) as reason:
        what = f"{folder} can't be read as a dataset ({printable(str(reason)[:80])})"
        raise PbdError(f"{what}; give a new folder", path=folder) from None


def robot_type_of(robot: Robot) -> str:
    """Return LeRobot's name of the arm, else the robot's own."""
    return robot.name if robot.servos is None else robot.servos.robot_type


def write(robot: Robot, episodes: Sequence[Episode], folder: Path) -> None:
    """Write the dataset into an empty folder."""
    import pyarrow as pa

    words = list(dict.fromkeys(each.task for each in episodes))
    ends = np.cumsum([len(each.action) for each in episodes]).tolist()
    columns = [_frames(i, each, words, end) for i, (each, end) in enumerate(zip(episodes, ends, strict=True))]
    dataset = {name: np.concatenate([frames[name] for frames in columns]) for name in columns[0]}
    k = len(robot.joints) + 1
    kinds = {name: pa.list_(pa.float32(), k) for name in ("action", "observation.state")}
    kinds |= {name: pa.type_for_alias(kind) for name, kind in COLUMNS.items()}
    _write_table(folder / DATA, {name: pa.array(list(dataset[name]), kind) for name, kind in kinds.items()})
    rows: dict[str, list[Any]] = {}
    for i, (each, frames, end) in enumerate(zip(episodes, columns, ends, strict=True)):
        n = len(each.action)
        row: dict[str, Any] = {"episode_index": i, "tasks": [each.task], "length": n}
        row |= {"data/chunk_index": 0, "data/file_index": 0, "dataset_from_index": end - n, "dataset_to_index": end}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= {f"stats/{name}/{kind}": x for name, stats in _stats(frames).items() for kind, x in stats.items()}
        for name, value in row.items():
            rows.setdefault(name, []).append(value)
    _write_table(folder / EPISODES, {name: pa.array(column) for name, column in rows.items()})
    _write_tasks(folder / TASKS, words)
    info = {
        "codebase_version": "v3.0",
        "robot_type": robot_type_of(robot),
        "total_episodes": len(episodes),
        "total_frames": ends[-1],
        "total_tasks": len(words),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": _features(robot),
    }
    for name, value in ((INFO, info), (STATS, _stats(dataset))):
        (folder / name).write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")


def _features(robot: Robot) -> dict[str, Any]:
    names = [f"{name}.pos" for name in (*robot.joints, "gripper")]
    joints = {"dtype": "float32", "shape": [len(names)], "names": names}
    plain = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in COLUMNS.items()}
    return {"action": joints, "observation.state": joints, **plain}


def _frames(i: int, each: Episode, words: Sequence[str], end: int) -> dict[str, Rows]:
    n = len(each.action)
    return {
        "action": each.action,
        "observation.state": each.state,
        "timestamp": (np.arange(n) / FPS).astype(np.float32),
        "frame_index": np.arange(n),
        "episode_index": np.full(n, i),
        "task_index": np.full(n, words.index(each.task)),
        "index": np.arange(end - n, end),
    }


def _stats(frames: dict[str, Rows]) -> dict[str, dict[str, list[float]]]:
    """Compute each column's statistics, with which LeRobot normalises."""
    stats = {}
    for name, column in frames.items():
        rows = column.reshape(len(column), -1).astype(np.float64)
        each = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
        each |= {f"q{percent:02d}": np.percentile(rows, percent, axis=0) for percent in (1, 10, 50, 90, 99)}
        stats[name] = {key: value.tolist() for key, value in each.items()} | {"count": [len(rows)]}
    return stats


def _write_tasks(path: Path, words: Sequence[str]) -> None:
    """Write the tasks as pandas does: the descriptions are the index of a data frame, the column is their number."""
    import pyarrow as pa

    index = "__index_level_0__"
    kinds = (("task_index", "task_index", "int64", "int64"), (None, index, "unicode", "object"))
    keys = "name", "field_name", "pandas_type", "numpy_type", "metadata"
    described = [dict(zip(keys, (*kind, None), strict=True)) for kind in kinds]
    pandas = {"index_columns": [index], "column_indexes": [], "columns": described}
    columns = {"task_index": pa.array(range(len(words)), pa.int64()), index: pa.array(words, pa.string())}
    _write_table(path, columns, {"pandas": json.dumps(pandas | {"pandas_version": "2.2.0"})})


def _write_table(path: Path, columns: dict[str, Any], metadata: dict[str, str] | None = None) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), path)
