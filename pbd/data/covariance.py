"""Joint covariance of the poses of all keyframes, and one sigma of a pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pbd.data.one_line_repr import brief, counted
from pbd.errors import is_whole_number, require_kind
from pbd.frozen_arrays import Frozen, readonly
from pbd.lazy import cached_property
from pbd.pose import Array

KEYFRAMES_PER_BATCH = 32
"""Number of keyframes whose joint covariance is computed at once. It bounds memory."""


@dataclass(frozen=True, eq=False)
class PoseCovariance(Frozen):
    """Covariance (6n, 6n) of n poses: position (m), then rotation vector (rad), in nav.

    It is never stored as a whole: blocks are computed when they are read.

    Attributes:
        multiply: multiplies the covariance by columns: (n, 6, c) -> (n, 6, c).
        diagonal, moves: compute `of_each` and `of_moves`; None: by `multiply`, whose time grows with the square of n.
    """

    count: int
    multiply: Callable[[Array], Array]
    diagonal: Callable[[], Array] | None = None
    moves: Callable[[], Array] | None = None

    def __repr__(self) -> str:
        return brief(self, counted(self.count, "pose"))

    @classmethod
    def chained(cls, blocks: Array) -> PoseCovariance:
        """Make it from each pose's covariance (n, 6, 6). Position errors add up move by move; rotation errors do
        not."""
        return cls(len(blocks), partial(_chained, blocks), partial(readonly, blocks))

    def joint(self, poses: Sequence[int] | None = None) -> Array:
        """Covariance (6m, 6m) of m of the poses, given by their numbers; of all poses by default."""
        poses = range(self.count) if poses is None else poses
        listed = isinstance(poses, Sequence | np.ndarray)
        valid = listed and all(is_whole_number(pose) and 0 <= pose < self.count for pose in poses)
        require_kind("poses", poses, f"a list of numbers from 0 to {self.count - 1}", valid)
        columns = np.zeros((self.count, 6, 6 * len(poses)))
        for i, pose in enumerate(poses):
            columns[pose, :, 6 * i : 6 * i + 6] = np.eye(6)
        block = self.multiply(columns)[list(poses)].reshape(6 * len(poses), 6 * len(poses))
        return np.asarray(0.5 * (block + block.T))

    def joint_at(self, numbers: Array) -> Array:
        """Covariance (6m, 6m) of m poses at stops or in moves; `numbers` as `errors_at` takes them.

        In a move the path has an error of its own, as from white noise of acceleration and gyro whose effect is known
        at both ends: that of a clamped beam for the position, of a Brownian bridge for the rotation.
        """
        moving, shares = np.flatnonzero(numbers % 1.0), numbers[numbers % 1.0 > 0.0] % 1.0
        if not moving.size:
            return self.joint(numbers.astype(int).tolist())
        at = np.unique((np.floor(numbers), np.ceil(numbers))).astype(int).tolist()
        among, joint = np.interp(numbers, at, np.arange(len(at))), self.joint(at).reshape(len(at), 6, len(at), 6)
        half = errors_at(among, joint.reshape(len(at), 6, -1)).reshape(-1, len(at), 6).transpose(1, 2, 0)
        found = errors_at(among, half).reshape(len(numbers), 6, len(numbers), 6)
        first, each = among[moving].astype(int), range(len(moving))
        change = joint[first + 1] - joint[first]
        moved = change[each, :, first + 1] - change[each, :, first]
        moved[:, :3, 3:] = moved[:, 3:, :3] = 0.0
        s, u = np.minimum.outer(shares, shares), np.maximum.outer(shares, shares)
        own = np.stack((2.0 * s**2 * (1.0 - u) ** 2 * (3.0 * u - s - 2.0 * s * u), s * (1.0 - u)), axis=2)
        own *= np.equal.outer(first, first)[:, :, None]
        found[moving[:, None], :, moving] += np.repeat(own, 3, axis=2)[..., None] * moved
        return found.reshape(6 * len(numbers), -1)

    @cached_property
    def of_each(self) -> Array:
        """Covariance (n, 6, 6) of each single pose."""
        if self.diagonal is not None:
            return readonly(self.diagonal())
        each = (np.einsum("iaib->iab", joint) for joint in self._batches())
        return readonly(np.concatenate([np.empty((0, 6, 6)), *each]))

    @cached_property
    def of_moves(self) -> Array:
        """Covariance (n - 1, 3, 3) of the displacement from each pose to the next, m2."""
        if self.moves is not None:
            return readonly(self.moves())
        moves = (np.diff(np.diff(joint[:, :3, :, :3], axis=0), axis=2) for joint in self._batches(overlap=1))
        return readonly(np.concatenate([np.empty((0, 3, 3)), *(np.einsum("iaib->iab", move) for move in moves)]))

    def _batches(self, overlap: int = 0) -> Iterator[Array]:
        """Yield the joint covariance (m, 6, m, 6) of one batch of poses after the other."""
        for start in range(0, self.count - overlap, KEYFRAMES_PER_BATCH):
            poses = range(start, min(start + KEYFRAMES_PER_BATCH + overlap, self.count))
            yield self.joint(poses).reshape(len(poses), 6, len(poses), 6)


def errors_at(numbers: Array, at_stops: Array) -> Array:
    """Errors (m, 6, c) of m poses at stops or in moves, from those at n stops (n, 6, c).

    As `between_stops` shifts a path: in a move the position's error grows as 3 s^2 - 2 s^3 with the share s of its
    time, the rotation's linearly.

    Args:
        numbers: (m,) of stops; 2.25 is in the move from stop 2 to stop 3, after a quarter of its time.
    """
    first, s = np.floor(numbers).astype(int), (numbers % 1.0)[:, None]
    share = np.repeat(np.hstack((s**2 * (3.0 - 2.0 * s), s)), 3, axis=1)[:, :, None]
    return np.asarray(at_stops[first] + share * (at_stops[np.ceil(numbers).astype(int)] - at_stops[first]))


def _chained(blocks: Array, columns: Array) -> Array:
    moves = np.diff(blocks[:, :3, :3], axis=0, prepend=np.zeros((1, 3, 3)))
    later = np.cumsum(columns[::-1, :3], axis=0)[::-1]
    p = np.cumsum(moves @ later, axis=0)
    return np.concatenate((p, blocks[:, 3:, 3:] @ columns[:, 3:]), axis=1)


def one_sigma(cov: Array) -> Array:
    """One sigma (6,) m and rad of a pose's covariance (6, 6); NaN where the variance is zero, i.e. not measured."""
    variance = np.diagonal(cov)
    return np.sqrt(np.where(variance > 0.0, variance, np.nan))


def keyframe_sigmas(covs: Sequence[Array]) -> Array:
    """One sigma (k, 6) m and rad at keyframes, NaN where unknown.

    The position of the first keyframe has sigma zero, and so has its heading where its tilt has a sigma: they fix nav.
    """
    sigma = np.array([one_sigma(cov) for cov in covs]).reshape(-1, 6)
    exact = 6 if np.isfinite(sigma[:1, 3:]).any() else 3
    sigma[:1, :exact] = np.nan_to_num(sigma[:1, :exact])
    return sigma
