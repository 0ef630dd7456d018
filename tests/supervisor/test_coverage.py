"""The dashboard says how much of the scenario space was seen, as the space itself says it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from space.spaces import KINDS, space_of

from resim.results.catalog import Catalog
from resim.results.reading import read_entry
from resim.space.folder import write_space


def test_the_newest_spaces_are_on_the_dashboard(
    user: Any, catalog: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("resim.supervisor.kept.FRESH", 0.0)
    assert "No space of scenarios is known" in user.get("/").text
    space = space_of([kind for kind in KINDS for _ in range(4)], hours=2.0)
    folder = tmp_path / "seen"
    folder.mkdir()
    report = write_space(space, folder)
    Catalog(catalog).add(read_entry(folder))
    text = " ".join(user.get("/").text.split())
    state = report.coverage.convergence.unseen
    assert f"{100 * state.value:.3g} % ({100 * state.low:.3g} to {100 * state.high:.3g})" in text
    assert f"{report.coverage.kinds.seen} seen" in text
    assert "2 h" in text
    (folder / "space.json").write_text("{}", encoding="utf-8")
    assert "its folder is not here, or holds something else" in user.get("/").text
