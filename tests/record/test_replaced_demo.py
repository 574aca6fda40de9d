"""A demonstration that makes room for a new one of its name: whatever goes wrong, it is whole somewhere."""

import errno
import re
from dataclasses import replace
from pathlib import Path

import pytest

from pbd.data import RecordingInfo
from pbd.errors import RecordingError
from pbd.record.replaced_demo import set_aside
from pbd.record.session import Session
from pbd.record.session_types import RecordOptions
from pbd.sensors.protocols import protocol
from tests.not_none import not_none
from tests.sensors.encoders import ximu3


@pytest.fixture
def tea(tmp_path: Path) -> Path:
    folder = tmp_path / "tea"
    folder.mkdir()
    (folder / "demo.toml").write_text("the old one")
    return folder


def beside(tea: Path) -> dict[str, str]:
    return {path.parent.name: path.read_text() for path in tea.parent.glob("*/demo.toml")}


def test_a_name_that_is_free(tea: Path) -> None:
    """Even by a link that leads nowhere."""
    (tea.parent / "tea.before").mkdir()
    (tea.parent / "tea.before-2").symlink_to(tea.parent / "nowhere")
    before = not_none(set_aside(tea))
    assert before.aside.name == "tea.before-3"
    assert not tea.exists()
    assert before.put_back() == f"the old {tea} is back"
    assert beside(tea) == {"tea": "the old one"}


def test_where_there_is_none_nothing_is_done(tmp_path: Path) -> None:
    assert set_aside(tmp_path / "tea") is None


def test_what_is_no_demonstration_stays(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    with pytest.raises(RecordingError, match="is not a demonstration, so it is not replaced; give another name"):
        set_aside(tmp_path / "photos")
    assert (tmp_path / "photos").exists()


def test_a_recording_stays_where_it_is_said_to_be(tea: Path) -> None:
    before = not_none(set_aside(tea))
    assert before.notice == f"the old one is in {tea}.before"
    assert before.replace() == f"the old {tea}, a recording, is kept in {tea}.before"
    assert beside(tea) == {"tea.before": "the old one"}
    assert replace(before, why_kept="").replace() == f"the old {tea} is replaced"
    assert beside(tea) == {}


def test_one_that_is_kept_says_how_to_get_it_back(tea: Path) -> None:
    before = not_none(set_aside(tea))
    told = before.keep()
    assert told == (
        f"the new one can't be replayed, so the old one is kept in {tea}.before; to have it back, "
        f"remove {tea} and rename {tea}.before to {tea}"
    )
    assert beside(tea) == {"tea.before": "the old one"}


def test_a_link_goes_and_what_it_leads_to_stays(tea: Path) -> None:
    link = tea.with_name("link")
    link.symlink_to(tea)
    before = not_none(set_aside(link))
    before.replace()
    assert beside(tea) == {"tea": "the old one"}
    assert [path.name for path in tea.parent.iterdir()] == ["tea"]


def test_what_can_not_be_put_back_is_told(tea: Path) -> None:
    before = not_none(set_aside(tea))
    tea.mkdir()
    (tea / "left over").touch()
    assert before.put_back().startswith(f"the old one is in {tea}.before: it can't be put back (")
    assert beside(tea) == {"tea.before": "the old one"}


def test_a_new_one_that_can_not_be_begun_makes_no_room(tea: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Unwritable:
        def __init__(self, folder: Path, info: RecordingInfo, channels: tuple[str, ...], closed: bool) -> None:
            folder.mkdir()
            raise RecordingError("no space left")

    monkeypatch.setattr("pbd.record.session.RecordingWriter", Unwritable)
    session = Session(protocol("ximu3").decoder(), RecordOptions(tea, "ximu3", "2026-01-02T03:04:05Z", force=True))
    packets = [ximu3.binary("I", 1_000_000 + 10_000 * k, [0.0] * 5 + [1.0]) for k in range(40)]
    with pytest.raises(RecordingError, match="no space left"):
        session.take(b"".join(packets), 0.0)
    assert beside(tea) == {"tea": "the old one"}
    assert session.backup is None


def test_a_folder_that_cannot_be_renamed(tea: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as one on which a disk is mounted."""
    before = not_none(set_aside(tea))
    tea.mkdir()
    (tea / "demo.toml").write_text("the new one")

    def busy(*given: object) -> None:
        raise OSError(errno.EBUSY, "Device or resource busy")

    monkeypatch.setattr(Path, "rename", busy)
    why = "(Device or resource busy)"
    told = f"no rest was found in it; the old one is in {tea}.before: it can't be put back {why}"
    assert before.swap_back() == (tea, told)
    with pytest.raises(RecordingError, match=re.escape(f"can't be renamed to make room {why}; give another name")):
        set_aside(tea)
    assert beside(tea) == {"tea": "the new one", "tea.before": "the old one"}
