"""rich's console as we use it: names and labels are shown as they are, whatever stands in them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from pbd.view.terminal import drawing, visible


class Screen(Console):
    """A console without markup, emoji and highlights, in which control characters are visible."""

    def __init__(self, stream: TextIO, **options: Any) -> None:
        super().__init__(file=drawing(stream), highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich does: measured as it will be shown."""
        return super().render_str(visible(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)
