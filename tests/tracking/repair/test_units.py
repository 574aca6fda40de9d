"""Units that nobody gave are compared with what the Earth and a hand allow."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from pbd.data import GRAVITY, Recording
from pbd.data.units import UNITS
from pbd.errors import PbdWarning, RecordingError
from pbd.files.importers import import_file
from pbd.pose import Array
from pbd.tracking.repair.units import refuse_other_units

PER_DEG_S, PER_G = 131.0, 16384.0
"""Counts of an MPU-6050 at 250 deg/s and 2 g (InvenSense, MPU-6050 Product Specification)."""


def imported(folder: Path, acc: Array, gyr: Array, mag: Array, units: dict[str, str]) -> Recording:
    """Import three sensors' samples (n, 3) from a table without units."""
    rows = np.column_stack((0.01 * np.arange(len(acc)), acc, gyr, mag))
    header = "t,ax,ay,az,gx,gy,gz,mx,my,mz"
    np.savetxt(folder / "run.csv", rows, fmt="%.9g", delimiter=",", header=header, comments="")
    return import_file(folder / "run.csv", {}, units).recording


@pytest.mark.parametrize("field_ut", [22.0, 67.0])
@pytest.mark.parametrize(("unit", "own_ut"), [("uT", 0.0), ("uT", 300.0), ("gauss", 0.0), ("nT", 0.0), ("nT", 30.0)])
def test_a_fields_strength_tells_its_unit(tmp_path: Path, field_ut: float, unit: str, own_ut: float) -> None:
    """A part's own field of 300 uT does not make uT look like another unit."""
    factor = UNITS["mag"][unit]
    acc, gyr = np.tile((0.0, 0.0, GRAVITY), (3, 1)), np.zeros((3, 3))
    mag = np.tile((own_ut, 0.0, -field_ut), (3, 1)) / factor
    told = pytest.warns(PbdWarning, match=f"likely in {unit}; import the file with --unit mag={unit}, or")
    with nullcontext() if unit == "uT" else told:
        refuse_other_units(imported(tmp_path, acc, gyr, mag, {}))
    refuse_other_units(imported(tmp_path, acc, gyr, mag, {"mag": unit}))


@pytest.mark.parametrize("of_acc", [True, False])
def test_a_gyros_counts_are_named_as_such(tmp_path: Path, of_acc: bool) -> None:
    gyr = np.rint(PER_DEG_S * np.array([[0.0, 0.0, 0.5], [2.0, -1.0, 90.0], [0.1, 0.0, 0.0]]))
    acc, mag = np.tile((0.0, 0.0, PER_G if of_acc else GRAVITY), (3, 1)), np.tile((0.0, 20.0, -40.0), (3, 1))
    also = r", and --unit acc=0\.00006103515625g$" if of_acc else r"\)$"
    with pytest.raises(RecordingError, match=rf"gx, gy, gz .* up to 11790: they are likely raw counts.*{also}"):
        refuse_other_units(imported(tmp_path, acc, gyr, mag, {}))
    refuse_other_units(imported(tmp_path, acc, gyr, mag, {"gyr": f"{1.0 / PER_DEG_S}deg/s"}))
    refuse_other_units(imported(tmp_path, acc, gyr, mag, {"gyr": "rad/s"}))  # a person's word
    refuse_other_units(imported(tmp_path, acc, gyr + 0.5, mag, {}))  # no count is a fraction
    refuse_other_units(imported(tmp_path, acc, np.rint(gyr / 200.0), mag, {}))  # a gyro may turn at 59 rad/s


def test_a_field_of_zeros_has_no_unit(tmp_path: Path) -> None:
    acc, none = np.tile((0.0, 0.0, GRAVITY), (3, 1)), np.zeros((3, 3))
    refuse_other_units(imported(tmp_path, acc, none, none, {}))


@pytest.mark.parametrize(("field_ut", "refused"), [(0.006, True), (0.02, False)])
def test_a_field_below_a_hundredth_of_a_microtesla_is_in_another_unit(field_ut: float, refused: bool) -> None:
    recording = Recording(np.arange(3.0), np.zeros((3, 3)), mag=np.tile((0.0, 0.0, field_ut), (3, 1)))
    with pytest.raises(RecordingError, match="field is 22 to 67 uT: its unit is another") if refused else nullcontext():
        refuse_other_units(recording)


@pytest.mark.parametrize(("heading", "refused"), [(12.0, False), (20.0, True)])
def test_a_heading_may_count_on_after_a_turn_but_not_for_ever(heading: float, refused: bool) -> None:
    recording = Recording(np.arange(3.0), np.zeros((3, 3)), device_rpy=np.tile((0.0, 0.0, heading), (3, 1)))
    with pytest.raises(RecordingError, match="they are in degrees") if refused else nullcontext():
        refuse_other_units(recording)
