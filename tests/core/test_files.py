"""Files of strangers: what is nested without end is refused where it is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from resim.core.errors import InputError
from resim.core.files import parse_json, parse_toml

DEPTHS = (40, 2_000, 100_000)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_toml, lambda n: "a = " + n * "[" + n * "]"),
        (parse_toml, lambda n: ".".join(["a"] * min(n, 20_000)) + " = 1"),
        (parse_json, lambda n: n * "[" + n * "]"),
        (parse_json, lambda n: n * '{"a":' + "1" + n * "}"),
    ],
)
def test_deep_nesting_is_refused(
    parse: Callable[[bytes, Path], Any], text: Callable[[int], str], depth: int
) -> None:
    with pytest.raises(InputError, match="nested deeper than 30 levels"):
        parse(text(depth).encode(), Path("deep"))


def test_what_people_nest_is_read() -> None:
    assert parse_toml(b"[a.b.c]\nd = [[1, 2], [3]]", Path("file")) == {
        "a": {"b": {"c": {"d": [[1, 2], [3]]}}}
    }
    assert parse_json(b'{"a": [{"b": null}]}', Path("file")) == {"a": [{"b": None}]}


def test_a_mark_of_the_byte_order_is_no_fault(tmp_path: Path) -> None:
    assert parse_toml(b"\xef\xbb\xbfa = 1", tmp_path / "a.toml") == {"a": 1}
