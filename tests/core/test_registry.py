"""Parts by name, in order."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from resim.core.errors import ResimError
from resim.core.registry import Registry


@dataclass(frozen=True)
class Gauge:
    name: str


def test_parts_are_found_by_name_and_kept_in_order() -> None:
    gauges: Registry[Gauge] = Registry("gauge")
    b, a = gauges.add(Gauge("b")), gauges.add(Gauge("a"))
    assert gauges.names == ("b", "a")
    assert list(gauges) == [b, a]
    assert gauges["a"] is a
    assert "a" in gauges
    assert "c" not in gauges


def test_an_unknown_name_is_told_with_those_that_there_are() -> None:
    gauges: Registry[Gauge] = Registry("gauge")
    gauges.add(Gauge("b"))
    with pytest.raises(ResimError, match="there is no gauge 'c'; there are: b"):
        _ = gauges["c"]


def test_no_two_parts_have_one_name() -> None:
    gauges: Registry[Gauge] = Registry("gauge")
    gauges.add(Gauge("b"))
    with pytest.raises(ValueError, match="'b'"):
        gauges.add(Gauge("b"))
