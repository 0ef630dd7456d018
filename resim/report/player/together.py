"""Several drives on one map above each other: their sources as layers of one drive, each in colours of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.tracks import Tracks
from resim.report.player.drive import Layer, PlayedDrive, TimelineMark


def together(drives: Sequence[PlayedDrive]) -> PlayedDrive:
    """Give drives as one: "rGT 2" is rGT of the second. What an earlier one has likewise is there once.

    Times are each drive's own. Notes say what of a drive is there already. Raises InputError for drives on other maps
    than the first.
    """
    first = drives[0]
    road = file_hash(first.network.path)
    layers: list[Layer] = []
    bases: list[str] = []
    marks: list[TimelineMark] = []
    notes: list[str] = []
    for number, drive in enumerate(drives, start=1):
        if file_hash(drive.network.path) != road:
            remedy = "Give drives on one map, or leave out --together."
            raise InputError(drive.name, f"is on another map than {first.name}", remedy)
        shown = {"": ""}
        known: list[str] = []
        for layer in drive.layers:
            new = _layer(layer, drive, first.ego, number)
            alike = (
                k
                for k, old in enumerate(layers)
                if bases[k] == layer.name and _is_same(new.tracks, old.tracks)
            )
            k = next(alike, len(layers))
            if k < len(layers):
                layers[k] = _with_curves(layers[k], new)
                known.append(layer.name)
            else:
                layers.append(new)
                bases.append(layer.name)
            shown[layer.name] = layers[k].name
        of = f"{number}: " if number > 1 else ""
        marks += [replace(m, source=shown.get(m.source, m.source), text=of + m.text) for m in drive.marks]
        notes += [of + note for note in drive.notes]
        if known:
            notes.append(f"{of}{drive.name}: {', '.join(known)} exactly as above, shown once")
    told = {
        (m.kind, m.start, m.end, m.source, m.object, m.text.rpartition(": ")[2]): m for m in reversed(marks)
    }
    in_order = tuple(sorted(told.values(), key=lambda mark: mark.start))
    name = " and ".join(_names(drives))
    return PlayedDrive(name, first.ego, first.network, tuple(layers), in_order, tuple(dict.fromkeys(notes)))


def _with_curves(known: Layer, other: Layer) -> Layer:
    """A layer with what only the same one of another drive was judged to be."""
    return replace(
        known, danger=known.danger or other.danger, acceleration=known.acceleration or other.acceleration,
        assessed=known.assessed or other.assessed, plans=known.plans or other.plans,
    )  # fmt: skip


def _names(drives: Sequence[PlayedDrive]) -> Iterator[str]:
    names = [*dict.fromkeys(drive.name for drive in drives)]
    yield from names[:3]
    if len(names) > 3:
        yield f"{len(names) - 3} more"


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
        name=f"{layer.name} {number}",
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
