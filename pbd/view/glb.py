"""The replay's scene as a GLB file (glTF 2.0, binary), for Blender and other programs that show 3D models.

glTF has y up and our scene z up, so the root node rotates the scene. Players interpolate each joint's own rotation
between two frames (slerp), so links keep their shape and stay connected.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_continuous, quat_to_xyzw
from pbd.view.compact_mesh import Mesh
from pbd.view.meshcat_encoding import PoseTrack, ScenePath, SetTracks, Visualizer, is_still, linear_light
from pbd.view.replay_scene import ReplayScene
from pbd.view.scene import build

VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963
FLOAT, UINT16, UINT32, UINT8 = 5126, 5123, 5125, 5121
"""Numbers of the glTF standard for buffer targets and component types."""


def write_glb(scene: ReplayScene, path: Path) -> None:
    """Write the arm and its motion, the paths, the keyframes and the obstacles.

    Raises:
        RobotError: the robot's meshes can't be read.
        OSError: the file can't be written.
    """
    window = _Window(scene.title, scene.robot.license)
    build(scene, Visualizer.view_into(window, ScenePath()))
    path.write_bytes(window.glb())


class _Window:
    """A substitute for meshcat's window that translates its commands to glTF."""

    def __init__(self, title: str, license_: str) -> None:
        self.asset = {"version": "2.0", "generator": "pbd"}
        if license_:
            self.asset["copyright"] = f"The robot's model and meshes: {license_}."  # as the page says it
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        z_to_y = -float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5))  # xyzw
        self.nodes: list[dict[str, Any]] = [{"name": title, "rotation": z_to_y}]
        self.channels: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self._paths: dict[tuple[str, ...], int] = {(): 0}
        self._known: dict[tuple[object, ...], int] = {}

    def send(self, command: Any) -> None:
        """Take one of meshcat's commands. Those that only concern the page, such as properties, are ignored."""
        if isinstance(command, SetTracks):
            for track in command.tracks:
                self._animate(track)
        elif hasattr(command, "object"):
            mesh, material = command.object.geometry.mesh, command.object.material
            self.nodes[self._node(command.path.entries)]["mesh"] = self._mesh(mesh, float(material.opacity))
        elif hasattr(command, "matrix"):
            self.nodes[self._node(command.path.entries)]["matrix"] = np.asarray(command.matrix).T.ravel().tolist()

    def glb(self) -> bytes:
        """The file's bytes: a header, the JSON, the binary data, each padded to four bytes."""
        content = {
            "asset": self.asset,
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
            "animations": [{"name": "motion", "channels": self.channels, "samplers": self.samplers}],
        }
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = (
            struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def _node(self, entries: tuple[str, ...]) -> int:
        """Index of the node at a path. A new node is made, with its parents."""
        if entries not in self._paths:
            above = self.nodes[self._node(entries[:-1])]
            name = f"{entries[-2]} {entries[-1]}" if entries[-1].isdigit() else entries[-1]
            self._paths[entries] = len(self.nodes)
            above.setdefault("children", []).append(len(self.nodes))
            self.nodes.append({"name": name})
        return self._paths[entries]

    def _animate(self, track: PoseTrack) -> None:
        """Give a node its first pose, and animate its position and rotation if they change."""
        i = self._node(track.path.entries)
        turns = quat_to_xyzw(quat_continuous(track.wxyz))
        self.nodes[i].pop("matrix", None)  # the standard allows a matrix or these two, and animates only these
        for name, values in (("translation", track.p), ("rotation", turns)):
            self.nodes[i][name] = values[0].tolist()
            if is_still(values):
                continue
            seconds = self._accessor(track.t[:, None], FLOAT, bounds=True)
            sampler = {"input": seconds, "output": self._accessor(values, FLOAT)}
            self.channels.append({"sampler": len(self.samplers), "target": {"node": i, "path": name}})
            self.samplers.append({**sampler, "interpolation": "LINEAR"})

    def _mesh(self, mesh: Mesh, opacity: float) -> int:
        """Index of a mesh with this shape and these colours; nodes with equal meshes share it."""
        position = self._accessor(mesh.vertices, FLOAT, VERTEX_BUFFER, bounds=True)
        attributes = {"POSITION": position, "NORMAL": self._accessor(_normals(mesh), FLOAT, VERTEX_BUFFER)}
        colours, colour_of = np.unique(mesh.rgb, axis=0, return_inverse=True)
        few = len(colours) <= 8  # each is a material then; more are vertex colours, which fewer programs show
        if not few:
            vertices = np.column_stack((linear_light(mesh.rgb), np.full(len(mesh.rgb), 255)))
            attributes["COLOR_0"] = self._accessor(vertices, UINT8, VERTEX_BUFFER)
        colour_of_face = colour_of.ravel()[mesh.faces[:, 0]]
        groups = [mesh.faces[colour_of_face == i] for i in range(len(colours))] if few else [mesh.faces]
        index = UINT32 if len(mesh.grid) > 65535 else UINT16
        primitives = [
            {
                "attributes": attributes,
                "indices": self._accessor(faces.reshape(-1, 1), index, INDEX_BUFFER),
                "material": self._material(colour if few else None, opacity, mesh.closed),
            }
            for faces, colour in zip(groups, colours, strict=False)
            if len(faces)
        ]
        return _index({"primitives": primitives}, self.meshes)

    def _material(self, rgb: NDArray[np.uint8] | None, opacity: float, closed: bool) -> int:
        light = [1.0] * 3 if rgb is None else (linear_light(rgb) / 255.0).tolist()
        surface = {"baseColorFactor": [*light, opacity], "metallicFactor": 0.0, "roughnessFactor": 0.6}
        material: dict[str, Any] = {"pbrMetallicRoughness": surface, "doubleSided": not closed}
        if opacity < 1.0:
            material["alphaMode"] = "BLEND"
        return _index(material, self.materials)

    def _accessor(self, values: NDArray[Any], kind: int, target: int | None = None, bounds: bool = False) -> int:
        """Index of the accessor of an array (n, k); a new array is appended to the data."""
        dtype = {FLOAT: "<f4", UINT16: "<u2", UINT32: "<u4", UINT8: "u1"}[kind]
        stored = np.ascontiguousarray(values, dtype=dtype)
        key = (stored.tobytes(), stored.shape, kind, target, bounds)
        if key in self._known:
            return self._known[key]
        self._known[key] = len(self.accessors)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.data += stored.tobytes() + b"\0" * (-stored.nbytes % 4)
        shape = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[stored.shape[1]]
        accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(stored), "type": shape}
        if bounds:
            accessor |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.accessors.append(accessor | ({"normalized": True} if kind == UINT8 else {}))
        return self._known[key]


def _index(item: dict[str, Any], items: list[dict[str, Any]]) -> int:
    """Index of an item in a list; a new item is appended."""
    if item not in items:
        items.append(item)
    return items.index(item)


def _normals(mesh: Mesh) -> Array:
    """Unit normals (n, 3) at the vertices: the mean of the adjacent faces' normals, weighted by their areas."""
    p, q, r = (mesh.vertices[corner] for corner in mesh.faces.T)
    normals = np.zeros(mesh.grid.shape)
    np.add.at(normals, mesh.faces, np.cross(q - p, r - p)[:, None])
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(size > 0.0, normals / np.maximum(size, 1e-300), (0.0, 0.0, 1.0))
