"""All real recordings, at several rates."""

from functools import cache
from pathlib import Path

from pbd.data import Recording
from pbd.files.importers import import_file
from tests.benchmarks.trials import read_broad


@cache
def real_recordings(folder: Path) -> dict[str, Recording]:
    """Each at its sensor's rate, and resampled as slower sensors would read it."""
    found: dict[str, Recording] = {}
    for file in sorted((folder / "broad").glob("*.npz")):
        found |= {f"{file.stem} {rate}": trial.recording for rate, trial in read_broad(file).items()}
    for file in [*(folder / "strides").glob("*.npz"), *(folder / "walks").glob("*.csv")]:
        recording = import_file(file).recording
        for every in (1, 2, 4):
            n = len(recording) // every
            found[f"{file.stem} {every}"] = Recording(
                *(
                    values[: n * every].reshape(n, every, -1).mean(axis=1).reshape(n, *values.shape[1:])
                    for values in (recording.t, recording.acc, recording.gyr)
                    if values is not None
                )
            )
    return found
