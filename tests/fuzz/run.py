"""One reader and its damaged files, in a process of its own: bounded in time and memory, as native code may crash."""

import os
import random
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

from pbd.errors import PbdError, PbdWarning
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import READERS

MUTATIONS = 100
MOST_S = 20
"""Processor time for all files of one reader, s; five times that on the clock, so that nothing waits for ever."""

MOST_BYTES = 2_000_000_000
"""Address space of its process."""


def read_damaged(name: str, folder: Path, answer: Connection) -> None:
    """Read damaged files; answer with what went wrong, and how many were refused."""
    reader = READERS[name]
    files = reader.files
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S))
    signal.alarm(5 * MOST_S)
    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", PbdWarning)
    faults, refused = list[str](), 0
    path = folder / reader.changed
    with tempfile.TemporaryFile() as printed:
        for stream in (1, 2):
            os.dup2(printed.fileno(), stream)
        for file, content in files.items():
            (folder / file).write_bytes(content)
        whole = files[reader.changed]
        for seed in range(MUTATIONS):
            path.write_bytes(_damaged(whole, name, seed))
            answer.send(seed)
            try:
                reader.read(path)
            except PbdError as error:
                refused += 1
                if not seed:
                    faults.append(f"the undamaged file is refused: {error}")
                if "\n" in str(error) or len(str(error)) > 2000:
                    faults.append(f"{seed}: not one line: {str(error)[:2000]!r}")
            except BaseException:
                faults.append(f"{seed}: {traceback.format_exc()[-1500:]}")
        sys.stdout.flush()
        printed.seek(0)
        if said := printed.read(2000):
            faults.append(f"printed: {said!r}")
    answer.send((faults, refused))


def _damaged(whole: bytes, name: str, seed: int) -> bytes:
    """The file itself, then its first byte, which no reader takes for a file, then the file with mishaps."""
    return (whole, whole[:1])[seed] if seed < 2 else mutated(whole, random.Random(f"{name} {seed}"))
