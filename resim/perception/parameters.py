"""The parameters of a model by their dotted names, as --set and the estimates of a training name them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from resim.perception.model import PerceptionModel, Training
from resim.perception.parts.registry import PARTS

UNITS = {
    "longitudinal": "m", "lateral": "m", "speed": "m/s", "heading": "rad", "length": "m", "width": "m",
    "range": "m", "bearing": "rad", "relative_speed": "m/s", "acceleration": "m/s²",
}  # fmt: skip
PER = {
    (own, per): f"{own}/({per})" if "/" in per else "1" if own == per else f"{own}/{per}"
    for own in ("1", "m", "m/s", "rad")
    for per in ("m", "rad", "m/s", "m/s²")
}
"""A unit per unit of a feature."""
TIMES = ("latency", "averaging", "update")
RATES = ("loss", "gain", "rate", "id_switch")
NAMES = ("schema", "name", "provenance", "training", "validity")
FEW = 10
"""Drives below which a misfit of the size of the errors themselves may not show."""
EDGES = ("range_edges", "bearing_edges", "occlusion_edges")
"""What is no parameter; edges say where the rates of detection hold."""
OF_PARTS = {f"{part.name}.{name}": unit for part in PARTS for name, unit in part.units.items()}
"""Units that parts of perception give to their parameters."""


def parameters(model: PerceptionModel) -> Iterator[tuple[str, float, str]]:
    """Give name, value and unit of every parameter that differs from what does nothing."""
    data = model.model_dump(by_alias=True, exclude_defaults=True, exclude=set(NAMES))
    coupling = data.get("errors", {}).pop("coupling", None) or ()
    for name, value in _flat(data, ""):
        yield name, value, unit(name)
    for i, row in enumerate(coupling):
        for j, value in enumerate(row[:i]):
            if value != 0.0:
                yield f"errors.coupling.{i}.{j}", float(value), ""


def fit_in_words(training: Training) -> tuple[str, list[str]]:
    """Say whether the model fits what it was trained on, and which assumptions fail, most sure first."""
    fit = training.fit
    if fit is None:
        return "whether the model fits was not tested: train it again", []
    if not fit.tests:
        return (
            f"whether the model fits was not tested: {fit.drives} drives, or errors of 0, are too little data",
            [],
        )
    if not fit.misfits:
        few = "; with so few drives only gross misfits show" if fit.drives < FEW else ""
        return f"no misfit found by {fit.tests} tests on {fit.drives} drives{few}", []
    verdict = f"the model does not fit: {len(fit.misfits)} of {fit.tests} tests on {fit.drives} drives fail"
    return verdict, [misfit.text for misfit in fit.misfits]


def unit(name: str) -> str:
    """Give the unit of a parameter, "" where it has none."""
    if name in OF_PARTS:
        return OF_PARTS[name]
    parts = [part for part in name.split(".") if not part.isdigit()]
    last = parts[-1]
    if (
        parts[0] in TIMES
        or "latency" in parts
        or "averaging" in parts
        or last in ("correlation_time", "lifetime")
    ):
        return "s"
    if last in RATES or parts[-1] == "id_switch":
        return "1/s"
    if "errors" in parts and parts[-2] in ("bias", "drift", "noise"):
        own = UNITS[parts[parts.index("errors") + 1]]
        if last == "constant":
            return own
        return PER[own if parts[-2] == "bias" else "1", UNITS[last]]
    if parts[0] == "ego":
        return UNITS[parts[1]]
    if last == "speed_spread":
        return "m/s"
    return UNITS.get(last, "")


def _flat(data: Any, name: str) -> Iterator[tuple[str, float]]:
    if isinstance(data, dict):
        for key, value in data.items():
            if key in EDGES:
                continue
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    elif isinstance(data, list | tuple):
        for number, value in enumerate(data):
            yield from _flat(value, f"{name}.{number}")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield name, float(data)
