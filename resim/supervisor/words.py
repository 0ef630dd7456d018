"""Words of pages: how long ago something was, how long it took, how large it is."""

from __future__ import annotations

import time
from datetime import UTC, datetime

from markupsafe import Markup


def moment(at: float | str | None) -> str:
    """Give a time, of seconds since 1970 or in ISO 8601, as UTC to the second; "" for None."""
    if at is None or at == "":
        return ""
    told = datetime.fromtimestamp(at, UTC) if isinstance(at, float | int) else datetime.fromisoformat(at)
    return told.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S")


def span(start: float | None, end: float | None = None) -> str:
    """Give how long something took, or takes until now, in words; "" where it has not begun."""
    if start is None:
        return ""
    seconds = max(0.0, (time.time() if end is None else end) - start)
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h" if seconds < 100 * 3600 else f"{seconds / 86400:.0f} days"


def age(start: float) -> int:
    """Give for how many seconds something has gone on, which a page counts on by itself."""
    return max(0, round(time.time() - start))


def size(count: float) -> str:
    """Give a number of bytes in words."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def coded(text: str) -> Markup:
    """Give a text with what stands between two backticks as code; all of it is escaped."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return Markup.escape(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(p) if k % 2 else Markup.escape(p) for k, p in enumerate(parts)
    )
