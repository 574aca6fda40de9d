"""pbd calibrate mount CALIBRATION DEMO: where the tool is relative to the sensor."""

import argparse

import numpy as np

from pbd.calibration.mount import PivotFit, TurnsFit, fit_pivot, fit_turns
from pbd.calibration.rests import rms
from pbd.cli.calibrate.replacing import judge_fit
from pbd.cli.common import sigma_json, track_with
from pbd.cli.console import print_json, say
from pbd.data import Calibration
from pbd.data.calibration import DOCK_SIGMA_M, DOCK_SIGMA_RAD
from pbd.data.covariance import one_sigma
from pbd.errors import UsageError, warn
from pbd.files.calibration_edit import calibration_to_update, earlier_fit, pose_values, update_calibration
from pbd.files.demo import load_demo
from pbd.pose import Array, Pose, quat_rotate
from pbd.tracking.keyframes import find_keyframes
from pbd.view.terminal_tables import print_table, words_table


def run(args: argparse.Namespace) -> None:
    """Track the recording, fit the mount, write it, and report its uncertainty."""
    if not (args.pivot or args.turns):
        raise UsageError("say what the recording shows: --pivot, --turns x,-x,z, or both")
    path, calibration = calibration_to_update(args.name)
    hand = track_with(args, load_demo(args.demo).recorded, calibration)
    keyframes = find_keyframes(hand)
    pivot = fit_pivot(keyframes, hand.covariance, calibration.scale) if args.pivot else None
    turns = fit_turns(keyframes, args.turns) if args.turns else None
    if turns is not None and len({name.strip("-") for name in args.turns}) < 3:
        warn(
            "turns about two axes fit wrong signs, or another two axes, just as well: check where the approach (z) "
            "points, or add turns about the third axis"
        )
    mount, cov, figures = _merged(calibration, pivot, turns)
    cov_before = calibration.cov_sensor_tool
    if pivot is not None:
        more = f"{np.sqrt(pivot.chi2):.1f} times more than the tracker's uncertainty predicts"
        what = f"the tip slipped, or the moves were too fast (it moved {more})"
        again = "pivot again, more slowly, on a point that holds the tip"
        measured = cov_before is not None and bool(cov_before[:3, :3].any())
        before = calibration if measured and not args.force else None
        judge_fit(path, before, "mount.pivot_chi2", pivot.chi2, what, again)
    metres, rad = mount.distance(calibration.T_sensor_tool)
    if calibration.knows_start and (metres > DOCK_SIGMA_M or rad > DOCK_SIGMA_RAD):
        part = "nav" if calibration.T_base_dock is None else "dock"
        warn(
            f"the [{part}] of {path} stays as it is: if it was found with this tool (by points, or --joints), find it "
            "again, because the mount has changed since"
        )
    values = pose_values(mount, "in sensor axes", cov) | {"fit": (figures, "")}
    update_calibration(path, {"mount": values})
    if cov_before is not None:
        say(f"before, {_certainty(calibration.T_sensor_tool, cov_before)}")
    if args.json:
        shown = {"position_m": mount.p, "wxyz": mount.wxyz} | sigma_json(one_sigma(cov))
        of_pivot = pivot and {"residuals_m": pivot.residuals, "chi2": pivot.chi2}
        of_turns = turns and {"moves": list(turns.moves), "off_deg": np.degrees(turns.off)}
        return print_json({"calibration": str(path), "mount": shown, "pivot": of_pivot, "turns": of_turns})
    _print(args, pivot, turns)
    return say(f"{path}: {_certainty(mount, cov)}")


def _merged(
    calibration: Calibration, pivot: PivotFit | None, turns: TurnsFit | None
) -> tuple[Pose, Array, dict[str, float]]:
    """Return T_sensor_tool, its covariance (6, 6) and the fits' figures; parts that were not fitted are kept."""
    mount = calibration.T_sensor_tool
    cov = np.zeros((6, 6)) if calibration.cov_sensor_tool is None else calibration.cov_sensor_tool.copy()
    figures = earlier_fit(calibration, "mount")
    for fitted, part in ((pivot, slice(0, 3)), (turns, slice(3, 6))):
        if fitted is not None:
            cov[part] = cov[:, part] = 0.0
            cov[part, part] = fitted.cov
    if pivot is not None:
        mount = Pose(pivot.p_sensor_tip, mount.wxyz)
        off_mm = 1e3 * np.linalg.norm(pivot.residuals, axis=1)
        figures |= {"pivot_stops": len(off_mm), "pivot_rms_mm": round(rms(off_mm), 2)}
        figures["pivot_chi2"] = round(pivot.chi2, 3)
    if turns is not None:
        mount = Pose(mount.p, turns.wxyz_sensor_tool)
        figures |= {"turns": len(turns.off), "turns_rms_deg": round(rms(np.degrees(turns.off)), 2)}
    return mount, cov, figures


def _certainty(mount: Pose, cov: Array) -> str:
    """Say where the tool is on the sensor, with the sigmas that are known."""
    sigma = one_sigma(cov)
    x, y, z = 1e3 * mount.p
    place = f"the tool is at ({x:.1f}, {y:.1f}, {z:.1f}) mm on the sensor"
    to = f"{', '.join(f'{1e3 * s:.1f}' for s in sigma[:3])} mm"
    turned = f"{np.degrees(sigma[3:].max()):.1f} degrees"
    if np.isnan(sigma[3:]).any():
        return f"{place}, to {to} (one sigma); its rotation is not measured yet: --turns does that"
    if np.isnan(sigma[:3]).any():
        return f"{place}, which is not measured yet: --pivot does that; its rotation is known to {turned} (one sigma)"
    return f"{place}, to {to} and {turned} (one sigma)"


def _print(args: argparse.Namespace, pivot: PivotFit | None, turns: TurnsFit | None) -> None:
    """Print the residual of each stop and turn."""
    rows = []
    if pivot is not None:
        for k, off in enumerate(pivot.residuals):
            rows.append((f"stop {k}", f"tip {1e3 * np.linalg.norm(off):.1f} mm off its point", ""))
    if turns is not None:
        for name, move, off, angle in zip(args.turns, turns.moves, turns.off, turns.turned, strict=True):
            rows.append((f"move {move}, about {name}", f"{np.degrees(angle):.0f}°", f"axis {np.degrees(off):.1f}° off"))
        x, y, z = quat_rotate(turns.wxyz_sensor_tool, (0.0, 0.0, 1.0))
        rows.append(("the approach (z)", f"({x:.2f}, {y:.2f}, {z:.2f})", "in the sensor's axes"))
    print_table(words_table(("what", "value", ""), rows))
