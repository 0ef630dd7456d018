"""Several drives on one map above each other: their sources as layers of one drive, each in colours of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.tracks import Tracks
from resim.report.player.drive import Layer, PlayedDrive


def together(drives: Sequence[PlayedDrive]) -> PlayedDrive:
    """Give drives as one: "rGT 2" is rGT of the second. What an earlier one has likewise is there once.

    Times are each drive's own. Raises InputError for drives on other maps than the first.
    """
    first = drives[0]
    road = file_hash(first.network.path)
    layers: list[Layer] = []
    marks, notes = list(first.marks), list(first.notes)
    for number, drive in enumerate(drives, start=1):
        if file_hash(drive.network.path) != road:
            remedy = "Give drives on one map, or leave out --together."
            raise InputError(drive.name, f"is on another map than {first.name}", remedy)
        own = [_layer(layer, drive, first.ego, number) for layer in drive.layers]
        layers += [new for new in own if not any(_is_same(new.tracks, old.tracks) for old in layers)]
        if number > 1:
            kept = {layer.name for layer in layers}
            named = (
                replace(m, source=_name(m.source, number), text=f"{number}: {m.text}") for m in drive.marks
            )
            marks += [mark for mark in named if mark.source in kept]
            notes += [f"{number}: {note}" for note in drive.notes]
    return PlayedDrive(" and ".join(_names(drives)), first.ego, first.network, tuple(layers),
                       tuple(sorted(marks, key=lambda mark: mark.start)), tuple(dict.fromkeys(notes)))  # fmt: skip


def _names(drives: Sequence[PlayedDrive]) -> Iterator[str]:
    names = [*dict.fromkeys(drive.name for drive in drives)]
    yield from names[:3]
    if len(names) > 3:
        yield f"{len(names) - 3} more"


def _name(source: str, number: int) -> str:
    return f"{source} {number}" if number > 1 else source


def _layer(layer: Layer, drive: PlayedDrive, ego: str, number: int) -> Layer:
    """A layer of a drive as one of several; its EGO is the EGO, whatever it is called there."""
    if number == 1:
        return layer
    tracks = layer.tracks
    if drive.ego != ego:
        names = {ego: f"{ego} of {drive.name}", drive.ego: ego}
        tracks = replace(
            tracks, ids=np.array([names.get(one, one) for one in tracks.ids.tolist()], dtype=object)
        )
    return replace(
        layer,
        name=_name(layer.name, number),
        title=f"{drive.name}: {layer.title}",
        tracks=tracks,
        of=number - 1,
    )


def _is_same(one: Tracks, other: Tracks) -> bool:
    """Whether everybody is where he is in the other, as of one recording in two results of it."""
    for field in fields(Tracks):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if a is None or b is None:
            if a is not b:
                return False
        elif a.shape != b.shape or not np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            return False
    return True
