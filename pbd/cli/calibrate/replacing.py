"""When a step of pbd calibrate may replace a part of the file."""

from __future__ import annotations

from pathlib import Path

from pbd.calibration.points import POOR_CHI2
from pbd.data import Calibration
from pbd.errors import CalibrationError


def keep_good_part(path: Path, calibration: Calibration, figure: str, chi2: float, what: str, again: str) -> None:
    """Refuse to replace a part that was measured, and did not fit badly, by one that does.

    Args:
        path: the calibration's file.
        calibration: its content.
        figure: "part.figure" of the old fit's chi2 in `residuals`.
        chi2: of the new fit.
        what: the beginning of the message: how it fits.
        again: what to do.
    """
    if chi2 > POOR_CHI2 and calibration.residuals.get(figure, 0.0) <= POOR_CHI2:
        part = figure.partition(".")[0]
        raise CalibrationError(
            f"{what}, so the [{part}] of {path} stays as it is; {again}; --force replaces it",
            path=path,
            value=chi2,
            bound=POOR_CHI2,
        )


def keep_other_start(path: Path, calibration: Calibration, part: str) -> None:
    """Refuse to replace a [dock] by the new `part` "nav", or a [nav] by a "dock"."""
    other = "nav" if part == "dock" else "dock"
    if (calibration.T_base_nav if other == "nav" else calibration.T_base_dock) is not None:
        what = f"{path} has a [{other}], and a calibration can't have [{part}] too"
        raise CalibrationError(f"{what}; replace it with --force, or give another name", path=path)
