"""Public real recordings (see the data folder's README)."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.data import GRAVITY
from pbd.errors import PbdWarning
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.tracking import orientation_errors, slower_strides, stride_errors
from tests.benchmarks.trials import read_broad, with_drift, with_taps


def test_rests_agree_with_the_optics(data_folder: Path) -> None:
    """And no warning is given: it would be an error here."""
    for file in sorted((data_folder / "broad").glob("*.npz")):
        path = track(import_file(file).recording)
        assert len(find_keyframes(path)) == 5 or not file.name.startswith("14")
        still = np.zeros(len(path.t), dtype=bool)
        for stop in path.stops:
            still[stop.start : stop.stop] = True
        with np.load(file, allow_pickle=False) as arrays:
            truly = ~arrays["moving"]
        f1 = 2.0 * (still & truly).sum() / (still.sum() + truly.sum())
        assert f1 > 0.985, file.name


@pytest.mark.filterwarnings("ignore:the hand moves when the recording ends:pbd.errors.PbdWarning")
@pytest.mark.filterwarnings("ignore:.*its readings drift like:pbd.errors.PbdWarning")  # they do
def test_minutes_without_a_stop_are_tracked_with_a_gyro_that_drifts(data_folder: Path) -> None:
    """Its bias walks half as far again as the model assumes. Dead reckoning may end a kilometre away."""
    for file in sorted((data_folder / "broad").glob("1[06]_*.npz")):
        trial = read_broad(file)["40"]
        path = track(with_drift(trial.recording, 1.5, 4))
        assert orientation_errors(trial, path.wxyz_nav_sensor)["tilt_deg"] < 0.5, file.name


@pytest.mark.filterwarnings("ignore:.*at the end of the range:pbd.errors.PbdWarning")
@pytest.mark.filterwarnings("ignore:no motion between the stops fits:pbd.errors.PbdWarning")
def test_a_fast_hand_is_tracked_by_an_accelerometer_of_2_g(data_folder: Path) -> None:
    """It reaches up to 9 g, and passes 2 g in most of its moves."""
    (file,) = (data_folder / "broad").glob("16_*.npz")
    trial = read_broad(file)["40"]
    acc = np.clip(trial.recording.acc, -2.0 * GRAVITY, 2.0 * GRAVITY)
    path = track(replace(trial.recording, acc=acc))
    assert orientation_errors(trial, path.wxyz_nav_sensor)["tilt_deg"] < 1.0


def test_a_gyro_that_warms_up_while_a_hand_moves_hides_no_rest(data_folder: Path) -> None:
    """When the hand rests again after two minutes, the gyro seems to turn by 1.4 degrees/s."""
    (file,) = (data_folder / "broad").glob("10_*.npz")
    trial = read_broad(file)["40"]
    recording = trial.recording
    assert recording.gyr is not None
    warm = np.radians(1.0) * (1.0 - np.exp(-recording.t / 60.0))[:, None] * (1.0, -1.0, 0.5)
    first, last = track(replace(recording, gyr=recording.gyr + warm)).stops
    moved = np.flatnonzero(trial.moving)
    assert moved[0] - 20 < first.stop <= moved[0] + 10
    assert moved[-1] - 50 < last.start <= moved[-1] + 10


def test_a_real_hand_is_tracked_while_its_sensor_is_tapped(data_folder: Path) -> None:
    """If the one sample in which a tap turned it by 0.8 degrees were left out, the turn back would remain."""
    (file,) = (data_folder / "broad").glob("14_*.npz")
    trial = read_broad(file)["286"]
    path = track(with_taps(trial.recording))
    assert orientation_errors(trial, path.wxyz_nav_sensor)["tilt_deg"] < 0.3


def test_the_short_walk_has_its_stops(data_folder: Path) -> None:
    with pytest.warns(PbdWarning, match="244 samples missing, in 165 gaps"):
        path = track(import_file(data_folder / "walks" / "short_walk.csv").recording)
    assert len(path.stops) >= 14
    assert np.linalg.norm(path.p_nav_sensor[path.stops[-1].start]) < 1.0


@pytest.mark.filterwarnings("ignore:no motion between the stops fits:pbd.errors.PbdWarning")  # impacts
def test_each_of_32_strides_is_found_at_205_102_and_51_hz(data_folder: Path) -> None:
    (file,) = (data_folder / "strides").glob("*.npz")
    demo = import_file(file)
    found = [len(stride_errors(each)[0]) for each in (demo, *slower_strides(demo))]
    assert [found[0], found[1], found[3]] == [32, 32, 32]
    assert found[2] >= 30  # at 68 Hz


@pytest.mark.filterwarnings("ignore:no motion between the stops fits:pbd.errors.PbdWarning")  # impacts
@pytest.mark.filterwarnings("ignore:the hand moves when the recording ends:pbd.errors.PbdWarning")
def test_strides_are_found_though_the_foot_never_rests_for_a_second(data_folder: Path) -> None:
    (file,) = (data_folder / "strides").glob("*.npz")
    demo = import_file(file)
    walking = demo.recording.t < 34.0  # later, it rests for two seconds
    rows: dict[str, Any] = {name: values[walking] for name, values in demo.recording.channels.items()}
    whole, cut = (
        track(each) for each in (demo.recording, replace(demo.recording, t=demo.recording.t[walking], **rows))
    )
    assert len(cut.stops) == sum(bool(whole.t[stop.stop - 1] < 34.0) for stop in whole.stops)


def test_a_trial_that_the_optics_never_saw_is_read(tmp_path: Path) -> None:
    n = 2000
    np.savez(
        tmp_path / "blind.npz",
        rate_hz=286.0,
        acc=np.tile([0.0, 0.0, GRAVITY], (n, 1)),
        gyr=np.zeros((n, 3)),
        true_position=np.full((n, 3), np.nan),
        true_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        moving=np.zeros(n),
    )
    assert all(np.isnan(trial.v_true).all() for trial in read_broad(tmp_path / "blind.npz").values())
