"""One-line representations of values with large arrays."""

from pbd.errors import amount
from pbd.pose import Array


def brief(value: object, *said: str, name: str = "") -> str:
    """Write `<Recording 'tea': 2281 samples, 22.8 s at 100 Hz>`. Empty parts are left out."""
    what = f"{type(value).__name__}{f' {name!r}' if name else ''}"
    return f"<{what}: {', '.join(filter(None, said))}>"


def counted(n: int, what: str) -> str:
    """Write `1 stop`, `2 stops`, and nothing for none."""
    return amount(n, what) if n else ""


def span(t: Array) -> str:
    """Write the number of samples at instants (n,) s, their duration and their mean rate."""
    if len(t) < 2:
        return counted(len(t), "sample") or "no samples"
    duration = float(t[-1] - t[0])
    rate = f" at {(len(t) - 1) / duration:.4g} Hz" if duration > 0.0 else ""
    return f"{len(t)} samples, {duration:.1f} s{rate}"
