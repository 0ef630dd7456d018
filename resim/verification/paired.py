"""Two builds in the same scenarios with the same seeds: what the new one gained, lost and changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from resim.core.geometry import Floats
from resim.core.intervals import CONFIDENCE
from resim.resimulation.drive_outcome import COMFORT, DriveOutcome, Kpi
from resim.verification.compare import kpi_text
from resim.verification.ends import ends_text, worse_ends

NOT_COMPARED = "INVALID with one build or both, which shows nothing of them:"
"""How a note begins that names criteria which were not compared."""
RECORDINGS, DIFFERENT = 5, 3
"""Recordings that an interval of a mean needs, and how many have to differ from what most of them give.

It is Student's, widened as if one recording more had gone beyond either end by the range of the others, less of it the
more there are: t alone holds 83 % where differences are skew (docs/validation.md, the twenty-third round)."""
Change = Literal["gained", "lost", "same"]


@dataclass(frozen=True)
class RunPair:
    """One run of both builds, same scenario, same seed (None: without a perception model).

    gained, lost: KPIs; weight_lost: of these. decisions, reactions [s]: the old one's and the new one's. risk, comfort:
    the new one's less the old one's. t: when [s] the first difference shows. failure: of the functions. open: KPIs that
    are INVALID with the new build, or were with the old one, and neither gained nor lost: nothing is shown of them.
    """

    seed: int | None
    gained: tuple[str, ...]
    lost: tuple[str, ...]
    weight_lost: float
    decisions: tuple[list[str], list[str]]
    reactions: tuple[float | None, float | None]
    risk: float | None
    comfort: Mapping[str, float | None]
    t: float | None
    differences: tuple[str, ...]
    failure: str
    open: tuple[str, ...] = ()

    @property
    def changed(self) -> bool:
        """Whether the EGO does something else."""
        return self.decisions[0] != self.decisions[1]


def pair(seed: int | None, old: DriveOutcome, new: DriveOutcome, diverged: float | None) -> RunPair:
    """Set the new build's run beside the old one's. diverged: when [s] the EGOs diverge.

    A run that ended before there was anything to judge has lost what the other passed. One that ends worse than the
    old one's, which may have ended badly too, has lost that (`resim.verification.ends`), and gained nothing.
    """
    lost_all = {
        name: Kpi("INVALID", None, k.unit, None, "", k.weight, "no run") for name, k in old.kpis.items()
    }
    before, now = old.kpis, {**lost_all, **new.kpis}
    changes = {name: _change(before[name].outcome, now[name].outcome) for name in before}
    gained, lost = (tuple(name for name, c in changes.items() if c == which) for which in ("gained", "lost"))
    told = [
        f"{name}: {kpi_text(before[name])} before, {kpi_text(now[name])} now" for name in (*lost, *gained)
    ]
    if worse := tuple(worse_ends(old, new)):
        gained, lost = (), (*lost, *worse)
    if ends := ends_text(old, new, worse):
        told.append(ends)
    if old.decision != new.decision:
        did = [", ".join(o.decision).replace("_", " ") or "nothing" for o in (old, new)]
        told.append(f"decision: {did[0]} before, {did[1]} now")
    broken = [t for name in lost if name in now and (t := now[name].t) is not None]
    if worse and new.bad is not None:
        broken.append(new.bad.t)
    return RunPair(
        seed, gained, lost, _weight(lost, now), (old.decision, new.decision),
        (old.reaction, new.reaction),
        _minus(new.risk, old.risk), {name: _minus(new.comfort[name], old.comfort[name]) for name in COMFORT},
        min([*broken, *([] if diverged is None or not told else [diverged])], default=None), tuple(told),
        "; ".join(o.failure for o in (old, new) if o.failure),
        tuple(name for name in before if "INVALID" in (before[name].outcome, now[name].outcome)
              and changes[name] == "same"),
    )  # fmt: skip


def _weight(lost: Sequence[str], now: Mapping[str, Kpi]) -> float:
    """The weight of what is lost; a worse end weighs as much as the gravest criterion."""
    gravest = max((kpi.weight for kpi in now.values()), default=1.0)
    return float(sum(now[name].weight if name in now else gravest for name in lost))


def _change(old: str, new: str) -> Change:
    """A KPI is lost where it passed and does not any more, or fails now that was doubtful; gained where it passes now.

    Who failed and is doubtful now has shown nothing.
    """
    if old == new or (old, new) == ("FAIL", "INVALID"):
        return "same"
    return "gained" if new == "PASS" else "lost"


@dataclass(frozen=True)
class Difference:
    """The mean of paired differences, and its 95 % interval over `of` recordings, None where these are too few."""

    mean: float
    low: float | None
    high: float | None
    of: int


def difference(pairs: Sequence[Sequence[float | None]]) -> Difference | None:
    """Give the mean difference over recordings, each the mean of its seeds; None where there is none.

    The interval is over recordings, as seeds of one recording are no independent evidence: none of fewer than
    RECORDINGS, or where fewer than DIFFERENT differ from what most of them give, so that equal values claim nothing.
    """
    means = [float(np.mean(known)) for one in pairs if (known := [x for x in one if x is not None])]
    if not means:
        return None
    values: Floats = np.array(means)
    mean, n = float(values.mean()), len(values)
    apart = n - int(np.unique(np.round(values, 12), return_counts=True)[1].max())
    if n < RECORDINGS or apart < DIFFERENT:
        return Difference(mean, None, None, n)
    reach = float(np.ptp(values) * np.sqrt(RECORDINGS / n))
    ends = [
        _student(values),
        *(_student(np.append(values, x)) for x in (values.min() - reach, values.max() + reach)),
    ]
    return Difference(mean, float(min(low for low, _ in ends)), float(max(high for _, high in ends)), n)


def _student(values: Floats) -> tuple[float, float]:
    """Student's t interval (low, high) of the mean of values (K,)."""
    half = stdtrit(len(values) - 1, 0.5 + 0.5 * CONFIDENCE) * values.std(ddof=1) / np.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


def _minus(new: float | None, old: float | None) -> float | None:
    return None if new is None or old is None else new - old
