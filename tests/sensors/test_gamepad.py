"""A DualSense: bytes of input events through a FIFO, as the kernel gives them."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.cli import main
from pbd.data import GRAVITY
from pbd.errors import SensorError
from pbd.files.demo import read_demo
from pbd.sensors import gamepad_port
from pbd.sensors.gamepad import GamepadDecoder
from pbd.sensors.gamepad_port import GamepadPort, open_gamepad
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.not_none import not_none
from tests.sensors.encoders.gamepad import event, press, report
from tests.system_failures import as_a_user

LEVEL = (0.0, 0.0, 1.0)


def test_counts_axes_and_stamps() -> None:
    """On the table y points up, by SDL_sensor.h; z toward the player. 8192 counts are 1 g, 1024 are 1 deg/s."""
    data = b"".join(event(3, code, value) for code, value in enumerate((819, 8192, -1638, 1024, 2048, -3072)))
    (sample,) = GamepadDecoder().feed(data + event(4, 5, 4_000) + event(0, 0, 0))
    assert sample.acc == pytest.approx(np.array((819, 1638, 8192)) * GRAVITY / 8192)
    assert sample.gyr == pytest.approx(np.radians((1.0, 3.0, 2.0)))
    assert sample.t_device == pytest.approx(4e-3)


def test_an_axis_that_is_not_sent_has_not_changed() -> None:
    decoder = GamepadDecoder()
    assert decoder.feed(event(3, 0, 5) + event(4, 5, 1) + event(0, 0, 0)) == []  # the others are unknown
    first, second = decoder.feed(report(4000, LEVEL, (1, 2, 3)) + event(3, 0, 819) + event(4, 5, 8000) + event(0, 0, 0))
    assert second.gyr == first.gyr
    assert second.acc == pytest.approx((819 * GRAVITY / 8192, 0.0, GRAVITY))


def test_the_stamp_wraps() -> None:
    us = (2**32 - 4000, 2**32, 2**32 + 4000)
    samples = GamepadDecoder().feed(b"".join(report(each, LEVEL, (0, 0, 0)) for each in us))
    assert_allclose(np.diff([sample.t_device for sample in samples if sample.t_device is not None]), 4e-3)


def test_what_follows_a_loss_is_half_a_report() -> None:
    decoder = GamepadDecoder()
    decoder.feed(report(4000, LEVEL, (0, 0, 0)))
    lost = event(0, 3, 0) + event(3, 1, 0) + event(4, 5, 8000) + event(0, 0, 0)
    assert decoder.feed(lost) == []
    assert decoder.tally.bad_packets == 1
    assert len(decoder.feed(report(12000, LEVEL, (0, 0, 0)))) == 1


def fifo(folder: Path, name: str = "event5") -> Path:
    os.mkfifo(folder / name)
    return folder / name


def test_a_recording_with_its_grip_by_the_pads_button(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over Bluetooth: reports come in bursts, but the device's own stamps count."""
    motion, buttons = fifo(elsewhere), fifo(elsewhere, "event6")
    monkeypatch.setattr(gamepad_port, "find_gamepads", lambda: {str(motion): ("DualSense", str(buttons))})
    monkeypatch.setattr("fcntl.ioctl", Kernel().ioctl)
    way = (Waypoint(rest_s=1.5), Waypoint((0.2, 0.0, 0.1), (0.5, 0.0, 0.3), move_s=0.7, rest_s=1.8))
    hand = simulate(Task("short", way), "ideal", rate_hz=250.0).recording
    assert hand.gyr is not None
    us = np.rint(1e6 * hand.t).astype(int) + 77
    rows = [
        report(int(at), acc / GRAVITY, gyr, 9000 - int(at) % 9000)
        for at, acc, gyr in zip(us, hand.acc, np.degrees(hand.gyr), strict=True)
    ]

    def play() -> None:
        with motion.open("wb", buffering=0) as sensors, buttons.open("wb", buffering=0) as keys:
            for k in range(0, len(rows), 10):
                if k == 600:  # more than a pipe holds, so the recording has begun
                    keys.write(press() + press(down=False))
                sensors.write(b"".join(rows[k : k + 10]))

    thread = threading.Thread(target=play)
    thread.start()
    assert main(["record", "tea", "--sensor", "gamepad"]) == 0
    thread.join()
    recording = read_demo(Path("demos/tea")).recording
    assert len(recording) == len(hand)
    assert_allclose(recording.t, hand.t, atol=2e-6)
    assert_allclose(recording.acc, hand.acc, atol=GRAVITY / 8192)
    assert_allclose(not_none(recording.gyr), hand.gyr, atol=np.radians(1 / 1024))
    assert [grip.closed for grip in recording.grip] == [True]


def test_unplugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = fifo(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", Kernel().ioctl)
    port = GamepadPort(str(motion))
    port.read()
    with motion.open("wb", buffering=0) as writer:
        writer.write(report(0, LEVEL, (0, 0, 0))[:50])
    assert len(port.read()) == 50
    with pytest.raises(SensorError, match="is gone: the gamepad was unplugged, or fell asleep") as caught:
        port.read()
    assert caught.value.fields["lost"]
    port.close()


class Kernel:
    """An input device's ioctls: the axes with their fuzz, as hid-playstation sets them."""

    def __init__(self, resolution: tuple[int, int] = (8192, 1024)) -> None:
        self.info = {axis: [axis * 100, -32768, 32767, 16, 0, resolution[axis // 3]] for axis in range(6)}

    def ioctl(self, fd: int, request: int, argument: bytes) -> bytes:
        number = request & 0xFF
        assert (request >> 8) & 0xFF == ord("E")
        assert (request >> 16) & 0x3FFF == gamepad_port.ABSINFO.size
        if number >= 0xC0:
            self.info[number - 0xC0] = list(gamepad_port.ABSINFO.unpack(argument))
            return argument
        return gamepad_port.ABSINFO.pack(*self.info[number - 0x40])


def test_the_kernels_filter_is_off_while_it_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel, motion = Kernel(), fifo(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", kernel.ioctl)
    port = GamepadPort(str(motion))
    assert {info[3] for info in kernel.info.values()} == {0}
    axes_as_they_are = b"".join(event(3, axis, 100 * axis) for axis in range(6))
    assert port.read() == event(4, 3, 8192) + axes_as_they_are
    port.close()
    assert {info[3] for info in kernel.info.values()} == {16}


def test_a_loss_is_followed_by_the_axes_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel, motion = Kernel(), fifo(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", kernel.ioctl)
    port = GamepadPort(str(motion))
    port.read()
    with motion.open("wb", buffering=0) as writer:
        writer.write(event(0, 3, 0))
        assert port.read() == event(0, 3, 0) + b"".join(event(3, axis, 100 * axis) for axis in range(6))
    port.close()


def test_another_motion_sensor_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for resolution, said in (((16384, 131), "16384 for a unit of axis 0"), ((4096, 1024), "1024 for a unit of axis 3")):
        monkeypatch.setattr("fcntl.ioctl", Kernel(resolution).ioctl)
        with pytest.raises(SensorError, match=f"counts {said}: it is the motion sensor of no DualSense, "):
            GamepadPort(str(fifo(tmp_path, said)))


def test_what_is_no_input_device_is_no_gamepad() -> None:
    with pytest.raises(SensorError, match="counts 0 for a unit of axis 0: it is the motion sensor of no DualSense"):
        GamepadPort("/dev/null")


def test_a_joy_con_has_its_own_scale_axes_and_stamps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """hid-nintendo: x toward the triggers, y left, z up; 4096 counts are 1 g, 14247 are 1 deg/s; three in a report."""
    motion, buttons = fifo(tmp_path), fifo(tmp_path, "event6")
    monkeypatch.setattr("fcntl.ioctl", Kernel((4096, 14247)).ioctl)
    port = GamepadPort(str(motion), str(buttons))
    data = port.read()
    counts = {3: 14247, 4: -2 * 14247, 5: 3 * 14247, 0: 1024, 1: -2048, 2: 4096}
    reading = b"".join(event(3, code, value) for code, value in counts.items()) + event(0, 0, 0)
    with motion.open("wb", buffering=0) as sensors, buttons.open("wb", buffering=0) as keys:
        keys.write(event(3, 0, 32767) + event(3, 4, -32767) + event(1, 0x221, 1) + event(0, 0, 0))  # its stick
        data += port.read()
        sensors.write(b"".join(event(4, 5, us) + reading for us in (0, 5000, 10000)))
        data += port.read()
    port.close()
    decoder = GamepadDecoder()
    samples = decoder.feed(data)
    assert len(samples) == 3
    assert samples[0].acc == pytest.approx(np.array((0.5, 0.25, 1.0)) * GRAVITY)
    assert samples[0].gyr == pytest.approx(np.radians((2.0, 1.0, 3.0)))
    assert samples[0].t_device is None
    assert decoder.tally.grip_presses == 1


def test_a_stick_does_not_move_the_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sticks have the codes of the sensor's axes, in the buttons' device."""
    motion, buttons = fifo(tmp_path), fifo(tmp_path, "event6")
    monkeypatch.setattr("fcntl.ioctl", Kernel().ioctl)
    port = GamepadPort(str(motion), str(buttons))
    with motion.open("wb", buffering=0) as sensors, buttons.open("wb", buffering=0) as keys:
        sensors.write(report(4000, LEVEL, (0, 0, 0)))
        data = port.read()
        keys.write(event(3, 0, 255) + event(0, 0, 0))
        data += port.read()
        sensors.write(event(3, 1, 8000) + event(4, 5, 8000) + event(0, 0, 0))
        data += port.read()
    port.close()
    first, second = GamepadDecoder().feed(data)
    assert first.acc == pytest.approx((0.0, 0.0, GRAVITY))
    assert second.acc == pytest.approx((0.0, 0.0, GRAVITY * 8000 / 8192))


def test_the_buttons_are_those_of_the_same_pad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two pads of one name: /sys tells which input devices are one pad's. Another device's name may be any bytes."""
    monkeypatch.setattr(gamepad_port, "SYSFS_INPUT", tmp_path / "class")
    for number, pad, end in ((3, "A", ""), (4, "A", " Motion Sensors"), (5, "B", ""), (6, "B", " Motion Sensors")):
        (tmp_path / pad).mkdir(exist_ok=True)
        device = tmp_path / "class" / f"event{number}" / "device"
        device.mkdir(parents=True)
        (device / "name").write_text(f"DualSense{end}\n")
        (device / "device").symlink_to(tmp_path / pad)
    (other := tmp_path / "class" / "event7" / "device").mkdir(parents=True)
    (other / "name").write_bytes(b"M\xfcller")
    found = gamepad_port.find_gamepads()
    assert found == {
        "/dev/input/event4": ("DualSense", "/dev/input/event3"),
        "/dev/input/event6": ("DualSense", "/dev/input/event5"),
    }
    with pytest.raises(SensorError, match=r"several gamepads are there: /dev/input/event4 \(DualSense\), .*name a --p"):
        open_gamepad(None)
    monkeypatch.setattr(gamepad_port, "SYSFS_INPUT", tmp_path / "nothing")
    with pytest.raises(SensorError, match="no gamepad with motion sensors is there: connect a DualSense"):
        open_gamepad(None)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("event5", "no permission for .*event5: add yourself with `sudo usermod -aG input"),
        ("event6", "can't be opened .No such file or directory.; connect the gamepad, or name another --port"),
    ],
)
def test_a_device_that_cannot_be_opened(tmp_path: Path, name: str, told: str) -> None:
    fifo(tmp_path).chmod(0)
    with as_a_user(), pytest.raises(SensorError, match=told):
        GamepadPort(str(tmp_path / name))
