"""One drive, assessed: criticality of every object and accident risk, at each time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from resim.assess import criticality
from resim.assess.criteria import Criteria, Verdict, judge, overall
from resim.assess.criticality import Measure, Pairs, State
from resim.assess.criticality.measure import States
from resim.assess.drive import Drive
from resim.assess.risk import DEFAULTS, Parameters, Risk
from resim.core.geometry import Floats, boxes_overlap
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork

MEASURES: Mapping[str, Callable[[Pairs], Measure]] = {
    "TTC": criticality.ttc, "ETTC": criticality.ettc, "WTTC": criticality.wttc, "THW": criticality.thw,
    "TTB": criticality.ttb, "TTK": criticality.ttk, "TTS": criticality.tts, "TTR": criticality.ttr,
    "PMD": criticality.pmd, "TPMD": criticality.tpmd, "DRAC": criticality.drac,
    "half speedometer": criticality.half_speedometer, "overtaking on the right": criticality.overtaking_right,
}  # fmt: skip
"""Measures of the EGO and one object, by name."""

OWN: Mapping[str, Callable[[Tracks, RoadNetwork], Measure]] = {
    "longitudinal acceleration": lambda tracks, network: criticality.longitudinal_acceleration(tracks),
    "lateral acceleration": lambda tracks, network: criticality.magnitude(
        criticality.lateral_acceleration(tracks)
    ),
    "speed over limit": criticality.speed_over_limit,
    "off the road": criticality.off_road,
}
"""Measures of the EGO alone, by name."""

KNOWN = (*MEASURES, *OWN, "collision", "risk")
"""What a criterion may be about."""

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
    """What a drive was like. measures by name, each (S, K), or (S,) of the EGO alone; risk of each scene and object.

    verdicts: of each criterion that it was judged by.
    """

    drive: Drive
    measures: Mapping[str, Measure]
    risk: Risk
    verdicts: Mapping[str, Verdict]

    def worst(self) -> list[Worst]:
        """Give the worst of each measure that has a value, and of the risk."""
        ids, t = self.drive.ids, self.drive.t
        out = []
        for name, measure in self.measures.items():
            if (found := measure.worst()) is not None:
                value, (scene, *k) = found
                out.append(Worst(name, measure.unit, value, float(t[scene]), ids[k[0]] if k else ""))
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
                name: {i: _numbers(value) for i, value, _ in self._columns(m)} for name, m in self.measures.items()
            },
            "reasons": {
                name: {i: _reasons(value, state) for i, value, state in self._columns(m)}
                for name, m in self.measures.items()
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
            "criteria": {name: _verdict(v) for name, v in self.verdicts.items()},
            "verdict": overall(self.verdicts) if self.verdicts else None,
        }  # fmt: skip

    def _columns(self, measure: Measure) -> list[tuple[str, Floats, States]]:
        """Each object's value and state (S,), or the EGO's."""
        if measure.value.ndim == 1:
            return [(str(self.drive.own.ids[0]), measure.value, measure.state)]
        return [(i, measure.value[:, k], measure.state[:, k]) for k, i in enumerate(self.drive.ids)]


def assess(
    drive: Drive, network: RoadNetwork, parameters: Parameters = DEFAULTS, criteria: Criteria | None = None
) -> Assessment:
    """Compute every measure and the risk of a drive, and judge it by criteria if there are any."""
    pairs = Pairs.of(drive.scenes, parameters.step)
    measures = {name: measure(pairs) for name, measure in MEASURES.items()}
    measures |= {name: _of_ego(measure(drive.own, network)) for name, measure in OWN.items()}
    risk = drive.risk(parameters)
    judged = {**measures, "collision": _collision(drive), "risk": _whole("risk", risk.r_ind)}
    verdicts = {
        c.name: judge(c, judged[c.measure], drive.t, drive.ids, drive.present)
        for c in (criteria.criterion if criteria is not None else ())
    }
    return Assessment(drive, measures, risk, verdicts)


def _of_ego(measure: Measure) -> Measure:
    """A measure of one track, (1, S), as (S,)."""
    return Measure(measure.name, measure.unit, measure.value[0], measure.state[0], measure.bad)


def _whole(name: str, value: Floats) -> Measure:
    return Measure(name, "1", value, np.zeros(value.shape, dtype=np.uint8), "high")


def _collision(drive: Drive) -> Measure:
    """1 where the boxes of the EGO and an object touch, else 0 (S, K)."""
    own, state, size = drive.scenes.plan[:, 0, None], drive.scenes.state, drive.scenes.size
    length, width = (drive.scenes.ego_size[:, k, None] for k in (0, 1))
    hit = boxes_overlap(own[..., 0], own[..., 1], own[..., 2], length, width, state[..., 0], state[..., 1],
                        state[..., 2], size[..., 0], size[..., 1])  # fmt: skip
    return _whole("collision", np.where(hit & drive.present, 1.0, 0.0))


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """The verdict as JSON has it: a value without bound is null, its reason says so."""
    fields = {name: value for name, value in asdict(verdict).items() if name != "criterion"}
    fields["verdict"] = fields.pop("outcome")
    if verdict.value is not None and not np.isfinite(verdict.value):
        fields["value"] = None
    return fields


def _reasons(value: Floats, state: States) -> list[str]:
    """Why there is no number, "" where there is one; no number is enough where the value has no bound."""
    return [
        UNBOUNDED if np.isinf(v) else REASONS[State(s)] for v, s in zip(value, state.tolist(), strict=True)
    ]


def _numbers(values: Floats) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
