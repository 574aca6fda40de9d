"""Every reader of the project, each with a small file that it reads well."""

import io
import struct
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pbd.arm.collision.allowed_collisions import link_pairs
from pbd.arm.collision.geometry import link_bodies
from pbd.arm.collision.shape_coverage import doubtful_shapes
from pbd.arm.model import load_model
from pbd.data import Demonstration, Truth
from pbd.errors import SensorError
from pbd.files.calibration import read_calibration
from pbd.files.calibration_edit import update_calibration
from pbd.files.demo import read_demo, write_demo
from pbd.files.importers import import_file
from pbd.files.joint_state import read_joints
from pbd.files.keyframes import keyframes_toml
from pbd.files.points import read_points
from pbd.files.robot import read_robot
from pbd.record.redecode import decode_raw
from pbd.sensors.gamepad import GamepadDecoder
from pbd.sensors.line_layout import layout_from_toml
from pbd.view.visuals import load_mesh, read_visuals
from tests.files.write_bag import write_bag
from tests.fuzz import contents
from tests.record.emulated_sensors import SPEAKERS, random_hand
from tests.sensors.encoders.gamepad import press, report

ROWS = 30


@dataclass(frozen=True)
class Reader:
    """Files that go together, which of them is changed, and what reads it (or its folder)."""

    made: Mapping[str, bytes] | Callable[[], Mapping[str, bytes]]
    changed: str
    read: Callable[[Path], object]

    @property
    def files(self) -> Mapping[str, bytes]:
        """Made when needed, where that takes long."""
        return self.made() if callable(self.made) else self.made


def _readers() -> dict[str, Reader]:
    demo = _demonstration()
    found = {
        name: Reader(demo, name, lambda path: read_demo(path.parent))
        for name in ("demo.toml", "imu.csv", "truth.csv", "keyframes.toml")
    }
    calibration = {"bench.toml": contents.CALIBRATION.encode()}
    found |= {
        "calibration": Reader(calibration, "bench.toml", read_calibration),
        "calibration edited": Reader(calibration, "bench.toml", _update),
        "points": Reader({"points.csv": contents.POINTS.encode()}, "points.csv", read_points),
        "joints": Reader({"now.json": b'{"one": 0.5, "two": -1}'}, "now.json", _joints),
        "line layout": Reader({"board.toml": contents.LAYOUT.encode()}, "board.toml", _layout),
    }
    for name, text in contents.TABLES.items():
        beside = {"Magnetometer.csv": contents.MAGNETOMETER.encode()} if name == "Inertial.csv" else {}
        found[name] = Reader({name: text.encode("gb18030"), **beside}, name, import_file)
    found["Magnetometer.csv"] = Reader(
        {
            "Inertial.csv": contents.TABLES["Inertial.csv"].encode(),
            "Magnetometer.csv": contents.MAGNETOMETER.encode(),
        },
        "Magnetometer.csv",
        lambda path: import_file(path.with_name("Inertial.csv")),
    )
    savers: dict[str, Callable[..., None]] = {"npz": np.savez, "npz, packed": np.savez_compressed}
    for name, save in savers.items():
        packed = io.BytesIO()
        save(packed, **contents.ARRAYS)
        found[name] = Reader({"run.npz": packed.getvalue()}, "run.npz", import_file)
    hand = random_hand(ROWS, seed=1)
    for name, speaker in SPEAKERS.items():
        data = b"".join(speaker.encode(hand, row) for row in range(ROWS))
        decoder, sensor = speaker.decoder, speaker.sensor
        found[f"raw.bin {name}"] = Reader(
            {"raw.bin": data},
            "raw.bin",
            lambda path, decoder=decoder, sensor=sensor: decode_raw(path, decoder(), sensor, 100.0),  # type: ignore[misc]
        )
    grips = [report(10_000 * k, (0.0, 0.0, 1.0), (0.0, 0.0, 0.1 * k)) + press() for k in range(ROWS)]
    found["raw.bin gamepad"] = Reader(
        {"raw.bin": b"".join(grips)}, "raw.bin", lambda path: decode_raw(path, GamepadDecoder(), "gamepad", None)
    )
    found["printed lines"] = Reader({"printed.log": contents.PRINTED.encode()}, "printed.log", _printed)
    sensors = {
        f"{name}.csv": f"epoc (ms),x,y,z\n{contents.rows('1{0}0', 12, 0.01, 3)}".encode() for name in ("acc", "gyro")
    }
    found["files of sensors"] = Reader(sensors, "gyro.csv", import_file)
    found["phone's zip"] = Reader({"walk.zip": _zipped()}, "walk.zip", import_file)
    for name, mcap in (("bag.mcap", True), ("bag.db3", False)):
        found[name] = Reader(partial(_bag, name, mcap), name, import_file)
    robot = {
        "mine.toml": contents.ROBOT,
        "mine.urdf": contents.URDF,
        "mine.srdf": contents.SRDF,
        "a.dae": contents.DAE,
    }
    files = {name: text.encode() for name, text in robot.items()} | {"a.stl": _stl()}
    for name in ("mine.toml", "mine.srdf"):
        found[f"robot's {name}"] = Reader(files, name, _robot)
    found["robot's mine.urdf"] = Reader(files, "mine.urdf", _arm)
    found["robot's mesh"] = Reader(files, "a.stl", _arm)
    for name, data in (
        ("a.stl", _stl()),
        ("b.stl", _stl_text()),
        ("c.obj", _obj()),
        ("d.dae", contents.DAE.encode()),
    ):
        found[f"mesh {name}"] = Reader({name: data}, name, lambda path: load_mesh(path, (1.0, 1.0, 1.0), (0.5,) * 3))
    return found


def _demonstration() -> dict[str, bytes]:
    hand = random_hand(ROWS, seed=0)
    truth = Truth(hand.t, np.zeros((ROWS, 3)), np.tile((1.0, 0.0, 0.0, 0.0), (ROWS, 1)))
    with tempfile.TemporaryDirectory() as inside:
        folder = Path(inside) / "tea"
        write_demo(Demonstration(hand, truth=truth), folder)
        found = {path.name: path.read_bytes() for path in folder.iterdir()}
    keyframes = keyframes_toml("tea", contents.KEYFRAMES, magnetic=False)
    return found | {"keyframes.toml": keyframes.encode(), "demo.toml": contents.DEMO.encode()}


def _bag(name: str, mcap: bool) -> dict[str, bytes]:
    hand = random_hand(ROWS, seed=2)
    with tempfile.TemporaryDirectory() as inside:
        write_bag(Path(inside) / "bag", hand, mcap=mcap)
        return {name: next((Path(inside) / "bag").glob("*.mcap" if mcap else "*.db3")).read_bytes()}


def _zipped() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("TotalAcceleration", "Gyroscope"):
            archive.writestr(
                f"{name}.csv", "time,seconds_elapsed,z,y,x\n" + contents.rows("{0}0000000,{1:.2f}", 12, 0.01, 3)
            )
    return packed.getvalue()


def _printed(path: Path) -> object:
    return import_file(path, rate_hz=100.0)


def _update(path: Path) -> object:
    update_calibration(path, {"dock": {"position": ((0.1, 0.2, 0.3), "m")}}, scale=0.5)
    return read_calibration(path)


def _joints(path: Path) -> object:
    return read_joints(str(path), ("one", "two"))


def _layout(path: Path) -> object:
    try:
        return layout_from_toml(path.read_text(encoding="utf-8"), path.name)
    except UnicodeDecodeError:
        raise SensorError("its reader refuses what is no UTF-8") from None


def _robot(path: Path) -> object:
    return read_robot(path.with_name("mine.toml"))


def _arm(path: Path) -> object:
    robot = read_robot(path.with_name("mine.toml"))
    arm = load_model(robot)
    link_pairs(arm)
    doubtful_shapes(arm)
    return link_bodies(arm), read_visuals(robot)


def _corners() -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.05, 0.05, (12, 3, 3)).astype("<f4")


def _stl() -> bytes:
    faces = b"".join(bytes(12) + corners.tobytes() + b"\0\0" for corners in _corners())
    return bytes(80) + struct.pack("<I", len(_corners())) + faces


def _stl_text() -> bytes:
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in _corners()
    )
    return f"solid a\n{facets}endsolid a\n".encode()


def _obj() -> bytes:
    corners = _corners().reshape(-1, 3)
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in corners)
    return (vertices + "".join(f"f {k} {k + 1} {k + 2}\n" for k in range(1, len(corners), 3))).encode()


READERS = _readers()
