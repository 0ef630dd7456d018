"""Times until contact, if everybody goes on as now: TTC, ETTC, THW."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.measures import motion
from resim.metrics.measures.contact import first_contact
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.horizon import for_time, later
from resim.metrics.measures.pairs import CompletePairs, Pairs
from resim.metrics.measures.values import MeasureValues, StateArray, stated

TTC = MeasureDefinition(
    name="TTC",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Hayward 1972; Wagner 2021, Eq. 3.2",
    meaning="time to collision: first contact of both boxes at present speeds",
    of=lambda inputs: ttc(inputs.pairs),
    by_scene=True,
    needs=for_time,
    open_beyond=later,
    unseen=lambda absent: absent.time("goes on", steady=True),
)


def ttc(pairs: Pairs) -> MeasureValues:
    """Give the time to collision (S, K) [s]: the first contact of both boxes at present speeds.

    TTC = d / (v_follow - v_lead) (Wagner 2021, Eq. 3.2, after Hayward 1972) where one follows the other. In general:
    the EGO along the path of its plan at its present speed, the object straight on at its present velocity. 0 where
    the boxes touch already; NO_CONFLICT where they do not touch within the horizon.
    """
    return pairs.measured(TTC, _ttc, columns=4)


def _ttc(p: CompletePairs) -> tuple[Floats, StateArray]:
    at = first_contact(p.steady, motion.straight(p.state, p.t), p.h, p.ego_size, p.size)
    return stated(at, conflict=np.isfinite(at))


ETTC = MeasureDefinition(
    name="ETTC",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, Eq. 3.4",
    meaning="enhanced TTC: the same with accelerations",
    of=lambda inputs: ettc(inputs.pairs),
    by_scene=True,
    open_beyond=later,
    unseen=lambda absent: absent.time("anything"),
)


def ettc(pairs: Pairs) -> MeasureValues:
    """Give the enhanced time to collision (S, K) [s]: as TTC, with accelerations.

    ETTC = (sqrt(v_rel² + 2 a_rel d) - v_rel) / a_rel, defined where v_rel² > -2 a_rel d (Wagner 2021, Eq. 3.4,
    printed with +; v_rel = v_follow - v_lead, a_rel likewise). In general: the EGO as planned, the object on its
    driven path or with acceleration and yaw rate kept. Who brakes to standstill stays there, where Eq. 3.4 has him
    reverse. 0 where the boxes touch already; NO_CONFLICT where they do not touch within the horizon.
    """
    return pairs.measured(ETTC, _ettc)


def _ettc(p: CompletePairs) -> tuple[Floats, StateArray]:
    at = planned_contact(p)
    return stated(at, conflict=np.isfinite(at))


def planned_contact(p: CompletePairs) -> Floats:
    """Give the first contact (P,) [s] of the EGO's plan with the expected motion of the objects, inf for none."""
    return p.every.contact[p.scene, p.column]


THW = MeasureDefinition(
    name="THW",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, Eq. 3.5",
    meaning="time headway: until the EGO's box is where the object's box is now",
    of=lambda inputs: thw(inputs.pairs),
    by_scene=True,
    needs=for_time,
    open_beyond=later,
    unseen=lambda absent: np.where(absent.v > 0.0, absent.time("stays", steady=True), np.nan),
)


def thw(pairs: Pairs) -> MeasureValues:
    """Give the time headway (S, K) [s]: until the EGO's box comes to where the object's box is now.

    THW = d / v_follow (Wagner 2021, Eq. 3.5), d along the path of the plan, at the present speed. NOT_DEFINED where
    the EGO stands or reverses; NO_CONFLICT where its path does not lead over the object within the horizon.
    """
    return pairs.measured(THW, _thw, columns=4)


def _thw(p: CompletePairs) -> tuple[Floats, StateArray]:
    there = p.state.copy()
    there[:, 3] = 0.0
    at = first_contact(p.steady, motion.straight(there, p.t), p.h, p.ego_size, p.size)
    return stated(at, conflict=np.isfinite(at), defined=p.plan[:, 0, 3] > 0.0)
