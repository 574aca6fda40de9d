"""Tables and JSON of a fusion: how takes were matched, and the hand's scatter."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

from pbd.data import FusedTake, Fusion, HandPath
from pbd.pose import quat_log
from pbd.view.terminal_tables import make_table
from pbd.view.units import Units

ALIKE_RAD = np.radians(20.0)
"""Turn of the sensor in the hand between takes, rad, below which it was held alike. People are asked for 90 degrees."""


def takes_table(fusion: Fusion, units: Units) -> Table:
    """Return a table with a row for each take: keyframes, sensor's pose in the hand, offset from the task."""
    fine = units.finer
    several = ("device",) if len({take.device for take in fusion.takes}) > 1 else ()
    columns = (
        "keyframes",
        "more stops",
        "not believed",
        f"sensor turned ({units.angle_sign})",
        "±",
        f"lever ({fine.length})",
    )
    table = make_table(
        "take", *several, *columns, f"off, rms ({fine.length})", left=("take", "more stops", "not believed")
    )
    for take in fusion.takes:
        if take.left_out:
            table.add_row(take.name, *("" for _ in several), "", "", f"left out: {take.left_out}", "", "", "", "")
            continue
        table.add_row(
            take.name,
            *(str(take.device + 1) for _ in several),
            str(sum(own is not None for own in take.own)),
            " ".join(map(str, take.extra)),
            " ".join(map(str, take.outliers)),
            *units.angles((_turned(take), take.turn_sigma)),
            *fine.lengths(0.0 if take.T_hand is None else float(np.linalg.norm(take.T_hand.p)), finer=1),
            *fine.lengths(float(np.sqrt(np.nanmean((take.off**2).sum(axis=1)))), finer=1),
        )
    return table


def fusion_table(path: HandPath, units: Units) -> Table:
    """Return a table with a row for each keyframe: number of takes, position, sigma, scatter and its uncertainty."""
    fusion, fine = path.fusion, units.finer
    assert fusion is not None
    m, mm, deg = units.length, fine.length, units.angle_sign
    position, scatter = [f"{axis} ({m})" for axis in "xyz"], [f"scatter {axis} ({mm})" for axis in "xyz"]
    table = make_table("#", "in takes", *position, f"σ ({mm})", *scatter, "±", f"turn ({deg})", "±")
    sigma = np.sqrt(np.diagonal(path.cov, axis1=1, axis2=2))
    for k, stop in enumerate(path.stops):
        table.add_row(
            str(k),
            str(sum(take.own[k] is not None and k not in take.outliers for take in fusion.takes)),
            *units.lengths(path.p_nav_sensor[stop.start]),
            *fine.lengths(float(sigma[k, :3].max()), finer=1),
            *fine.lengths(fusion.scatter[k], finer=1),
            f"{100.0 * float(fusion.log_sigma[k, :3].mean()):.0f} %",
            *units.angles(float(fusion.turn[k])),
            f"{100.0 * float(fusion.log_sigma[k, 3]):.0f} %",
        )
    return table


def fusion_rows(path: HandPath) -> dict[str, Any]:
    """Return both tables' content for `--json`."""
    fusion = path.fusion
    assert fusion is not None
    sigma = np.sqrt(np.diagonal(path.cov, axis1=1, axis2=2))
    return {
        "takes": [
            {
                "name": take.name,
                "device": take.device,
                "left_out": take.left_out or None,
                "keyframes": list(take.own),
                "extra": list(take.extra),
                "outliers": list(take.outliers),
                "yaw_deg": float(np.degrees(take.yaw)),
                "sensor_turned_deg": float(np.degrees(_turned(take))),
                "sensor_turned_sigma_deg": float(np.degrees(take.turn_sigma)),
                "lever_m": None if take.T_hand is None else take.T_hand.p.tolist(),
                "off_m": [None if np.isnan(off).any() else off.tolist() for off in take.off],
                "off_deg": [None if np.isnan(off) else float(np.degrees(off)) for off in take.off_rad],
            }
            for take in fusion.takes
        ],
        "keyframes": [
            {
                "index": k,
                "position_m": path.p_nav_sensor[stop.start].tolist(),
                "sigma_m": sigma[k, :3].tolist(),
                "scatter_m": fusion.scatter[k].tolist(),
                "scatter_deg": float(np.degrees(fusion.turn[k])),
                "scatter_unsure": fusion.log_sigma[k].tolist(),
                "tolerance_m": fusion.tolerance_m[k].tolist(),
                "tolerance_deg": float(np.degrees(fusion.tolerance_rad[k])),
            }
            for k, stop in enumerate(path.stops)
        ],
        "scatter_m": fusion.overall[0],
        "scatter_deg": float(np.degrees(fusion.overall[1])),
        "scatter_unsure": list(fusion.overall_log_sigma),
        "thing": None if fusion.thing is None else asdict(fusion.thing),
    }


def held_alike(takes: Sequence[FusedTake]) -> bool:
    """Whether all takes that are used are of one device, held alike: its own errors are then the same in each."""
    return all(take.device == 0 and _turned(take) < ALIKE_RAD for take in takes)


def _turned(take: FusedTake) -> float:
    return 0.0 if take.T_hand is None else float(np.linalg.norm(quat_log(take.T_hand.wxyz)))
