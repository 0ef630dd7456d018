"""Which recordings of a space are one drive: a drive that is there again, or vehicles that saw the same traffic."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from resim.space.model import Space
from resim.space.repeated_drives import merged, same_traffic
from resim.space.shared_traffic import recordings_of_one_traffic


def with_drives(space: Space, since: int, new: set[str]) -> Space:
    """Give a space that says which drive each recording is, and each scenario is of.

    since: the first row that is new; new: names of the sources that are.
    """
    names = [f"{one.name}/{name}" for one in space.sources for name in one.lengths]
    number = {name: k for k, name in enumerate(names)}
    known = [(number[one], number[two]) for one, two in _known(space, new)]
    drive = merged(names, _pairs(known))
    of_row = [number[name] for name in space.rows["source"] + "/" + space.rows["recording"]]
    again = same_traffic(space.traces, drive[of_row].tolist(), space.rows["map"].astype(str).tolist(), since)
    drive = merged(names, _pairs([*known, *((of_row[one], of_row[two]) for one, two in again.tolist())]))
    told = dict(zip(names, drive.tolist(), strict=True))
    sources = (
        replace(one, drives={name: told[f"{one.name}/{name}"] for name in one.lengths})
        for one in space.sources
    )
    return replace(space, sources=tuple(sources), rows=space.rows.assign(drive=drive[of_row]))


def _pairs(told: list[tuple[int, int]]) -> np.ndarray:
    return np.array(told, dtype=np.intp).reshape(-1, 2)


def _known(space: Space, new: set[str]) -> Iterator[tuple[str, str]]:
    """Recordings that are one drive: as the space says, that hold the same traffic, or saw it."""
    first: dict[str, str] = {}
    for one in space.sources:
        for name in one.lengths:
            own = f"{one.name}/{name}"
            yield own, one.drives.get(name, own)
            if traffic := one.traffic.get(name, "").partition(" ")[0]:
                yield own, first.setdefault(traffic, own)
    recordings = {f"{one.name}/{name}" for one in space.sources if one.name in new for name in one.lengths}
    yield from recordings_of_one_traffic(space.moments, recordings)
