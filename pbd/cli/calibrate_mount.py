"""pbd calibrate mount CALIBRATION DEMO."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pbd.cli.calibrate_common import add_name, existing
from pbd.cli.options import Commands, add_accept_gap, add_command, print_json, say
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.calibration.mount import PivotFit, TurnsFit
    from pbd.pose import Array, Pose


def add(commands: Commands) -> None:
    """Add the step."""
    parser = add_command(
        commands,
        "mount",
        "how the sensor is mounted on the tool: its lever and its rotation",
        "Find where the tool is relative to the sensor. --pivot: the tip stays on one point while you tilt the tool\n"
        "to all sides, with rests between; this gives the lever. --turns: you turn the tool about its own axes,\n"
        "one after the other, with rests between; this gives the sensor's rotation. Signs follow the right-hand\n"
        "rule; the tool's z is the approach direction, its x the direction in which the jaws open.",
        "  pbd calibrate mount bench pivot --pivot\n  pbd calibrate mount bench turns --turns x,-x,z,-z",
    )
    add_name(parser)
    parser.add_argument("demo", metavar="DEMO", help="the recording")
    parser.add_argument("--pivot", action="store_true", help="the tip stayed on one point at every stop")
    parser.add_argument(
        "--turns", type=_turns, metavar="A,A", help="the tool axis of each turn of 20 degrees or more: x, -x, y ..."
    )
    add_accept_gap(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track, fit, write, and say how far it is to be trusted."""
    import numpy as np

    from pbd.calibration.mount import fit_pivot, fit_turns
    from pbd.data import TOOL_DOWN
    from pbd.errors import CalibrationError
    from pbd.files.calibration_edit import calibration_file, covariance_values, pose_values, update_calibration
    from pbd.files.demo import load_demo
    from pbd.pipeline import track
    from pbd.pose import Pose
    from pbd.tracking.keyframes import find_keyframes

    if not (args.pivot or args.turns):
        raise CalibrationError("say what the recording shows: --pivot, --turns x,-x,z, or both")
    path = calibration_file(args.name)
    calibration = existing(path)
    with working("tracking"):
        recording = load_demo(args.demo).recording
        hand = track(recording, calibration=calibration, accept_gap=args.accept_gap)
    keyframes = find_keyframes(hand)
    mount, cov = TOOL_DOWN, np.zeros((6, 6))
    figures: dict[str, float] = {}
    if calibration is not None:
        mount = calibration.T_sensor_tool
        cov = cov if calibration.cov_sensor_tool is None else calibration.cov_sensor_tool.copy()
        figures = {
            name.removeprefix("mount."): int(value) if value == int(value) else value
            for name, value in calibration.residuals.items()
            if name.startswith("mount.")
        }
    pivot = fit_pivot(keyframes, hand.covariance) if args.pivot else None
    turns = fit_turns(keyframes, args.turns) if args.turns else None
    if pivot is not None:
        mount = Pose(pivot.p_sensor_tip, mount.wxyz)
        cov[:3] = cov[:, :3] = 0.0
        cov[:3, :3] = pivot.cov
        rms = float(np.sqrt((pivot.residuals**2).sum(axis=1).mean()))
        figures |= {"pivot_stops": len(pivot.residuals), "pivot_rms_mm": round(1e3 * rms, 2)}
    if turns is not None:
        mount = Pose(mount.p, turns.wxyz_sensor_tool)
        cov[3:] = cov[:, 3:] = 0.0
        cov[3:, 3:] = turns.cov
        if pivot is not None:
            cov[:3, :3] = pivot.cov
        figures |= {
            "turns": len(turns.off),
            "turns_rms_deg": round(float(np.degrees(np.sqrt(np.mean(turns.off**2)))), 2),
        }
    update_calibration(
        path, {"mount": pose_values(mount, "in sensor axes") | covariance_values(cov) | {"fit": (figures, "")}}
    )
    if args.json:
        print_json({"calibration": str(path)} | _json(mount, cov, pivot, turns))
        return 0
    _tell(args, pivot, turns)
    say(f"{path}: {_sure(mount, cov)}")
    return 0


def _sure(mount: Pose, cov: Array) -> str:
    """Where the tool is on the sensor, and how sure that is; what nobody measured has no sigma."""
    import numpy as np

    from pbd.data.sigma import one_sigma

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


def _turns(text: str) -> tuple[str, ...]:
    from pbd.calibration.mount import AXES

    names = tuple(text.lower().split(","))
    if not set(names) <= set(AXES):
        raise argparse.ArgumentTypeError(f"must be some of {', '.join(AXES)}, got {text}")
    return names


def _tell(args: argparse.Namespace, pivot: PivotFit | None, turns: TurnsFit | None) -> None:
    import numpy as np

    from pbd.calibration.points import POOR_CHI2
    from pbd.view.calibration_tables import figures_table
    from pbd.view.tables import print_table

    rows = []
    if pivot is not None:
        for k, off in enumerate(pivot.residuals):
            rows.append((f"stop {k}", f"tip {1e3 * np.linalg.norm(off):.1f} mm off its point", ""))
    if turns is not None:
        for name, move, off, angle in zip(args.turns, turns.moves, turns.off, turns.turned, strict=True):
            rows.append((f"move {move}, about {name}", f"{np.degrees(angle):.0f}°", f"axis {np.degrees(off):.1f}° off"))
    print_table(figures_table(rows))
    if pivot is not None and pivot.chi2 > POOR_CHI2:
        say(
            f"the tip moved {np.sqrt(pivot.chi2):.1f} times more than the tracker's uncertainty predicts: it slipped, "
            "or the moves were too fast; pivot again"
        )


def _json(mount: Any, cov: Any, pivot: PivotFit | None, turns: TurnsFit | None) -> dict[str, Any]:
    import numpy as np

    from pbd.data.sigma import one_sigma, or_none

    sigma = one_sigma(cov)
    return {
        "mount": {
            "position_m": mount.p.tolist(),
            "wxyz": mount.wxyz.tolist(),
            "sigma_m": or_none(sigma[:3]),
            "sigma_deg": or_none(np.degrees(sigma[3:])),
        },
        "pivot": None if pivot is None else {"residuals_m": pivot.residuals.tolist(), "chi2": pivot.chi2},
        "turns": None if turns is None else {"moves": list(turns.moves), "off_deg": np.degrees(turns.off).tolist()},
    }
