"""Recordings as named numpy arrays."""

import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pbd.data import Demonstration
from pbd.errors import RecordingError
from pbd.files.importers import import_file
from pbd.pose import Array


def import_arrays(folder: Path, **arrays: Any) -> Demonstration:
    path = folder / "run.npz"
    np.savez(path, **arrays)
    return import_file(path)


def test_npz(tmp_path: Path) -> None:
    acc, gyr, mag = np.random.default_rng(0).normal(size=(3, 4, 3))
    true_position = np.array([[np.nan] * 3, [1, 2, 3], [2, 2, 3], [np.nan] * 3])
    true_wxyz = np.tile((1.0, 0.0, 0.0, 0.0), (4, 1))
    demo = import_arrays(
        tmp_path,
        rate_hz=50,
        acc=acc,
        gyr=gyr,
        mag=mag,
        true_position=true_position,
        true_wxyz=true_wxyz,
        subject="names are passed over",
    )
    assert_allclose(demo.recording.t, [0.0, 0.02, 0.04, 0.06])
    for channel, values in (("acc", acc), ("gyr", gyr), ("mag", mag)):
        assert_array_equal(getattr(demo.recording, channel), values)
    assert demo.recording.info.rate_hz == 50.0
    assert demo.truth is not None
    assert_allclose(demo.truth.t, demo.recording.t)
    assert_array_equal(demo.truth.wxyz_nav_sensor, true_wxyz)
    from_the_first_known = np.array([[np.nan] * 3, [0, 0, 0], [1, 0, 0], [np.nan] * 3])
    assert_array_equal(demo.truth.p_nav_sensor, from_the_first_known)


def test_npz_with_only_the_required_arrays(tmp_path: Path) -> None:
    demo = import_arrays(tmp_path, rate_hz=100.0, acc=np.ones((3, 3)))
    assert (demo.recording.gyr, demo.recording.mag, demo.truth) == (None, None, None)
    assert [column.ours for column in demo.recording.info.source.columns] == ["ax", "ay", "az"]


def test_npz_whose_truth_has_a_rate_of_its_own(tmp_path: Path) -> None:
    demo = import_arrays(
        tmp_path, rate_hz=200.0, acc=np.ones((4, 3)), true_position=np.ones((2, 3)), true_rate_hz=100.0
    )
    assert demo.truth is not None
    assert_allclose(demo.truth.t, [0.0, 0.01])


def npy(values: Array) -> bytes:
    np.save(packed := BytesIO(), values)
    return packed.getvalue()


VALID: dict[str, object] = {"rate_hz": 100.0, "acc": np.ones((3, 3))}
TRUE: dict[str, object] = {"true_position": np.zeros((3, 3))}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"acc": np.ones((3, 3))}, "no array 'rate_hz'; it has acc"),
        ({"rate_hz": 100.0}, "no array 'acc'; it has rate_hz"),
        ({"rate_hz": "fast", "acc": np.ones((3, 3))}, "no array 'rate_hz'; it has acc"),
        ({"rate_hz": 0.0, "acc": np.ones((3, 3))}, "rate_hz is 0; it must be above zero"),
        ({"rate_hz": np.nan, "acc": np.ones((3, 3))}, "rate_hz is nan; it must be above zero"),
        (VALID | {"gyr": np.ones((2, 3))}, r"'gyr' has shape \(2, 3\), not \(3, 3\)"),
        (VALID | {"acc": np.ones(3)}, r"'acc' has shape \(3,\), not \(3, 3\); correct it"),
        (VALID | {"acc": 9.81}, r"'acc' has shape \(\), not \(1, 3\)"),
        (VALID | {"gyr": {"a": 1}}, "Object arrays cannot be loaded"),  # a pickle
        (VALID | {"rate_hz": [100.0, 100.0]}, "rate_hz holds 2 numbers; it must be one"),
        (VALID | {"rate_hz": np.inf}, "rate_hz is inf; it must be 1e-06 to 1e"),
        (VALID | {"true_position": np.zeros(3)}, r"'true_position' has shape \(3,\), not \(3, 3\)"),
        (VALID | TRUE | {"true_wxyz": np.zeros((2, 4))}, r"'true_wxyz' has shape \(2, 4\), not \(3, 4\)"),
        (VALID | TRUE | {"true_rate_hz": 0.0}, "true_rate_hz is 0; it must be above zero"),
        (VALID | {"true_wxyz": np.zeros((3, 4))}, "'true_wxyz' without 'true_position'; add it, or leave both out"),
    ],
)
def test_npz_with_a_missing_or_wrong_array_is_refused(tmp_path: Path, arrays: dict[str, object], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        import_arrays(tmp_path, **arrays)


@pytest.mark.parametrize(
    "content", [b"", b"t,ax\n0,1\n", b"PK\x03\x04 cut short", b"\x80\x04K\x01.", npy(np.ones((3, 3)))]
)
def test_not_an_npz(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"can't be read as an npz \(.*\); save it with numpy\.savez$"):
        import_file(path)


def test_a_gyro_under_another_name_is_not_dropped(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", rate_hz=100.0, acc=np.ones((3, 3)), gyro=np.ones((3, 3)))
    with pytest.raises(
        RecordingError, match="the array 'gyro' looks like inertial data, but is not read; name it 'gyr'"
    ):
        import_file(tmp_path / "run.npz")


def test_a_member_that_is_no_array_is_missing(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        archive.writestr("rate_hz.npy", npy(np.array(100.0)))
        archive.writestr("acc.npy", b"1,2,3")
    with pytest.raises(RecordingError, match="no array 'acc'"):
        import_file(tmp_path / "run.npz")


def test_a_broken_file_is_not_quoted_in_full(tmp_path: Path) -> None:
    import_arrays(tmp_path, **VALID)
    path = tmp_path / "run.npz"
    whole = path.read_bytes()
    at = whole.index(b"acc.npy") - 4  # the length of the name, before that of the extra field
    path.write_bytes(whole[:at] + b"\xff\x01" + whole[at + 2 :])  # zipfile quotes all that follows
    with pytest.raises(RecordingError, match="can't be read as an npz") as caught:
        import_file(path)
    assert len(caught.value.message) < 300 + len(str(path))
