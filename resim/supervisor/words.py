"""Words and tones of pages: how verdicts look, how long ago something was, how long it took."""

from __future__ import annotations

import time
from datetime import UTC, datetime

from markupsafe import Markup

_TONES = {
    "pass": ("PASS", "verified", "same", "better", "within limits", "done"),
    "fail": ("FAIL", "not verified", "worse", "regresses", "error", "bad", "lost"),
    "invalid": ("INVALID", "undecided", "invalid", "changed"),
    "failed": ("failed",),
}
_TONE = {verdict: tone for tone, verdicts in _TONES.items() for verdict in verdicts}
WORST = ("failed", "fail", "invalid", "none", "pass")
"""Tones, the worst first."""


def tone(verdict: str) -> str:
    """Give the tone of a verdict; "none" for one that is none, or is not known: never a good one."""
    return _TONE.get(verdict, "none")


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
