"""rich's console as we use it: names and labels are shown literally, control characters as escapes."""

from collections.abc import Iterable
from typing import Any, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from pbd.view.terminal import escaped, for_rich


class SafeConsole(Console):
    """A console without markup, emoji and highlights, which shows control characters as escapes."""

    def __init__(self, stream: TextIO, **options: Any) -> None:
        super().__init__(file=for_rich(stream), highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Make control characters visible before rich measures the text."""
        return super().render_str(escaped(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Make control characters visible in what rich prints, except in rich's own control sequences."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(escaped(segment.text), segment.style)
