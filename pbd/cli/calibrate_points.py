"""pbd calibrate points CALIBRATION DEMO --points FILE."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbd.cli.calibrate_common import add_force, add_name, existing, instead_of
from pbd.cli.calibrate_heading import magnetometer, tell_heading
from pbd.cli.options import Commands, add_accept_gap, add_command, positive, print_json, say
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.calibration.point_observations import PointObservations
    from pbd.calibration.points import PointFit
    from pbd.data import Calibration, HandPath
    from pbd.files.points import Points


def add(commands: Commands) -> None:
    """Add the step."""
    parser = add_command(
        commands,
        "points",
        "where the hand's frame (nav) lies in the robot's base, from known points that the hand touched",
        "Find how a demonstration lies in the robot's base from three or more known points that its stops touched.\n"
        "FILE is a CSV with the header name,x_m,y_m,z_m (or _cm, _mm) and one row per point.",
        "  pbd calibrate points bench touches --points corners.csv\n"
        "  pbd calibrate points bench touches --points corners.csv --any-order",
    )
    add_name(parser)
    parser.add_argument("demo", metavar="DEMO", help="the demonstration whose stops touched the points")
    parser.add_argument("--points", type=Path, required=True, metavar="FILE", help="the points, in the robot's base")
    parser.add_argument("--unit", choices=("m", "cm", "mm"), help="unit of columns named x, y, z")
    order = parser.add_mutually_exclusive_group()
    order.add_argument("--any-order", action="store_true", help="the points were touched in an unknown order: find it")
    order.add_argument(
        "--stops", type=_stops, metavar="K,K,...", help="the stop that touched each point, in the points' order"
    )
    parser.add_argument("--free", action="store_true", help="also find the tilt, where the base's z is not vertical")
    parser.add_argument("--find-scale", action="store_true", help="also find the scale of the hand's path")
    parser.add_argument(
        "--touch-mm",
        type=positive,
        default=1.0,
        metavar="MM",
        help="one sigma between tip and point, each axis, mm (1)",
    )
    parser.add_argument(
        "--as",
        dest="part",
        choices=("nav", "dock"),
        help="nav: later demonstrations start at the same point with any heading (needs a magnetometer, and is the "
        "default with one); dock: they start with the sensor in the same pose",
    )
    parser.add_argument(
        "--again",
        nargs="+",
        default=(),
        metavar="DEMO",
        help="check how well the heading repeats, in demonstrations that began with the sensor put down the same way",
    )
    add_force(parser)
    add_accept_gap(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track, match, fit, write, and say how far it is to be trusted."""
    import numpy as np

    from pbd.calibration.points import POOR_CHI2, fit_points
    from pbd.data.sigma import one_sigma, or_none
    from pbd.files.calibration_edit import calibration_file, covariance_values, pose_values, update_calibration
    from pbd.files.demo import load_demo
    from pbd.files.points import read_points
    from pbd.pipeline import track
    from pbd.pose import Pose, quat_to_rpy
    from pbd.tracking.keyframes import find_keyframes

    points = read_points(args.points, args.unit)
    path = calibration_file(args.name)
    calibration = existing(path)
    recording = load_demo(args.demo).recording
    mag = magnetometer(recording)
    part = args.part or ("dock" if mag is None else "nav")
    instead = instead_of(path, calibration, part, args.force)
    with working("tracking"):
        hand = track(recording, calibration=calibration, accept_gap=args.accept_gap)
    keyframes = find_keyframes(hand)
    with working("fitting"):
        touched = _touched(args, hand, points, calibration)
        fit = fit_points(touched, points.p_base, free=args.free, scaled=args.find_scale, touch_m=1e-3 * args.touch_mm)
    _warn(fit, points, touched)
    heading = tell_heading(args.again, replace(recording, mag=mag), keyframes, calibration, part, args.accept_gap)

    pose = fit.T_base_nav
    if part == "dock":
        pose = pose @ Pose(np.zeros(3), keyframes[0].T_nav_sensor.wxyz)  # nav's origin is the sensor at its first rest
    figures = _figures(fit) | ({} if heading is None else {"heading_deg": round(float(np.degrees(heading)), 2)})
    cov = fit.cov.copy()
    if part == "nav" and heading is not None:
        cov[5, 5] += heading**2  # the next demonstration's heading differs by so much
    update_calibration(
        path,
        {
            part: pose_values(pose, "in base")
            | covariance_values(cov)
            | {"fit": (figures, ""), "any_attitude": (None, "")}
        },
        instead=instead,
        scale=fit.scale if args.find_scale else None,
    )
    sigma = one_sigma(cov)
    if args.json:
        print_json(
            {
                "calibration": str(path),
                part: {
                    "position_m": pose.p.tolist(),
                    "rpy_deg": np.degrees(quat_to_rpy(pose.wxyz)).tolist(),
                    "sigma_m": or_none(sigma[:3]),
                    "sigma_deg": or_none(np.degrees(sigma[3:])),
                },
                "scale": fit.scale,
                "points": _rows(fit, points, touched),
                "fit": figures,
            }
        )
        return 0
    _print(fit, points, touched)
    if not touched.lever.any():
        say(f"{path} has no lever in [mount]: assuming that the sensor itself touched the points")
    x, y, z = pose.p
    say(
        f"{path}: [{part}] at ({x:.3f}, {y:.3f}, {z:.3f}) m in base to {1e3 * float(sigma[:3].max()):.1f} mm, heading "
        f"to {np.degrees(sigma[5]):.2f} degrees (one sigma)"
        + (f"; scale {fit.scale:.4f} to {fit.scale_sigma:.4f}" if args.find_scale else "")
    )
    if fit.chi2 > POOR_CHI2:
        say(
            f"the points fit {np.sqrt(fit.chi2):.1f} times worse than the tracker's uncertainty predicts: do not use it"
            " until you have touched the points again, more calmly, or corrected their coordinates"
        )
    else:
        say(f"the points fit as expected ({np.sqrt(fit.chi2):.1f} times the tracker's uncertainty)")
    where = "with the sensor's first rest at that point" + ("" if part == "nav" else ", turned as in this one")
    say(f"this holds for later demonstrations that start {where}")
    return 0


def _stops(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be stops such as 1,2,4, got {text}") from None


def _touched(
    args: argparse.Namespace, hand: HandPath, points: Points, calibration: Calibration | None
) -> PointObservations:
    """The stops that touched the points, in the points' order."""
    import numpy as np

    from pbd.calibration.correspondence import match_points
    from pbd.calibration.point_observations import observe_points
    from pbd.calibration.points import refuse_shape
    from pbd.data import TOOL_DOWN
    from pbd.errors import CalibrationError
    from pbd.tracking.keyframes import find_keyframes

    refuse_shape(points.p_base, args.free)
    keyframes = find_keyframes(hand)
    if calibration is None:
        every = observe_points(keyframes, hand.covariance, TOOL_DOWN.p)
    else:
        cov = calibration.cov_sensor_tool
        cov_tip = None if cov is None else cov[:3, :3]
        every = observe_points(keyframes, hand.covariance, calibration.T_sensor_tool.p, cov_tip=cov_tip)
    if args.stops is None:
        if args.free and len(keyframes) != len(points.names):
            raise CalibrationError(
                f"{len(keyframes)} stops can't be matched with {len(points.names)} points while the tilt is free; name "
                "the stops with --stops"
            )
        sigma = np.sqrt(np.diagonal(every.cov).reshape(-1, 3).mean(axis=1))
        stops = match_points(every.p_nav_sensor + every.lever, sigma, points.p_base, not args.any_order)
    else:
        stops = args.stops
        if len(stops) != len(points.names):
            raise CalibrationError(
                f"--stops names {len(stops)} stops for {len(points.names)} points; name one stop per point"
            )
        if len(set(stops)) < len(stops) or not all(0 <= stop < len(keyframes) for stop in stops):
            raise CalibrationError(
                f"--stops must name different stops from 0 to {len(keyframes) - 1}; `pbd keyframes {args.demo}` lists "
                "them"
            )
    return every.only(stops)


def _figures(fit: PointFit) -> dict[str, float]:
    import numpy as np

    used = np.array(fit.used)
    return {
        "points": int(used.sum()),
        "rms_mm": round(1e3 * float(np.sqrt((fit.residuals[used] ** 2).sum(axis=1).mean())), 2),
        "left_out_rms_mm": round(1e3 * float(np.sqrt((fit.left_out[used] ** 2).sum(axis=1).mean())), 2),
        "chi2": round(fit.chi2, 3),
    }


def _warn(fit: PointFit, points: Points, touched: PointObservations) -> None:
    import numpy as np

    from pbd.errors import PbdWarning

    for name, stop, off, good in zip(points.names, touched.stops, fit.left_out, fit.used, strict=True):
        if not good:
            warnings.warn(
                f"the point '{name}' (stop {stop}) is wrong: it lies {100.0 * np.linalg.norm(off):.1f} cm from where "
                "the other points put it, so it is left out; check its coordinates, or touch it again",
                PbdWarning,
                stacklevel=2,
            )


def _rows(fit: PointFit, points: Points, touched: PointObservations) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "stop": touched.stops[k],
            "residual_m": fit.residuals[k].tolist(),
            "left_out_m": fit.left_out[k].tolist(),
            "left_out_sigma_m": fit.left_out_sigma[k].tolist(),
            "used": fit.used[k],
        }
        for k, name in enumerate(points.names)
    ]


def _print(fit: PointFit, points: Points, touched: PointObservations) -> None:
    from pbd.view.calibration_tables import points_table
    from pbd.view.tables import print_table

    print_table(points_table(points.names, touched.stops, fit.residuals, fit.left_out, fit.left_out_sigma, fit.used))
