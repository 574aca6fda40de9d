"""Tables that `pbd calibrate` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from pbd.data import Calibration, Linear
from pbd.data.sigma import one_sigma
from pbd.data.units import DEG, MG
from pbd.pose import Array, Pose, quat_to_rpy
from pbd.view.terminal_tables import make_table


def points_table(
    names: Sequence[str], stops: Sequence[int], residuals: Array, left_out: Array, sigma: Array, used: Sequence[bool]
) -> Table:
    """Each point: its residual in base, and its distance from the others' fit."""
    table = make_table(
        "point",
        "stop",
        "off x (mm)",
        "y (mm)",
        "z (mm)",
        "off (mm)",
        "by the others (mm)",
        "σ (mm)",
        "",
        left=("point",),
    )
    for name, stop, off, alone, its_sigma, good in zip(names, stops, residuals, left_out, sigma, used, strict=True):
        table.add_row(
            name,
            str(stop),
            *(f"{1e3 * x:.1f}" for x in off),
            f"{1e3 * np.linalg.norm(off):.1f}",
            f"{1e3 * np.linalg.norm(alone):.1f}",
            f"{1e3 * np.linalg.norm(its_sigma):.1f}",
            "" if good else "wrong, left out",
        )
    return table


def calibration_table(calibration: Calibration) -> Table:
    """Everything that a calibration says."""
    table = make_table("part", "what", "value", "σ", left=("part", "what", "value", "σ"))
    if calibration.T_base_dock is not None:
        _add_pose(table, "dock", "the sensor in base", calibration.T_base_dock, calibration.cov_base)
    if calibration.T_base_nav is not None:
        _add_pose(table, "nav", "nav in base", calibration.T_base_nav, calibration.cov_base)
    _add_pose(table, "mount", "the tool on the sensor", calibration.T_sensor_tool, calibration.cov_sensor_tool)
    if sensor := calibration.sensor:
        table.add_row("sensor", "of", sensor.sensor, "")
        if sensor.temperature_c is not None:
            table.add_row("", "at", f"{sensor.temperature_c:.0f} °C", "")
        deg, mg = 1.0 / DEG, 1.0 / MG
        for what, linear, factor, unit in (
            ("gyro", sensor.gyr, deg, "°/s"),
            ("accelerometer", sensor.acc, mg, "mg"),
            ("magnetometer", sensor.mag, 1.0, "µT"),
        ):
            if linear is not None:
                _add_linear(table, what, linear, factor, unit)
        if sensor.field is not None and sensor.dip is not None:
            table.add_row("", "field", f"{sensor.field:.1f} µT, dip {np.degrees(sensor.dip):.1f}°", "")
    if calibration.scale != 1.0:
        table.add_row("scale", "of the hand's path", f"{calibration.scale:.4f}", "")
    if calibration.table_height is not None:
        table.add_row("table", "height", f"{calibration.table_height:.3f} m", "")
    if calibration.robots:
        table.add_row("robots", "only for", ", ".join(calibration.robots), "")
    for obstacle in calibration.obstacles:
        table.add_row("obstacle", obstacle.name, f"{obstacle.shape} {', '.join(f'{x:g}' for x in obstacle.size)} m", "")
    for name, value in calibration.residuals.items():
        part, _, figure = name.partition(".")
        table.add_row("fit", f"of {part}", f"{figure} {value:.4g}", "")
    return table


def base_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """One sigma of the tool in base at each keyframe (of `base_sigmas`), whole and by parts (rms over the axes).

    A dash stands for a part that was not measured.
    """
    names = list(rows[0]["base_sigma_parts_m"]) if rows else []
    table = make_table("#", "σ x (mm)", "y (mm)", "z (mm)", "σ (°)", *(f"{name} (mm)" for name in names))
    for k, row in enumerate(rows):
        table.add_row(
            str(k),
            *(f"{1e3 * x:.1f}" for x in row["base_sigma_m"]),
            f"{max(row['base_sigma_deg']):.1f}",
            *(
                "–" if x is None else f"{1e3 * np.sqrt(np.mean(np.square(x))):.1f}"
                for x in row["base_sigma_parts_m"].values()
            ),
        )
    return table


def figures_table(rows: Sequence[tuple[str, str, str]]) -> Table:
    """What was found, its value, and what is to be said of it."""
    table = make_table("what", "value", "", left=("what", "value", ""))
    for row in rows:
        table.add_row(*row)
    return table


def _add_pose(table: Table, part: str, what: str, pose: Pose, cov: Array | None) -> None:
    sigma = np.full(6, np.nan) if cov is None else one_sigma(cov)
    position = ", ".join(f"{x + 0.0:.4f}" for x in np.round(pose.p, 4))
    rpy = ", ".join(f"{x + 0.0:.2f}" for x in np.round(np.degrees(quat_to_rpy(pose.wxyz)), 2))
    table.add_row(part, what, f"({position}) m", _stated(1e3 * sigma[:3], 1, " mm"))
    table.add_row("", "roll, pitch, yaw", f"({rpy})°", _stated(np.degrees(sigma[3:]), 2, "°"))


def _stated(sigma: Array, decimals: int, unit: str) -> str:
    """One sigma along each axis; a dash where it is unknown."""
    if np.isnan(sigma).all():
        return "not stated"
    return f"{', '.join('–' if np.isnan(x) else f'{x:.{decimals}f}' for x in sigma)}{unit}"


def _add_linear(table: Table, what: str, linear: Linear, factor: float, unit: str) -> None:
    sigma = (
        ""
        if np.isnan(linear.bias_sigma).any()
        else f"{', '.join(f'{factor * x:.3f}' for x in linear.bias_sigma)} {unit}"
    )
    table.add_row("", f"{what} bias", f"({', '.join(f'{factor * x:.3f}' for x in linear.bias)}) {unit}", sigma)
    if (linear.matrix != np.eye(3)).any():
        scale = ", ".join(f"{100.0 * (x - 1.0):+.2f}" for x in np.diagonal(linear.matrix))
        skew = linear.matrix - np.diag(np.diagonal(linear.matrix))
        table.add_row("", f"{what} scale", f"({scale}) %", "")
        table.add_row("", f"{what} axes", f"misaligned by up to {np.degrees(np.abs(skew).max()):.2f}°", "")
