"""When a step of pbd calibrate may replace a part of the file."""

from pathlib import Path

from pbd.calibration.points import POOR_CHI2
from pbd.data import Calibration
from pbd.errors import CalibrationError, warn


def judge_fit(path: Path, before: Calibration | None, figure: str, chi2: float, what: str, again: str) -> None:
    """Warn of a poor fit; refuse it if `before`, the content of the file that has this part measured, fits well.

    `figure` is "part.figure" of the fit's chi2 in `residuals`. The message begins with `what` and ends with `again`.
    """
    part = f"the [{figure.partition('.')[0]}] of {path}"
    if chi2 > POOR_CHI2 and before is not None and before.residuals.get(figure, 0.0) <= POOR_CHI2:
        line = f"{what}, so {part} stays as it is; {again}; --force replaces it"
        raise CalibrationError(line, path=path, value=chi2, bound=POOR_CHI2)
    if chi2 > POOR_CHI2:
        warn(f"{what}, so do not use {part} yet; {again}")


def keep_other_start(path: Path, calibration: Calibration, part: str) -> None:
    """Refuse to replace a [dock] by the new `part` "nav", or a [nav] by a "dock"."""
    other = "nav" if part == "dock" else "dock"
    if (calibration.T_base_nav if other == "nav" else calibration.T_base_dock) is not None:
        what = f"{path} has a [{other}], and a calibration can't have [{part}] too"
        raise CalibrationError(f"{what}; replace it with --force, or give another name", path=path)
