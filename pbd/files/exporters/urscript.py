"""URScript: a program with a movej to each keyframe, to read and edit; or dense, with a servoj each controller period.

movej moves straight in joint space from rest to rest: the leading axis accelerates with a to v, and brakes with a
(Universal Robots, Script Manual, chapter "Module motion"). v is the planned motion's peak velocity, and a makes the
move as long as planned. a never exceeds the planned peak acceleration, which builds up with limited jerk.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pbd.data import Robot, Samples
from pbd.errors import PlanError, one_line
from pbd.files.exporters import SERVOJ_HZ
from pbd.files.exporters.controller_interpolation import set_point_samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.io.made_by_pbd import sealed
from pbd.pose import Array

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
"""Names of the joints in Universal Robots' own URDFs, base to tool. A prefix may come before them."""

OFF_LINE_RAD = 1e-6
"""Largest deviation of a move from a straight line in joint space, rad, for movej."""

SETTLE_S = 0.2
"""Time for which a dense move's last point is held, s: twice servoj's lookahead time, by which the arm lags."""

HEAD = """\
# {demo} for {robot}, planned and audited by pbd. Fill in the two functions of the gripper. You may edit the moves, but
# edited moves are not audited: set a low speed on the slider the first time.
def pbd_{name}():
  def gripper_close():
    # replace this by your gripper's call, which must wait until it has closed
    sleep({stroke})
  end
  def gripper_open():
    sleep({stroke})
  end

  # Refuse to start if the arm is not where the motion begins.
  start = [{start}]
  here = get_actual_joint_positions()
  i = 0
  while i < 6:
    if norm(here[i] - start[i]) > 0.02:
      popup("The arm is not where the motion begins ({degrees} degrees)", title="pbd", error=True, blocking=True)
      halt
    end
    i = i + 1
  end

"""


class _Phase(NamedTuple):
    """From `start` to `end`, s, the arm moves from rest to rest, or stands still."""

    start: float
    end: float
    moves: bool


def check(robot: Robot) -> None:
    """Refuse (PlanError) an arm whose joints don't have Universal Robots' names, or that has others too (a rail)."""
    own = [name for name in robot.joints if name.endswith(JOINTS)]
    others = [name for name in robot.joints if name not in own]
    if len(own) != 6 or not all(map(str.endswith, own, JOINTS)):
        what = f"urscript is for arms of Universal Robots, which {robot.name} is not; take csv, npz or ros2-json"
        raise PlanError(what, robot=robot.name)
    if others:
        what = f"urscript moves the six joints of the arm, but not {', '.join(others)}: leave that out of [arm] joints"
        raise PlanError(f"{what}, where it stays at 0, or take csv, npz or ros2-json", robot=robot.name)


def samples(request: ExportRequest) -> Samples:
    """Sample at the end of each move, or, dense, at the controller's period."""
    return request.trajectory.at(
        np.concatenate([_instants(request, phase) for phase in _phases(request) if phase.moves])
    )


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the program."""
    trajectory, gripper = request.trajectory, request.robot.gripper
    name = re.sub(r"\W", "_", request.source.name, flags=re.ASCII)
    # A servoj goes on from there within 2 ms, so a rounded start would be a jerk.
    q = trajectory.at(np.zeros(1)).q[0]
    start, degrees = _numbers(q, 12 if request.dense else 6), _numbers(np.degrees(q), 1)
    stroke = _seconds(1.0 if gripper is None else gripper.stroke_s)
    demo, robot = one_line(request.source.name), one_line(request.robot.name)
    filled = {"demo": demo, "robot": robot, "name": name, "stroke": stroke}
    lines = [HEAD.format(**filled, start=start, degrees=degrees)]
    arrives = {round(float(t), 6): i for i, t in enumerate(trajectory.keyframe_t)}
    for phase in _phases(request):
        keyframe = arrives.get(round(phase.end, 6)) if phase.moves else None
        label = "" if keyframe is None else one_line(request.source.keyframes[keyframe].label)
        comment = "" if keyframe is None else f"  # keyframe {keyframe}{label and ': '}{label}"
        if not phase.moves:
            lines += _stay(request, phase)
        elif request.dense:
            lines += [_servoj(q, _period_s(request)) for q in trajectory.at(_instants(request, phase)).q]
            lines[-1] = f"{lines[-1][:-1]}{comment}\n"
        else:
            a, v = _acceleration_and_velocity(request, phase)
            q = trajectory.at(np.array([phase.end])).q[0]
            lines.append(f"  movej([{_numbers(q, 6)}], a={_positive(a)}, v={_positive(v)}){comment}\n")
    if request.dense and phase.moves:
        lines += _end_of_servo(request, phase.end)
    path.write_text(sealed(f"{''.join(lines)}end\n\npbd_{name}()\n"), encoding="utf-8")


def _phases(request: ExportRequest) -> list[_Phase]:
    """Cut the motion where the arm comes to rest, and merge neighbouring phases without motion.

    A move too small for the program's decimals counts as none.
    """
    c, knots = request.trajectory.coefficients, request.trajectory.knots
    q = request.trajectory.at(knots).q
    rests = np.append(np.abs(c[:, 1]).max(axis=1) <= 1e-9, True)  # rad/s
    phases: list[_Phase] = []
    for a, b in pairwise(np.flatnonzero(rests).tolist()):
        moves = bool(np.abs(q[a + 1 : b + 1] - q[a]).max() > OFF_LINE_RAD)
        start = phases.pop().start if phases and not (moves or phases[-1].moves) else float(knots[a])
        phases.append(_Phase(start, float(knots[b]), moves))
    return phases


def _instants(request: ExportRequest, move: _Phase) -> Array:
    """Return the instants of a move's points: its end and, dense, each period before it."""
    if not request.dense:
        return np.array([move.end])
    count = int(np.ceil((move.end - move.start) / _period_s(request) - 1e-6))
    return np.append(move.start + _period_s(request) * np.arange(1, count), move.end)


def _period_s(request: ExportRequest) -> float:
    """Return the controller's period, s."""
    return 1.0 / (request.rate_hz or SERVOJ_HZ[0])


def _acceleration_and_velocity(request: ExportRequest, move: _Phase) -> tuple[float, float]:
    """Return a and v of the leading axis, so that a movej is as long as the move; PlanError: it is not straight."""
    points = request.trajectory.at(np.linspace(move.start, move.end, 200))  # they find the peak to 0.01 %
    delta, duration = points.q[-1] - points.q[0], move.end - move.start
    leading = int(np.argmax(np.abs(delta)))
    distance = float(np.abs(delta[leading]))
    along = (points.q[:, leading] - points.q[0, leading]) / delta[leading] if distance else np.zeros(len(points.t))
    if np.abs(points.q - points.q[0] - along[:, None] * delta).max() > OFF_LINE_RAD:
        what = f"from {move.start:.2f} to {move.end:.2f} s the arm follows a curve, which movej can't; take --dense"
        raise PlanError(what, value=move.start)
    v = min(float(np.abs(points.qd[:, leading]).max()), 2.0 * distance / duration)
    a = v / (duration - distance / v)
    return a, v


def _stay(request: ExportRequest, stop: _Phase) -> list[str]:
    """Return the calls of the gripper and of sleep during a stop. A call of the gripper lasts as long as its stroke."""
    lines, at = (_end_of_servo(request, stop.start), stop.start + SETTLE_S) if request.dense else ([], stop.start)
    t, opening = request.trajectory.gripper_t.tolist(), request.trajectory.gripper_opening.tolist()
    for (start, end), (before, after) in zip(pairwise(t), pairwise(opening), strict=True):
        if before != after and stop.start - 1e-6 <= start < stop.end:
            lines += _sleep(start - at)
            lines.append(f"  gripper_{'open' if after > before else 'close'}()\n")
            at = end
    return lines + _sleep(stop.end - at)


def _servoj(q: Array, seconds: float) -> str:
    return f"  servoj([{_numbers(q, 12)}], 0, 0, {seconds:g}, 0.1, 300)\n"


def _end_of_servo(request: ExportRequest, t: float) -> list[str]:
    """Return the calls that let the arm arrive where it is to stand at t s, and end servo mode at 4 rad/s2.

    UR's own driver stops so (external_control.urscript). Without a next servoj in time, the controller itself brakes an
    arm that still lags, maybe with a protective stop.
    """
    return [_servoj(request.trajectory.at(np.array([t])).q[0], SETTLE_S), "  stopj(4)\n"]


def _sleep(seconds: float) -> list[str]:
    return [f"  sleep({_seconds(seconds)})\n"] if seconds > 1e-6 else []


def _seconds(seconds: float) -> str:
    return f"{round(seconds, 6):g}"


def _positive(x: float) -> str:
    """Return a number above zero with seven digits; a slow move's would vanish in six decimals."""
    return np.format_float_positional(x, 7, fractional=False)


def _numbers(q: Array, decimals: int) -> str:
    return ", ".join(f"{x:.{decimals}f}" for x in np.round(q, decimals) + 0.0)


def read(path: Path) -> Samples:
    """Simulate the controller that runs a program of `write`; sample at changes of acceleration or, dense, each period.

    A servoj lasts a whole period, so a dense motion falls behind the planned one by up to one period per move, and by
    up to SETTLE_S per stop.
    """
    head, *body = path.read_text(encoding="utf-8").partition("\n  start = ")
    calls = re.findall(r"^  (movej|servoj|sleep|gripper_open|gripper_close)\((.*?)\)(?:  #|$)", body[1], re.M)
    periods = [_servoj_seconds(given) for name, given in calls if name == "servoj"]
    stroke = float(re.findall(r"sleep\((.+)\)", head)[0])
    run = _Controller(_floats(body[1].partition("\n")[0]), stroke, min(periods, default=0.0))
    for name, given in calls:
        if name == "movej":
            run.move(_floats(given), *(float(each) for each in re.findall(r"[av]=([^,]+)", given)))
        elif name == "servoj":
            for _ in range(round(_servoj_seconds(given) / run.period)):
                run.add(run.period, _floats(given))
        else:
            seconds = float(given) if name == "sleep" else run.stroke
            run.stay(seconds, {"gripper_open": 1.0, "gripper_close": 0.0}.get(name))
    return run.samples()


def _floats(listed: str) -> Array:
    return np.array([float(each) for each in listed.partition("[")[2].partition("]")[0].split(",")])


def _servoj_seconds(given: str) -> float:
    return float(given.split("], ")[1].split(", ")[2])


class _Controller:
    """The simulated arm; `period`, s, is that of servoj, or 0 where there is none."""

    def __init__(self, q: Array, stroke: float, period: float) -> None:
        """Start at joints q (6,), rad; `stroke`: duration of a gripper's call, s."""
        self.stroke, self.period = stroke, period
        self.rows: list[tuple[float, Array, Array, Array, float]] = [(0.0, q, 0.0 * q, 0.0 * q, np.nan)]

    def add(self, dt: float, q: Array, qd: float | Array = 0.0, qdd: float | Array = 0.0) -> None:
        """Add the state after dt s: joints, velocity, and the acceleration from then on."""
        t, *_, opening = self.rows[-1]
        self.rows.append((t + dt, q, qd + 0.0 * q, qdd + 0.0 * q, opening))

    def move(self, q: Array, a: float, v: float) -> None:
        """Move with a trapezoidal, or triangular, velocity of the leading joint, and the others in step."""
        t, before, *_, opening = self.rows.pop()
        distance = float(np.abs(q - before).max())
        direction = (q - before) / (distance or 1.0)
        v = min(v, float(np.sqrt(a * distance)))
        ramp_s, cruise_s = v / a, max(distance / v - v / a, 0.0) if distance else 0.0
        self.rows.append((t, before, 0.0 * q, a * direction, opening))
        if cruise_s > 1e-9:
            self.add(ramp_s, before + 0.5 * v * ramp_s * direction, v * direction)
        self.add(
            cruise_s if cruise_s > 1e-9 else ramp_s, q - 0.5 * v * ramp_s * direction, v * direction, -a * direction
        )
        self.add(ramp_s, q)

    def stay(self, seconds: float, opening: float | None) -> None:
        """Stand for some seconds, in which the gripper may move to an opening."""
        *_, q, _, _, before = self.rows[-1]
        if opening is not None and np.isnan(before):
            self.rows = [(*row[:-1], 1.0 - opening) for row in self.rows]
            before = 1.0 - opening
        steps = int(np.ceil(seconds / self.period)) if self.period else 1
        for i in range(1, steps + 1):
            self.add(self.period or seconds, q)
            if opening is not None:
                self.rows[-1] = (*self.rows[-1][:-1], before + i / steps * (opening - before))

    def samples(self) -> Samples:
        """Return all states."""
        t, q, qd, qdd, opening = (np.array(column) for column in zip(*self.rows, strict=True))
        opening = np.nan_to_num(opening, nan=1.0)
        return set_point_samples(t, q, opening) if self.period else Samples(t, q, qd, qdd, opening)
