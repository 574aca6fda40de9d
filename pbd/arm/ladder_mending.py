"""Remedies for barred links of a motion's ladder graph: another path, more configurations, more layers, a detour."""

from itertools import pairwise

from pbd.arm.ik.cartesian import line
from pbd.arm.ladder_building import CONTINUOUS_RAD, MEND_AFTER_STEPS, STARTS, layers_along, widen
from pbd.arm.ladder_checks import LinkChecks
from pbd.arm.ladder_state import Link
from pbd.arm.motion_request import DEMO, LINE, STRAIGHT
from pbd.pose import Pose

MEND_AFTER_COSTLY = 4
"""Number of pairs of configurations without a free path of the tool, or without a detour, after which a link is mended.
"""
DETOUR_EXTRA = 1.0
"""Assumed extra length of a detour over the straight move, rad, until the detour is found."""
MEND_AFTER_STRAIGHT_WIDENED = 150
"""Number of barred straight moves after which a link between two widened keyframes is mended again."""
COARSE = 4
"""Number of poses between two layers of a split path."""
LOOK_BACK = 8
"""Number of paths before a barred one that are split with it, if they are not final yet."""


class Mending(LinkChecks):
    """The ladder of a motion, with the remedies for its links."""

    def _follow_path(self, place: int, kind: str | None = None) -> None:
        """Let the tool follow one path to a layer: the hand's if it is known and `kind` is not LINE, else a line."""
        link = self.links[place - 1]
        i, T_base_tool = link.keyframe, self.request.T_base_tool
        hand = self.request.hand_paths if kind != LINE else None
        self.moves[i].kind = DEMO if hand else LINE
        link.poses = tuple(hand()[i - 1]) if hand else line(T_base_tool[i - 1], T_base_tool[i])
        self.ladder.reset_moves(place, MEND_AFTER_COSTLY, costly=True)

    def _detour(self, i: int) -> None:
        """Replace the move to keyframe i by a detour in joint space; the tool's path is then free."""
        places = self.places_of(i)
        self.moves[i].detour = True
        self.ladder.drop(places[0], places[-1])
        self.links[places[0] - 1 : places[-1]] = [Link(i)]
        self.ladder.reset_moves(places[0], MEND_AFTER_COSTLY, costly=True, in_order=True, unchecked_cost=DETOUR_EXTRA)

    def _widen(self, i: int) -> None:
        """Add configurations at all layers of the move to keyframe i.

        A one-link move is reset to straight in joint space.
        """
        places = self.places_of(i)
        for place in (places[0] - 1, *places):
            if place > 0 and self.links[place - 1].keyframe < self.n:
                widen(self.arm, self._pose(place), self.ladder, place)
        if len(places) == 1:
            self.links[places[0] - 1].poses, self.moves[i].kind = None, STRAIGHT
        for place in places:
            self.ladder.reset_moves(place, MEND_AFTER_STRAIGHT_WIDENED, costly=len(places) > 1)

    def _split(self, place: int) -> int | None:
        """Insert layers along a path and the paths just before it, which decide the configuration it starts from.

        Return the keyframe to which a path leads on which a pose has no solution; None: there is no such path.
        """
        if self.links[place - 1].poses is None:  # widening made it straight
            self._follow_path(place)
        first = place
        while first - 1 > self.ladder.first and place - first < LOOK_BACK and self._is_unsplit(first - 1):
            first -= 1
        end = place
        while first <= end:
            link, move = self.at(first)
            move.drop_remedy("split")
            added = self._split_one(first)
            if added is None:
                return link.keyframe
            first, end = first + added + 1, end + added
        return None

    def _is_unsplit(self, place: int) -> bool:
        """Whether the link to a layer is an unsplit path of the tool from keyframe to keyframe."""
        link, before = self.links[place - 1], self.links[place - 2]
        return link.poses is not None and link.at_keyframe and before.keyframe != link.keyframe

    def _split_one(self, place: int) -> int | None:
        """Insert a layer at every COARSE poses of a path; return how many, None if a pose has no solution."""
        link = self.links[place - 1]
        poses = link.poses or ()
        marks = [0, *range(COARSE, len(poses) - 1, COARSE), len(poses) - 1]
        layers = layers_along(self.arm, self.ladder, place - 1, [poses[mark] for mark in marks[1:-1]])
        if layers is None:
            return None
        last = self.ladder.layers[place]
        last.mend_after, last.most_step = MEND_AFTER_STEPS, CONTINUOUS_RAD
        self.ladder.insert(place, layers)
        self.links[place - 1 : place] = [
            Link(link.keyframe, poses[a : b + 1], b == len(poses) - 1) for a, b in pairwise(marks)
        ]
        widen(self.arm, poses[-1], self.ladder, place + len(layers), STARTS)
        return len(layers)

    def _pose(self, place: int) -> Pose:
        link = self.links[place - 1]
        return self.request.T_base_tool[link.keyframe] if link.poses is None else link.poses[-1]
