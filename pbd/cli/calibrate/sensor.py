"""pbd calibrate sensor CALIBRATION DEMO: the sensor's bias, scale, misalignment, hard and soft iron."""

import argparse
import shlex
from typing import Any

import numpy as np

from pbd.calibration.accelerometer import NAMES
from pbd.calibration.sensor import KINDS, SensorFit, calibrate_sensor
from pbd.calibration.sensor_changed import gravity_at
from pbd.cli.console import print_json, say, working
from pbd.data.units import MG
from pbd.errors import CalibrationError, amount, warn
from pbd.files.calibration_edit import calibration_to_update, earlier_fit, sensor_parts, update_calibration, warn_of_nav
from pbd.files.demo import load_demo
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.view.terminal_tables import print_table, words_table


def run(args: argparse.Namespace) -> None:
    """Fit the sensor's errors, write them, and print them."""
    gravity = args.gravity or (None if args.latitude is None else gravity_at(args.latitude))
    path, calibration = calibration_to_update(args.name)
    with working(f"reading {args.demo}"):
        demo = load_demo(args.demo)
        if demo.takes:
            again = f"name one of them, or use `pbd fuse TAKE... -o NEW --save-calibration {shlex.quote(args.name)}`"
            raise CalibrationError(f"{args.demo} is fused from {amount(len(demo.takes), 'take')}; {again}")
        recording, gaps = repair_recording(demo.recording)
    if gaps:
        at, missing = float(recording.t[gaps[0].before]), 1e3 * gaps[0].missing_s
        raise CalibrationError(f"{args.demo} has a gap of {missing:.0f} ms at {at:.2f} s; record it again")
    with working("fitting"):
        known, celsius = calibration.sensor, args.temperature
        fit = calibrate_sensor(recording, gravity=gravity, only=args.only, known=known, temperature_c=celsius)
    for remark in fit.remarks:
        warn(remark)
    if fit.acc or fit.mag:
        warn_of_nav(path, calibration)
    kept = earlier_fit(calibration, "sensor") if args.only else {}
    update_calibration(path, sensor_parts(fit.errors, kept | _figures(fit)))
    if args.json:
        return print_json({"calibration": str(path)} | _json(fit))
    _print(fit)
    say(f"{path}: [sensor] of '{fit.errors.sensor}' from {amount(len(fit.rests), 'rest')}")
    if args.gravity is None and args.latitude is None and fit.acc is not None:
        say("assumed gravity is 9.80665 m/s2, which may be off by 0.3 %; give --latitude for a better scale")
    return None


def _figures(fit: SensorFit) -> dict[str, float]:
    """Return how well the errors fit: |a| - g (mg) and the field's strength (%), before and after."""
    figures: dict[str, float] = {}
    if acc := fit.acc:
        figures |= {"rests": len(fit.rests), "orientations": acc.orientations}
        figures |= {"acc_before_mg": round(acc.rms_before / MG, 2), "acc_after_mg": round(acc.rms_after / MG, 2)}
    if mag := fit.mag:
        figures |= {
            "mag_before_pct": round(100.0 * mag.uneven_before, 2),
            "mag_after_pct": round(100.0 * mag.uneven, 2),
        }
    return figures


def _json(fit: SensorFit) -> dict[str, Any]:
    errors = fit.errors
    result: dict[str, Any] = {"sensor": errors.sensor, "fit": _figures(fit), "remarks": list(fit.remarks)}
    for kind in KINDS:
        linear = getattr(errors, kind)
        result[kind] = linear and {"bias": linear.bias, "matrix": linear.matrix}
    result["told"] = [] if fit.acc is None else list(fit.acc.determined)
    return result | {"field_ut": errors.field, "dip_rad": errors.dip}


def _print(fit: SensorFit) -> None:
    rows = []
    if fit.errors.gyr is not None:
        bias = np.degrees(fit.errors.gyr.bias)
        rows.append(("gyro bias", f"({', '.join(f'{x:.3f}' for x in bias)}) °/s", ""))
    if fit.acc is not None:
        linear = fit.acc.linear
        lean = np.degrees([linear.matrix[1, 2], linear.matrix[0, 2], linear.matrix[0, 1]])
        shown = [f"{x / MG:+.1f} mg" for x in linear.bias]
        shown += [f"{100.0 * (x - 1.0):+.2f} %" for x in np.diagonal(linear.matrix)] + [f"{x:+.2f}°" for x in lean]
        for name, value in zip(NAMES, shown, strict=True):
            rows.append((f"accelerometer {name}", value, "" if name in fit.acc.determined else "unknown"))
        rows.append(
            ("|a| minus gravity", f"{fit.acc.rms_before / MG:.1f} mg -> {fit.acc.rms_after / MG:.2f} mg rms", "")
        )
    if fit.mag is not None:
        bias, matrix = fit.mag.linear.bias, fit.mag.linear.matrix
        rows.append(("hard iron", f"({', '.join(f'{x:.1f}' for x in bias)}) µT", ""))
        rows.append(("soft iron", f"{100.0 * np.abs(matrix - np.eye(3)).max():.1f} %", ""))
        evened = f"{100.0 * fit.mag.uneven_before:.1f} % -> {100.0 * fit.mag.uneven:.2f} % rms"
        rows.append(("strength of the field differs by", evened, f"{fit.mag.field:.1f} µT"))
        rows.append(("dip differs by", f"{np.degrees(fit.mag.dip_uneven):.2f}° rms", f"{np.degrees(fit.mag.dip):.1f}°"))
    print_table(words_table(("what", "value", ""), rows))
