"""Every protocol through a pseudo-terminal and pyserial into a folder: over a good cable, a bad one, and unplugged."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pbd.data import Recording
from pbd.files.demo import read_demo
from pbd.record import Outcome, RecordOptions, Status, record
from pbd.record.redecode import decode_raw
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import PROTOCOLS
from tests.benchmarks.wires import MIXED
from tests.record.emulated_sensors import SPEAKERS, Device, Speaker, Wire, bad_cable, random_hand

ROWS, PACE_HZ = 220, 1200.0
every = pytest.mark.parametrize("name", SPEAKERS)


def test_no_protocol_is_left_out() -> None:
    assert {speaker.sensor for speaker in SPEAKERS.values()} == {name for name, one in PROTOCOLS.items() if one.bauds}


def recorded(speaker: Speaker, packets: tuple[bytes, ...], folder: Path) -> tuple[Outcome, Recording, list[Status]]:
    """Record what a device sends until it is unplugged."""
    shown: list[Status] = []
    with Device(packets, PACE_HZ) as device:

        def opened() -> Port:
            port = open_port(device.device, PROTOCOLS[speaker.sensor].bauds[0])
            device.go()
            return port

        options = RecordOptions(folder, speaker.sensor, "2026-01-02T03:04:05Z", raw=True)
        outcome = record(opened, speaker.decoder(), options, device.pull_once_heard, shown.append)
    return outcome, read_demo(folder).recording, shown


def rows_of(speaker: Speaker, hand: Recording, got: Recording) -> list[int]:
    """Which row of the hand each recorded one is; -1 where it is none."""
    found = []
    for k in range(len(got)):
        near = np.abs(hand.acc - got.acc[k]).max(axis=1) <= speaker.acc
        if got.gyr is not None and hand.gyr is not None and np.isfinite(got.gyr[k]).all():
            near &= np.abs(hand.gyr - got.gyr[k]).max(axis=1) <= speaker.gyr
        rows = np.flatnonzero(near)
        found.append(int(rows[0]) if len(rows) == 1 else -1)
    return found


@every
def test_a_good_cable_until_it_is_pulled_in_mid_packet(tmp_path: Path, name: str) -> None:
    speaker, hand = SPEAKERS[name], random_hand(ROWS, seed=1)
    packets = [speaker.encode(hand, row) for row in range(ROWS)]
    cut = packets[-1][: len(packets[-1]) // 2]
    begun = time.monotonic()
    outcome, got, _ = recorded(speaker, (*packets[:-1], cut), tmp_path / "tea")
    assert outcome.ended_by == "sensor unplugged"
    assert outcome.bad_packets == 0
    rows = rows_of(speaker, hand, got)
    assert rows == list(range(rows[0], rows[0] + len(rows)))
    assert len(rows) == outcome.samples >= ROWS - 3  # the first line may be the end of one, the last wait for the next
    assert (got.gyr is None) == (name == "os5000")
    assert np.all(np.diff(got.t) > 0.0)
    if speaker.clocked:
        assert outcome.lost == 0
        assert got.info.clock == "device"
        assert got.t == pytest.approx(hand.t[rows] - hand.t[rows[0]], abs=2e-6)
        assert got.info.rate_hz == pytest.approx(hand.rate_hz, rel=1e-4)
    else:
        assert got.info.clock.startswith("host: arrival times")
        assert got.t[-1] < time.monotonic() - begun  # a busy machine may let so short a recording arrive all at once
    again = decode_raw(tmp_path / "tea" / "raw.bin", speaker.decoder(), speaker.sensor).recording
    assert again.t == pytest.approx(got.t, abs=1e-6)
    assert again.acc == pytest.approx(got.acc, abs=1e-5)


@every
def test_a_bad_cable(tmp_path: Path, name: str) -> None:
    """One byte in 500 has a flipped bit or is missing."""
    speaker, hand = SPEAKERS[name], random_hand(ROWS, seed=2)
    packets = [speaker.encode(hand, row) for row in range(ROWS)]
    wire = bad_cable(packets, flipped=0.001, dropped=0.001, seed=3)
    outcome, got, shown = recorded(speaker, wire.packets, tmp_path / "tea")
    rows = rows_of(speaker, hand, got)
    broken = ROWS - sum(wire.whole)
    assert 5 < broken < ROWS / 2
    true = [row for row in rows if row >= 0]
    assert true == sorted(set(true))
    assert np.all(np.diff(got.t) > 0.0)
    altered = len(rows) - len(true)
    assert altered <= (len(by_chance(speaker, packets, wire)) if altered and speaker.checked else broken)
    assert set(safe(wire)) <= set(true)
    assert 0 < outcome.bad_packets <= 4 * broken
    assert shown[-1].bad_packets == outcome.bad_packets
    if speaker.clocked:
        sent = round(float(got.t[-1]) * hand.rate_hz) + 1
        assert outcome.lost == sent - len(rows)
        assert shown[-1].lost == outcome.lost


def safe(wire: Wire) -> list[int]:
    """Rows that came whole, as did the ones beside them: a broken end can take the next beginning with it."""
    return [row for row in range(1, ROWS - 1) if all(wire.whole[row - 1 : row + 2])]


def by_chance(speaker: Speaker, packets: Sequence[bytes], wire: Wire) -> set[bytes]:
    """What was broken and yet has a right checksum: of eight bits, one in 256. (Without a checksum all of it has.)"""
    checked = MIXED[speaker.sensor].checked
    assert checked is not None
    return set(checked(b"".join(wire.packets))) - set(checked(b"".join(packets)))
