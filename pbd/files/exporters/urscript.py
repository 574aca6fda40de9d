"""URScript: a movej for each keyframe, in a program to read and edit; or servoj at the controller's period.

movej goes straight in joint space, from rest to rest: its leading axis accelerates by a up to v, and brakes by a.
(Universal Robots, Script Manual, chapter "Module motion".) So v is what the planned motion reaches, and a makes the
move last as long as planned: that is never more than the planned motion's own largest, which has to build it up.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pbd.data import Robot, Samples
from pbd.errors import PbdError, PlanError
from pbd.files.exporters.controller_interpolation import set_point_samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
PERIODS_HZ = (125.0, 500.0)
"""Of a CB3 controller and of an e-Series one."""

OFF_LINE_RAD = 1e-6
"""How far from straight a move may be for movej, rad."""

AT_REST = 1e-9
"""Velocity, rad/s, below which a knot is one where the arm stands."""

HEAD = """\
# {demo} for {robot}, planned and audited by pbd. Fill in the two functions of the gripper; then edit what you like, but
# what you edit is no longer audited: take a low speed on the slider the first time.
def pbd_{name}():
  def gripper_close():
    # your gripper's own call goes here; the arm waits until it has closed
    sleep({stroke})
  end
  def gripper_open():
    sleep({stroke})
  end

  # The motion begins where the arm stands when this program starts: refuse any other place.
  start = [{start}]
  here = get_actual_joint_positions()
  i = 0
  while i < 6:
    if norm(here[i] - start[i]) > 0.02:
      popup("The arm does not stand where the motion begins: move it there", title="pbd", error=True, blocking=True)
      halt
    end
    i = i + 1
  end

"""


class _Leg(NamedTuple):
    """From when to when the arm moves, or stands."""

    since: float
    until: float
    moves: bool


def check(robot: Robot) -> None:
    """Refuse (PlanError) an arm whose joints are not named as Universal Robots' are."""
    if len(robot.joints) != 6 or not all(map(str.endswith, robot.joints, JOINTS)):
        what = f"urscript is for arms of Universal Robots, which {robot.name} is not; take csv, npz or ros2-json"
        raise PlanError(what, robot=robot.name)


def samples(request: ExportRequest) -> Samples:
    """Evaluate at the end of each move; dense, at the controller's period in each. PbdError: no controller has it."""
    check(request.robot)
    if request.rate_hz not in (None, *PERIODS_HZ):
        what = f"--rate must be 125 (CB3) or 500 (e-Series) for servoj, got {request.rate_hz:g}"
        raise PbdError(what, value=request.rate_hz)
    moves = [leg for leg in _legs(request) if leg.moves]
    return request.trajectory.at(np.concatenate([_instants(request, leg) for leg in moves]))


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the program."""
    trajectory, gripper = request.trajectory, request.robot.gripper
    name = re.sub(r"\W", "_", request.source.name, flags=re.ASCII)
    stroke, start = _seconds(1.0 if gripper is None else gripper.stroke_s), _numbers(trajectory.at(np.zeros(1)).q[0], 6)
    demo = " ".join(request.source.name.split())
    lines = [HEAD.format(demo=demo, robot=request.robot.name, name=name, stroke=stroke, start=start)]
    arrives = {round(float(t), 6): i for i, t in enumerate(trajectory.keyframe_t)}
    for leg in _legs(request):
        keyframe = arrives.get(round(leg.until, 6)) if leg.moves else None
        label = "" if keyframe is None else " ".join(request.source.keyframes[keyframe].label.split())
        remark = "" if keyframe is None else f"  # keyframe {keyframe}{label and ': '}{label}"
        if not leg.moves:
            lines += _stay(request, leg)
        elif request.dense:
            period = 1.0 / (request.rate_hz or PERIODS_HZ[0])
            rows = trajectory.at(_instants(request, leg)).q
            lines += [f"  servoj([{_numbers(q, 12)}], 0, 0, {period:g}, 0.1, 300)\n" for q in rows]
            lines[-1] = f"{lines[-1][:-1]}{remark}\n"
        else:
            a, v = _speeds(request, leg)
            q = trajectory.at(np.array([leg.until])).q[0]
            lines.append(f"  movej([{_numbers(q, 6)}], a={a:.6f}, v={v:.6f}){remark}\n")
    path.write_text(f"{''.join(lines)}end\n\npbd_{name}()\n", encoding="utf-8")


def _legs(request: ExportRequest) -> list[_Leg]:
    """Cut the motion where the arm comes to rest; what stands follows what moves."""
    c, knots = request.trajectory.coefficients, request.trajectory.knots
    stands = np.abs(c[:, 1:]).max(axis=(1, 2)) == 0.0
    rests = np.append(np.abs(c[:, 1]).max(axis=1) <= AT_REST, True)
    legs: list[_Leg] = []
    for a, b in pairwise(np.flatnonzero(rests).tolist()):
        moves = not stands[a:b].all()
        since = legs.pop().since if legs and not (moves or legs[-1].moves) else float(knots[a])
        legs.append(_Leg(since, float(knots[b]), moves))
    return legs


def _instants(request: ExportRequest, leg: _Leg) -> Array:
    """When a move's points are: its end, and dense each period before it."""
    if not request.dense:
        return np.array([leg.until])
    period = 1.0 / (request.rate_hz or PERIODS_HZ[0])
    count = int(np.ceil((leg.until - leg.since) / period - 1e-6))
    return np.append(leg.since + period * np.arange(1, count), leg.until)


def _speeds(request: ExportRequest, leg: _Leg) -> tuple[float, float]:
    """The leading axis' a and v by which a movej lasts as long as the move; PlanError: the move isn't straight."""
    points = request.trajectory.at(np.linspace(leg.since, leg.until, 200))
    way, took = points.q[-1] - points.q[0], leg.until - leg.since
    leading = int(np.argmax(np.abs(way)))
    reach = float(np.abs(way[leading]))
    along = (points.q[:, leading] - points.q[0, leading]) / way[leading] if reach else np.zeros(len(points.t))
    if np.abs(points.q - points.q[0] - along[:, None] * way).max() > OFF_LINE_RAD:
        what = f"from {leg.since:.2f} to {leg.until:.2f} s the arm follows a curve, which movej can't; take --dense"
        raise PlanError(what, value=leg.since)
    v = min(_peak(request, leg, leading), 2.0 * reach / took)
    a = v / (took - reach / v)
    return a, v


def _peak(request: ExportRequest, leg: _Leg, joint: int) -> float:
    """The largest velocity of a joint in a move: at a knot, or where a piece's acceleration passes zero."""
    trajectory = request.trajectory
    inside = (trajectory.knots[:-1] >= leg.since - 1e-12) & (trajectory.knots[:-1] < leg.until)
    t, c = trajectory.knots[:-1][inside], trajectory.coefficients[inside, :, joint]
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = t - c[:, 2] / (3.0 * c[:, 3])
    turns = turns[np.isfinite(turns) & (turns > leg.since) & (turns < leg.until)]
    return float(np.abs(trajectory.at(np.concatenate((t, turns))).qd[:, joint]).max())


def _stay(request: ExportRequest, leg: _Leg) -> list[str]:
    """Wait, with the gripper's calls: each lasts as long as its stroke."""
    lines, at = [], leg.since
    t, opening = request.trajectory.gripper_t.tolist(), request.trajectory.gripper_opening.tolist()
    for (since, until), (before, after) in zip(pairwise(t), pairwise(opening), strict=True):
        if before != after and leg.since - 1e-6 <= since < leg.until:
            lines += _sleep(since - at)
            lines.append(f"  gripper_{'open' if after > before else 'close'}()\n")
            at = until
    return lines + _sleep(leg.until - at)


def _sleep(seconds: float) -> list[str]:
    return [f"  sleep({_seconds(seconds)})\n"] if seconds > 1e-6 else []


def _seconds(seconds: float) -> str:
    return f"{round(seconds, 6):g}"


def _numbers(q: Array, decimals: int) -> str:
    return ", ".join(f"{x:.{decimals}f}" for x in np.round(q, decimals) + 0.0)


def read(path: Path) -> Samples:
    """Run what `write` wrote, as the controller does: where the arm is whenever its acceleration changes, or each beat.

    A servoj lasts a whole period, so a dense motion falls behind the planned one by up to a period for each move.
    """
    head, *body = path.read_text(encoding="utf-8").partition("\n  start = ")
    run = _Run(_floats(body[1].partition("\n")[0]), float(re.findall(r"sleep\((.+)\)", head)[0]))
    for name, given in re.findall(
        r"^  (movej|servoj|sleep|gripper_open|gripper_close)\((.*?)\)(?:  #|$)", body[1], re.M
    ):
        if name == "movej":
            run.move(_floats(given), *(float(each) for each in re.findall(r"[av]=([^,]+)", given)))
        elif name == "servoj":
            run.period = float(given.split("], ")[1].split(", ")[2])
            run.add(run.period, _floats(given))
        else:
            seconds = float(given) if name == "sleep" else run.stroke
            run.stay(seconds, {"gripper_open": 1.0, "gripper_close": 0.0}.get(name))
    return run.samples()


def _floats(listed: str) -> Array:
    return np.array([float(each) for each in listed.partition("[")[2].partition("]")[0].split(",")])


class _Run:
    """A program's run; joints q (6,), the gripper's stroke in s, and the period (s) of servoj once there was one."""

    def __init__(self, q: Array, stroke: float) -> None:
        self.stroke, self.period = stroke, 0.0
        self.rows: list[tuple[float, Array, Array, Array, float]] = [(0.0, q, 0.0 * q, 0.0 * q, np.nan)]

    def add(self, dt: float, q: Array, qd: float | Array = 0.0, qdd: float | Array = 0.0) -> None:
        """Go on by dt s: then the arm is there, with this velocity, and from then on with this acceleration."""
        t, *_, opening = self.rows[-1]
        self.rows.append((t + dt, q, qd + 0.0 * q, qdd + 0.0 * q, opening))

    def move(self, q: Array, a: float, v: float) -> None:
        """A trapezoid of the leading joint's velocity, or a triangle; the others in step."""
        t, before, *_, opening = self.rows.pop()
        reach = float(np.abs(q - before).max())
        way = (q - before) / (reach or 1.0)
        v = min(v, float(np.sqrt(a * reach)))
        rise, even = v / a, max(reach / v - v / a, 0.0) if reach else 0.0
        self.rows.append((t, before, 0.0 * q, a * way, opening))
        if even > 1e-9:
            self.add(rise, before + 0.5 * v * rise * way, v * way)
        self.add(even if even > 1e-9 else rise, q - 0.5 * v * rise * way, v * way, -a * way)
        self.add(rise, q)

    def stay(self, seconds: float, opening: float | None) -> None:
        """Stand for a time, in which the gripper may go to an opening."""
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
        t, q, qd, qdd, opening = (np.array(column) for column in zip(*self.rows, strict=True))
        opening = np.nan_to_num(opening, nan=1.0)
        return set_point_samples(t, q, opening) if self.period else Samples(t, q, qd, qdd, opening)
