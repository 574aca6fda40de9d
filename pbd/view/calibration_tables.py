"""Tables that `pbd calibrate` prints."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from pbd.data import Calibration, LinearErrors
from pbd.data.covariance import one_sigma
from pbd.data.units import DEG, MG
from pbd.pose import Array, Pose, quat_to_rpy
from pbd.view.terminal_tables import make_table, words_table
from pbd.view.units import Units


def points_table(
    names: Sequence[str], stops: Sequence[int], residuals: Array, left_out: Array, sigma: Array, used: Sequence[bool]
) -> Table:
    """One row per point: its residual in base, its distance from a fit to the others, and its sigma, (n, 3) m each."""
    sizes = np.linalg.norm((residuals, left_out, sigma), axis=2).T
    mm = [[f"{1e3 * x:.1f}" for x in row] for row in np.hstack((residuals, sizes))]
    notes = ("" if good else "wrong, left out" for good in used)
    columns = ("point", "stop", "off x (mm)", "y (mm)", "z (mm)", "off (mm)", "by the others (mm)", "σ (mm)", "")
    rows = ((name, str(stop), *row, note) for name, stop, row, note in zip(names, stops, mm, notes, strict=True))
    return make_table(*columns, left=("point",), rows=rows)


def calibration_table(calibration: Calibration) -> Table:
    """All values of a calibration."""
    rows: list[tuple[str, str, str, str]] = []
    if calibration.T_base_dock is not None:
        rows += _pose("dock", "the sensor in base", calibration.T_base_dock, calibration.cov_base)
    if calibration.T_base_nav is not None:
        rows += _pose("nav", "nav in base", calibration.T_base_nav, calibration.cov_base)
    rows += _pose("mount", "the tool on the sensor", calibration.T_sensor_tool, calibration.cov_sensor_tool)
    if sensor := calibration.sensor:
        rows.append(("sensor", "of", sensor.sensor, ""))
        if sensor.temperature_c is not None:
            rows.append(("", "at", f"{sensor.temperature_c:.0f} °C", ""))
        rows += _linear("gyro", sensor.gyr, 1.0 / DEG, "°/s")
        rows += _linear("accelerometer", sensor.acc, 1.0 / MG, "mg")
        rows += _linear("magnetometer", sensor.mag, 1.0, "µT")
        if sensor.field is not None and sensor.dip is not None:
            rows.append(("", "field", f"{sensor.field:.1f} µT, dip {np.degrees(sensor.dip):.1f}°", ""))
    if calibration.scale != 1.0:
        rows.append(("scale", "of the hand's path", f"{calibration.scale:.4f}", ""))
    if calibration.table_height is not None:
        rows.append(("table", "height", f"{calibration.table_height:.3f} m", ""))
    if calibration.robots:
        rows.append(("robots", "only for", ", ".join(calibration.robots), ""))
    for each in calibration.obstacles:
        rows.append(("obstacle", each.name, f"{each.shape} {', '.join(f'{x:g}' for x in each.size)} m", ""))
    for name, value in calibration.residuals.items():
        part, _, figure = name.partition(".")
        rows.append(("fit", f"of {part}", f"{figure} {value:.4g}", ""))
    return words_table(("part", "what", "value", "σ"), rows)


def base_table(rows: Sequence[Mapping[str, Any]], units: Units) -> Table:
    """One sigma of the tool in base at each keyframe (from `base_sigmas`): in total, and by source (rms over the axes).

    A source that was not measured is blank.
    """
    parts, fine = list(rows[0]["base_sigma_parts_m"]) if rows else [], units.finer
    total = (*(f"tool σ {axis} ({fine.length})" for axis in "xyz"), f"tool σ ({units.angle_sign})")
    table = make_table("#", *total, *(f"σ by {part} ({fine.length})" for part in parts))
    for k, row in enumerate(rows):
        sigmas = (np.nan if x is None else np.sqrt(np.mean(np.square(x))) for x in row["base_sigma_parts_m"].values())
        turn = units.angles(np.radians(max(row["base_sigma_deg"])))
        lengths, by_source = (fine.lengths(list(x), finer=1) for x in (row["base_sigma_m"], sigmas))
        table.add_row(str(k), *lengths, *turn, *by_source)
    return table


def _pose(part: str, what: str, pose: Pose, cov: Array | None) -> list[tuple[str, str, str, str]]:
    sigma = np.full(6, np.nan) if cov is None else one_sigma(cov)
    position = ", ".join(f"{x + 0.0:.4f}" for x in np.round(pose.p, 4))
    rpy = ", ".join(f"{x + 0.0:.2f}" for x in np.round(np.degrees(quat_to_rpy(pose.wxyz)), 2))
    return [
        (part, what, f"({position}) m", _sigma_text(1e3 * sigma[:3], 1, " mm")),
        ("", "roll, pitch, yaw", f"({rpy})°", _sigma_text(np.degrees(sigma[3:]), 2, "°")),
    ]


def _sigma_text(sigma: Array, decimals: int, unit: str) -> str:
    """One sigma along each axis, as text; a dash where it is unknown."""
    if np.isnan(sigma).all():
        return "not stated"
    return f"{', '.join('–' if np.isnan(x) else f'{x:.{decimals}f}' for x in sigma)}{unit}"


def _linear(what: str, linear: LinearErrors | None, factor: float, unit: str) -> list[tuple[str, str, str, str]]:
    if linear is None:
        return []
    bias, sigma = (", ".join(f"{factor * x:.3f}" for x in each) for each in (linear.bias, linear.bias_sigma))
    known = not np.isnan(linear.bias_sigma).any()
    rows = [("", f"{what} bias", f"({bias}) {unit}", f"{sigma} {unit}" if known else "")]
    if (linear.matrix != np.eye(3)).any():
        scale = ", ".join(f"{100.0 * (x - 1.0):+.2f}" for x in np.diagonal(linear.matrix))
        skew = linear.matrix - np.diag(np.diagonal(linear.matrix))
        rows.append(("", f"{what} scale", f"({scale}) %", ""))
        rows.append(("", f"{what} axes", f"misaligned by up to {np.degrees(np.abs(skew).max()):.2f}°", ""))
    return rows
