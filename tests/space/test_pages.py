"""What the pages of a space show."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path

import numpy as np
from space.spaces import KINDS, space_of

from resim.space.described import report
from resim.space.page import figures, write_space_page


def test_the_dendrogram_of_two_scenarios_keeps_off_the_frame() -> None:
    (bucket,) = report(space_of([KINDS[0], KINDS[3]]), {}).buckets
    (packed,) = re.findall(r'application/gzip">([^<]*)<', str(figures.dendrogram(bucket)))
    drawn = json.loads(gzip.decompress(base64.b64decode(packed)))
    for axis, lowest in (("x", 5.0), ("y", 0.0)):  # links stand on the axis, and touch no other side
        (told,) = (base64.b64decode(trace[axis]["bdata"]) for trace in drawn["data"])
        values, (low, high) = np.frombuffer(told), drawn["layout"][f"{axis}axis"]["range"]
        assert low <= np.nanmin(values) - lowest
        assert np.nanmax(values) < high


def test_one_is_no_plural(tmp_path: Path) -> None:
    space = space_of([KINDS[0], KINDS[3]])
    write_space_page(space, report(space, {}), tmp_path)
    words = (tmp_path / "space.html").read_text(encoding="utf-8")
    assert "2 in 1 bucket<" in words
    assert "1 member," in words
    assert not re.search(r"\b1 (members|buckets|scenarios|clusters)", words)
