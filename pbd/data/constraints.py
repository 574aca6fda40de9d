"""What a person knows about the stops, and how well the data agree."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """The tool stood at the same place at each of these instants.

    Attributes:
        t: one instant in each stop, s.
        p_base_tool: the place in the robot's base, m, or None.
        sigma_m: one sigma along each axis of how well the hand met it, m; None: as pbd.tracking.stop_constraints.

    Raises:
        ValueError: fewer than two instants and no position, an instant named twice, or a sigma not above zero.
    """

    t: tuple[float, ...]
    p_base_tool: tuple[float, float, float] | None = None
    sigma_m: float | None = None

    def __post_init__(self) -> None:
        if len(self.t) < (2 if self.p_base_tool is None else 1):
            raise ValueError("must name at least two stops, or one and a position_m")
        if len(set(self.t)) < len(self.t):
            raise ValueError("must name each stop once")
        _refuse_sigma(self.sigma_m)


@dataclass(frozen=True)
class Contact:
    """The tool stood at a known height: on the table, unless `as_at` or `height` is given.

    Attributes:
        t: an instant in the stop, s.
        as_at: an instant in another stop with the same height, s.
        height: height above the tool's height at the first rest, m.
        sigma_m: one sigma of the height, m; None: the default of pbd.tracking.stop_constraints.

    Raises:
        ValueError: both are given, `as_at` equals `t`, or a sigma not above zero.
    """

    t: float
    as_at: float | None = None
    height: float | None = None
    sigma_m: float | None = None

    def __post_init__(self) -> None:
        if self.as_at is not None and self.height is not None:
            raise ValueError("takes as_at_s or height_m, not both")
        if self.as_at == self.t:
            raise ValueError("and as_at_s must be two stops")
        _refuse_sigma(self.sigma_m)


def _refuse_sigma(sigma_m: float | None) -> None:
    if sigma_m is not None and not sigma_m > 0.0:
        raise ValueError(f"must have a sigma_m above zero, got {sigma_m}")


@dataclass(frozen=True)
class Known:
    """What a person knows about a demonstration's stops. `closed`: the last stop is where the first one was."""

    closed: bool = False
    places: tuple[Place, ...] = ()
    contacts: tuple[Contact, ...] = ()


@dataclass(frozen=True)
class ClaimFit:
    """How well the data agreed with a claim about a stop before the claim was used.

    Attributes:
        saying: the claim, in words.
        t: the middle of the stop, s.
        off_m: misfit, m.
        sigmas: misfit in sigmas. A typical value is 1.5 for a position and 0.7 for a height.
    """

    saying: str
    t: float
    stop: int
    off_m: float
    sigmas: float
