"""Decode a recording's raw bytes again: with a better decoder, or because its demonstration was lost."""

from itertools import groupby
from pathlib import Path

import numpy as np

from pbd.data import Demonstration, Recording, RecordingInfo
from pbd.data.recording import DEVICE_CLOCK
from pbd.errors import RecordingError, amount
from pbd.files.demo import read_demo
from pbd.io.read_file import read_bytes
from pbd.pose import Array
from pbd.record.session import FIRST_BYTES
from pbd.record.session_types import recording_from_samples
from pbd.sensors.decoding import Decoder, Sample
from pbd.sensors.probe import describe_bytes, identify_protocol, printed_line
from pbd.timestamps.sample_clock import SampleClock


def decode_raw(path: Path, decoder: Decoder, sensor: str, rate_hz: float | None = None) -> Demonstration:
    """Decode a raw.bin, or a text of lines.

    The file has no arrival times. The samples get the times of the demonstration in the same folder if the number of
    samples agrees, else the device's own times, or, without a device clock, evenly spaced times.

    Args:
        path: the file.
        decoder: a new decoder of the sensor's protocol.
        sensor: the protocol's name.
        rate_hz: rate of evenly spaced times; default: that of the demonstration in the same folder.

    Raises:
        RecordingError: the file can't be read or has no samples, or the rate is unknown.
    """
    data = read_bytes(path, RecordingError, "name a raw.bin")
    if path.suffix.lower() != ".bin":
        data = b"\n" + data  # a text begins with a whole line; what came from a port may begin within one
    samples = [sample for sample in decoder.feed(data) if sample.acc is not None]
    if len(samples) < 2:
        first, correct = data[:FIRST_BYTES], "name the sensor that it came from"
        if identify_protocol(first) or printed_line(first):
            correct = describe_bytes(first, None, sensor, decoder.tally.last_fault)
        raise RecordingError.at(path, f"no samples of {sensor} in its {amount(len(data), 'byte')}; {correct}")
    demo = read_demo(path.parent) if (path.parent / "demo.toml").is_file() else None
    stored = None if demo is None else demo.recording
    samples, t, clock = _sample_times(path, samples, stored, rate_hz)
    created, grip = (None, ()) if stored is None else (stored.info.created, stored.grip)
    info = RecordingInfo(sensor=sensor, rate_hz=rate_hz, created=created, clock=clock)
    recording = recording_from_samples(t, samples, grip=grip, info=info)
    return Demonstration(recording, closed=demo is not None and demo.closed)


def _sample_times(
    path: Path, samples: list[Sample], stored: Recording | None, rate_hz: float | None
) -> tuple[list[Sample], Array, str]:
    """Return the samples that have a time, their times (n,) s, and the clock's description."""
    steps = np.diff([np.nan if sample.t_device is None else sample.t_device for sample in samples])
    if (backwards := int((steps < 0.0).sum())) > 0.05 * len(steps):  # resets are rare, and few digits are corrupted
        what = f"the device's time runs backwards at {backwards} of {len(samples)} samples, so it is no time"
        raise RecordingError.at(path, f"{what}; in a text of lines, name another column t, or none and add --rate HZ")
    if has_clock := bool((steps > 0.0).any()):
        # Samples of one time, as of a batch, are believed or left out together. A packet that came twice counts once.
        once = [sample for sample, before in zip(samples, [None, *samples], strict=False) if sample != before]
        clock = SampleClock[list[Sample]](float(np.median(steps[steps > 0.0])))
        batches = [(t, list(batch)) for t, batch in groupby(once, lambda sample: sample.t_device)]
        taken = [each for t_device, batch in batches for each in clock.take(batch, t_device, 0.0)]
        timed = [(t, sample) for t, batch in taken for sample in batch]
        samples = [sample for _, sample in timed]
    if stored is not None and len(stored) == len(samples):
        return samples, stored.t, stored.info.clock
    if has_clock:
        return samples, np.array([t for t, _ in timed]), DEVICE_CLOCK
    rate_hz = rate_hz or (None if stored is None else stored.rate_hz)
    if rate_hz is None:
        raise RecordingError.at(path, "the sensor has no clock, and nothing tells its rate; give --rate")
    return samples, np.arange(len(samples)) / rate_hz, f"none: evenly spaced at {rate_hz:g} Hz"
