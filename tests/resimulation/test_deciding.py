"""Whose verdict is that on the drive."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from resim.core.errors import InputError
from resim.resimulation.assessed import ResimulationAssessment


def found(decides: tuple[str, ...] | None = None, **verdicts: str) -> ResimulationAssessment:
    """An assessment with these verdicts."""
    drive = SimpleNamespace(path=["plan"])
    blocks = {name: SimpleNamespace(verdict=v, drive=drive, notes=list) for name, v in verdicts.items()}
    return ResimulationAssessment("x", None, True, blocks, None, {}, decides=decides)  # type: ignore[arg-type]


def test_what_was_simulated_decides_and_the_rest_is_told() -> None:
    one = found(GT="FAIL", SD="INVALID", rGT="PASS", rSD="PASS")
    assert (one.deciding(), one.bad()) == (("rGT", "rSD"), {})
    assert one.notes() == ["GT FAIL, SD INVALID: reported only; the verdict is decided by rGT, rSD"]


def test_what_was_measured_decides_where_nothing_was_simulated() -> None:
    assert found(GT="PASS", SD="FAIL").bad() == {"SD": "FAIL"}


def test_who_decides_is_a_setting() -> None:
    one = found(("GT",), GT="FAIL", rGT="INVALID")
    assert one.bad() == {"GT": "FAIL"}
    assert one.notes() == ["rGT INVALID: reported only; the verdict is decided by GT"]


def test_who_is_not_there_cannot_decide() -> None:
    with pytest.raises(InputError, match="rSD is not judged here; there are: GT, rGT"):
        found(("rSD",), GT="PASS", rGT="PASS").bad()
