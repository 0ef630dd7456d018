"""A new measure, as docs/extend/measure.md says."""

from __future__ import annotations

import json

import pytest
from extend import Extended, extended
from pages import ROOT


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("measure.md", tmp_path_factory.mktemp("measure"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_it_is_assessed_and_a_criterion_uses_it(copy: Extended) -> None:
    printed = copy.commands("measure.md")
    assert "closing speed" in printed
    found = json.loads((copy.folder / "out" / "assessed" / "assessment.json").read_text())
    assert (found["units"]["closing speed"], found["kinds"]["closing speed"]) == ("m/s", "quantitative")
    values = [v for column in found["measures"]["closing speed"].values() for v in column if v is not None]
    verdict = found["criteria"]["no fast approach"]
    assert (verdict["verdict"], verdict["value"]) == ("PASS", max(values))
    assert list(found["measures"])[-1] == "closing speed"


@pytest.mark.slow
def test_it_stands_in_the_table_of_the_documentation(copy: Extended) -> None:
    done = copy.run("-c", f"import sys; sys.path.insert(0, {str(ROOT / 'docs')!r}); import generated; "
                    "print(generated.measures())")  # fmt: skip
    assert "| `closing speed` | quantitative | m/s |" in done.stdout, done.stderr
