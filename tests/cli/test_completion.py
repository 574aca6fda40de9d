"""Shell completion, tested in the shells."""

import shutil
import subprocess
from pathlib import Path

import pytest

from pbd.cli import main
from pbd.cli.commands.completion import SHELLS


def script(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        main(["--print-completion", shell])
    assert left.value.code == 0
    return capsys.readouterr().out


def completed(line: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> set[str]:
    """The completions that bash offers after the line."""
    words = line.split(" ")
    asked = (
        f"{script('bash', capsys)}\n"
        f"COMP_WORDS=({' '.join(words[:-1])} '{words[-1]}'); COMP_CWORD={len(words) - 1}\n"
        "COMPREPLY=()\n"
        '_shtab_pbd pbd "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD-1]}" || true\n'
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    bash = shutil.which("bash")
    assert bash is not None
    found = subprocess.run([bash, "-c", asked], cwd=folder, capture_output=True, text=True, check=True)
    return {word.strip() for word in found.stdout.splitlines()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder with an own demonstration and an own robot."""
    (tmp_path / "demos" / "tea").mkdir(parents=True)
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "mine.toml").touch()
    (tmp_path / "log.txt").touch()
    return tmp_path


def test_commands_options_and_names(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert {"record", "replay", "export"} <= completed("pbd ", folder, capsys)
    assert completed("pbd key", folder, capsys) == {"keyframes"}
    assert "--method" in completed("pbd segments --me", folder, capsys)
    assert {"tea", "pouring"} <= completed("pbd segments ", folder, capsys)
    assert completed("pbd replay --robot mi", folder, capsys) == {"mine"}
    assert "panda" in completed("pbd replay --robot pa", folder, capsys)
    assert completed("pbd replay --calibration de", folder, capsys) == {"default"}
    assert "tea" in completed("pbd plot t", folder, capsys)
    assert "default" in completed("pbd calibrate dock d", folder, capsys)
    assert "witmotion" in completed("pbd record x --sensor w", folder, capsys)
    assert "pour" in completed("pbd simulate p", folder, capsys)
    assert completed("pbd import lo", folder, capsys) == {"log.txt"}
    assert completed("pbd export -o lo", folder, capsys) == {"log.txt"}
    assert "default" not in completed("pbd record --separator ", folder, capsys)
    assert "modern" not in completed("pbd replay --path-tolerance ", folder, capsys)


def test_a_name_is_never_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bash expands the words that it completes, and a completed line is run as it stands."""
    for name in ("$(touch ran)", "`touch ran`", "a;touch ran", "-rf"):
        (folder / "demos" / name).mkdir()
        (folder / "robots" / f"{name}.toml").touch()
    assert "tea" in (demos := completed("pbd segments ", folder, capsys))
    assert not any(set(word) & set("$`;") for word in demos | completed("pbd replay --robot ", folder, capsys))
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_gets_a_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "keyframes" in script(shell, capsys)


def test_zsh_takes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By eval, as the README says, after compinit; commands are described as in `pbd --help`."""
    zsh = shutil.which("zsh")
    if zsh is None:
        pytest.skip("no zsh here")
    text = script("zsh", capsys)
    assert "import:'import a recording of another program'" in text
    file = tmp_path / "pbd.zsh"
    file.write_text(text, encoding="utf-8")
    asked = f'autoload -U compinit; compinit -u -D; eval "$(<{file})"; print $_comps[pbd]'
    found = subprocess.run([zsh, "-f", "-c", asked], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "_shtab_pbd"
    assert found.stderr == ""


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("pbd key", "keyframes"),
        ("pbd segments --me", "--method"),
        ("pbd segments te", "tea"),
        ("pbd replay --robot mi", "mine"),
        ("pbd calibrate dock de", "default"),
    ],
)
def test_fish_takes_it(folder: Path, capsys: pytest.CaptureFixture[str], line: str, word: str) -> None:
    fish = shutil.which("fish")
    if fish is None:
        pytest.skip("no fish here")
    file = folder / "pbd.fish"
    file.write_text(script("fish", capsys), encoding="utf-8")
    found = subprocess.run(
        [fish, "-N", "-c", f"source {file}; complete -C '{line}'"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert word in {offer.partition("\t")[0] for offer in found.stdout.splitlines()}
    assert found.stderr == ""
