"""pbd calibrate points CALIBRATION DEMO --points FILE: where nav lies in the robot's base, from touched points."""

import argparse
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pbd.calibration.correspondence import match_points
from pbd.calibration.dock import lever_figure, placing_covariance, refuse_tilted, sensor_heading, warn_of_doubts
from pbd.calibration.field_uniformity import field_at_start, field_spread
from pbd.calibration.points import POOR_CHI2, PointFit, fit_points, refuse_shape
from pbd.calibration.registration import PointObservations, observe_points
from pbd.calibration.rests import rms
from pbd.cli.calibrate.replacing import judge_fit, keep_other_start
from pbd.cli.common import sigma_json, track_with
from pbd.cli.console import print_json, say, working
from pbd.data import Calibration, HandPath, Keyframe, Recording
from pbd.data.covariance import one_sigma
from pbd.errors import CalibrationError, UsageError, amount, warn
from pbd.files.calibration_edit import calibration_to_update, pose_values, update_calibration
from pbd.files.demo import load_demo
from pbd.files.points import read_points
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_to_rpy, yaw_toward
from pbd.tracking.keyframes import find_keyframes
from pbd.view.calibration_tables import points_table
from pbd.view.terminal_tables import print_table


def run(args: argparse.Namespace) -> None:
    """Track, match stops with points, fit nav in base, write it, and report its uncertainty."""
    points = read_points(args.points, args.unit)
    p_base = np.array(list(points.values()))
    path, calibration = calibration_to_update(args.name)
    warn_of_doubts(calibration, "mount")
    hand = track_with(args, load_demo(args.demo).recorded, calibration)
    assert hand.tracking is not None
    recording = hand.tracking.recording
    part = args.part or ("dock" if recording.mag is None else "nav")
    if not args.force:
        keep_other_start(path, calibration, part)
    keyframes = find_keyframes(hand)
    with working("fitting"):
        touched = _match_stops(args, hand, keyframes, p_base, calibration)
        fit = fit_points(
            touched,
            p_base,
            free=args.free,
            scaled=args.find_scale,
            scale=calibration.scale,
            touch_m=1e-3 * args.touch_mm,
        )
    if part == "dock":
        refuse_tilted(fit.T_base_nav)
    _warn_of_wrong_points(args, points, touched, fit)
    heading, tan_dip = _report_heading(args, recording, keyframes, calibration, part)

    pose = fit.T_base_nav
    if part == "dock":
        pose = pose @ Pose(np.zeros(3), keyframes[0].T_nav_sensor.wxyz)  # nav's origin is the sensor at its first rest
    figures = _figures(fit) | lever_figure(calibration)
    if scale_sigma := fit.scale_sigma / fit.scale if args.find_scale else calibration.scale_sigma:
        figures["scale_sigma"] = round(scale_sigma, 5)
    if heading is not None and recording.mag is not None:
        level, up = field_at_start(hand, recording.mag)
        figures |= {"heading_deg": round(float(np.degrees(heading)), 2), "field_level": round(level, 3)}
        figures["field_up"] = round(up, 3)
        figures["sensor_heading_deg"] = round(float(np.degrees(sensor_heading(keyframes[0].T_nav_sensor.wxyz))), 1)
    cov = fit.cov.copy()
    if part == "nav" and heading is not None:
        cov[5, 5] += heading**2  # the heading differs between demonstrations by this sigma
    _judge(args, path, calibration, part, fit)
    later = placing_covariance(args.sigma_mm, args.sigma_deg if part == "dock" or heading is None else 0.0)
    values = pose_values(pose, "in base", cov + later) | {"fit": (figures, ""), "any_attitude": (None, "")}
    update_calibration(path, {part: values}, scale=fit.scale if args.find_scale else None)
    sigma = one_sigma(cov)
    columns = tuple(points), touched.stops, fit.residuals, fit.left_out, fit.left_out_sigma, fit.used
    if args.json:
        rpy_deg = np.degrees(quat_to_rpy(pose.wxyz))
        where = {"position_m": pose.p, "rpy_deg": rpy_deg} | sigma_json(sigma)
        keys = "name", "stop", "residual_m", "left_out_m", "left_out_sigma_m", "used"
        rows = [dict(zip(keys, each, strict=True)) for each in zip(*columns, strict=True)]
        print_json({"calibration": str(path), part: where, "scale": fit.scale, "points": rows, "fit": figures})
        return
    print_table(points_table(*columns))
    if not touched.lever.any():
        say(f"{path} has no lever in [mount]: assuming that the sensor itself touched the points")
    x, y, z = pose.p
    say(
        f"{path}: [{part}] at ({x:.3f}, {y:.3f}, {z:.3f}) m in base to {1e3 * float(sigma[:3].max()):.1f} mm, heading "
        f"to {np.degrees(sigma[5]):.2f} degrees (one sigma)"
        + (f"; scale {fit.scale:.4f} to {fit.scale_sigma:.4f}" if args.find_scale else "")
    )
    if fit.chi2 <= POOR_CHI2:
        say(f"the points fit as expected ({np.sqrt(fit.chi2):.1f} times the tracker's uncertainty)")
    # The accelerometer's bias tilts nav in another direction where the sensor starts with another heading.
    of_tilt_deg = tan_dip * float(np.degrees(np.sqrt(np.trace(keyframes[0].cov[3:5, 3:5]))))
    _say_where_it_holds(args, part, float(np.degrees(sigma[5])), of_tilt_deg)


def _warn_of_wrong_points(
    args: argparse.Namespace, names: Iterable[str], touched: PointObservations, fit: PointFit
) -> None:
    order = " and the order (--any-order finds it)" if args.stops is None and not args.any_order else ""
    for name, stop, off, good in zip(names, touched.stops, fit.left_out, fit.used, strict=True):
        if not good:
            warn(
                f"the point '{name}' (stop {stop}) is wrong: it lies {100.0 * np.linalg.norm(off):.1f} cm from where "
                f"the other points put it, so it is left out; check its coordinates{order}, or touch it again"
            )


def _figures(fit: PointFit) -> dict[str, float]:
    """How well the points fit, as the calibration file has it."""
    off_mm, left_out_mm = (1e3 * np.linalg.norm(each[list(fit.used)], axis=1) for each in (fit.residuals, fit.left_out))
    figures = {"points": len(off_mm), "rms_mm": round(rms(off_mm), 2), "left_out_rms_mm": round(rms(left_out_mm), 2)}
    return figures | {"chi2": round(fit.chi2, 3)}


def _judge(args: argparse.Namespace, path: Path, calibration: Calibration, part: str, fit: PointFit) -> None:
    """Refuse or warn of points that fit badly (`judge_fit`)."""
    what = f"the points fit {np.sqrt(fit.chi2):.1f} times worse than the tracker's uncertainty predicts"
    again = "touch them again, more calmly, or correct their coordinates, the tip in [mount]"
    if calibration.scale != 1.0 and not args.find_scale:
        again += f" or the scale of {calibration.scale:g} there (--find-scale finds it)"
    again += "" if args.free else "; a tilted base needs --free"
    known = calibration.T_base_nav if part == "nav" else calibration.T_base_dock
    before = calibration if known is not None and not args.force else None
    judge_fit(path, before, f"{part}.chi2", fit.chi2, what, again)


def _say_where_it_holds(args: argparse.Namespace, part: str, sigma_deg: float, of_tilt_deg: float) -> None:
    """Say for which demonstrations the start holds; both angles are sigmas of nav's heading, degrees."""
    there = f"at that point (to {args.sigma_mm:g} mm: --sigma-mm)"
    angle = amount(args.sigma_deg, "degree", "g")
    turned = "" if part == "nav" else f" and with the same rotation (to {angle}: --sigma-deg)"
    if part == "nav" and of_tilt_deg > 0.5:  # 4 mm at half a metre
        turned = (
            f"; with another heading there, nav's is known to {np.hypot(sigma_deg, of_tilt_deg):.1f} degrees only: "
            "`pbd calibrate sensor` betters that"
        )
    say(f"this holds for later demonstrations that start with the sensor's first rest {there}{turned}")


def _report_heading(
    args: argparse.Namespace, recording: Recording, keyframes: Sequence[Keyframe], calibration: Calibration, part: str
) -> tuple[float | None, float]:
    """Say how well nav's heading repeats; return its sigma, rad, and the tangent of the field's dip.

    Without a magnetometer they are None and 0.
    """
    again = [(name, load_demo(name).recording) for name in args.again]
    if again and (bare := [name for name, each in [(args.demo, recording), *again] if each.mag is None]):
        what = f"--again compares headings by the magnetometer, and {bare[0]} has none; leave it out"
        raise UsageError(what, value=bare[0])
    if recording.mag is None:
        if part == "nav":
            warn(
                "without a magnetometer the heading is measured from the first rest, so [nav] holds only for "
                f"demonstrations that start with the same heading{'' if args.free else '; use --as dock instead'}"
            )
        return None, 0.0
    at_stops = [recording.mag[np.abs(recording.t - keyframe.t) <= 0.5 * keyframe.dwell_s] for keyframe in keyframes]
    means = np.array([each.mean(axis=0) for each in at_stops])
    spread = field_spread(means, np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes]))
    heading = spread.heading
    say(
        f"the magnetic heading differs by {np.degrees(spread.heading):.1f} degrees from stop to stop (rms), the "
        f"field's strength by {100.0 * spread.strength:.0f} %"
    )
    if again:
        turns = []
        for name, other in again:
            with working(f"tracking {name}"):
                path = track(other, calibration=calibration, accept_gap=args.accept_gap)
                wxyz = find_keyframes(path)[0].T_nav_sensor.wxyz
                turns.append(yaw_toward(keyframes[0].T_nav_sensor.wxyz, wxyz))
        changes = np.array(turns)
        heading = rms(changes)
        say(
            f"nav's heading repeats to {np.degrees(heading):.1f} degrees (rms over {len(changes)} demonstrations; at "
            f"most {np.degrees(np.abs(changes).max()):.1f})"
        )
    if part == "nav" and spread.disturbed:
        warn(
            "the magnetic field is disturbed here, or the magnetometer is not calibrated: "
            + (
                "keep iron away, or calibrate it"
                if args.free
                else "start every demonstration from a dock (--as dock), whose heading does not depend on it"
            )
        )
    return heading, spread.tan_dip


def _match_stops(
    args: argparse.Namespace, hand: HandPath, keyframes: Sequence[Keyframe], p_base: Array, calibration: Calibration
) -> PointObservations:
    """Match the stops with the points: by --stops, in their order, or in any order."""
    refuse_shape(p_base, args.free)
    count, cov = len(keyframes), calibration.cov_sensor_tool
    cov_tip = None if cov is None else cov[:3, :3]
    every = observe_points(keyframes, hand.covariance, calibration.T_sensor_tool.p, cov_tip)
    if args.stops is None:
        sigma = np.sqrt(np.diagonal(every.cov).reshape(-1, 3).mean(axis=1))
        p_tip = calibration.scale * every.p_nav_sensor + every.lever
        in_order = not args.any_order
        return every.only(match_points(p_tip, calibration.scale * sigma, p_base, in_order, args.free))
    if len(args.stops) != len(p_base):
        what = f"--stops names {amount(len(args.stops), 'stop')} for {len(p_base)} points"
        raise CalibrationError(f"{what}; name one stop per point")
    if len(set(args.stops)) < len(args.stops) or not set(args.stops) <= set(range(count)):
        what = f"--stops must name different stops from 0 to {count - 1}"
        raise CalibrationError(f"{what}; `pbd keyframes {shlex.quote(args.demo)}` lists them")
    return every.only(args.stops)
