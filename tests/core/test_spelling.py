from __future__ import annotations

import pytest

from resim.core.spelling import did_you_mean, nearest, unknown


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("TCT", ["TTB", "TTC", "TTK", "TTS"], "TTC"),
        ("ttc", ["TTB", "TTC"], "TTC"),
        ("kinmatic", ["kinematic", "single-track"], "kinematic"),
        ("headng", ["t", "heading", "v"], "heading"),
        ("heading", ["heading", "headings"], ""),
        ("nothing", ["kinematic"], ""),
        ("x", [], ""),
    ],
)
def test_the_name_that_is_spelt_most_alike_is_found(name: str, known: list[str], meant: str) -> None:
    assert nearest(name, known) == meant
    assert did_you_mean(name, known) == (f", did you mean {meant!r}?" if meant else "")


def test_words_for_an_unknown_name() -> None:
    assert (
        unknown("plan", "gird", ["grid"]) == "there is no plan 'gird', did you mean 'grid'? There are: grid"
    )
    assert unknown("plan", "x", ["grid"]) == "there is no plan 'x'; there are: grid"
