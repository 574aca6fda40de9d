"""Track one recording, without what is known of its stops."""

from pbd.calibration.sensor import corrected
from pbd.calibration.sensor_changed import disagreements
from pbd.data import Calibration, Demonstration, HandPath, Recording, SensorErrors, Stop, Tracking
from pbd.errors import UsageError, warn
from pbd.pose import Array
from pbd.tracking.estimate import Estimate, estimate, refuse_doubted_rest
from pbd.tracking.first_rest import Rest, find_rest
from pbd.tracking.noise import noise_of
from pbd.tracking.paper import track_as_paper
from pbd.tracking.repair.channel_faults import refuse_freezes
from pbd.tracking.repair.gaps import is_in_rest, refuse_gaps
from pbd.tracking.repair.gyro_consistency import warn_upside_down
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.repair.saturation import declip, find_clips
from pbd.tracking.residual_tests import alarms
from pbd.tracking.smoother.preintegration import LostMotion
from pbd.tracking.white_noise import steps_of

OPEN_END_S = 0.2
"""Longest motion, s, before the first stop or after the last one, without a warning."""

METHODS = ("default", "paper")
"""Names of the tracking methods: pbd's own, and the paper's."""


def track_recording(
    demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool
) -> tuple[HandPath, Estimate]:
    """Track the recording without known places; return the path and the estimate that it was made from."""
    if method not in METHODS:
        raise UsageError(f"no method '{method}'; known are {', '.join(METHODS)}", value=method, valid=METHODS)
    recording, gaps = repair_recording(demo.recording)
    clips, steps = find_clips(recording), steps_of(recording)  # of readings: neither guessed nor mixed by a matrix
    lost: tuple[LostMotion, ...] = ()
    if method == "default":
        recording, lost = declip(recording, clips)
    errors = None if calibration is None else calibration.sensor
    recording = corrected(recording, errors)  # after `declip`: clipping is at the range of the raw values
    rest = find_rest(recording)
    if calibration is None:  # planning compares the tilt with the calibration's dock
        warn_upside_down(recording, rest.up_sensor, rest.start, rest.stop)
    if method == "paper":
        found = track_as_paper(recording, rest)
    else:
        noise, unseen = noise_of(recording, rest, errors, steps), [(gap.before, gap.after) for gap in gaps]
        found = estimate(recording, rest, noise, lost, unseen)
        still = [(gap.before, gap.after) for gap in gaps if accept_gap and is_in_rest(recording, gap, found.stops)]
        if still:  # before, the motion in them was unknown
            del found  # of a long recording it is large
            found = estimate(recording, rest, noise, lost, [gap for gap in unseen if gap not in still], still)
    refuse_gaps(gaps, recording, found.stops, accept=accept_gap)
    refuse_freezes(recording, found.path.v)
    if found.solution is not None:
        refuse_doubted_rest(recording.t, rest, found.stops)
    _warn_at_rest(recording, rest, errors)
    _warn_of_open_ends(recording.t, found.stops)
    if found.solution is not None:
        for line in alarms(found.solution, found.stops, found.sensor):
            warn(line)
    path = HandPath(
        t=recording.t,
        p_nav_sensor=found.path.p,
        v_nav_sensor=found.path.v,
        wxyz_nav_sensor=found.path.wxyz,
        stops=found.stops,
        closure=found.closure,
        covariance=found.covariance,
        grip=recording.grip,
        tracking=Tracking(
            demo, method, calibration, recording, found.path.a, rest.gravity, (rest.start, rest.stop), accept_gap
        ),
        sensor=found.sensor,
    )
    return path, found


def _warn_at_rest(recording: Recording, rest: Rest, errors: SensorErrors | None) -> None:
    """Warn where the samples of the first rest contradict gravity or the calibration."""
    rows, acc = slice(rest.start, rest.stop), rest.gravity * rest.up_sensor
    gyr = None if recording.gyr is None else rest.gyro_bias
    mag = None if recording.mag is None else recording.mag[rows].mean(axis=0)
    for line in disagreements(errors, acc, gyr, mag):
        warn(line)


def _warn_of_open_ends(t: Array, stops: tuple[Stop, ...]) -> None:
    """Warn of motion before the first stop and after the last one: neither is used."""
    before, after = float(t[stops[0].start] - t[0]), float(t[-1] - t[stops[-1].stop - 1])
    if before > OPEN_END_S:
        warn(
            f"the hand moves when the recording starts; its first rest, at {before:.1f} s, is taken as the dock; hold "
            "still there before you start the recording"
        )
    if after > OPEN_END_S:
        warn(
            f"the hand moves when the recording ends: the last {after:.1f} s are not used; stop before you end the "
            "recording"
        )
