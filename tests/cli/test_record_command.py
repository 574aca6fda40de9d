"""`pbd record` as a process: with and without a terminal, killed, hung up; and its refusals."""

import argparse
import errno
import json
import os
import re
import select
import shlex
import signal
import subprocess
import sys
import threading
import time
import tty
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.cli import main
from pbd.cli.commands import parse
from pbd.cli.record import _report
from pbd.cli.recording.device import find_sensor, only_port
from pbd.cli.recording.keys import Keys
from pbd.errors import PbdError, SensorError
from pbd.files.demo import demo_folder, read_demo, write_demo
from pbd.record import Outcome
from pbd.sensors import probe
from pbd.sensors.port import PortInfo
from pbd.simulation.emulator import Emulator
from pbd.simulation.simulate import simulate
from tests.cli.pbd_process import Terminal, run_pbd
from tests.cli.run_command import Capture, refused, run
from tests.not_none import not_none
from tests.record.emulated_sensors import SPEAKERS, Device, random_hand
from tests.record.phone import Phone, streams_of


def test_at_a_terminal(tmp_path: Path) -> None:
    """Space marks, q asks first, Enter ends, the bell rings, and the terminal's settings are restored."""
    terminal = Terminal("record", "tea", "--sensor", "sim", cwd=tmp_path)
    terminal.until("Enter ends")
    terminal.until("\a")
    terminal.until("you may move")
    assert not terminal.echoes()
    terminal.type(" ")
    terminal.until("closed")
    terminal.type("q")
    terminal.until("discard this recording? y discards")
    terminal.type("n")
    terminal.until("Enter ends")
    terminal.type("\n")
    terminal.until("ended: stopped by you")
    terminal.until("fewer than two stops: nothing to replay; hold still")
    assert terminal.exit_code() == 0
    recording = read_demo(tmp_path / "demos" / "tea").recording
    assert len(recording) > 100
    assert [event.closed for event in recording.grip] == [True]


def test_a_discarded_recording_leaves_nothing(
    elsewhere: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo, keys = elsewhere / "demos" / "tea", iter("qy")
    monkeypatch.setattr(Keys, "next", lambda _: next(keys, "") if demo.exists() else "")
    code, out, error = run(capsys, "record", "tea", "--sensor", "sim")
    assert code == 0
    assert "discarded" in out + error
    assert next(keys, None) is None
    assert not demo.exists()


@pytest.mark.parametrize("hung_up", [True, False])
def test_ctrl_c_and_a_lost_connection_end_it_in_good_order(tmp_path: Path, hung_up: bool) -> None:
    terminal = Terminal("record", "tea", "--sensor", "sim", cwd=tmp_path)
    terminal.until("Hz,")
    if hung_up:
        terminal.hang_up()
    else:
        terminal.type("\x03")
        terminal.until("ended: stopped by you")
    assert terminal.exit_code() == 0
    recording = read_demo(tmp_path / "demos" / "tea").recording
    assert recording.info.rate_hz == pytest.approx(100.0, rel=1e-3)


def test_a_terminal_that_goes_without_a_signal_is_a_hang_up(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = os.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keys() as keys:
            assert keys.next() == ""
            os.close(master)
            assert (keys.next(), keys.signal) == (keys.END, signal.SIGHUP)


def test_another_key_than_enter_cancels(monkeypatch: pytest.MonkeyPatch) -> None:
    pressed = iter(("", "n"))
    monkeypatch.setattr(Keys, "next", lambda _: next(pressed))
    with pytest.raises(PbdError, match="cancelled: run it again when you are ready"):
        Keys().ask("Enter starts it")


def test_nohup_outlives_a_hang_up() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Keys() as keys:
            assert not keys.terminal
            os.kill(os.getpid(), signal.SIGHUP)
            assert keys.next() == ""
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_stopped_for_a_while_it_goes_on(tmp_path: Path) -> None:
    """After Ctrl-Z the gap is not taken for a silent sensor."""
    patient = "from pbd.record import sensor_connection as s; s.SILENT_S = 1.2; from pbd.cli import main; exit(main())"
    with Emulator(simulate("pour", "modern", 1).recording) as sensor:
        words = ["record", "tea", "--sensor", "ximu3", "--port", sensor.device, "--baud", "115200", "--duration", "3"]
        process = subprocess.Popen(
            [sys.executable, "-c", patient, *words],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        while not (tmp_path / "demos" / "tea" / "imu.csv").exists():
            time.sleep(0.01)
        process.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        time.sleep(2.5)  # longer than MAX_BACKLOG_S
        stood_s = time.monotonic() - stopped
        process.send_signal(signal.SIGCONT)
        out, error = process.communicate(timeout=60)
    told = not_none(re.search(r"this program did not run for ([\d.]+) s", error))
    assert float(told[1]) > stood_s - 0.1
    assert "ended: 3 s recorded" in out
    assert process.returncode == 0


def test_nobody_reads_what_it_prints(tmp_path: Path) -> None:
    process = run_pbd("record", "tea", "--sensor", "sim", "--duration", "1.5", cwd=tmp_path)
    assert process.stderr is not None
    assert process.stderr.readline().startswith("recording demos/tea from sim (x-IMU3); hold still")
    process.stderr.close()
    assert process.wait(60) == 0
    assert process.stdout is not None
    assert "ended: 1.5 s recorded" in process.stdout.read()
    process.stdout.close()
    assert read_demo(tmp_path / "demos" / "tea").recording.t[-1] >= 1.5


def test_without_a_terminal_it_prints_lines_and_a_signal_ends_it(tmp_path: Path) -> None:
    process = run_pbd("record", "tea", "--sensor", "sim", "--json", cwd=tmp_path)
    for line in not_none(process.stderr):
        if "you may move" in line:
            break
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    told = json.loads(out)
    assert told["demo"] == "demos/tea"
    assert told["ended_by"] == "stopped by you"
    assert len(read_demo(tmp_path / "demos" / "tea").recording) == told["samples"]


def test_a_killed_recording_has_all_but_the_last_quarter_second(tmp_path: Path) -> None:
    process = run_pbd("record", "tea", "--sensor", "sim", cwd=tmp_path)
    imu = tmp_path / "demos" / "tea" / "imu.csv"
    while not imu.exists():
        time.sleep(0.01)
    moments = [time.monotonic()]
    while moments[-1] - moments[0] < 1.0:
        time.sleep(0.01)
        moments.append(time.monotonic())
    process.kill()
    process.communicate(timeout=60)
    assert imu.read_text().endswith("\n")
    recording = read_demo(imu.parent).recording
    held_up = float(np.diff(moments).max()) - 0.01  # s that a busy machine held this test up at worst, and `pbd` too
    # the folder holds LOOK_S already when it appears
    assert recording.t[-1] >= moments[-1] - moments[0] - 0.25 - 3.0 * held_up


def folders(tmp_path: Path) -> list[str]:
    return sorted(folder.name for folder in (tmp_path / "demos").iterdir())


def test_discarding_a_forced_recording_brings_the_old_one_back(tmp_path: Path) -> None:
    assert main(["simulate", "pour", str(tmp_path / "demos" / "tea")]) == 0
    before = (tmp_path / "demos" / "tea" / "imu.csv").read_bytes()
    terminal = Terminal("record", "tea", "--sensor", "sim", "--force", cwd=tmp_path)
    terminal.until("Hz,")
    terminal.type("qy")
    terminal.until("the old demos/tea is back")
    terminal.until("discarded")
    assert terminal.echoes()
    assert terminal.exit_code() == 0
    assert folders(tmp_path) == ["tea"]
    assert (tmp_path / "demos" / "tea" / "imu.csv").read_bytes() == before


def test_a_killed_forced_recording_leaves_the_old_one_beside_and_the_next_does_so_too(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["simulate", "pour", str(tmp_path / "demos" / "tea")]) == 0
    before = (tmp_path / "demos" / "tea" / "imu.csv").read_bytes()
    (tmp_path / "demos" / "tea" / "keyframes.toml").write_text("as a person left it")
    process = run_pbd("record", "tea", "--sensor", "sim", "--force", cwd=tmp_path)
    told = next(line for line in not_none(process.stderr) if "demos/tea.before" in line)
    assert told.endswith("the old one is in demos/tea.before\n")
    process.kill()
    process.communicate(timeout=60)
    assert folders(tmp_path) == ["tea", "tea.before"]
    monkeypatch.chdir(tmp_path)
    code, out, error = run(capsys, "record", "tea", "--sensor", "sim", "--force", "--duration", "1.6")
    assert code == 0, error
    assert "the old one is in demos/tea.before-2 until this one has ended well\n" in error
    assert "so the old one is kept in demos/tea.before-2; to have it back, remove demos/tea and rename" in error
    assert out.endswith(
        "fewer than two stops: nothing to replay; hold still for two seconds, then move, stop, move, stop\n"
    )
    assert folders(tmp_path) == ["tea", "tea.before", "tea.before-2"]
    assert (tmp_path / "demos" / "tea.before" / "imu.csv").read_bytes() == before
    assert (tmp_path / "demos" / "tea.before" / "keyframes.toml").exists()


def test_a_take_leads_to_the_next_one_and_to_what_is_made_of_them(elsewhere: Path, capsys: Capture) -> None:
    assert refused(capsys, 2, "record", "--take", "2").endswith("needs the task's NAME: pbd record tea --take 2")
    words = shlex.split(
        "--sensor lines --baud 115200 --columns t,ax,ay,az,gx,gy,gz --unit acc='0.001 g' --separator ';'"
        " --prefix 'IMU ' --wrap 65536 --grip tap --closed --tolerance 2"
    )
    _, _, err = run(capsys, "record", "my tea", "--take", "2", "--port", "/dev/nothing", *words)
    assert err.startswith("pbd: take 2: turn the sensor by a quarter about the vertical, as it lies at the dock: ")
    for take in (1, 2):
        write_demo(simulate("pick-and-place-direct"), demo_folder(f"my tea{take}"))
        args = parse(["record", "my tea", "--take", f"{take}", "--port", "/dev/x", *words])
        args.json = False
        _report(args, Outcome(demo_folder(f"my tea{take}"), 100, 1.0, 0, 0, stops=2, ended_by="you"))
        line = capsys.readouterr().out.splitlines()[-1]
        again, _, fuse = line.removeprefix("next: ").partition("; or ")
        more = parse(shlex.split(again)[1:])
        args.take += 1
        assert {name: getattr(more, name) for name in vars(args)} == vars(args)
        assert fuse == ("" if take == 1 else "pbd fuse 'my tea1' 'my tea2' -o 'my tea'")


@pytest.mark.parametrize(("usable", "fuse"), [((1, 3), "pbd fuse tea1 tea3 -o tea"), ((3,), "")])
def test_a_take_that_failed_or_is_missing_is_not_fused(
    elsewhere: Path, capsys: Capture, usable: tuple[int, ...], fuse: str
) -> None:
    demo = simulate("pick-and-place-direct")
    for take in (2, *usable):
        write_demo(replace(demo, failed=take not in usable), demo_folder(f"tea{take}"))
    _report(
        parse(["record", "tea", "--take", "3"]), Outcome(demo_folder("tea3"), 100, 1.0, 0, 0, stops=2, ended_by="you")
    )
    assert capsys.readouterr().out.splitlines()[-1].partition("; or ")[2] == fuse


@pytest.mark.parametrize("name", ["tea 9/x", "../oops", "./-x", "./~it's"])
def test_the_next_command_that_it_prints_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    folder = demo_folder(name)
    write_demo(simulate("pick-and-place-direct"), folder)
    _report(
        argparse.Namespace(json=False, take=None, rate=None), Outcome(folder, 100, 1.0, 0, 0, stops=2, ended_by="you")
    )
    program, *words = shlex.split(capsys.readouterr().out.splitlines()[-1].removeprefix("next: "))
    assert program == "pbd"
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


def test_a_recording_that_cannot_be_tracked_says_so_at_its_end(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = Outcome(Path("demos/stuck"), 100, 1.0, 0, 0, stops=2, ended_by="you", why_failed="it is frozen")
    with pytest.warns(UserWarning, match=r"^demos/stuck/imu.csv: it is frozen$"):
        _report(argparse.Namespace(json=False, take=None, rate=None), outcome)
    assert "next:" not in capsys.readouterr().out
    _report(argparse.Namespace(json=True, take=None, rate=None), outcome)
    assert json.loads(capsys.readouterr().out)["why"] == "it is frozen"


@pytest.mark.parametrize(("number", "code"), [(errno.ENOSPC, 1), (errno.EPIPE, 141), (errno.EIO, 0)])
def test_a_recording_whose_end_nobody_can_read_is_kept(
    elsewhere: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, number: int, code: int
) -> None:
    """A full disk, a reader that has gone, and a terminal that was closed, which is no fault of the recording."""

    def unwritable(*given: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("pbd.cli.record._report", unwritable)
    found, _, err = run(capsys, "record", "tea", "--sensor", "sim", "--duration", "0.5")
    assert found == code
    assert err.endswith("(No space left on device); send it elsewhere\n") is (code == 1)
    assert len(read_demo(elsewhere / "demos" / "tea").recording) > 20


def test_a_simulated_task_grips_by_itself_and_ends_it_where_nobody_could(elsewhere: Path, capsys: Capture) -> None:
    code, out, error = run(capsys, "record", "tea", "--sensor", "sim:pick-and-place-direct", "--json")
    assert code == 0, error
    assert json.loads(out)["ended_by"] == "simulated task finished"
    assert error.count("the simulated task is finished: it ends here") == 1
    task = simulate("pick-and-place-direct", "modern").recording
    recording = read_demo(elsewhere / "demos" / "tea").recording
    assert recording.info.sensor == "sim (x-IMU3)"
    assert recording.t[-1] >= task.t[-1] - 0.25  # what came before the port was open, and after the last look
    assert [event.closed for event in recording.grip] == [event.closed for event in task.grip]
    assert recording.grip[0].t == pytest.approx(task.grip[0].t, abs=0.3)


@pytest.mark.parametrize(
    ("code", "words", "message"),
    [
        (2, ("--sensor", "witmotoin"), "sensor 'witmotoin' is unknown"),  # before the name, which is taken
        (2, ("--sensor", "sim:juggle"), "juggle"),
        (2, ("--sensor", "sim", "--rate", "50"), "a simulated sensor has no port, baud, rate or unit to choose; leave"),
        (2, ("--sensor", "sim", "--unit", "acc=g"), "leave out --port, --baud, --rate, --unit"),
        (2, ("--sensor", "sim", "--columns", "t,ax,ay,az"), "are for --sensor lines; leave them out for sim"),
        (
            2,
            ("--sensor", "gamepad", "--rate", "50"),
            "a gamepad has no baud or rate to choose; leave out --baud, --rate",
        ),
        (2, ("--sensor", "witmotion", "--wrap", "9"), "are for --sensor lines; leave them out for witmotion"),
        (2, ("--port", "http://127.0.0.1:1", "--prefix", "x"), "are for --sensor lines; leave them out for phyphox"),
        (2, ("--port", "http://127.0.0.1:1", "--unit", "acc=g"), "phyphox has fixed units: leave it out"),
        (1, ("--sensor", "witmotion", "--port", "/dev/null", "--baud", "9600"), "/dev/null is not a serial port"),
        (2, ("--sensor", "xsens", "--unit", "gyr=deg/s", "--port", "/dev/null"), "xsens has fixed units: leave it out"),
        (2, ("--sensor", "razor", "--unit", "gyr=turns", "--port", "/dev/null"), "'turns' is not a unit of gyr"),
    ],
)
def test_what_can_not_be_opened_is_told(
    capsys: Capture, elsewhere: Path, code: int, words: tuple[str, ...], message: str
) -> None:
    if "witmotoin" in words:
        (elsewhere / "demos" / "tea").mkdir(parents=True)
    assert message in refused(capsys, code, "record", "tea", *words)


def bytes_of(name: str, rows: int = 400) -> tuple[bytes, ...]:
    hand = random_hand(rows, seed=1)
    return tuple(SPEAKERS[name].encode(hand, row) for row in range(rows))


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "it is silent at every baud rate; check that the sensor is on and sends by itself"),
        (
            b"0.01,0.02,0.98\r\n",
            r"it prints lines such as '0.01,0.02,0.98' .3 numbers.; give --sensor lines --columns ",
        ),
        (b"\xf0\x0f garbage ", r"\d+ bytes came in no known protocol; give --sensor and --baud"),
    ],
)
def test_a_device_that_is_not_recognised(
    capsys: Capture, elsewhere: Path, monkeypatch: pytest.MonkeyPatch, data: bytes, why: str
) -> None:
    monkeypatch.setattr(probe, "LISTEN_S", 0.05)
    monkeypatch.setattr(probe, "BOOT_S", 0.05)
    with Device([data], 400.0, again=True) as device:
        monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: (PortInfo(device.device, "", "0403:6001"),))
        device.go()
        code, _, error = run(capsys, "record", "tea")
    assert code == 1
    assert re.search(f"pbd: the protocol of {device.device} is not recognised: {why}", error)


def test_the_only_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    built_in, one, other = (PortInfo(f"/dev/{name}", "", usb) for name, usb in (("S0", ""), ("U1", "a"), ("U2", "b")))
    for ports, message in (
        ((built_in,), "no USB serial port has anything plugged in; plug the arm in, or name its --port"),
        ((built_in, one, other), r"several ports have something plugged in \(/dev/U1, /dev/U2\); name a --port"),
    ):
        monkeypatch.setattr("pbd.sensors.port.list_ports", lambda ports=ports: ports)
        with pytest.raises(SensorError, match=message):
            only_port("arm", "")
    monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: (built_in, other))
    assert only_port() == "/dev/U2"


def test_a_sensor_that_is_plugged_in_again_may_have_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    with Device((), 1.0) as before, Device((), 1.0) as after:
        monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: (PortInfo(before.device, "", "0403:6001"),))
        _, opened, _ = find_sensor(parse(["record", "tea", "--sensor", "xsens", "--baud", "115200"]))
        monkeypatch.setattr("pbd.sensors.port.list_ports", lambda: (PortInfo(after.device, "", "0403:6001"),))
        with opened() as port:
            assert port.device == after.device


def test_the_baud_rate_of_a_named_sensor_is_found(
    capsys: Capture, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "BOOT_S", 0.05)
    with Device(bytes_of("xsens"), 400.0, again=True) as device:
        device.go()
        words = ("--sensor", "xsens", "--port", device.device, "--duration", "0.5")
        code, _, error = run(capsys, "record", "tea", *words)
    assert code == 0, error
    assert f"looking for the baud rate of {device.device} ..." in error


def test_a_phone_is_recorded_under_its_models_name(capsys: Capture, elsewhere: Path) -> None:
    hand = simulate("pour", "modern", 1).recording
    with Phone(streams_of({"acc": hand, "gyr": hand})) as phone:
        code, _, error = run(capsys, "record", "tea", "--port", phone.address, "--duration", "0.5")
        assert code == 0, error
        assert read_demo(elsewhere / "demos" / "tea").recording.info.sensor == "phyphox (Test Phone)"
        _, opened, _ = find_sensor(parse(["record", "tea", "--port", phone.address]))
        opened().close()
        phone.offline = True
        with pytest.raises(SensorError, match="does not answer"):
            opened()


def test_a_device_is_recognised_set_and_recorded(elsewhere: Path, capsys: Capture) -> None:
    """Only the port and the rate are given."""
    packets = bytes_of("os5000")
    with Device(packets, 200.0, again=True) as device:
        heard: list[bytes] = []
        tty.setraw(device.master)

        def listen() -> None:
            if select.select([device.master], [], [], 20.0)[0]:
                heard.append(os.read(device.master, 100))

        listener = threading.Thread(target=listen, daemon=True)
        listener.start()
        device.go()
        words = ("--port", device.device, "--rate", "40", "--duration", "1", "--json")
        code, out, error = run(capsys, "record", "tea", *words)
        listener.join(5.0)
    assert code == 0, error
    assert heard == [b"\x1bR40 "]
    assert f"listening to {device.device} ..." in error
    assert re.search(r"warning: the sensor sends \d+ samples a second, not the 40 of --rate", error)  # it sends 200
    told = json.loads(out)
    assert told["ended_by"] == "1 s recorded"
    got = read_demo(elsewhere / "demos" / "tea").recording
    assert got.info.sensor == "os5000"
    assert len(got) == told["samples"] > 100


def test_a_missing_unit_is_named_at_the_end_and_not_taken_for_a_hand_that_never_stopped(
    elsewhere: Path, capsys: Capture
) -> None:
    """The lines are in g. What is advised brings this recording in."""
    words = ["--sensor", "lines", "--baud", "115200", "--duration", "2.5", "--columns", "t,ax,ay,az,gx,gy,gz"]
    still = np.random.default_rng(0).normal((0, 0, 1, 0, 0, 0), 0.002, (400, 6))
    lines = [",".join(f"{value:.5f}" for value in (k / 100.0, *row)) + "\n" for k, row in enumerate(still)]
    lines[99] = "MPU9250 ok\n"
    with Device([line.encode() for line in lines], 100.0) as device:
        threading.Timer(0.3, device.go).start()
        code, out, error = run(capsys, "record", "tea", "--port", device.device, *words)
    assert code == 0
    assert ", 1 bad packets (the last: it has 1 column, not 7), " in out
    assert "fewer than two stops" not in out
    assert "warning: demos/tea/imu.csv: at rest the accelerometer reads " in error
    assert "likely in g: import the file with --unit acc=g" in error
    assert run(capsys, "import", "demos/tea/imu.csv", "tea2", "--unit", "acc=g")[0] == 0


def test_raw_bytes_of_lines_are_decoded_again(elsewhere: Path) -> None:
    described = ["--columns", "t,ax,ay,az,gx,gy,gz", "--unit", "t=us", "--unit", "acc=g", "--unit", "gyr=deg/s"]
    with Device(bytes_of("lines"), 100.0) as device:
        threading.Timer(0.3, device.go).start()
        recorded = ["--port", device.device, "--baud", "115200", "--raw", "--duration", "0.8"]
        assert main(["record", "tea", "--sensor", "lines", *recorded, *described]) == 0
    assert main(["import", "demos/tea/raw.bin", "again", "--sensor", "lines", *described]) == 0
    tea, again = (read_demo(elsewhere / "demos" / name).recording for name in ("tea", "again"))
    assert len(tea) >= 78
    assert again.t == pytest.approx(tea.t, abs=1e-6)
    assert again.acc == pytest.approx(tea.acc, abs=1e-5)
    assert np.isfinite(not_none(again.gyr)).all()
