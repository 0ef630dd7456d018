from __future__ import annotations

import json
from dataclasses import asdict

import pytest
from perception.generator import KNOWN, drives

from resim.core.errors import InputError
from resim.perception.model import PerceptionModel
from resim.perception.validation import Report, cross_validate, judge

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report() -> Report:
    return cross_validate(drives(KNOWN["everything"], 2, 12), folds=3, seeds=2)


def test_the_models_errors_are_as_far_from_the_measured_as_these_among_themselves(report: Report) -> None:
    for a in report.quantities.values():
        assert a.yardstick is not None
        assert a.wasserstein < max(2.0 * a.yardstick, 0.15 * a.deviation[0])
        assert a.deviation[1] == pytest.approx(a.deviation[0], rel=0.15)
        for one, other in zip(a.autocorrelation_measured, a.autocorrelation_model, strict=True):
            assert one is not None
            assert one == pytest.approx(other, abs=0.2)


def test_drop_outs_and_latencies(report: Report) -> None:
    assert report.detected[0] == pytest.approx(report.detected[1], abs=0.03)
    assert len(report.dropouts_model) == pytest.approx(2 * len(report.dropouts_measured), rel=0.15)
    assert len(report.latencies["speed"]) == 3
    assert report.latencies["speed"] == pytest.approx([0.6] * 3, abs=0.05)


def test_a_report_is_json(report: Report) -> None:
    assert json.loads(json.dumps(asdict(report), allow_nan=False))["drives"] == 12


def test_a_model_of_nothing_is_far_off() -> None:
    a = judge(PerceptionModel(name="none"), drives(KNOWN["drift"], 2, 4)).quantities["longitudinal"]
    assert a.wasserstein > 3.0 * (a.yardstick or 0.0)


def test_one_drive_cannot_be_cross_validated() -> None:
    with pytest.raises(InputError, match="expected two or more"):
        cross_validate(drives(KNOWN["drift"], 2, 1))
