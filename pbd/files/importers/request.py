"""What is to be imported: a path, and what the caller says of it. Each reader gets it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pbd.errors import RecordingError
from pbd.files.demo import RATE_BOUNDS_HZ


@dataclass(frozen=True)
class Request:
    """A path to read, with the caller's options, of which a reader honours each or refuses it.

    Attributes:
        columns: our name -> the file's column; -NAME reverses the sign.
        units: channel (t, gyr, acc, mag, angle) -> unit; -UNIT reverses the sign.
        rate_hz: the rate of a table without times, or with wrong ones.
        topic: the topic of a bag with several.
    """

    path: Path
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rate_hz: float | None = None
    topic: str | None = None

    @property
    def suffix(self) -> str:
        """The path's suffix in lower case."""
        return self.path.suffix.lower()

    @property
    def beside(self) -> dict[str, str]:
        """The columns that the caller names with their file, as `Magnetometer.csv: x`."""
        return {ours: name for ours, name in self.columns.items() if ".csv: " in name}

    @property
    def is_csv(self) -> bool:
        """Whether the path is a CSV file, which may be one of several of a recording."""
        return self.suffix == ".csv" and self.path.is_file()

    def refuse_rate(self, known: str) -> None:
        """Refuse a rate of a recording with times; `known` says so."""
        if self.rate_hz is not None:
            raise RecordingError.at(self.path, f"{known} of its own; leave --rate out")


def check_rate(path: Path, rate_hz: float, what: str) -> None:
    """Refuse (RecordingError) a rate that no sensor has; `what` is the beginning of the message."""
    slowest, fastest = RATE_BOUNDS_HZ
    if not slowest <= rate_hz <= fastest:
        bound = "above zero" if not rate_hz > 0.0 else f"{slowest:g} to {fastest:g} Hz"
        raise RecordingError.at(path, f"{what} {rate_hz:g}; it must be {bound}", value=rate_hz)
