"""The dock places nav in the robot's base frame. A new dock can be taken from a stop of a demonstration."""

import shlex
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.calibration.field_uniformity import DISTURBED_HEADING, field_at_start
from pbd.calibration.points import POOR_CHI2
from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import joint_tool_covariances
from pbd.data import Calibration, HandPath, Keyframe
from pbd.data.calibration import DOCK_SIGMA_M
from pbd.errors import CalibrationError, UsageError, in_degrees, warn
from pbd.pose import Array, Pose, lengths, level_onto, quat_inverse, quat_rotate, yaw_toward

TILT_WARNING_DEG, UPSIDE_DOWN_DEG = 5.0, 150.0
"""Angles, degrees, between the declared and the measured vertical, above which there is a warning, or an error."""

MAX_BASE_TILT_DEG = 0.25
"""Largest tilt of the base, degrees, with which a dock may be written. A dock stores no tilt. Leaving out this much
moves a tool 0.7 m away by 3 mm, which is a dock's own sigma (DOCK_SIGMA_M)."""


def placing_covariance(sigma_mm: float, sigma_deg: float) -> Array:
    """Covariance (6, 6), m and rad, of how a person puts the sensor down: its place, and its turn about z."""
    return np.diag(np.square([*[1e-3 * sigma_mm] * 3, 0.0, 0.0, np.radians(sigma_deg)]))


def lever_figure(calibration: Calibration) -> dict[str, float]:
    """Return the lever, mm, with which a dock or nav is found, as a figure for `fit` in the calibration's file."""
    return {"lever_mm": round(1e3 * float(lengths(calibration.T_sensor_tool.p)), 1)}


def warn_of_doubts(calibration: Calibration, *parts: str) -> None:
    """Warn, a line each, of those parts ("dock", "nav", "mount") that are doubtful by the calibration's own figures."""
    fit, lever_mm = calibration.residuals, lever_figure(calibration)["lever_mm"]
    for part in parts:
        chi2 = fit.get("mount.pivot_chi2" if part == "mount" else f"{part}.chi2", 0.0)
        what = f"the [{part}] of '{calibration.name}'"
        if fit.get(f"{part}.lever_mm") == 0.0 and lever_mm > 1e3 * DOCK_SIGMA_M:
            what += f" was found before [mount] had its lever of {lever_mm:.0f} mm; find it again, or remove lever_mm"
            warn(f"{what} there if the sensor itself was at those places")
        elif chi2 > POOR_CHI2:
            what += f" fits its recording {np.sqrt(chi2):.1f} times worse than the tracker's uncertainty predicts"
            warn(f"{what}: make it again (pbd calibrate)")


def nav_in_base(calibration: Calibration, wxyz_nav_sensor: Array) -> Pose:
    """Return T_base_nav, from the sensor's attitude (4,) in nav at its first rest.

    With a dock, nav's origin is the dock's position, and nav's heading is the yaw that brings the measured attitude
    closest to the declared one. Both frames have z up. So a tilt between the two attitudes is an error, of the declared
    dock or of how the sensor was put down: it gives a warning and is never "corrected".

    Raises:
        CalibrationError: the calibration has no dock, or the sensor lies upside down on it.
    """
    if calibration.T_base_nav is not None:
        return calibration.T_base_nav
    dock = calibration.T_base_dock
    if dock is None:
        raise CalibrationError(
            f"the calibration '{calibration.name}' does not say where the hand starts in the robot's base; add a dock: "
            f"pbd calibrate dock {shlex.quote(calibration.name)} --position X Y Z --rpy R P Y"
        )
    tilt_deg = np.degrees(dock_tilt(dock, wxyz_nav_sensor))
    if tilt_deg > UPSIDE_DOWN_DEG:  # no yaw is the nearest at half a turn, so any_attitude does not help
        raise CalibrationError(
            f"at its first rest the sensor lies upside down compared with the dock of '{calibration.name}'; if the "
            "accelerometer reads -g along the axis that points up, import with --unit acc=-g (or -m/s2); if the sensor "
            "is mounted upside down, give --calibration one with rpy_deg = [180, 0, 0] in [dock] and [0, 0, 0] in "
            "[mount]",
            value=float(tilt_deg),
            bound=UPSIDE_DOWN_DEG,
        )
    if tilt_deg > TILT_WARNING_DEG and not calibration.any_attitude:
        warn(
            f"at its first rest the sensor is tilted by {tilt_deg:.0f} degrees from the dock of "
            f"'{calibration.name}'; put it down as the dock says; or, if it is held otherwise in the hand, correct "
            "rpy_deg in [dock] and in [mount]; or set any_attitude = true in [dock]"
        )
    return level_onto(Pose(np.zeros(3), wxyz_nav_sensor), dock)


def sensor_heading(wxyz_nav_sensor: Array) -> float:
    """Return the angle, rad, about nav's vertical by which the sensor is turned from nav's axes."""
    return yaw_toward(np.array([1.0, 0.0, 0.0, 0.0]), wxyz_nav_sensor)


def with_heading_sigma(path: HandPath, calibration: Calibration) -> Calibration:
    """Return the calibration, with its [nav]'s heading as uncertain as magnetic north makes it.

    If the field at the path's first rest differs from the field in which [nav] was registered, the heading is turned.
    So it is by an error of the tilt there, by the tangent of the dip times that error (M. J. Caruso, Applications of
    magnetic sensors for low cost compass systems, PLANS 2000). The error turns with the sensor; [nav] has it as it was
    at its own first rest. If the sensor's heading differs by h between the two, 2 sin(h / 2) times the error is left.

    Raises:
        CalibrationError: nav of the calibration and nav of the path count their heading from different directions: one
            with a magnetometer, one without, or the field differs too much.
    """
    tracking, registered = path.tracking, calibration.nav_points_north
    if (
        tracking is None
        or registered is None
        or (tracking.method == "paper" and tracking.recording.device_rpy is not None)
    ):
        return calibration  # unknown; the paper's method takes the device's own heading
    mag, fit = tracking.recording.mag, calibration.residuals
    if registered != (mag is not None):
        before, now = ("with", "has none, or none that can be used") if mag is None else ("without", "has one")
        raise CalibrationError(
            f"the [nav] of '{calibration.name}' was registered {before} a magnetometer, and this demonstration {now}, "
            "so its heading counts from another direction; name a calibration with a dock, or touch the points again "
            "with this sensor (pbd calibrate points)"
        )
    level, up = (fit.get(f"nav.{figure}", np.nan) for figure in ("field_level", "field_up"))
    if mag is None or not level > 0.0 or np.isnan(up):
        return calibration  # found before these figures were noted, or they were edited
    level_now, up_now = field_at_start(path, mag)
    strength, change = np.hypot(level, up), np.hypot(level_now - level, up_now - up)
    wxyz, cov_tilt = path.wxyz_nav_sensor[(path.stops[0].start + path.stops[0].stop) // 2], path.cov[0, 3:5, 3:5]
    turned = np.nan_to_num(sensor_heading(wxyz) - np.radians(fit.get("nav.sensor_heading_deg", np.nan)))
    leans = 2.0 * np.sin(0.5 * turned) * np.sqrt(np.trace(cov_tilt) / 2.0)
    # Two of the change's three components are seen. The third turns the heading, and is taken to be as large as each.
    disturbed = np.sqrt(max(change**2 - (leans * strength) ** 2, 0.0) / 2.0)
    sigma = min(float(disturbed / level), np.pi)
    if sigma > DISTURBED_HEADING:
        share = 100.0 * change / strength
        raise CalibrationError(
            f"at the first rest the magnetic field differs by {share:.0f} % from that in which the [nav] of "
            f"'{calibration.name}' was registered, so the whole motion may be turned by {in_degrees(sigma)}; keep "
            "magnets and iron away and record again, or name a calibration with a dock",
            value=sigma,
            bound=DISTURBED_HEADING,
        )
    cov = calibration.cov_start.copy()
    cov[5, 5] += sigma**2 + (leans * up / level) ** 2
    return replace(calibration, cov_base=cov)


def place_in_base(
    keyframes: Sequence[Keyframe],
    calibration: Calibration,
    scale: float = 1.0,
    path: HandPath | None = None,
    orientation: str = "demo",
) -> KeyframesInBase:
    """Place keyframes in base, by the attitude at the first of them and by the known places that the path used.

    Raises:
        CalibrationError: as `nav_in_base`; or as `with_heading_sigma`, if the path is given; or known places made the
            path depend on another start, mount or scale; or, with orientation "fixed", the tool points up at the first
            keyframe.
    """
    warn_of_doubts(calibration, "dock", "nav", "mount")
    update = None
    if path is not None:
        calibration = with_heading_sigma(path, calibration)
        update = path.calibration_update
    if update is not None:
        calibration = update.applied_to(calibration)
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    if orientation == "fixed":
        wxyz = (T_base_nav @ keyframes[0].T_nav_sensor @ calibration.T_sensor_tool).wxyz
        up = float(quat_rotate(wxyz, (0.0, 0.0, 1.0))[2])
        if up > -np.cos(np.radians(UPSIDE_DOWN_DEG)):  # near half a turn, no heading is the nearest
            raise CalibrationError(
                f"the tool points up at the first keyframe, so with z straight down it has no heading; correct [mount] "
                f"of '{calibration.name}', or use --orientation demo",
                value=up,
            )
    return KeyframesInBase(keyframes, T_base_nav, calibration, scale, path, orientation, update)


def refuse_tilted(T_base_nav: Pose) -> None:
    """Refuse a dock in a base whose z is not vertical: of a dock, position and yaw alone are used.

    Raises:
        CalibrationError: nav is tilted in base by more than MAX_BASE_TILT_DEG.
    """
    up = quat_rotate(T_base_nav.wxyz, (0.0, 0.0, 1.0))
    tilt_deg = float(np.degrees(np.arctan2(np.hypot(up[0], up[1]), up[2])))
    if tilt_deg > MAX_BASE_TILT_DEG:
        raise CalibrationError(
            f"the base is tilted by {tilt_deg:.1f} degrees from the vertical, and a dock has no tilt; "
            "pbd calibrate points --free --as nav keeps it, for demonstrations that start with the same heading",
            value=tilt_deg,
            bound=MAX_BASE_TILT_DEG,
        )


def dock_tilt(T_base_dock: Pose, wxyz_nav_sensor: Array) -> float:
    """Return the angle, rad, in sensor axes between the vertical that the dock declares and the measured one."""
    z = np.array([0.0, 0.0, 1.0])
    declared = quat_rotate(quat_inverse(T_base_dock.wxyz), z)
    measured = quat_rotate(quat_inverse(wxyz_nav_sensor), z)
    return float(np.arctan2(np.linalg.norm(np.cross(declared, measured)), declared @ measured))


def dock_at(
    keyframes: Sequence[Keyframe], index: int, calibration: Calibration, path: HandPath | None = None
) -> tuple[Pose, Array]:
    """Return T_base_sensor at a keyframe, and its covariance (6, 6), m and rad.

    The covariance has no tilt, because only position and heading of a dock are used.

    Raises:
        CalibrationError: as `place_in_base`, or the base is tilted.
        UsageError: there is no such keyframe.
    """
    if not 0 <= index < len(keyframes):
        raise UsageError(f"the keyframe must be from 0 to {len(keyframes) - 1}, got {index}", value=index)
    placed = place_in_base(keyframes, calibration, path=path)
    no_tool = replace(placed.calibration, T_sensor_tool=Pose.identity())
    placed = replace(placed, keyframes=[keyframes[index]], calibration=no_tool)
    refuse_tilted(placed.T_base_nav)
    cov = np.sum([*joint_tool_covariances(placed, of_sensor=True).values()], axis=0)
    cov[3:5] = cov[:, 3:5] = 0.0
    return tool_poses(placed)[0], cov
