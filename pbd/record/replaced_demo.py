"""The demonstration that `--force` replaces. It gets another name until the new one has ended well."""

import os
from dataclasses import dataclass
from pathlib import Path

from pbd.errors import RecordingError, in_words
from pbd.files.demo import refuse_demo_folder
from pbd.files.set_aside_demos import why_kept
from pbd.io.atomic import name_aside, remove_folder


@dataclass(frozen=True)
class Backup:
    """A demonstration that was renamed to make room for a new one.

    Attributes:
        folder: its old folder, where the new one is.
        aside: its present folder, where a person finds it whatever happens to the recording.
        why_kept: why it stays there when the new one has ended well, or "".
    """

    folder: Path
    aside: Path
    why_kept: str

    @property
    def notice(self) -> str:
        """Say where it is while the new one is recorded."""
        return f"the old one is in {self.aside}{'' if self.why_kept else ' until this one has ended well'}"

    def replace(self) -> str:
        """Remove it, because the new one has ended well, unless `why_kept` says why not; return a message."""
        if self.why_kept:
            return f"the old {self.folder}, {self.why_kept}, is kept in {self.aside}"
        return remove_folder(self.aside) or f"the old {self.folder} is replaced"

    def keep(self) -> str:
        """Leave it where it is, because the new one can't be replayed; return a message for the person."""
        return (
            f"the new one can't be replayed, so the old one is kept in {self.aside}; to have it back, remove "
            f"{self.folder} and rename {self.aside} to {self.folder}"
        )

    def put_back(self) -> str:
        """Give it its old name back; return a message for the person."""
        try:
            self.aside.rename(self.folder)
        except OSError as reason:
            return f"the old one is in {self.aside}: it can't be put back ({in_words(reason)})"
        return f"the old {self.folder} is back"

    def swap_back(self) -> tuple[Path, str]:
        """Give it its old name back and the new one another name, because the new one has no rest.

        Returns:
            The new one's folder, and a message for the person.
        """
        why, kept = "no rest was found in it", name_aside(self.folder, "new")
        try:
            self.folder.rename(kept)
        except OSError as reason:
            return self.folder, f"{why}; the old one is in {self.aside}: it can't be put back ({in_words(reason)})"
        return kept, f"{why}, so it is kept in {kept}; {self.put_back()}"


def set_aside(folder: Path) -> Backup | None:
    """Rename a demonstration to NAME.before, or a free name like it; return None if there is none.

    Raises:
        RecordingError: the folder is not a demonstration, or can't be renamed.
    """
    if not os.path.lexists(folder):
        return None
    refuse_demo_folder(folder, force=True)
    why = why_kept(folder)
    try:
        return Backup(folder, folder.rename(name_aside(folder, "before")), why)
    except OSError as reason:
        what = f"{folder} can't be renamed to make room ({in_words(reason)}); give another name"
        raise RecordingError(what, path=folder) from None
