"""The live view in the browser: the sensor, its path so far and its stops, in nav."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pbd.data import Keyframe
from pbd.pose import Array, Pose
from pbd.view import shapes
from pbd.view.live_path import LivePath
from pbd.view.meshcat_encoding import scene_object, two_sigma_transform
from pbd.view.server import LiveViewer, invite

FAST_M_S = 0.6
"""Speed, m/s, from which the path has the colour of the fastest motion."""

PIECES_AT_ONCE = 2
"""Largest number of the path's pieces sent with one picture. The rest follows with the next."""

SMALLEST_M, SMALLEST_RAD = 2e-4, 2e-3
"""Smallest displacement, m, and rotation, rad, that is drawn."""

VIEW_STEP_M, VIEW_MARGIN_M = 0.1, 0.03
"""Step, m, by which the box that the camera shows grows; the hand's distance from its edge, m, at which it grows."""

FIRST_VIEW_M = np.array([[-0.1, -0.1, 0.0], [0.2, 0.2, 0.2]])
"""Lowest and highest corner, m in nav, of that box at the start."""

State = Literal["waits", "still", "moves", "pause", "ended"]
"""What the hand does. page.css has a colour for each."""


@dataclass(frozen=True, eq=False)
class LivePicture:
    """The state of a recording at one instant.

    Attributes:
        t: s.
        p_nav_sensor: (3,) m.
        v_nav_sensor: (3,) m/s.
        wxyz_nav_sensor: (4,).
        keyframes: one for each stop so far; the first is the rest at the start.
        state: what the hand does; it chooses the colour.
        badge: that state in one or two words.
        line: the recorder's last message.
        figures: numbers about the recording, a few words each.
    """

    t: float
    p_nav_sensor: Array
    v_nav_sensor: Array
    wxyz_nav_sensor: Array
    keyframes: tuple[Keyframe, ...]
    state: State
    badge: str
    line: str = ""
    figures: tuple[str, ...] = ()


class LiveView:
    """A page on this machine that shows a recording while it runs.

    The page can be opened at any time. It keeps its last picture when the view is closed.

    Raises:
        PbdError: the viewer's server can't be started.
    """

    def __init__(self) -> None:
        """Start the server."""
        self._about: dict[str, Any] = {"title": "", "subtitle": "", "fast": FAST_M_S}
        self._path = LivePath()
        self._known: tuple[Keyframe, ...] = ()
        self._drawn: list[Pose] = []
        self._box = FIRST_VIEW_M
        self._T_nav_hand = Pose.identity()
        self._viewer = LiveViewer(advice="record without --live")
        self._scene = self._viewer.visualizer
        self._triad = scene_object(shapes.triad(shapes.TRIAD_M, shapes.TRIAD_RADIUS_M))
        self._ball = scene_object(shapes.sphere(1.0, shapes.UNSURE_RGB), opacity=shapes.UNSURE_OPACITY)
        self._scene["nav"].set_object(scene_object(shapes.triad(0.12, 0.0022)))
        sensor = shapes.box((0.040, 0.028, 0.012), (0.96, 0.62, 0.16))
        self._scene["hand/box"].set_object(scene_object(sensor))
        self._scene["hand/triad"].set_object(self._triad)

    def open(self, title: str, subtitle: str, open_browser: bool = True) -> None:
        """Print the page's address on stderr, and open it if wanted. Titles: what is recorded, with which sensor."""
        self._about |= {"title": title, "subtitle": subtitle}
        wxyz = self._T_nav_hand.wxyz
        self._draw(LivePicture(0.0, np.zeros(3), np.zeros(3), wxyz, (), "waits", "waits", "for the sensor"))
        invite(f"live view at {self._viewer.url}", self._viewer.url, open_browser)

    def show(self, picture: LivePicture) -> None:
        """Draw what has changed, in a few milliseconds; nothing while the server is busy with the last picture."""
        if np.isfinite((*picture.p_nav_sensor, *picture.v_nav_sensor, *picture.wxyz_nav_sensor)).all():
            self._follow(picture)
            if not self._viewer.behind():
                self._draw(picture)

    def end(self, picture: LivePicture) -> None:
        """Draw all that is left, and the last picture of the recording."""
        while self._draw(picture):
            pass

    def close(self) -> None:
        """End the server; a second call does nothing."""
        self._viewer.close()

    def _follow(self, picture: LivePicture) -> None:
        """Extend the path. A stop corrects the end of the move before it."""
        known, self._known = self._known, picture.keyframes
        last = max(len(known) - 1, 0)
        for i, keyframe in enumerate(self._known[last:], last):
            p, since = keyframe.T_nav_sensor.p, keyframe.t - 0.5 * keyframe.dwell_s
            if i == 0 and not known:
                self._path.begin(since, p)
            elif i >= len(known) or not np.array_equal(p, known[i].T_nav_sensor.p):
                self._path.correct(since, p)
        if self._known:
            self._path.grow(picture.t, picture.p_nav_sensor, picture.v_nav_sensor)
            low, high = self._path.corners()
            # A hand on the table may seem to be a little below its start, which must not lower the ground.
            low = VIEW_STEP_M * np.floor((low - (VIEW_MARGIN_M, VIEW_MARGIN_M, -VIEW_MARGIN_M)) / VIEW_STEP_M)
            high = VIEW_STEP_M * np.ceil((high + VIEW_MARGIN_M) / VIEW_STEP_M)
            self._box = np.array((np.minimum(FIRST_VIEW_M[0], low), np.maximum(FIRST_VIEW_M[1], high)))

    def _draw(self, picture: LivePicture) -> bool:
        """Send what has changed; return whether more is left than one picture takes."""
        first = max(len(self._drawn) - 2, 0)  # older stops do not change any more
        for i, keyframe in enumerate(self._known[first:], first):
            self._draw_stop(i, keyframe)
        for name, points, speed in self._path.take(PIECES_AT_ONCE):
            tube = shapes.tube(points, shapes.speed_rgb(speed / FAST_M_S), shapes.PATH_RADIUS_M, sides=6)
            self._scene[f"path/{name}"].set_object(scene_object(tube))
        T_nav_hand = Pose(picture.p_nav_sensor, picture.wxyz_nav_sensor)
        if _has_moved(self._T_nav_hand, T_nav_hand):
            self._T_nav_hand = T_nav_hand
            self._scene["hand"].set_transform(T_nav_hand.matrix())
        words = {
            **self._about,
            "state": picture.state,
            "badge": picture.badge,
            "line": picture.line,
            "figures": list(picture.figures),
            "stops": len(self._drawn),
            "box": self._box.tolist(),
        }
        self._scene["hand"].set_property("live", words)
        return self._path.more

    def _draw_stop(self, i: int, keyframe: Keyframe) -> None:
        node, T_nav_sensor = self._scene[f"stops/{i}"], keyframe.T_nav_sensor
        if i == len(self._drawn):
            node["triad"].set_object(self._triad)
            node["two_sigma"].set_object(self._ball)
            self._drawn.append(T_nav_sensor)
        elif _has_moved(self._drawn[i], T_nav_sensor):
            self._drawn[i] = T_nav_sensor
        else:
            return
        node["triad"].set_transform(T_nav_sensor.matrix())
        node["two_sigma"].set_transform(two_sigma_transform(T_nav_sensor.p, keyframe.cov[:3, :3]))


def _has_moved(before: Pose, after: Pose) -> bool:
    metres, radians = before.distance(after)
    return metres > SMALLEST_M or radians > SMALLEST_RAD
