"""Every reader, with files that are damaged at random: only our errors come out, in bounded time and memory."""

import multiprocessing
from multiprocessing.context import ForkServerContext
from pathlib import Path

import pytest

from tests.fuzz.readers import READERS
from tests.fuzz.run import read_damaged


@pytest.fixture(scope="session")
def forked() -> ForkServerContext:
    """Processes that have all that is heavy loaded."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.fuzz.run", "collada", "scipy.ndimage", "scipy.optimize", "trimesh"])
    return context


@pytest.mark.parametrize("name", READERS)
def test_only_our_errors_come_out(name: str, forked: ForkServerContext, tmp_path: Path) -> None:
    here, there = forked.Pipe()
    process = forked.Process(target=read_damaged, args=(name, tmp_path, there))
    process.start()
    there.close()
    said: object = None
    try:
        while not isinstance(said, tuple):
            said = here.recv()
    except EOFError:
        pass
    process.join()
    assert process.exitcode == 0, f"{name}, file {said}: ended with {process.exitcode}"
    assert isinstance(said, tuple)
    faults, refused = said
    assert not faults, "\n".join(faults[:3])
    assert refused
