"""Logs of WitMotion's programs: a simulated recording in each version's format is read again."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data import GRAVITY, Recording
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.io.numbers import seconds
from pbd.simulation.simulate import simulate
from tests.files.witmotion_logs import DIALECTS, STEP_S, Dialect, iso, of_day, spaced, unpadded, written
from tests.not_none import not_none


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate("pick-and-place-stops", "wt901", 3).recording


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=list(DIALECTS))
def test_the_log_of_every_program_is_read(dialect: Dialect, recording: Recording, tmp_path: Path) -> None:
    file = tmp_path / "log.txt"
    file.write_bytes(written(dialect, recording))
    got = import_file(file).recording
    np.testing.assert_allclose(got.t, STEP_S * np.arange(len(recording)), atol=1e-6)
    np.testing.assert_allclose(got.acc, recording.acc, atol=0.51e-4 * GRAVITY)
    np.testing.assert_allclose(not_none(got.gyr), not_none(recording.gyr), atol=np.radians(0.51e-3))
    np.testing.assert_allclose(not_none(got.device_rpy), not_none(recording.device_rpy), atol=np.radians(0.51e-3))
    np.testing.assert_allclose(not_none(got.mag), not_none(recording.mag), atol=0.51)


def test_an_attitude_that_the_module_does_not_send_is_left_out(tmp_path: Path) -> None:
    head = "time,AccX(g),AccY(g),AccZ(g),AsX(°/s),AsY(°/s),AsZ(°/s),AngleX(°),AngleY(°),AngleZ(°)\n"
    (tmp_path / "log.txt").write_text(head + "".join(f"10:00:0{k}.000,0,0,1,1,2,3,,,\n" for k in range(3)))
    recording = import_file(tmp_path / "log.txt").recording
    assert recording.device_rpy is None
    assert recording.info.source.unread["AngleZ(°)"] == "no number in any row"


def test_a_broken_cell_is_named_with_its_line(recording: Recording, tmp_path: Path) -> None:
    file = tmp_path / "log.txt"
    lines = written(DIALECTS["MiniIMU"], recording).decode("gb18030").split("\r\n")
    lines[7] = lines[7].rsplit("\t", 3)[0] + "\tx\ty\tz"
    file.write_text("\r\n".join(lines), encoding="gb18030", newline="")
    with pytest.raises(RecordingError, match=r":8: 'x' in column 'hY' is not a number"):
        import_file(file)


@given(st.datetimes(min_value=datetime(1990, 1, 1), max_value=datetime(2090, 1, 1)))
def test_stamps_count_seconds(at: datetime) -> None:
    at = at.replace(microsecond=at.microsecond // 1000 * 1000)
    exact = (at - datetime(2000, 1, 1)).total_seconds()
    for write in (iso, spaced, unpadded):
        assert seconds(write(at)) == pytest.approx(exact, abs=1e-6)
    midnight = at.replace(hour=0, minute=0, second=0, microsecond=0)
    assert seconds(of_day(at)) == pytest.approx((at - midnight).total_seconds(), abs=1e-9)


@pytest.mark.parametrize("cell", ["noon", "8:18", "2025-13-41 8:18:09", "8:18:9pm"])
def test_a_text_that_is_not_a_time_is_refused(cell: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        seconds(cell)
