"""Kinds of scenarios (Kaefer 2022, Appendix 1) as queries over labels: how often each was found, and which never.

`scenarios/catalog/kinds.toml` has all rows of both catalogs: each with a query, or the reason why object lists cannot
show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from resim.core.spec import Strict, read_strict

EXAMPLE = "See scenarios/catalog/kinds.toml"


class KindQuery(Strict):
    """Which maneuvers are of a kind: labels, each list any of it.

    label: of the maneuver. own: the same object has one of these at the same time. partner: its partner has. other:
    anybody else of the recording has. not_own, not_partner, not_other: nobody of these has one. before, not_before: the
    same object had one that ended up to `within` [s] before, or during it. alone: it has no partner.
    """

    label: tuple[str, ...] = Field(min_length=1)
    own: tuple[str, ...] = ()
    partner: tuple[str, ...] = ()
    other: tuple[str, ...] = ()
    not_own: tuple[str, ...] = ()
    not_partner: tuple[str, ...] = ()
    not_other: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    not_before: tuple[str, ...] = ()
    within: float = Field(default=3.0, ge=0.0)
    alone: bool = False

    def labels(self) -> set[str]:
        """Give every label that it names."""
        lists = (
            self.label,
            self.own,
            self.partner,
            self.other,
            self.not_own,
            self.not_partner,
            self.not_other,
        )
        return {name for names in (*lists, self.before, self.not_before) for name in names}


class ScenarioKind(Strict):
    """A row of a catalog: `find` it, or say `never` why not. reading: what of the row the query stands for."""

    catalog: str = Field(min_length=1)
    group: str = Field(min_length=1)
    name: str = Field(min_length=1)
    find: KindQuery | None = None
    never: str = ""
    reading: str = ""

    @model_validator(mode="after")
    def _one(self) -> ScenarioKind:
        if (self.find is None) == (not self.never):
            raise ValueError("expected either find or never")
        return self


class KindsFile(Strict):
    """All kinds."""

    kind: tuple[ScenarioKind, ...]


@dataclass(frozen=True)
class KindCount:
    """How often a kind was found, None where it cannot be."""

    kind: ScenarioKind
    found: int | None


def read_kinds(path: Path) -> tuple[ScenarioKind, ...]:
    """Read a file of kinds. Raises InputError naming every fault."""
    return read_strict(path, KindsFile, EXAMPLE).kind


def count_kinds(kinds: Sequence[ScenarioKind], maneuvers: pd.DataFrame) -> list[KindCount]:
    """Give how many maneuvers are of each kind. maneuvers: rows as of maneuvers.parquet."""
    index = _Index(maneuvers)
    return [KindCount(kind, None if kind.find is None else len(index.matching(kind.find))) for kind in kinds]


def matching(query: KindQuery, maneuvers: pd.DataFrame) -> pd.DataFrame:
    """Give the maneuvers that are of a kind."""
    return maneuvers.iloc[_Index(maneuvers).matching(query)]


class _Index:
    """Maneuvers by label, for queries."""

    def __init__(self, maneuvers: pd.DataFrame) -> None:
        self.label = maneuvers["label"].to_numpy(dtype=str)
        self.recording = pd.factorize(maneuvers["recording"])[0]
        names = maneuvers["recording"].astype(str) + "\n" + maneuvers["object"].astype(str)
        partners = maneuvers["recording"].astype(str) + "\n" + maneuvers["partner"].astype(str)
        codes = pd.factorize(pd.concat([names, partners]))[0]
        self.object, self.partner = codes[: len(names)], codes[len(names) :]
        self.partnered = maneuvers["partner"].to_numpy(dtype=str) != ""
        self.start, self.end = maneuvers["start"].to_numpy(float), maneuvers["end"].to_numpy(float)

    def matching(self, query: KindQuery) -> np.ndarray:
        """Give the places of maneuvers that are of a kind."""
        at = np.flatnonzero(np.isin(self.label, query.label))
        if query.alone:
            at = at[~self.partnered[at]]
        late = query.within
        for names, wanted, of, back in (
            (query.own, True, "own", 0.0), (query.partner, True, "partner", 0.0), (query.other, True, "other", 0.0),
            (query.not_own, False, "own", 0.0), (query.not_partner, False, "partner", 0.0),
            (query.not_other, False, "other", 0.0), (query.before, True, "own", late),
            (query.not_before, False, "own", late),
        ):  # fmt: skip
            if names:
                at = at[self._has(at, names, of, back) == wanted]
        return at

    def _has(self, at: np.ndarray, names: tuple[str, ...], of: str, back: float) -> np.ndarray:
        """Whether one of these labels is there during each maneuver, or up to `back` [s] before it."""
        some = np.flatnonzero(np.isin(self.label, names))
        key = self.recording if of == "other" else self.object
        some = some[np.argsort(key[some], kind="stable")]
        wanted = {"own": self.object, "partner": self.partner, "other": self.recording}[of][at]
        low, high = (np.searchsorted(key[some], wanted, side=side) for side in ("left", "right"))
        out = np.zeros(len(at), dtype=bool)
        for k, place in enumerate(at.tolist()):
            near = some[low[k] : high[k]]
            near = near[(self.start[near] <= self.end[place]) & (self.end[near] >= self.start[place] - back)]
            if of == "other":
                near = near[self.object[near] != self.object[place]]
            out[k] = bool((near != place).any())
        return out
