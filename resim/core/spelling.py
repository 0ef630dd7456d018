"""What a misspelt name may have meant, and numbers of things in words."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches


def nearest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Give the known name that is spelt most alike, whatever its case; "" where none is, or it is known itself.

    cutoff: 0 to 1, how much of both must be alike. Letters that are only in another order go first.
    """
    names = list(known)
    folded = {one.casefold(): one for one in reversed(names) if one != name}
    if name in names or not folded:
        return ""
    wanted = name.casefold()
    alike = get_close_matches(wanted, folded, len(folded), cutoff)
    return folded[max(alike, key=lambda one: _likeness(wanted, one))] if alike else ""


def _likeness(wanted: str, one: str) -> tuple[bool, float]:
    return sorted(wanted) == sorted(one), SequenceMatcher(None, one, wanted).ratio()


def did_you_mean(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Give ", did you mean ...?" with the known name that is spelt most alike; "" where none is."""
    alike = nearest(name, known, cutoff)
    return f", did you mean {alike!r}?" if alike else ""


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Give the words for a name that is none of the known ones: "there is no `what` ...", and which there are."""
    names = list(known)
    alike = did_you_mean(name, names)
    return f"there is no {what} {name!r}{f'{alike} There' if alike else '; there'} are: {', '.join(names)}"


def counted(number: int, noun: str) -> str:
    """Give a number of things in words: "1 scenario", "2 scenarios"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
