from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import InputError
from resim.perception.model import PerceptionModel, read_model, write_model

MODELS = Path(__file__).parents[2] / "adfunc" / "perception"


@pytest.fixture
def written(tmp_path: Path):
    def write(**parts: object) -> Path:
        path = tmp_path / "model.json"
        path.write_text(json.dumps({"schema": "resim-perception-1", "name": "m", **parts}))
        return path

    return write


@pytest.mark.parametrize("name", ["none", "latency", "field_of_view"])
def test_written_by_hand(name: str, tmp_path: Path) -> None:
    model = read_model(MODELS / f"{name}.json")
    write_model(model, tmp_path / "again.json")
    assert read_model(tmp_path / "again.json") == model


def test_parameters_are_overridden_by_name() -> None:
    model = read_model(
        MODELS / "latency.json", ("latency.speed=0.4", "errors.longitudinal.bias.constant=1.5")
    )
    assert model.latency.speed == 0.4
    assert model.latency.heading == 0.3
    assert model.errors.longitudinal.bias.constant == 1.5


@pytest.mark.parametrize(
    "override", ["latency.speed", "latency.speed=fast", "nothing=1", "name.x=1", "latency.pace=1"]
)
def test_an_override_that_sets_nothing(override: str) -> None:
    with pytest.raises(InputError):
        read_model(MODELS / "latency.json", (override,))


def _coupling(**entries: float) -> list[list[float]]:
    table = np.eye(6)
    for where, value in entries.items():
        i, j = int(where[1]), int(where[2])
        table[i, j] = table[j, i] = value
    return table.tolist()


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ([[1.0]], "6 x 6"),
        (_coupling(_00=0.5), "1 on its diagonal"),
        ([[1.0, 0.3, 0, 0, 0, 0], *np.eye(6)[1:].tolist()], "symmetric"),
        (_coupling(_01=0.9, _12=0.9, _02=-0.9), "least eigenvalue"),
    ],
)
def test_correlations_that_cannot_be(written, table: list[list[float]], says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_model(written(errors={"coupling": table}))


def test_correlations_at_their_limit(written) -> None:
    assert read_model(written(errors={"coupling": _coupling(_01=1.0)})).errors.coupling is not None


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"averaging": {"speed": 0.5}, "latency": {"speed": 0.2}}, "twice latency.speed"),
        ({"maneuvers": {"braking": {"averaging": {"heading": 0.5}}}}, "twice latency.heading"),
        ({"maneuvers": {"parking": {}}}, "parking"),
        ({"latency": {"position": -0.1}}, "latency.position"),
        ({"detection": {"range_edges": [0, 50], "loss": [], "gain": []}}, "loss: expected 1 x 0 x 0"),
        ({"update": {"rate": 10}}, "update.rate"),
        (
            {"update": {"jitter": 0.1}},
            "update: jitter: .*found jitter 0.1 without one; set period, or jitter to 0",
        ),
        (
            {"false_objects": {"rate": 50.0, "lifetime": 3.0}},
            "false_objects: rate: .*50 x 3 = 150; lower rate or",
        ),
        ({"detection": {"range_edges": ["0", "50"]}}, "detection.range_edges.0: .*, found '0'"),
        ({"detection": {"bearing_edges": [False, True]}}, "detection.bearing_edges.0: .*, found False"),
        ({"errors": {"coupling": np.eye(6).astype(bool).tolist()}}, "errors.coupling.0.0: .*, found True"),
        ({"validity": {"range": ["0", "1"]}}, "validity.range.0: .*, found '0'"),
        (
            {"errors": {"longitudinal": {"noise": {"constant": 1.0, "range": 10.0}}}},
            r"noise: range: at 150 the standard deviation is exp\(1.5e\+03\) times the constant, expected exp\(50\)",
        ),
    ],
)
def test_faults_are_named(written, parts: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_model(written(**parts))


def test_pooled_parameters_are_those_at_the_top() -> None:
    model = PerceptionModel.model_validate(
        {"schema": "resim-perception-1", "name": "m", "latency": {"speed": 0.2}, "maneuvers": {"braking": {}}}
    )
    assert model.pooled.latency.speed == 0.2
    assert model.maneuvers["braking"].latency.speed == 0.0
