"""Recording from a phone: an HTTP server on loopback that does what phyphox does, and what can go wrong with one."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest

from pbd.data import Recording
from pbd.errors import SensorError
from pbd.files.demo import read_demo
from pbd.record import Command, Outcome, RecordOptions, Status, record, sensor_connection
from pbd.record.redecode import decode_raw
from pbd.sensors.decoding import Sample
from pbd.sensors.phyphox import phone as phone_port
from pbd.sensors.phyphox.answers import BUFFERS, PhyphoxDecoder, read_answer, read_clock_events
from pbd.sensors.phyphox.phone import PhonePort
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.record.phone import Phone, streams_of
from tests.tracking.tapping import tapped

RATES = {"acc": 200.0, "gyr": 400.0, "mag": 50.0}


@pytest.fixture(scope="module")
def hands() -> dict[str, Recording]:
    """The same hand, felt by three sensors without errors at rates of their own."""
    way = (Waypoint(rest_s=0.3), Waypoint((0.2, 0.1, 0.1), (0.5, 0.3, 0.2), move_s=0.9, rest_s=30.0))
    return {kind: simulate(Task("hurried", way), "ideal", rate_hz=hz).recording for kind, hz in RATES.items()}


@pytest.fixture
def phone(hands: dict[str, Recording]) -> Iterator[Phone]:
    with Phone(streams_of(hands)) as phone:
        yield phone


def later(phone: Phone, *acts: tuple[float, Callable[[], object]]) -> None:
    """Do each when the phone has measured for so many seconds and was asked for it a few times, beside the test."""

    def wait() -> None:
        for at, act in acts:
            while phone.t < at or sum(path.startswith("/get?") for path in phone.asked) < 5:
                time.sleep(0.01)
            act()

    threading.Thread(target=wait, daemon=True).start()


def hear(port: PhonePort, decoder: PhyphoxDecoder, samples: list[Sample], until_s: float) -> None:
    """Listen until a sample of that time came; a busy machine takes longer."""
    end = time.monotonic() + 30.0
    while not samples or (samples[-1].t_device or 0.0) < until_s:
        assert time.monotonic() < end, "the phone fell silent"
        samples += decoder.feed(port.read())


def heard(phone: Phone, until_s: float) -> list[Sample]:
    """What comes until a sample of that time."""
    samples = list[Sample]()
    with PhonePort(phone.address) as port:
        hear(port, PhyphoxDecoder(), samples, until_s)
    return samples


def times(samples: list[Sample]) -> np.ndarray:
    return np.array([sample.t_device for sample in samples])


def recorded(phone: Phone, folder: Path, **given: Any) -> tuple[Outcome, list[str]]:
    said, opened = list[str](), list[PhonePort]()

    def show(status: Status) -> None:
        said.extend(say.text for say in status.messages)

    def again() -> PhonePort:
        if opened:
            opened[0].connect()
        else:
            opened.append(PhonePort(phone.address))
        return opened[0]

    def nothing() -> Command | None:
        return None

    wanted = RecordOptions(folder, "phyphox (Test Phone)", "2026-01-02T03:04:05Z", raw=True, **given)
    return record(again, PhyphoxDecoder(), wanted, nothing, show), said


def test_three_sensors_come_as_one_on_the_gyros_clock(
    tmp_path: Path, phone: Phone, hands: dict[str, Recording]
) -> None:
    """A lost network costs nothing: the phone keeps what it measured."""
    later(phone, (0.6, lambda: setattr(phone, "offline", True)), (0.9, lambda: setattr(phone, "offline", False)))
    outcome, _ = recorded(phone, tmp_path / "tea", duration_s=1.3)
    got = read_demo(tmp_path / "tea").recording
    assert outcome.lost == 0
    assert got.info.clock == "device"
    assert got.info.sensor == "phyphox (Test Phone)"
    assert np.diff(got.t) == pytest.approx(0.0025, abs=2e-5)
    assert got.gyr is not None
    assert got.mag is not None
    # The gyro begins 1.3 ms after the accelerometer, the field 1.3 ms later (`streams_of`): no sample is moved.
    for kind, values, late in (("gyr", got.gyr, 0.0), ("acc", got.acc, 0.0013), ("mag", got.mag, -0.0013)):
        hand = hands[kind]
        right = np.column_stack([np.interp(got.t + late, hand.t, axis) for axis in getattr(hand, kind).T])
        known = np.isfinite(values[:, 0])
        assert known.mean() > 0.95
        assert values[known] == pytest.approx(right[known], abs=1e-4), kind
    again = decode_raw(tmp_path / "tea" / "raw.bin", PhyphoxDecoder(), "phyphox").recording
    assert again.acc == pytest.approx(got.acc, abs=1e-6)
    assert again.t == pytest.approx(got.t, abs=1e-6)


def test_pauses_and_clearing_on_the_phone_are_gaps_as_long_as_they_were(phone: Phone) -> None:
    """The samples that were cleared before pbd read them make a gap longer: each run begins when it was started."""
    decoder, samples = PhyphoxDecoder(), list[Sample]()
    with PhonePort(phone.address) as port:
        hear(port, decoder, samples, 0.3)
        phone.pause()
        time.sleep(0.3)
        phone.start()
        hear(port, decoder, samples, 0.8)
        phone.clear()
        time.sleep(0.2)
        phone.start()
        hear(port, decoder, samples, 1.3)
    t = times(samples)
    steps = np.diff(t)
    assert (steps > 0.0).all()
    first = t[np.r_[True, steps > 0.01]]
    began, paused, again, anew = (moment for _, moment in phone.pressed)
    assert first - first[0] == pytest.approx([0.0, again - began, anew - began], abs=0.01)
    assert t[t < first[1]][-1] - t[0] == pytest.approx(paused - began, abs=0.01)


def test_no_sample_comes_before_an_earlier_one_where_a_clearing_is_late() -> None:
    """The phone says that it started anew 20 ms before its last sample: the new ones until then are left out."""

    def told(begun: float, t: np.ndarray) -> bytes:
        moments = [{"event": "START", "experimentTime": 0.0, "systemTime": begun}]
        rows = {name: {"buffer": t.tolist()} for name in ("gyr_time", "acc_time")}
        rows |= {f"{kind}{axis}": {"buffer": [1.0] * len(t)} for kind in ("gyr", "acc") for axis in "XYZ"}
        return f"/time {json.dumps(moments)}\n/get {json.dumps({'buffer': rows})}\n".encode()

    decoder = PhyphoxDecoder()
    t = times(decoder.feed(told(100.0, 0.01 * np.arange(100))) + decoder.feed(told(100.97, 0.01 * np.arange(50))))
    assert (np.diff(t) > 0.0).all()
    assert len(t) == pytest.approx(147, abs=2)


def test_a_phone_that_sleeps_ends_the_recording_with_what_it_has(
    tmp_path: Path, phone: Phone, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phone_port, "PATIENCE_S", 0.6)
    later(phone, (0.6, lambda: setattr(phone, "offline", True)))
    outcome, _ = recorded(phone, tmp_path / "tea")
    assert outcome.ended_by.startswith("the phone does not answer")
    assert 0.0 < outcome.duration_s < phone.t
    assert len(read_demo(tmp_path / "tea").recording) == outcome.samples


def test_reconnecting_goes_on_with_the_first_sample_not_yet_read(
    tmp_path: Path, phone: Phone, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is told once that the phone is silent, though it is waited for first, and given up then."""
    monkeypatch.setattr(phone_port, "PATIENCE_S", 1.0)
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.6)
    later(phone, (0.5, lambda: setattr(phone, "offline", True)), (2.1, lambda: setattr(phone, "offline", False)))
    outcome, said = recorded(phone, tmp_path / "tea", reconnect=True, duration_s=2.6)
    assert outcome.lost == 0
    assert [text.endswith("(waiting)") for text in said if text.startswith("the phone does not answer")] == [True]
    assert "the sensor is back" in said
    assert np.diff(read_demo(tmp_path / "tea").recording.t).max() < 0.01


def endless(handler: Any) -> None:
    handler.send_response(200)
    handler.end_headers()
    handler.close_connection = True
    while True:
        handler.wfile.write(b'{"buffer":{"accX":{"buffer":[' + b"1," * 50_000)


def slow(handler: Any) -> None:
    handler.send_response(200)
    handler.end_headers()
    handler.close_connection = True
    for _ in range(100):
        handler.wfile.write(b"[")
        time.sleep(0.05)


def with_rows(*rows: object) -> bytes:
    return json.dumps(
        {"buffer": {name: {"buffer": list(rows)} for name in ("acc_time", "accX", "accY", "accZ")}}
    ).encode()


HOSTILE: list[Any] = [
    b'{"buffer":{"acc_time":{"buffer":[NaN,Infinity]},"accX":{"buffer":[1,2]}}}',
    with_rows(float("nan"), float("inf"), None),
    with_rows("1e3", "rm"),
    with_rows(True, False),
    with_rows(1e300, -1e300),
    with_rows(10**400),
    b'{"buffer":{"acc_time":{"buffer":[' + b"9" * 6000 + b"]}}}",
    b"[" * 200_000,
    b'{"buffer":{"acc_time":{"buf',
    b"{}",
    b"<html>router login</html>",
    bytes(range(256)),
    endless,
    slow,
]


def test_hostile_answers_cost_nothing_but_their_time(phone: Phone, monkeypatch: pytest.MonkeyPatch) -> None:
    """They end nothing, and no sample comes of them; what the phone measured meanwhile is read afterwards."""
    monkeypatch.setattr(phone_port, "ANSWER_S", 0.2)
    monkeypatch.setattr(phone_port, "POLL_S", 0.02)
    monkeypatch.setattr(phone_port, "LONGEST_ANSWER", 2_000_000)
    decoder, samples = PhyphoxDecoder(), list[Sample]()
    with PhonePort(phone.address) as port:
        for body in HOSTILE:
            phone.body = body
            asked = len(phone.asked)
            while not any(path.startswith("/get") for path in phone.asked[asked:]):
                samples += decoder.feed(port.read())
            phone.body = b""
            hear(port, decoder, samples, phone.t)
    assert np.diff(times(samples)).max() < 0.01
    assert max(abs(x) for sample in samples for x in sample.acc or ()) < 30.0


def dripping(handler: Any) -> None:
    handler.close_connection = True
    for byte in b"HTTP/1.1 200 OK\r\nX: " + bytes(80):
        handler.wfile.write(bytes([byte]))
        time.sleep(0.05)


def test_an_answer_whose_header_drips_holds_up_no_recording(phone: Phone, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phone_port, "ANSWER_S", 0.2)
    with PhonePort(phone.address) as port:
        began = time.monotonic()
        phone.answer = lambda path, query: dripping  # type: ignore[method-assign]
        while "timed out" not in port.trouble:
            port.read()
        assert time.monotonic() - began < 2.0


def test_hostile_answers_to_the_first_question_are_no_phone_at_most(phone: Phone) -> None:
    for body in (body for body in HOSTILE if isinstance(body, bytes)):
        phone.body = body
        with suppress(SensorError), PhonePort(phone.address):
            pass


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("http://127.0.0.1:1", "does not answer (Connection refused)"),
        ("http://127.0.0.1:99999", "is no address of a phone"),
        ("http://127.0.0.1/get", "is no address of a phone"),
        ("http://user:word@127.0.0.1", "is no address of a phone"),
        ("http://127.0.0.1?acc_time=full", "is no address of a phone"),
        ("http://:8080", "is no address of a phone"),
        ("ftp://phone", "is no address of a phone"),
    ],
)
def test_no_phone_is_one_line(address: str, said: str) -> None:
    with pytest.raises(SensorError) as error:
        PhonePort(address)
    assert said in error.value.message


def test_another_experiment_and_another_server_are_told(hands: dict[str, Recording]) -> None:
    stock = {"acc": ("accT", "accx", "accy", "accz")}
    with Phone(streams_of({"acc": hands["acc"]}), names=stock) as phone:
        with pytest.raises(SensorError, match=r"another experiment than pbd's .* `pbd sensors phyphox`"):
            PhonePort(phone.address)
        phone.body = b"<html>"
        with pytest.raises(SensorError, match="is no phyphox: scan the code"):
            PhonePort(phone.address)


def test_an_app_that_tells_no_times_is_too_old(phone: Phone) -> None:
    """Of phyphox 1.1.7, which has neither /meta nor /time."""
    newer = phone.answer
    phone.answer = lambda path, query: b"" if path in ("/meta", "/time") else newer(path, query)  # type: ignore[method-assign]
    with pytest.raises(
        SensorError, match=r"does not report its times \(/time\), as version 1\.1\.8 and later do: update the"
    ):
        PhonePort(phone.address)


def test_a_phone_that_does_not_start_is_told(phone: Phone) -> None:
    answer = phone.answer
    phone.answer = lambda path, query: b'{"result": false}' if path == "/control" else answer(path, query)  # type: ignore[method-assign]
    with pytest.raises(SensorError, match="does not start to measure: press its play button"):
        PhonePort(phone.address)


def test_a_server_that_closes_each_connection_is_asked_again(phone: Phone) -> None:
    def closing(handler: Any) -> None:
        text = answer("/get", dict(parse_qsl(urlsplit(handler.path).query, keep_blank_values=True)))
        handler.send_response(200)
        handler.send_header("Connection", "close")
        handler.send_header("Content-Length", str(len(text)))
        handler.end_headers()
        handler.wfile.write(text)

    answer = phone.answer
    phone.answer = lambda path, query: closing if path == "/get" else answer(path, query)  # type: ignore[method-assign]
    assert len(heard(phone, 0.5)) > 100


def test_a_paused_phone_and_another_experiment_are_told_while_it_waits(
    tmp_path: Path, phone: Phone, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pause_a_while() -> None:
        phone.pause()
        time.sleep(1.3)
        phone.start()

    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.6)
    other = b'{"buffer": {"x": {"buffer": [1]}}, "status": {"measuring": true}}'
    acts = (
        (0.6, lambda: setattr(phone, "body", other)),
        (1.8, lambda: setattr(phone, "body", b"")),
        (2.6, pause_a_while),
    )
    later(phone, *acts)
    _, said = recorded(phone, tmp_path / "tea", duration_s=4.3)
    told = [text for text in said if text.endswith(("(waiting)", "back"))]
    assert told == [
        "another experiment is open on the phone; open pbd's again (waiting)",
        "the sensor is back",
        "the measurement is paused on the phone; press its play button (waiting)",
        "the sensor is back",
    ]


def test_a_phone_that_never_sends_is_told(tmp_path: Path, phone: Phone, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.4)
    answer = phone.answer
    empty: dict[str, Any] = {name: {"buffer": []} for names in BUFFERS.values() for name in names}
    still = json.dumps({"buffer": empty, "status": {"measuring": False}}).encode()
    started = b'{"result": true}'
    phone.answer = lambda path, query: (  # type: ignore[method-assign]
        still if path == "/get" else started if path == "/control" else answer(path, query)
    )
    with pytest.raises(
        SensorError, match=r"nothing came from http.* in 0\.4 s: .* is paused on the phone; press its play"
    ):
        recorded(phone, tmp_path / "tea")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (b"1", "neither buffers nor clock events"),
        (b'[{"event": "START"}]', "no clock events"),
        (b"[3]", "no clock events"),
        (b'[{"event": "START", "experimentTime": -1, "systemTime": 1e9}]', "a clock event without a time"),
    ],
)
def test_what_is_no_answer_to_time(text: bytes, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read_clock_events(read_answer(text))


def test_rates_of_50_100_and_200_hz_are_joined() -> None:
    """A slow gyro is the clock: its samples are all there, and none is made between them."""
    rates = {"acc": 50.0, "gyr": 100.0, "mag": 200.0}
    way = Task("still", (Waypoint(rest_s=2.0),))
    slow = {kind: simulate(way, "ideal", rate_hz=hz).recording for kind, hz in rates.items()}
    with Phone(streams_of(slow)) as phone:
        samples = heard(phone, 0.8)
    assert np.diff(times(samples)) == pytest.approx(0.01, abs=1e-5)
    assert sum(sample.mag is not None for sample in samples) > 0.9 * len(samples)


def test_a_phone_without_gyro_or_field_gives_what_it_has(hands: dict[str, Recording]) -> None:
    with Phone(streams_of({"acc": hands["acc"]})) as phone:
        samples = heard(phone, 0.8)
    assert len(samples) == pytest.approx(160, abs=20 + 200 * (times(samples)[-1] - 0.8))
    assert {(sample.gyr, sample.mag) for sample in samples} == {(None, None)}


def test_what_the_phone_measured_before_is_left_to_it(phone: Phone) -> None:
    """Nothing is cleared, and the recording begins when it begins; nothing but questions and `start` is sent."""
    phone.start()
    time.sleep(0.5)
    samples = heard(phone, 0.6)
    assert times(samples)[0] > 0.45
    assert {path.partition("?")[0] for path in phone.asked} == {"/meta", "/get", "/time"}


def test_a_time_that_leaps_is_left_out_and_the_recording_goes_on(phone: Phone) -> None:
    honest = phone.answer

    def leaping(path: str, query: Mapping[str, str]) -> Any:
        answer = honest(path, query)
        return answer.replace(repr(float(f"{wrong:.7e}")).encode(), b"5e4") if path == "/get" else answer

    wrong = float(phone.streams["gyr"][0][int(np.searchsorted(phone.streams["gyr"][0], 0.4)) - 1])
    phone.answer = leaping  # type: ignore[method-assign]
    t = times(heard(phone, 0.8))
    assert np.diff(t).max() < 0.01


def test_two_taps_on_its_back_close_the_grip_and_are_told(tmp_path: Path) -> None:
    held = simulate(Task("held", (Waypoint(rest_s=2.0),)), "ideal", rate_hz=200.0).recording
    with Phone(streams_of({"acc": tapped(held, [(0.6, 40.0), (0.8, 40.0)]), "gyr": held})) as phone:
        outcome, said = recorded(phone, tmp_path / "tea", taps=True, duration_s=1.7)
    (event,) = read_demo(tmp_path / "tea").recording.grip
    assert event.closed
    assert event.t == pytest.approx(0.6, abs=0.05)
    assert "two taps: grip closed" in said
    assert outcome.lost == 0
