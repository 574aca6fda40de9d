"""The animated scene, read back by pygltflib and by trimesh."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from pbd.arm.model import from_se3
from pbd.pose import Array, Pose, quat_from_xyzw
from tests.arm.bundled import arm_of
from tests.files.planned_motions import written

Y_UP = Pose(np.zeros(3), np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]))
"""The file's axes (y up) in axes with z up."""


def numbers(gltf: Any, accessor: int) -> Array:
    """Read an accessor of float32."""
    found = gltf.accessors[accessor]
    start = gltf.bufferViews[found.bufferView].byteOffset
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[found.type]
    return np.frombuffer(gltf.binary_blob(), "<f4", found.count * width, start).reshape(-1, width).astype(np.float64)


class Player:
    """Computes poses of nodes at the frames, as a player does."""

    def __init__(self, gltf: Any) -> None:
        self.gltf = gltf
        self.above = {child: i for i, node in enumerate(gltf.nodes) for child in node.children or ()}
        self.channels: dict[tuple[int, str], Array] = {}
        for channel in gltf.animations[0].channels:
            sampler = gltf.animations[0].samplers[channel.sampler]
            self.t = numbers(gltf, sampler.input)[:, 0]
            self.channels[channel.target.node, channel.target.path] = numbers(gltf, sampler.output)

    def local(self, i: int, frame: int) -> Pose:
        node = self.gltf.nodes[i]
        if node.matrix:
            return Pose.from_matrix(np.array(node.matrix).reshape(4, 4).T)
        p, xyzw = node.translation or [0.0] * 3, node.rotation or [0.0, 0.0, 0.0, 1.0]
        p = self.channels[i, "translation"][frame] if (i, "translation") in self.channels else np.array(p)
        xyzw = self.channels[i, "rotation"][frame] if (i, "rotation") in self.channels else np.array(xyzw)
        return Pose(p, quat_from_xyzw(xyzw))

    def world(self, name: str, frame: int) -> Pose:
        """Return a node's pose in the robot's base."""
        i = next(i for i, node in enumerate(self.gltf.nodes) if node.name == name)
        pose = self.local(i, frame)
        while i in self.above:
            i = self.above[i]
            pose = self.local(i, frame) @ pose
        return Y_UP @ pose


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_every_joint_is_where_forward_kinematics_has_it(tmp_path: Path, name: str) -> None:
    from pygltflib import GLTF2

    trajectory, arm = written(name, "glb", tmp_path / "m.glb", 10.0).trajectory, arm_of(name)
    player, data = Player(GLTF2().load(str(tmp_path / "m.glb"))), arm.full.createData()
    assert (np.diff(player.t) > 0.0).all()
    assert all(np.abs(player.t - t).min() < 1e-5 for t in trajectory.keyframe_t)
    samples = trajectory.at(player.t)
    for frame in range(0, len(player.t), 17):
        pin.forwardKinematics(arm.full, data, arm.configurations(np.append(samples.q[frame], samples.gripper[frame])))
        for joint in range(1, arm.full.njoints):
            T_base_joint = from_se3(data.oMi[joint])
            shown = player.world(arm.full.names[joint], frame)
            assert max(shown.distance(T_base_joint)) < 1e-5


def test_the_hands_path_shows_its_speed(tmp_path: Path) -> None:
    from pygltflib import GLTF2

    written("panda", "glb", tmp_path / "m.glb")
    gltf = GLTF2().load(str(tmp_path / "m.glb"))
    path = next(node for node in gltf.nodes if node.name == "hand_path")
    colours = gltf.accessors[gltf.meshes[path.mesh].primitives[0].attributes.COLOR_0]
    assert (colours.componentType, colours.normalized) == (5121, True)  # bytes, of which 255 is 1.0


def test_the_meshes_license_is_in_the_file(tmp_path: Path) -> None:
    from pygltflib import GLTF2

    written("panda", "glb", tmp_path / "m.glb")
    told = "The robot's model and meshes: Apache-2.0, from https://github.com/frankaemika/franka_ros."
    assert GLTF2().load(str(tmp_path / "m.glb")).asset.copyright == told


def test_trimesh_reads_the_arm_upright_and_each_mesh_once(tmp_path: Path) -> None:
    import trimesh

    written("panda", "glb", tmp_path / "m.glb")
    scene = trimesh.load_scene(tmp_path / "m.glb")
    low, high = scene.bounds
    assert low[1] == pytest.approx(0.0, abs=1e-3)  # y is up
    assert 0.6 < high[1] < 1.0
    triads = [name for name in scene.graph.nodes_geometry if "triad" in name]
    assert len(triads) == 5 * 3  # each has three colours
    assert len({scene.graph[name][1] for name in triads}) == 3
    assert (tmp_path / "m.glb").stat().st_size < 4e6
    materials = [mesh.visual.material for mesh in scene.geometry.values()]
    assert {(each.baseColorFactor[3] < 255, each.alphaMode) for each in materials} == {(False, None), (True, "BLEND")}
    for mesh in scene.geometry.values():
        lengths = np.linalg.norm(mesh.vertex_normals, axis=1)
        assert_allclose(lengths, 1.0, atol=1e-5)
