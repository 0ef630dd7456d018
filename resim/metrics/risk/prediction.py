"""How a traffic object may go on: distributions of its inputs over the next second, by kind and state (Eq. 4.2).

The numbers of the sets that ship are in prediction.json.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import parse_json, read_file
from resim.core.geometry import Bools, Floats
from resim.core.spelling import did_you_mean
from resim.core.tracks import KINDS, ObjectKind, Strings

CTRA, WALKING = 0, 1
"""How an object moves: a and yaw rate kept (Eq. 4.1); or an acceleration for 1 s, then the velocity kept."""

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
_FROZEN = ConfigDict(**_STRICT, frozen=True)
_REMEDY = "`resim assess fit-prediction` writes such files."


def _ascending(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError("expected the lower bound first")
    return span


_Positive = Annotated[float, Field(gt=0.0)]
_Factor = Annotated[float, Field(ge=0.0)]
_Range = Annotated[tuple[float, float], AfterValidator(_ascending)]


@dataclass(frozen=True, config=_STRICT)
class Surfaces:
    """Means and standard deviations of acceleration a [m/s²] and yaw rate w [rad/s] over the next second.

    mu_a = A tanh(a0 / A), A = a_most / (1 + v / v_half); sigma_a = sigma_a0 + sigma_a1 |a0|;
    mu_w = W tanh(w0 / W), W = lateral_most / v; sigma_w = sigma_lateral / v + sigma_w1 |w0|, v at least v_least.
    v_most, a_range [m/s²] and lateral_range [m/s²] bound the states they were fitted to.
    """

    a_most: _Positive
    v_half: _Positive
    sigma_a0: _Positive
    sigma_a1: _Factor
    lateral_most: _Positive
    sigma_lateral: _Positive
    sigma_w1: _Factor
    v_least: _Positive
    v_most: _Positive
    a_range: _Range
    lateral_range: _Range

    def inputs(self, v: Floats, a0: Floats, w0: Floats) -> Floats:
        """Give mu_a, sigma_a, mu_w, sigma_w (..., 4) of states (...)."""
        speed = np.maximum(np.abs(v), self.v_least)
        most_a, most_w = self.a_most / (1.0 + speed / self.v_half), self.lateral_most / speed
        return np.stack(
            [
                most_a * np.tanh(a0 / most_a), self.sigma_a0 + self.sigma_a1 * np.abs(a0),
                most_w * np.tanh(w0 / most_w), self.sigma_lateral / speed + self.sigma_w1 * np.abs(w0),
            ],
            axis=-1,
        )  # fmt: skip

    def covers(self, v: Floats, a0: Floats, w0: Floats) -> Bools:
        """Say which states (...) lie in the range that the surfaces were fitted to."""
        return _within(v, self.v_most, a0, self.a_range, v * w0, self.lateral_range)


@dataclass(frozen=True, config=_STRICT)
class WalkerMotion:
    """Means and standard deviations of a walker's acceleration [m/s²] over the next second.

    Along the present heading and across it (to the left): mu = M tanh(acceleration / M), M = a_most, of a0 and
    v w0; sigma goes from sigma_still, alike in all directions, to sigma_along and sigma_across at v_walk [m/s] and
    above. v_most, along_range and across_range bound the states they were fitted to.
    """

    a_most: _Positive
    sigma_still: _Positive
    sigma_along: _Positive
    sigma_across: _Positive
    v_walk: _Positive
    v_most: _Positive
    along_range: _Range
    across_range: _Range

    def inputs(self, v: Floats, a0: Floats, w0: Floats) -> Floats:
        """Give mu_along, sigma_along, mu_across, sigma_across (..., 4) of states (...)."""
        share = np.minimum(np.abs(v) / self.v_walk, 1.0)
        along, across = (
            self.sigma_still + (sigma - self.sigma_still) * share
            for sigma in (self.sigma_along, self.sigma_across)
        )
        mu_along, mu_across = (self.a_most * np.tanh(x / self.a_most) for x in (a0, v * w0))
        return np.stack([mu_along, along, mu_across, across], axis=-1)

    def covers(self, v: Floats, a0: Floats, w0: Floats) -> Bools:
        """Say which states (...) lie in the range that the parameters were fitted to."""
        return _within(v, self.v_most, a0, self.along_range, v * w0, self.across_range)


def _within(
    v: Floats, v_most: float, along: Floats, a: tuple[float, float], across: Floats, b: tuple[float, float]
) -> Bools:
    return np.asarray(
        (np.abs(v) <= v_most) & (along >= a[0]) & (along <= a[1]) & (across >= b[0]) & (across <= b[1])
    )


ObjectMotion = Surfaces | WalkerMotion


class PredictionSources(BaseModel):
    """What parameters were fitted to: `sources` are recordings and the SHA-256 of their ground truth.

    v [m/s], a [m/s²], w [rad/s]: least and largest of the initial states. log_likelihood: per point, of this kind's
    parameters and of the published. standard_errors: by parameter, None where the data do not determine it.
    """

    model_config = _FROZEN

    sources: dict[str, str]
    points: int
    objects: int
    v: tuple[float, float]
    a: tuple[float, float]
    w: tuple[float, float]
    log_likelihood: float
    log_likelihood_published: float
    standard_errors: dict[str, float | None]


class PredictionEntry(BaseModel):
    """The parameters of one kind, or the kind whose parameters it takes; and where they come from."""

    model_config = _FROZEN

    provenance: str
    ctra: Surfaces | None = None
    walking: WalkerMotion | None = None
    like: ObjectKind | None = None
    fitted: PredictionSources | None = None

    @model_validator(mode="after")
    def _one(self) -> PredictionEntry:
        if sum(part is not None for part in (self.ctra, self.walking, self.like)) != 1:
            raise ValueError("expected one of ctra, walking and like")
        return self


class PredictionSet(BaseModel):
    """A set of parameters as a file holds it; a kind that it leaves out is the published set's."""

    model_config = _FROZEN

    name: str = Field(min_length=1)
    provenance: str = ""
    kinds: dict[ObjectKind, PredictionEntry] = Field(min_length=1)


@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """How objects of every kind may go on. motions, provenance: of each kind of `resim.core.tracks.KINDS`."""

    name: str
    motions: Mapping[str, ObjectMotion]
    provenance: Mapping[str, str]

    def of(self, kind: str) -> ObjectMotion:
        """Give the parameters of a kind; of `unknown` for one that is none."""
        return self.motions.get(kind, self.motions["unknown"])

    def motion(self, kinds: Strings) -> NDArray[np.uint8]:
        """Give how objects (K,) move: CTRA or WALKING."""
        return np.array(
            [WALKING if isinstance(self.of(str(k)), WalkerMotion) else CTRA for k in kinds], np.uint8
        )

    def inputs(self, kinds: Strings, v: Floats, a0: Floats, w0: Floats) -> Floats:
        """Give the means and standard deviations (..., K, 4) of the inputs of objects (K,) in states (..., K).

        mu_a, sigma_a [m/s²], mu_w, sigma_w [rad/s] of those that move by CTRA; mu_along, sigma_along, mu_across,
        sigma_across [m/s²] of those that walk.
        """
        out = np.empty((*v.shape, 4))
        for kind in np.unique(kinds):
            k = kinds == kind
            out[..., k, :] = self.of(str(kind)).inputs(v[..., k], a0[..., k], w0[..., k])
        return out

    def covers(self, kinds: Strings, v: Floats, a0: Floats, w0: Floats) -> Bools:
        """Say which states (..., K) of objects (K,) lie in the range that their parameters were fitted to."""
        out = np.empty(v.shape, dtype=bool)
        for kind in np.unique(kinds):
            k = kinds == kind
            out[..., k] = self.of(str(kind)).covers(v[..., k], a0[..., k], w0[..., k])
        return out


@lru_cache(maxsize=1)
def _shipped() -> dict[str, PredictionSet]:
    data = json.loads(files("resim.metrics.risk").joinpath("prediction.json").read_text(encoding="utf-8"))
    return {name: PredictionSet.model_validate(part) for name, part in data["sets"].items()}


def prediction(name: str = "published") -> Prediction:
    """Give a set that ships with resim, by its name in prediction.json. Raises InputError for any other."""
    sets = _shipped()
    if name not in sets:
        remedy = f"Sets: {', '.join(sets)}; or name a file."
        raise InputError("prediction", f"there is no set {name!r}{did_you_mean(name, sets)}", remedy)
    return _resolved(name, sets[name])


def named_prediction(name: str) -> Prediction:
    """Give the set of this name, or that of the file. Raises InputError for what is neither."""
    return prediction(name) if name in _shipped() or not Path(name).suffix else read_prediction(Path(name))


def read_prediction(path: Path) -> Prediction:
    """Read a set from a file, such as `resim assess fit-prediction` writes. Raises InputError naming every fault.

    Kinds that the file leaves out are those of the published set; what is `like` another kind follows the file's.
    """
    data = parse_json(read_file(path, f"Check the path; {_REMEDY}"), path, _REMEDY)
    try:
        found = PredictionSet.model_validate(data)
    except ValidationError as e:
        raise InputError(
            path, faults.describe(e.errors(), PredictionSet), f"Correct these fields; {_REMEDY}"
        ) from e
    return _resolved(path, found)


def _resolved(source: str | Path, found: PredictionSet) -> Prediction:
    """Every kind with its parameters, its own or those of the kind that it is like."""
    both = (_shipped()["published"].kinds, found.kinds)
    entries: dict[str, PredictionEntry] = {kind: entry for kinds in both for kind, entry in kinds.items()}
    motions: dict[str, ObjectMotion] = {}
    for kind in KINDS:
        at, seen = kind, [kind]
        while (like := entries[at].like) is not None:
            if like in seen:
                problem = f"kinds.{kind}: is like itself ({' like '.join([*seen, like])})"
                raise InputError(source, problem, "Give one of these kinds parameters of its own.")
            at = like
            seen.append(like)
        own = entries[at].ctra or entries[at].walking
        assert own is not None  # an entry that is like no other holds one of them
        motions[kind] = own
    return Prediction(found.name, motions, {kind: entries[kind].provenance for kind in KINDS})


def _published_car() -> Surfaces:
    car = prediction().of("car")
    assert isinstance(car, Surfaces)
    return car


PUBLISHED = _published_car()
"""Cars, as published; see the provenance in prediction.json."""
