"""Functions that the steps of `pbd calibrate` share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from pbd.cli.console import working
from pbd.data import Calibration, HandPath, Recording
from pbd.data.covariance import one_sigma
from pbd.errors import CalibrationError
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.pose import Array


def tracked(args: argparse.Namespace, calibration: Calibration) -> tuple[Recording, HandPath]:
    """A demonstration's recording, and the hand's path by that alone: what is known of its stops doesn't count."""
    recording = load_demo(args.demo).recording
    with working("tracking"):
        return recording, track(recording, calibration=calibration, accept_gap=args.accept_gap)


def instead_of(path: Path, calibration: Calibration, part: str, force: bool) -> dict[str, str]:
    """Which of [dock] and [nav] gives way to the other, by its name; empty where there is none.

    Raises:
        CalibrationError: one would, and `force` was not given.
    """
    other = "nav" if part == "dock" else "dock"
    if (calibration.T_base_nav if other == "nav" else calibration.T_base_dock) is None:
        return {}
    if not force:
        raise CalibrationError(
            f"{path} has a [{other}], and a calibration can't have [{part}] too; replace it with --force, or give "
            "another name",
            path=path,
        )
    return {other: part}


def sigma_json(cov: Array) -> dict[str, Any]:
    """One sigma of a pose's covariance (6, 6); NaN (null in JSON) where it is unknown."""
    sigma = one_sigma(cov)
    return {"sigma_m": sigma[:3], "sigma_deg": np.degrees(sigma[3:])}
