"""One drive, assessed: criticality of every object and accident risk, at each time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from resim.assess import criticality
from resim.assess.criticality import Measure, Pairs, State
from resim.assess.drive import Drive
from resim.assess.risk import DEFAULTS, Parameters, Risk
from resim.core.geometry import Floats

MEASURES: Mapping[str, Callable[[Pairs], Measure]] = {
    "TTC": criticality.ttc, "ETTC": criticality.ettc, "WTTC": criticality.wttc, "THW": criticality.thw,
    "TTB": criticality.ttb, "TTK": criticality.ttk, "TTS": criticality.tts, "TTR": criticality.ttr,
    "PMD": criticality.pmd, "TPMD": criticality.tpmd, "DRAC": criticality.drac,
}  # fmt: skip
"""Measures of the EGO and one object, by name."""

REASONS = {
    State.VALUE: "",
    State.NO_CONFLICT: "no conflict",
    State.NOT_DEFINED: "not defined",
    State.NOT_COMPUTED: "not computed",
}


UNBOUNDED = "no number is enough"
"""As of DRAC [m/s²] where no braking avoids contact."""


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst of one measure: value in `unit`, time [s], object ("" for the whole scene)."""

    name: str
    unit: str
    value: float
    t: float
    object: str


@dataclass(frozen=True, eq=False)
class Assessment:
    """What a drive was like. measures by name, each (S, K); risk of each scene and object."""

    drive: Drive
    measures: Mapping[str, Measure]
    risk: Risk

    def worst(self) -> list[Worst]:
        """Give the worst of each measure that has a value, and of the risk."""
        ids, t = self.drive.ids, self.drive.t
        out = []
        for name, measure in self.measures.items():
            if (found := measure.worst()) is not None:
                value, (scene, k) = found
                out.append(Worst(name, measure.unit, value, float(t[scene]), ids[k]))
        scene = int(self.risk.r_ind.argmax())
        near = np.nan_to_num(self.risk.r_to[scene], nan=-1.0)
        whom = ids[int(near.argmax())] if len(ids) and near.max() > 0.0 else ""
        out.append(Worst("risk", "", float(self.risk.r_ind[scene]), float(t[scene]), whom))
        return out

    def to_json(self) -> dict[str, Any]:
        """Give arrays over t by measure and object, null where there is no number, with the reasons beside."""
        ids = self.drive.ids
        return {
            "t": self.drive.t.tolist(),
            "path": list(self.drive.path),
            "measures": {
                name: {i: _numbers(m.value[:, k]) for k, i in enumerate(ids)} for name, m in self.measures.items()
            },
            "reasons": {
                name: {i: _reasons(m, k) for k, i in enumerate(ids)} for name, m in self.measures.items()
            },
            "units": {name: m.unit for name, m in self.measures.items()},
            "risk": {
                "r_ind": _numbers(self.risk.r_ind),
                "r_dep": _numbers(self.risk.r_dep),
                "r_to": {i: _numbers(self.risk.r_to[:, k]) for k, i in enumerate(ids)},
                "outside_fitted_range": {
                    i: (self.drive.present[:, k] & ~self.drive.covered[:, k]).tolist() for k, i in enumerate(ids)
                },
            },
        }  # fmt: skip


def assess(drive: Drive, parameters: Parameters = DEFAULTS) -> Assessment:
    """Compute every measure and the risk of a drive."""
    pairs = Pairs.of(drive.scenes, parameters.step)
    measures = {name: measure(pairs) for name, measure in MEASURES.items()}
    return Assessment(drive, measures, drive.risk(parameters))


def _reasons(measure: Measure, k: int) -> list[str]:
    """Why there is no number, "" where there is one; no number is enough where the value has no bound."""
    value, state = measure.value[:, k], measure.state[:, k].tolist()
    return [UNBOUNDED if np.isinf(v) else REASONS[State(s)] for v, s in zip(value, state, strict=True)]


def _numbers(values: Floats) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
