"""A demonstration's folder that grows while it is recorded: complete and readable at every moment."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration, GripEvent, Recording, RecordingInfo
from pbd.errors import RecordingError
from pbd.files.columns import ACC, DEVICE, GYR, MAG
from pbd.files.demo import demo_toml, may_be_written
from pbd.files.whole import folder_written_whole, unwritable, written_whole
from pbd.pose import Array

CHANNELS = {"gyr": (GYR, 7), "acc": (ACC, 6), "mag": (MAG, 4), "device": (DEVICE, 6)}
"""Name -> columns of imu.csv and decimals, in their order there."""


class GrowingDemo:
    """Rows are appended as whole lines, each with one system call: a killed process leaves no half of one.

    demo.toml is there before the first row, and is replaced as a whole when something is added to it.
    """

    def __init__(
        self, folder: Path, info: RecordingInfo, channels: Sequence[str], closed: bool, force: bool = False
    ) -> None:
        """Make the folder.

        Args:
            folder: where; must not exist, unless `force`.
            info: the name is the folder's.
            channels: those of CHANNELS that will be there.
            closed: the hand will end at the dock.
            force: replace a demonstration of that name.

        Raises:
            RecordingError: the folder exists or can't be written.
        """
        may_be_written(folder, force)
        self.folder = folder
        self.rows = 0
        self._info, self._closed = replace(info, name=folder.name), closed
        self._grip: list[GripEvent] = []
        self._channels = [name for name in CHANNELS if name in channels]
        names = ["t", *(column for name in self._channels for column in CHANNELS[name][0])]
        self._format = ",".join(["{:.6f}", *(f"{{:.{CHANNELS[name][1]}f}}" for name in self._channels for _ in "xyz")])
        with folder_written_whole(folder) as new:
            (new / "demo.toml").write_text(self._toml(), encoding="utf-8")
            (new / "imu.csv").write_text(",".join(names) + "\n", encoding="ascii")
        self._raw: int | None = None
        with self._kept():
            self._imu = os.open(folder / "imu.csv", os.O_WRONLY | os.O_APPEND)

    def add(self, t: Sequence[float], values: Iterable[Sequence[float]]) -> None:
        """Append rows: t in s, and for each the channels' numbers in their order; NaN is an empty cell.

        Raises:
            RecordingError: the disk is full; what was written before is intact.
        """
        lines = [self._format.format(at, *row).replace("nan", "") for at, row in zip(t, values, strict=True)]
        if lines:
            with self._kept():
                _append(self._imu, ("\n".join(lines) + "\n").encode())
            self.rows += len(lines)

    def add_raw(self, data: bytes) -> None:
        """Append bytes as they came to raw.bin."""
        with self._kept():
            if self._raw is None:
                self._raw = os.open(self.folder / "raw.bin", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            _append(self._raw, data)

    def mark(self, grip: GripEvent) -> None:
        """Add a grip event to demo.toml."""
        self._grip.append(grip)
        self._write_toml()

    def finish(self, rate_hz: float | None, clock: str, t: Array | None = None) -> None:
        """Close the files; write what is known at the end only: the rate, what was done about time, better times."""
        self.close()
        if t is not None:
            self._restamp(t)
        self._info = replace(self._info, rate_hz=rate_hz, clock=clock)
        self._write_toml()

    def close(self) -> None:
        """Close the files; closing twice is nothing."""
        for handle in (self._imu, self._raw):
            if handle is not None:
                with suppress(OSError):
                    os.close(handle)

    def discard(self) -> None:
        """Close and remove everything."""
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def _kept(self) -> Iterator[None]:
        """Say that what was written before is intact, where nothing more can be."""
        try:
            yield
        except OSError as reason:
            if self.rows == 0:
                raise unwritable(self.folder, reason, RecordingError) from None
            raise RecordingError(
                f"{self.folder} can't be written on ({reason.strerror}); its {self.rows} samples so far are intact: "
                "make room and record again",
                path=self.folder,
                rows=self.rows,
            ) from None

    def _toml(self) -> str:
        recording = Recording(np.zeros(0), np.zeros((0, 3)), grip=tuple(self._grip), info=self._info)
        return demo_toml(Demonstration(recording, closed=self._closed), self.folder.name)

    def _write_toml(self) -> None:
        with written_whole(self.folder / "demo.toml") as file:
            file.write_text(self._toml(), encoding="utf-8")

    def _restamp(self, t: Array) -> None:
        """Replace imu.csv's times."""
        imu = self.folder / "imu.csv"
        with written_whole(imu) as file, imu.open(encoding="ascii") as old, file.open("w", encoding="ascii") as new:
            new.write(next(old))
            for at, line in zip(t, old, strict=True):
                new.write(f"{at:.6f},{line.partition(',')[2]}")


def _append(handle: int, data: bytes) -> None:
    """Append all of it, or nothing."""
    size = os.fstat(handle).st_size
    try:
        while data:
            data = data[os.write(handle, data) :]
    except OSError:
        with suppress(OSError):  # no half of a line stays
            os.ftruncate(handle, size)
        raise
