"""What the system refuses is told in words: no error numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from pbd.cli import main


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("keyframes pouring --calibration calibration", "calibration is a folder: give a name, or a file; known are"),
        ("replay pouring --robot robots", "robots is a folder: give a name, or a file; known are"),
        ("replay pouring --robot panda --from no.json", "--from no.json: can't be read (No such file or directory)"),
        ("replay pouring --robot panda --from robots", "--from robots: can't be read (Is a directory); give a JSON"),
        ("simulate pour a-file/x", "a-file/x can't be written (Not a directory); give another place"),
        (
            "record x --sensor lines --columns no.toml",
            "no.toml: can't be read (No such file or directory); give a TOML",
        ),
    ],
)
def test_one_line_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("calibration", "robots"):
        Path(folder).mkdir()
    Path("a-file").touch()
    assert main(words.split()) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"pbd: {line}")
    assert err.count("\n") == 1
