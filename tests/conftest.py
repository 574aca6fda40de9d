"""Fixtures and settings of all tests."""

import atexit
import gc
import importlib
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import WorkStealingScheduling  # type: ignore[import-untyped]

# Matrices are small, and each core has a worker: more threads wait for each other, and take twice the time.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

# One of its plugins loads trio, which takes half a second of each process and serves no test.
os.environ["HYPOTHESIS_NO_PLUGINS"] = "1"

from hypothesis import settings

from pbd.files.robot import read_robot
from tests.result_cache import FUNCTIONS, reading_once, remembering

# Without OMPL, which has no build for Python 3.14, there are no detours.
collect_ignore = [] if find_spec("ompl") else ["arm/test_choose_motion.py", "test_ablations.py"]


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: a quarter of the time is spent waiting for a browser or a port."""
    return (os.cpu_count() or 1) + 1


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object:
    """Run the tests of a file in one process where possible, so that their shared fixtures are made once."""
    return WorkStealingScheduling(config, log)


def pytest_collection_finish() -> None:
    """Leave all that is loaded by now out of the search for garbage."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run files with a browser first: so one worker runs them all, starts each browser once and ends it early."""
    shown = {item.path for item in items if not {"chrome", "fox"}.isdisjoint(getattr(item, "fixturenames", ()))}
    items.sort(key=lambda item: item.path not in shown)


# Otherwise each worker, and each command that a test starts as a process, compiles all of it again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A process of the tests holds some million objects, nearly all of them modules and tests. Garbage is not looked for
# among them (below), and after each 50,000 new objects instead of 700: else it takes a tenth of the time.
gc.set_threshold(50_000, 5, 5)
gc.disable()
if "PYTEST_XDIST_WORKER" in os.environ:
    atexit.register(os._exit, 0)  # a worker has reported all its results; to free its objects takes seconds
else:
    atexit.register(gc.unfreeze)  # else libraries take what is still there at the end for leaks

# Each bundled robot is read once, so that all tests of a process share what is cached of it.
pytest.MonkeyPatch().setattr("pbd.files.robot.read_robot", reading_once(read_robot))

# Nothing fails on time: the machine may be busy. Tests whose fault is rare ask for more examples themselves.
settings.register_profile("pbd", deadline=None, max_examples=25)
settings.load_profile("pbd")


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, as a user's own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def cached_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cache tracking and planning by input, for tests of what follows them."""
    for module, function in FUNCTIONS:
        monkeypatch.setattr(importlib.import_module(module), function, remembering(module, function))


@pytest.fixture
def unadvised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take each line for one that the arm can follow: to find out takes a plan, for advice (tests/test_advice.py)."""
    monkeypatch.setattr("pbd.cli.plan_report.can_plan", lambda *_: True)


@pytest.fixture
def data_folder() -> Path:
    """The folder of real recordings with optical truth. They are not part of the project."""
    folder = Path(os.environ.get("PBD_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not (folder / "broad").is_dir():
        pytest.skip(
            "no real recordings: set PBD_DATA to a folder with broad/ (BROAD, doi 10.3390/data6070072), walks/ "
            "(x-io Technologies, Gait-Tracking) and strides/ (gaitmap's example data)"
        )
    return folder
