"""Which program made a result: one hash of resim's source, the same in a checkout and in its wheel."""

from pathlib import Path

import pytest

import resim
from resim.core.provenance import code_state


def test_the_state_of_the_code_is_that_of_its_source_and_not_of_what_a_wheel_ships(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "resim"
    (root / "core").mkdir(parents=True)
    (root / "__init__.py").write_text("")
    (root / "core" / "a.py").write_text("A = 1")
    monkeypatch.setattr(resim, "__file__", str(root / "__init__.py"))
    checkout = code_state.__wrapped__()
    (root / "shipped" / "adfunc").mkdir(parents=True)
    (root / "shipped" / "adfunc" / "idm.py").write_text("B = 1")
    assert code_state.__wrapped__() == checkout
    (root / "core" / "a.py").write_text("A = 2")
    assert code_state.__wrapped__() != checkout
