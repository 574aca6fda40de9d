"""When numba is asked for, and what becomes of a folder that it can't use."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pbd.arm import compiled
from pbd.arm.compiled import COMPILED_AFTER, LOADED_AFTER, Compiled
from pbd.errors import PbdWarning


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that were loaded from."""
    folders: list[Path] = []
    monkeypatch.setattr(compiled, "_load", folders.append)
    return folders


@pytest.mark.parametrize(("kept", "after"), [(True, LOADED_AFTER), (False, COMPILED_AFTER)])
def test_it_is_loaded_once_it_is_worth_it(tmp_path: Path, loads: list[Path], kept: bool, after: int) -> None:
    if kept:
        (tmp_path / "arm").mkdir()
        (tmp_path / "arm" / "kernel.descend_each-1.py311.nbi").touch()
    counted = Compiled(tmp_path)
    counted.count(after // 2)
    counted.count(after - after // 2)
    assert loads == []
    counted.count(1)
    counted.count(after)
    assert loads == [tmp_path]


def test_a_program_that_knows_needn_t_wait(tmp_path: Path, loads: list[Path]) -> None:
    eager = Compiled(tmp_path)
    assert not eager.load()  # there is no kernel in this test
    eager.load()
    assert loads == [tmp_path]


def test_one_motion_doesnt_wait_for_numba() -> None:
    code = (
        "import sys\nfrom tests.arm.bundled import arm_of\nfrom pbd.arm.sequence import solve_sequence\n"
        "arm = arm_of('panda')\nsolve_sequence(arm, [arm.forward(arm.robot.home)] * 9, arm.robot.home)\n"
        "print('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


@pytest.mark.parametrize("mode", [0o777, 0o750, 0o705])
def test_a_folder_that_others_can_enter_is_not_read_from(tmp_path: Path, mode: int) -> None:
    folder = tmp_path / "numba"
    folder.mkdir()
    folder.chmod(mode)
    assert not Compiled(folder).load()


def test_a_folder_that_cant_be_made_compiles_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert not Compiled(tmp_path / "file" / "numba").load()


def test_a_folder_is_made_for_the_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)  # as if it weren't installed
    assert not Compiled(tmp_path / "cache" / "numba").load()
    assert (tmp_path / "cache" / "numba").stat().st_mode & 0o777 == 0o700


def test_what_numba_cant_read_back_is_told_and_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    folder = tmp_path / "numba"

    def broken(name: str) -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr("pbd.arm.compiled.importlib.import_module", broken)
    with pytest.warns(PbdWarning, match=r"numba can't be used \(EOFError: Ran out of input\); remove .*numba to have"):
        assert not Compiled(folder).load()
