"""A new panel of the report, as docs/extend/panel.md says."""

from __future__ import annotations

import re

import duckdb
import pytest
from extend import Extended, extended


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("panel.md", tmp_path_factory.mktemp("panel"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_it_is_a_section_of_the_page(copy: Extended) -> None:
    copy.commands("panel.md")
    out = copy.folder / "out" / "run"
    page = (out / "report.html").read_text(encoding="utf-8")
    body = re.findall(r'<section id="nearest"><h2>Nearest approach</h2>\n(.*?)</section>', page)[0]
    apart = duckdb.sql(
        f"select e.source, min(sqrt(pow(o.x - e.x, 2) + pow(o.y - e.y, 2))) as m from '{out}/tracks.parquet' e "
        f"join '{out}/tracks.parquet' o using (source, t) where e.id = 'ego' and o.id = '1' group by e.source"
    ).fetchall()
    sources, cells = re.findall('<th scope="col">([^<]*)', body)[1:], re.findall("<td>([^<]*)", body)
    assert dict(zip(sources, cells, strict=True)) == {source: f"{m:.2f}" for source, m in apart}
