"""How good a verdict is, in a word: the tone in which pages show it, and by which builds are compared."""

from __future__ import annotations

_TONES = {
    "pass": ("PASS", "verified", "same", "better", "within limits", "done"),
    "fail": ("FAIL", "not verified", "worse", "regresses", "error", "bad", "lost"),
    "invalid": ("INVALID", "undecided", "invalid", "changed", "not comparable"),
    "failed": ("failed",),
}
_TONE = {verdict: tone for tone, verdicts in _TONES.items() for verdict in verdicts}
WORST = ("failed", "fail", "invalid", "none", "pass")
"""Tones, the worst first."""


def tone(verdict: str) -> str:
    """Give the tone of a verdict; "none" for one that is none, or is not known: never a good one."""
    return _TONE.get(verdict, "none")
