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
from resim.core.tracks import ObjectKind

NEAR = 100.0
"""m within which anybody else counts, by straight lines from where a maneuver begins to where it ends: how far ahead
somebody is relevant in the eight-vehicle model (Wagner 2021, 6.2.1.2)."""
EXAMPLE = "See scenarios/catalog/kinds.toml"


class KindQuery(Strict):
    """Which maneuvers are of a kind: labels and kinds of objects, each list any of it, an empty one all.

    label: of the maneuver. kind: of its object. own: the same object has one of these labels at the same time. partner:
    its partner has. partner_kind: of the partner. other: anybody else within 100 m has, of `other_kind`. not_own:
    it has none of these. not_partner: its partner has none. not_other: nobody else within 100 m has one, of
    `other_kind`. before: the same object had one that began before it, and ended up to `within` [s] before or later.
    not_before: it had none. within: s. alone: it has no partner.
    """

    label: tuple[str, ...] = Field(min_length=1)
    kind: tuple[ObjectKind, ...] = ()
    own: tuple[str, ...] = ()
    partner: tuple[str, ...] = ()
    partner_kind: tuple[ObjectKind, ...] = ()
    other: tuple[str, ...] = ()
    other_kind: tuple[ObjectKind, ...] = ()
    not_own: tuple[str, ...] = ()
    not_partner: tuple[str, ...] = ()
    not_other: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    not_before: tuple[str, ...] = ()
    within: float = Field(default=3.0, gt=0.0)
    alone: bool = False

    @model_validator(mode="after")
    def _of_others(self) -> KindQuery:
        if self.other_kind and not (self.other or self.not_other):
            raise ValueError("other_kind: expected other or not_other as well")
        return self

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
        self.kind, self.partner_kind = (
            maneuvers[name].to_numpy(dtype=str) for name in ("kind", "partner_kind")
        )
        self.recording = pd.factorize(maneuvers["recording"])[0]
        names = maneuvers["recording"].astype(str) + "\n" + maneuvers["object"].astype(str)
        partners = maneuvers["recording"].astype(str) + "\n" + maneuvers["partner"].astype(str)
        codes = pd.factorize(pd.concat([names, partners]))[0]
        self.object, self.partner = codes[: len(names)], codes[len(names) :]
        self.partnered = maneuvers["partner"].to_numpy(dtype=str) != ""
        self.start, self.end = maneuvers["start"].to_numpy(float), maneuvers["end"].to_numpy(float)
        x, y = (maneuvers[[f"{c}_from", f"{c}_to"]].to_numpy(float).T for c in ("x", "y"))
        self.place = x + 1j * y

    def matching(self, query: KindQuery) -> np.ndarray:
        """Give the places of maneuvers that are of a kind."""
        at = np.flatnonzero(np.isin(self.label, query.label))
        for kinds, own in ((query.kind, self.kind), (query.partner_kind, self.partner_kind)):
            if kinds:
                at = at[np.isin(own[at], kinds)]
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
                kinds = query.other_kind if of == "other" else ()
                at = at[self._has(at, names, of, back, kinds) == wanted]
        return at

    def _has(
        self, at: np.ndarray, names: tuple[str, ...], of: str, back: float, kinds: tuple[ObjectKind, ...]
    ) -> np.ndarray:
        """Whether one of these labels is there during each maneuver, or up to `back` [s] before it."""
        wanted = np.isin(self.label, names)
        some = np.flatnonzero(wanted & np.isin(self.kind, kinds) if kinds else wanted)
        key = self.recording if of == "other" else self.object
        some = some[np.argsort(key[some], kind="stable")]
        sought = {"own": self.object, "partner": self.partner, "other": self.recording}[of][at]
        low, high = (np.searchsorted(key[some], sought, side=side) for side in ("left", "right"))
        out = np.zeros(len(at), dtype=bool)
        for k, place in enumerate(at.tolist()):
            near = some[low[k] : high[k]]
            near = near[(self.start[near] <= self.end[place]) & (self.end[near] >= self.start[place] - back)]
            if back > 0.0:
                near = near[self.start[near] < self.start[place]]
            if of == "other":
                near = near[self.object[near] != self.object[place]]
                near = near[self._distance(place, near) <= NEAR]
            out[k] = bool((near != place).any())
        return out

    def _distance(self, one: int, others: np.ndarray) -> np.ndarray:
        """The least distance [m] between a maneuver and others while both last."""
        begin = np.maximum(self.start[one], self.start[others])
        end = np.minimum(self.end[one], self.end[others])
        first, last = (self._at(others, t) - self._at(np.full(len(others), one), t) for t in (begin, end))
        step = last - first
        with np.errstate(divide="ignore", invalid="ignore"):
            share = -(first * step.conj()).real / np.abs(step) ** 2
        return np.asarray(np.abs(first + np.clip(np.nan_to_num(share), 0.0, 1.0) * step))

    def _at(self, which: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Where maneuvers are at times, x + iy [m], by the straight line from their first place to their last."""
        lasts = self.end[which] - self.start[which]
        share = np.divide(t - self.start[which], lasts, out=np.zeros(len(t)), where=lasts > 0.0)
        return np.asarray(self.place[0, which] + share * (self.place[1, which] - self.place[0, which]))
