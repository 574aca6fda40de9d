"""Formats that contain more than joints, read back by their own readers, for several arms."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.files.exporters import export
from pbd.pose import Pose
from tests.arm.bundled import arm_of, path_of
from tests.files.planned_motions import planned, written

ARMS = ("panda", "ur5")


@pytest.mark.parametrize("name", ARMS)
def test_keyframes_have_joints_and_the_pose_of_these_joints(tmp_path: Path, name: str) -> None:
    plan = written(name, "keyframes", tmp_path / "k.json", demo="pouring")
    read = json.loads((tmp_path / "k.json").read_text())
    arm, trajectory = arm_of(name), plan.trajectory
    assert read["joint_names"] == list(trajectory.joint_names)
    assert [row["index"] for row in read["keyframes"]] == list(range(len(plan.keyframes)))
    for i, row in enumerate(read["keyframes"]):
        assert row["joints"] == trajectory.keyframe_q[i].tolist()
        pose = Pose(np.array(row["base_position_m"]), np.array(row["base_wxyz"]))
        assert max(pose.distance(arm.forward(np.array(row["joints"])))) < 1e-9
        stays = np.array([row["t_s"] + 1e-6, row["t_s"] + row["dwell_s"] - 1e-6, row["t_s"] + row["dwell_s"] + 0.02])
        moved = np.abs(trajectory.at(stays).q - row["joints"]).max(axis=1)
        assert (moved[:2] < 1e-9).all()
        assert moved[2] > 1e-9 or i == len(plan.keyframes) - 1
    assert [row["grip"] for row in read["keyframes"] if row["grip"] is not None] == [True, False]


def test_keyframes_as_csv_have_the_same_numbers(tmp_path: Path) -> None:
    written("ur5", "keyframes", tmp_path / "k.json", demo="pouring")
    written("ur5", "keyframes", tmp_path / "k.csv", demo="pouring")
    rows = json.loads((tmp_path / "k.json").read_text())["keyframes"]
    with (tmp_path / "k.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    for row, line in zip(rows, table, strict=True):
        assert line["grip"] == {None: "", True: "closes", False: "opens"}[row["grip"]]
        numbers = [row["t_s"], row["dwell_s"], *row["joints"], *row["base_position_m"], *row["base_wxyz"]]
        told = [value for key, value in line.items() if key not in ("index", "grip", "label")]
        assert [float(value) for value in told] == numbers


def test_a_keyframe_is_one_line_of_the_csv_whatever_its_label(tmp_path: Path) -> None:
    plan, robot, source = planned("ur5", "pouring")
    named = replace(source, keyframes=[replace(each, label="a\rb\x1b[2J") for each in source.keyframes])
    export(plan.trajectory, robot, "keyframes", tmp_path / "k.csv", source=named)
    with (tmp_path / "k.csv").open(newline="") as file:
        assert {line["label"] for line in csv.DictReader(file)} == {r"a b\x1b[2J"}


def read_tum(path: Path) -> Any:
    from evo.tools import file_interface  # slow to import

    return file_interface.read_tum_trajectory_file(path)


@pytest.mark.parametrize("name", ARMS)
def test_evo_reads_the_tools_path(tmp_path: Path, name: str) -> None:
    trajectory = written(name, "tum", tmp_path / "tool.tum", 20.0).trajectory
    read = read_tum(tmp_path / "tool.tum")
    assert read.check()[0]
    points = trajectory.sample(20.0)
    assert_allclose(read.timestamps, points.t)
    turns = read.orientations_quat_wxyz
    assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0.0).all()  # who interpolates takes the short way
    for q, p, wxyz in zip(points.q[::7], read.positions_xyz[::7], turns[::7], strict=True):
        assert max(arm_of(name).forward(q).distance(Pose(p, wxyz))) < 1e-9


def test_evo_reads_the_hands_path(tmp_path: Path) -> None:
    written("panda", "tum-hand", tmp_path / "hand.tum")
    read, hand = read_tum(tmp_path / "hand.tum"), path_of("paper-test1")
    assert_allclose(read.timestamps, hand.t, rtol=0.0, atol=0.0)
    assert_allclose(read.positions_xyz, hand.p_nav_sensor, rtol=0.0, atol=0.0)
    assert_allclose(read.orientations_quat_wxyz, hand.wxyz_nav_sensor, rtol=0.0, atol=0.0)
