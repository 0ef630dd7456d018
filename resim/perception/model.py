"""The perception model as a file: from true objects to perceived ones, by named parameters in SI units.

Object level, fused lists. Errors are perceived minus true, in the EGO's frame (x forward, y left of its box centre):
longitudinal and lateral position, speed over ground, heading, length, width. Features of an object: range [m] between
box centres; bearing [rad], to the left positive; relative speed [m/s], the object's speed along the EGO's heading minus
the EGO's; acceleration [m/s²] along the object's heading. They are those of the object as it would be perceived without
errors, late and averaged, against the EGO as it is; the acceleration is as late as the speed. What an object's maneuver
is was settled the pooled latency of speed ago.
"""

from __future__ import annotations

import hashlib
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, create_model, field_validator, model_validator

from resim.core import faults, remedies
from resim.core.errors import InputError
from resim.core.files import parse_json, read_file
from resim.core.plugins.frozen import FrozenFile, freeze, load_frozen
from resim.core.schema import PerceptionSchema
from resim.perception.fields import Lasting, Late, NotNegative, Number, ParameterGroup, Positive, Rate, Share
from resim.perception.parts.ego import Localisation
from resim.perception.parts.false_objects import FalseObjects
from resim.perception.parts.registry import PARTS

QUANTITIES = ("longitudinal", "lateral", "speed", "heading", "length", "width")
"""What has an error, in the order of all arrays: m, m, m/s, rad, m, m."""
FEATURES = ("range", "bearing", "relative_speed", "acceleration")

Assumption = Literal["bias", "spread", "tails", "white", "together", "latency", "detected", "places"]
Quantity = Literal["longitudinal", "lateral", "speed", "heading", "length", "width"]
Maneuver = Literal["follow_lane", "lane_change_left", "lane_change_right", "braking"]
Plain = Annotated[float, Field(strict=True)]
"""Any number, and no text or truth value for one."""

_SIGHT = {"range": 150.0, "bearing": np.pi, "relative_speed": 60.0, "acceleration": 10.0}
"""As far as features of objects usually reach: m, rad, m/s, m/s²."""
_STEEPEST = 50.0
"""Exponent of a standard deviation from which on nobody means it; at five times that sight it is still finite."""

ONE = "Name a parameter and its number, such as latency.speed=0.4."
REMEDY = remedies.MODEL


class Latency(ParameterGroup):
    """How late [s] what is perceived is: positions, speeds and headings of objects are those of so long ago."""

    position: Late = 0.0
    speed: Late = 0.0
    heading: Late = 0.0


class Averaging(ParameterGroup):
    """Time [s] over which a perceived value is the mean of the true one, centred at its latency.

    At most twice the latency: nothing is known before it happens.
    """

    speed: Late = 0.0
    heading: Late = 0.0


class Response(ParameterGroup):
    """A bias: constant + range r + bearing b + relative_speed dv + acceleration a, in the unit of the quantity."""

    constant: Number = 0.0
    range: Number = 0.0
    bearing: Number = 0.0
    relative_speed: Number = 0.0
    acceleration: Number = 0.0


class Spread(ParameterGroup):
    """A standard deviation: constant exp(range r + bearing |b| + relative_speed |dv| + acceleration |a|)."""

    constant: NotNegative = 0.0
    range: Number = 0.0
    bearing: Number = 0.0
    relative_speed: Number = 0.0
    acceleration: Number = 0.0

    @model_validator(mode="after")
    def _is_measured(self) -> Spread:
        grows = {name: getattr(self, name) * reach for name, reach in _SIGHT.items()}
        if sum(max(part, 0.0) for part in grows.values()) > _STEEPEST:
            name = max(grows, key=lambda n: grows[n])
            raise ValueError(
                f"{name}: at {_SIGHT[name]:.3g} the standard deviation is exp({grows[name]:.3g}) times the constant, "
                f"expected exp({_STEEPEST:g}) at most"
            )
        return self


class Error(ParameterGroup):
    """The error of one quantity: bias, plus a drift correlated over correlation_time [s], plus white noise."""

    bias: Response = Response()
    drift: Spread = Spread()
    correlation_time: Lasting = 1.0
    noise: Spread = Spread()


class ErrorModels(ParameterGroup):
    """The errors of all quantities.

    coupling: (6, 6) correlation of the noises that drive the drifts, in the order of QUANTITIES. Drifts of correlation
    times T and T' correlate themselves by 2 sqrt(T T') / (T + T') of that.
    """

    longitudinal: Error = Error()
    lateral: Error = Error()
    speed: Error = Error()
    heading: Error = Error()
    length: Error = Error()
    width: Error = Error()
    coupling: tuple[tuple[Plain, ...], ...] | None = None

    @field_validator("coupling")
    @classmethod
    def _correlation(
        cls, table: tuple[tuple[float, ...], ...] | None
    ) -> tuple[tuple[float, ...], ...] | None:
        if table is None:
            return table
        n = len(QUANTITIES)
        if len(table) != n or any(len(row) != n for row in table):
            raise ValueError(f"expected {n} x {n} correlations, of {', '.join(QUANTITIES)}")
        c = np.array(table)
        if np.abs(c - c.T).max() > 1e-9 or np.abs(np.diag(c) - 1.0).max() > 1e-9:
            raise ValueError("expected a symmetric table with 1 on its diagonal")
        least = float(np.linalg.eigvalsh(c)[0])
        if least < -1e-9:
            raise ValueError(
                f"this is not a correlation matrix: its least eigenvalue is {least:.3g}, expected none below 0"
            )
        return table


class Objects(ParameterGroup):
    """How objects are perceived that are detected."""

    latency: Latency = Latency()
    averaging: Averaging = Averaging()
    errors: ErrorModels = ErrorModels()

    @model_validator(mode="after")
    def _causal(self) -> Objects:
        for name in ("speed", "heading"):
            if getattr(self.averaging, name) > 2.0 * getattr(self.latency, name) + 1e-9:
                raise ValueError(f"averaging.{name}: expected at most twice latency.{name}")
        return self


class Detection(ParameterGroup):
    """Loss and regain of objects: rates [1/s] of a Markov chain, by bins of range, |bearing| and occlusion.

    Edges: increasing, one more than bins; the outer bins reach beyond them. occlusion: share of the object's angle,
    seen from the EGO's centre, that nearer objects cover. loss, gain, first: [range][bearing][occlusion]. first: the
    probability that an object is detected as soon as it is there and in the field of view; without it gain / (gain +
    loss), the share of the long run. Without bins everything is always detected. What the rates make of a time step,
    whatever its length, is in `chain`.
    """

    range_edges: tuple[Plain, ...] = ()
    bearing_edges: tuple[Plain, ...] = ()
    occlusion_edges: tuple[Plain, ...] = ()
    loss: tuple[tuple[tuple[Rate, ...], ...], ...] = ()
    gain: tuple[tuple[tuple[Rate, ...], ...], ...] = ()
    first: tuple[tuple[tuple[Share, ...], ...], ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> Detection:
        shape = [max(len(e) - 1, 0) for e in (self.range_edges, self.bearing_edges, self.occlusion_edges)]
        for edges in (self.range_edges, self.bearing_edges, self.occlusion_edges):
            if any(b <= a for a, b in pairwise(edges)):
                raise ValueError("edges: expected increasing numbers")
        for name in ("loss", "gain", "first"):
            table = getattr(self, name)
            if name == "first" and not table:
                continue
            if len(table) != shape[0] or any(
                len(row) != shape[1] or any(len(cell) != shape[2] for cell in row) for row in table
            ):
                raise ValueError(
                    f"{name}: expected {shape[0]} x {shape[1]} x {shape[2]} values, as the edges have bins"
                )
        return self


class FieldOfView(ParameterGroup):
    """What can be seen: range [m] and half the opening angle [rad] around straight ahead; None: no end to it."""

    range: Annotated[float, Field(strict=True, gt=0.0)] | None = None
    bearing: Positive | None = None


class Update(ParameterGroup):
    """Time [s] between two lists (0: one whenever the function asks), and the standard deviation of it, each by itself.

    Between two lists the last one stands, its objects where they were in the map.
    """

    period: Late = 0.0
    jitter: Late = 0.0

    @model_validator(mode="after")
    def _has_a_period(self) -> Update:
        if self.jitter > 0.0 and self.period == 0.0:
            raise ValueError(
                f"jitter: expected a period above 0 along with it, found jitter {self.jitter:g} without one; "
                "set period, or jitter to 0"
            )
        return self


class TrainedRange(ParameterGroup):
    """The states that the model was trained on: least and largest of each feature, and of the EGO's speed [m/s]."""

    range: tuple[Plain, Plain] | None = None
    bearing: tuple[Plain, Plain] | None = None
    relative_speed: tuple[Plain, Plain] | None = None
    acceleration: tuple[Plain, Plain] | None = None
    ego_speed: tuple[Plain, Plain] | None = None

    @model_validator(mode="after")
    def _in_order(self) -> TrainedRange:
        for name in type(self).model_fields:
            span = getattr(self, name)
            if span is not None and span[0] > span[1]:
                raise ValueError(f"{name}: expected the least first")
        return self


class TrainedParameter(ParameterGroup):
    """One trained parameter: its value, the confidence interval (95 %), and how many samples stand behind it."""

    value: Plain
    low: Plain
    high: Plain
    samples: int


class FailedAssumption(ParameterGroup):
    """One assumption that fails: of errors of a quantity, their `bias` or `spread` (which depend `on` something that
    the model leaves out; on `range_bend` or `bearing_side`: beyond a straight line), `tails`, `white` (how they vary in
    time), `together` (objects in one list are independent) or `latency` (one for all); of detection the share of time
    in which objects are `detected`; or the `places` of false objects. size: what it costs, in the unit; p: how likely
    by chance; text: the same in words."""

    quantity: Quantity | Literal["detection", "false objects"]
    assumption: Assumption
    on: str
    size: float
    unit: str
    p: float
    text: str


class ModelFit(ParameterGroup):
    """How the model fits what it was trained on: how many tests on how many drives, and which failed; no tests: not
    tested. The probability that one fails by chance is 5 % for all together."""

    drives: int
    tests: int = 0
    misfits: tuple[FailedAssumption, ...] = ()


class LeftOut(ParameterGroup):
    """What was not learned from, and why: count of so many."""

    what: str
    reason: str
    count: int
    of: int


class Training(ParameterGroup):
    """What a model was trained on. sources: recordings and the SHA-256 of their GT and SD; estimates by parameter; fit:
    whether it fits, none if not tested."""

    sources: dict[str, str]
    drives: int
    matched: int
    estimates: dict[str, TrainedParameter]
    fit: ModelFit | None = None
    left_out: tuple[LeftOut, ...] = ()


class _Model(ParameterGroup):
    """A model. The parameters at the top are of all maneuvers; `maneuvers` has those of maneuvers with enough data.

    Attributes:
        schema_: Kind and version of the file.
        name: What it is called.
        provenance: Where it comes from.
        latency: How late what is perceived is.
        averaging: Over which time values are averaged.
        errors: Errors of perceived values.
        maneuvers: In place of the parameters at the top, by maneuver.
        detection: Which objects are detected.
        field_of_view: Where objects can be detected.
        update: When lists of objects are made.
        id_switch: 1/s, at which a detected object gets another id.
        false_objects: Objects that are perceived and not there.
        ego: How the EGO's own state is perceived.
        validity: States of objects that it was trained on.
        training: What it was trained on, None where it was not.
    """

    schema_: PerceptionSchema = Field(default="resim-perception-1", alias="schema")
    name: str = Field(min_length=1)
    provenance: str = ""
    latency: Latency = Latency()
    averaging: Averaging = Averaging()
    errors: ErrorModels = ErrorModels()
    maneuvers: dict[Maneuver, Objects] = Field(default={})
    detection: Detection = Detection()
    field_of_view: FieldOfView = FieldOfView()
    update: Update = Update()
    id_switch: Rate = 0.0
    false_objects: FalseObjects = FalseObjects()
    ego: Localisation = Localisation()
    validity: TrainedRange = TrainedRange()
    training: Training | None = None

    @property
    def hash(self) -> str:
        """SHA-256 of all its values, whatever file they came from."""
        return hashlib.sha256(self.model_dump_json(by_alias=True).encode()).hexdigest()

    @property
    def pooled(self) -> Objects:
        """How objects are perceived in a maneuver that has no parameters of its own."""
        return Objects(latency=self.latency, averaging=self.averaging, errors=self.errors)

    @model_validator(mode="after")
    def _causal(self) -> _Model:
        assert self.pooled
        return self


def _groups() -> dict[str, tuple[Any, Any]]:
    """A field for each part that `_Model` does not have: what a file does not name is None, and not written."""
    known = _Model.model_fields
    if clash := [
        part.name for part in PARTS if part.name in known and known[part.name].annotation != part.parameters
    ]:
        raise ValueError(
            f"a part of perception cannot have the name {clash[0]!r}: models have it for something else"
        )
    absent = Field(default=None, exclude_if=lambda parameters: parameters is None)
    return {part.name: (part.parameters | None, absent) for part in PARTS if part.name not in known}


if TYPE_CHECKING:
    PerceptionModel = _Model
else:
    PerceptionModel = create_model(
        "PerceptionModel", __base__=_Model, __module__=__name__, __doc__=_Model.__doc__, **_groups()
    )


def freeze_model(path: Path) -> FrozenFile:
    """Keep a copy of a model. Raises InputError."""
    return freeze(path, read_file(path, REMEDY))


def fault_of(error: InputError, parameter: str) -> str:
    """Give the first fault that `read_model` found with this parameter set, without the parameter's name."""
    return error.problem.partition("; ")[0].removeprefix(f"{parameter}: ")


def read_model(model: str | Path | FrozenFile, overrides: tuple[str, ...] = ()) -> PerceptionModel:
    """Read a perception model.

    What is set of latency, averaging or errors is set of every maneuver. With a latency that was set, averaging is at
    most twice that, if it was not set as well.

    Args:
        model: The file (JSON), or its frozen copy.
        overrides: Parameters to set, such as "latency.speed=0.4"; indices of tables dotted too.

    Returns:
        The model.

    Raises:
        InputError: Names every fault.
    """
    if isinstance(model, FrozenFile):
        path, raw = model.path, load_frozen(model).raw
    else:
        path = Path(model)
        raw = read_file(path, REMEDY)
    data = parse_json(raw, path, REMEDY)
    if not overrides:
        return _validated(data, path)
    _validated(data, path)  # whose fault it is
    for override in overrides:
        _override(data, override)
    _keep_causal(data, {override.partition("=")[0].strip() for override in overrides})
    return _validated(data, f"--set {' --set '.join(overrides)}", ONE)


def _validated(data: Any, source: str | Path, remedy: str = REMEDY) -> PerceptionModel:
    try:
        return PerceptionModel.model_validate(data)
    except ValidationError as e:
        raise InputError(source, faults.describe(e.errors(), PerceptionModel), remedy) from e


def write_model(model: PerceptionModel, path: Path) -> None:
    """Write a model; the same model gives the same bytes."""
    text = model.model_dump_json(by_alias=True, indent=2, exclude_defaults=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _override(data: Any, override: str) -> None:
    """Set one parameter by its dotted name; of latency, averaging and errors that of every maneuver, too."""
    name, sign, text = override.partition("=")
    name = name.strip()
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = None
    if not sign or not isinstance(value, int | float) or isinstance(value, bool):
        raise InputError("--set", f"{override!r} sets no number", ONE)
    _set(data, name, value)
    if (parts := name.split("."))[:2] == ["errors", "coupling"] and len(parts) == 4:
        _set(data, f"errors.coupling.{parts[3]}.{parts[2]}", value)
    if name.split(".")[0] in ("latency", "averaging", "errors"):
        for part in _maneuvers(data):
            _set(part, name, value)


def _set(data: Any, name: str, value: float) -> None:
    *parents, last = name.split(".")
    for parent in parents:
        data = _inner(data, parent, name)
    if isinstance(data, list):
        _inner(data, last, name)
        data[int(last)] = value
    elif isinstance(data, dict):
        data[last] = value
    else:
        raise InputError("--set", f"there is no parameter {name!r}", ONE)


def _inner(data: Any, part: str, name: str) -> Any:
    """The part of a table or group of parameters; a group that is not written is made."""
    if isinstance(data, dict):
        return data.setdefault(part, {})
    if isinstance(data, list) and re.fullmatch("[0-9]{1,9}", part) and int(part) < len(data):
        return data[int(part)]
    raise InputError("--set", f"there is no parameter {name!r}", ONE)


def _keep_causal(data: Any, named: set[str]) -> None:
    """Shorten averaging to twice a latency that was set."""
    for part in (data, *_maneuvers(data)):
        for quantity in ("speed", "heading"):
            latency, averaging = (_number(part.get(of), quantity) for of in ("latency", "averaging"))
            free = f"latency.{quantity}" in named and f"averaging.{quantity}" not in named
            if free and averaging > 0.0:
                part["averaging"][quantity] = min(averaging, max(2.0 * latency, 0.0))


def _maneuvers(data: Any) -> list[dict[str, Any]]:
    """The parts of a model's maneuvers, as far as they are any."""
    parts = data.get("maneuvers")
    return [part for part in parts.values() if isinstance(part, dict)] if isinstance(parts, dict) else []


def _number(group: Any, name: str) -> float:
    """A number of a group of parameters, 0 where there is none; what else is wrong is told when the whole is read."""
    value = group.get(name) if isinstance(group, dict) else None
    return value if isinstance(value, int | float) else 0.0
