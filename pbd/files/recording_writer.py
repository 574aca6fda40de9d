"""Writing a demonstration while it is recorded: its folder can be read at any moment."""

import fcntl
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration, GripEvent, Recording, RecordingInfo
from pbd.errors import PbdError, RecordingError, amount
from pbd.files.demo import demo_toml, imu_header, imu_rows, refuse_demo_folder
from pbd.io.atomic import atomic_file, atomic_folder, is_file, unwritable, write_text
from pbd.pose import Array


class RecordingWriter:
    """Appends whole lines to imu.csv by one system call each time, so a killed process leaves no half line.

    demo.toml is written before the first row, and replaced atomically when it changes.
    """

    def __init__(self, folder: Path, info: RecordingInfo, channels: Collection[str], closed: bool) -> None:
        """Make the folder.

        Args:
            info: what is known of the recording; the folder's name becomes its name.
            channels: the names in IMU_COLUMNS of the channels that will be recorded.
            closed: whether the hand returns to its start.

        Raises:
            RecordingError: the folder exists, or can't be written.
        """
        refuse_demo_folder(folder, force=False)
        self.folder, self.rows = folder, 0
        self._info, self._closed = replace(info, name=folder.name), closed
        self._failed = False
        self._grip: list[GripEvent] = []
        self._channels = channels
        header, decimals = imu_header(channels)
        self._format = ",".join(f"{{:.{places}f}}" for places in decimals) + "\n"
        with atomic_folder(folder, replace=False) as new:
            (new / "demo.toml").write_text(self._toml(), encoding="utf-8")
            (new / "imu.csv").write_text(",".join(header) + "\n", encoding="ascii")
        self._raw: int | None = None
        with self._writing():
            self._imu = os.open(folder / "imu.csv", os.O_WRONLY | os.O_APPEND)
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(self._imu, fcntl.LOCK_EX | fcntl.LOCK_NB)  # `refuse_demo_folder` sees the lock

    def add(self, samples: Recording) -> None:
        """Append a row for each sample; NaN becomes an empty cell.

        Raises:
            RecordingError: the disk is full, and the earlier rows are intact; or the folder is gone.
        """
        text = "".join(self._format.format(*row) for row in imu_rows(samples, self._channels).tolist())
        with self._writing():
            _append(self._imu, text.replace("nan", "").encode())
        self.rows += len(samples)

    def add_raw(self, data: bytes) -> None:
        """Append the sensor's bytes to raw.bin."""
        with self._writing():
            if self._raw is None:
                self._raw = os.open(self.folder / "raw.bin", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            _append(self._raw, data)

    def mark(self, grip: GripEvent) -> None:
        """Add a grip event to demo.toml."""
        self._grip.append(grip)
        self._write_toml()

    def finish(self, rate_hz: float | None, clock: str, t: Array | None = None) -> None:
        """Close the files, and write what is known at the end; `t` (n,) s are better times than those so far."""
        self.close()
        if t is not None:
            with self._writing():
                _replace_times(self.folder / "imu.csv", t)
        self._info = replace(self._info, rate_hz=rate_hz, clock=clock)
        self._write_toml()

    def mark_failed(self) -> None:
        """Note in demo.toml that the recording can't be replayed."""
        self._failed = True
        self._write_toml()

    def close(self) -> None:
        """Close the files, if they are open."""
        for handle in (self._imu, self._raw):
            if handle is not None:
                with suppress(OSError):
                    os.close(handle)

    def discard(self) -> None:
        """Close the files and remove the folder."""
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Raise the error of a block that writes as a RecordingError that tells how many samples are safe."""
        if not is_file(self.folder / "imu.csv"):  # a deleted file takes rows too, and they are lost
            raise RecordingError(f"{self.folder} was renamed or deleted meanwhile; record again", path=self.folder)
        try:
            yield
        except (OSError, PbdError) as reason:
            error = unwritable(self.folder, reason, RecordingError) if isinstance(reason, OSError) else reason
            if self.rows:
                what = f"{error.message}; intact so far: {amount(self.rows, 'sample')}"
                error = RecordingError(what, path=self.folder, rows=self.rows)
            raise error from None

    def _write_toml(self) -> None:
        with self._writing():
            write_text(self.folder / "demo.toml", self._toml())

    def _toml(self) -> str:
        recording = Recording(np.zeros(0), np.zeros((0, 3)), grip=tuple(self._grip), info=self._info)
        return demo_toml(Demonstration(recording, closed=self._closed, failed=self._failed), self.folder)


def _replace_times(imu: Path, t: Array) -> None:
    """Give the rows of an imu.csv other times, t (n,) s."""
    with atomic_file(imu) as file, imu.open(encoding="ascii") as old, file.open("w", encoding="ascii") as new:
        new.write(next(old))
        new.writelines(f"{at:.6f},{line.partition(',')[2]}" for at, line in zip(t, old, strict=True))


def _append(handle: int, data: bytes) -> None:
    """Append all of the data, or nothing."""
    size = os.fstat(handle).st_size
    try:
        while data:
            data = data[os.write(handle, data) :]
    except OSError:
        with suppress(OSError):  # remove a half line
            os.ftruncate(handle, size)
        raise
