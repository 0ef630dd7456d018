"""The table of variations: the one place that says its columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from resim.variations.search import FoundVariation
from resim.variations.trust import Trust

VARIATION_COLUMNS = {
    "variation": "number, from 1 in the order of the sequence",
    "origin": "name of the drive that is varied",
    "recording": "hash of its content",
    "object": "ids of the varied objects, spaces between",
    "maneuvers": "what of them is varied, `object:label@start`, spaces between",
    "halton_index": "which point of the Halton sequence it is",
    "distance": "from the origin, in standard deviations of the kernels' data over all components",
    "trust": "inside, outside or unknown: whether it lies within what `resim verify --vary` found",
    "trust_reason": "why it is not inside",
    "rejections": "points of the sequence that were rejected since the variation before",
    "off_m": "m, the largest distance of a fitted trace from the varied one",
    "sizes": "objects with another type, `id:kind:length:width`, spaces between",
    "environment": "what of it differs, `name=value`, semicolons between",
    "file": "JSCEN file of it, from the table's folder; empty where none was written",
}
"""Columns of variations.parquet and what they say; after them `h1`, `h2`, ... (the point, 0 to 1) and `c1`, `c2`, ...
(the components), those of one maneuver after the other in the order of `maneuvers`; discrete dimensions come last."""
REJECTED_COLUMNS = {"halton_index": "which point of the sequence", "reason": "why it was left out"}
"""Columns of rejected.parquet."""


@dataclass(frozen=True)
class OriginNames:
    """What all rows have in common: name and hash of the origin, ids of the varied objects, maneuvers."""

    name: str
    hash: str
    objects: tuple[str, ...]
    maneuvers: tuple[str, ...]


def file_name(number: int) -> str:
    """Give the name of a variation's JSCEN file, without its folder."""
    return f"{number:06d}.jscen.json"


def variation_frame(
    found: Sequence[FoundVariation], trust: Sequence[Trust], names: OriginNames, folder: str
) -> pd.DataFrame:
    """Give a row a kept variation. folder: of the JSCEN files, "" where there are none."""
    kept = [one for one in found if not one.rejected]
    table: dict[str, object] = {
        "variation": np.arange(1, len(kept) + 1),
        "origin": [names.name] * len(kept), "recording": [names.hash] * len(kept),
        "object": [" ".join(names.objects)] * len(kept), "maneuvers": [" ".join(names.maneuvers)] * len(kept),
        "halton_index": [one.index for one in kept],
        "distance": [one.drive.distance for one in kept if one.drive is not None],
        "trust": [one.level for one in trust], "trust_reason": [one.reason for one in trust],
        "rejections": np.diff([0, *(one.index for one in kept)]) - 1,
        "off_m": [one.drive.off for one in kept if one.drive is not None],
        "sizes": [" ".join(f"{n}:{kind}:{a:g}:{b:g}" for n, kind, a, b in one.sizes) for one in kept],
        "environment": ["; ".join(f"{key}={value}" for key, value in one.environment) for one in kept],
        "file": [f"{folder}/{file_name(k)}" if folder else "" for k in range(1, len(kept) + 1)],
    }  # fmt: skip
    points = np.array([one.point for one in kept])
    components = np.array([one.drive.components for one in kept if one.drive is not None])
    table |= {f"h{k + 1}": column for k, column in enumerate(points.T)}
    table |= {f"c{k + 1}": column for k, column in enumerate(components.T)}
    frame = pd.DataFrame(table).astype(dict.fromkeys(("variation", "halton_index", "rejections"), "int64"))
    texts = (
        "origin",
        "recording",
        "object",
        "maneuvers",
        "trust",
        "trust_reason",
        "sizes",
        "environment",
        "file",
    )
    return frame.astype(dict.fromkeys(texts, "string"))


def rejected_frame(found: Sequence[FoundVariation]) -> pd.DataFrame:
    """Give a row a rejected point."""
    out = [(one.index, one.rejected) for one in found if one.rejected]
    frame = pd.DataFrame(out, columns=list(REJECTED_COLUMNS))
    return frame.astype({"halton_index": "int64", "reason": "string"})
