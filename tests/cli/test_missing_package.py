"""A missing package and a malformed number give one line, as every error."""

import json
import sys

import pytest

from pbd.cli import main
from pbd.cli.console import print_json


def test_a_missing_package_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import pbd.arm

    monkeypatch.setattr(pbd, "arm", pbd.arm)  # the package that is made anew meanwhile must not stay
    for module in [name for name in sys.modules if name.startswith(("pbd.arm", "pbd.cli.robots"))]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert main(["robots", "panda"]) == 1
    err = capsys.readouterr().err
    assert err.startswith("pbd: the Python package pinocchio is missing or broken (")
    assert err.endswith("; install pbd-robot again\n")
    assert err.count("\n") == 1


def test_a_library_that_the_system_lacks_is_named_by_its_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(_: object) -> int:
        raise ImportError("libgomp.so.1: cannot open shared object file: No such file or directory", name="pinocchio")

    monkeypatch.setattr("pbd.cli.robots.run", missing)
    assert main(["robots"]) == 1
    assert capsys.readouterr().err.endswith("; install Debian's package libgomp1\n")


def test_what_is_not_a_finite_number_is_null_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": float("nan"), "b": [1.5, float("inf"), {"c": (-float("inf"), "nan", True)}]})
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [1.5, None, {"c": [None, "nan", True]}]}


def test_a_missing_module_of_ours_is_a_bug(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pbd.cli.robots", None)
    with pytest.raises(ModuleNotFoundError, match=r"pbd\.cli\.robots"):
        main(["robots", "panda"])
