"""JSON with its own checksum."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from resim.core.errors import InputError
from resim.core.sealed import CHECKSUM, read_sealed, sealed

SAID = {"b": [1.5, None, (2, 3)], "a": {"ü": "text", "x": {}}, "n": 1e-300}


def write(path: Path, said: object) -> Path:
    path.write_text(json.dumps(said))
    return path


def test_what_was_sealed_is_read_back_without_its_checksum(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", sealed(SAID))
    assert read_sealed(path, "") == json.loads(json.dumps(SAID))
    assert next(iter(json.loads(path.read_text()))) == CHECKSUM


def test_no_character_may_be_another(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", sealed(SAID))
    whole = path.read_bytes()
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises(InputError, match=r"a\.json: .* Make it again\.$"):
            read_sealed(path, "Make it again.")


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (SAID, "it has no checksum"),
        ([SAID], "it has no checksum"),
        ({**sealed(SAID), CHECKSUM: 3}, "it has no checksum"),
        ({**sealed(SAID), "more": 1}, "was changed after it was written"),
        ({k: v for k, v in sealed(SAID).items() if k != "a"}, "was changed after it was written"),
    ],
)
def test_what_was_edited_is_refused(tmp_path: Path, said: object, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read_sealed(write(tmp_path / "a.json", said), "")


def test_how_it_is_laid_out_is_nothing_that_it_says(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(sealed(SAID), indent=4, sort_keys=True))
    assert read_sealed(path, "")["n"] == 1e-300
