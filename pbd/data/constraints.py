"""A person's knowledge of the stops, and how well the data fit it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """The tool stood at one and the same place at each of these instants.

    Attributes:
        t: s, one instant in each stop.
        p_base_tool: m, where that is in the robot's base, or None.
        sigma_m: m per axis, how well the hand met it; None: pbd.tracking.stop_constraints says.

    Raises:
        ValueError: fewer than two instants and no position, an instant named twice, a sigma that is not above zero.
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
    """The tool stood at a known height: on the table, unless one of the two others is given.

    Attributes:
        t: s, within the stop.
        as_at: s, within another stop: as high as there.
        height: m, above the tool's height at the first rest.
        sigma_m: m, how well that is so; None: pbd.tracking.stop_constraints says.

    Raises:
        ValueError: both are given, as high as at the same instant, a sigma that is not above zero.
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
    """A person's knowledge of a demonstration's stops. `closed`: the last stop is where the first one was."""

    closed: bool = False
    places: tuple[Place, ...] = ()
    contacts: tuple[Contact, ...] = ()


@dataclass(frozen=True)
class ClaimFit:
    """How well the data agreed with something known of a stop, before it was used.

    Attributes:
        saying: what was claimed, in words.
        t: s, the middle of the stop.
        off_m: m, misfit of the data.
        sigmas: the same in sigmas (over three axes a typical value is 1.5, over one 0.7).
    """

    saying: str
    t: float
    stop: int
    off_m: float
    sigmas: float
