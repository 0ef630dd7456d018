"""The tutorial, command by command, and what it says they give."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import generated
import pages
import pytest
from pages import DOCS, ROOT

TUTORIAL = DOCS / "tutorial.md"
RESULTS = DOCS / "formats" / "results.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what ships, and the tutorial's files."""
    made = tmp_path_factory.mktemp("tutorial")
    for name in ("scenarios", "adfunc", "networks"):
        (made / name).symlink_to(ROOT / name)
    for name, said in pages.named(TUTORIAL, "toml").items():
        (made / name).write_text(said)
    return made


def columns(file: str) -> list[str]:
    found = duckdb.sql(f"describe select * from '{file}'").df()
    return list(found["column_name"])


def described(after: str) -> list[str]:
    """The columns in the first table after a text on the page of results."""
    table = re.search(r"(?:^\|.*\n)+", pages.text(RESULTS).partition(after)[2], re.MULTILINE)
    assert table is not None
    return [name for row in table[0].splitlines() for name in re.findall(r"`([^`]+)`", row.split("|")[1])]


def load(path: Path) -> Any:
    return json.loads(path.read_text())


@pytest.mark.slow
@pytest.mark.timeout(900)  # a minute of CPU, on a machine that may be busy
def test_the_tutorial(
    folder: Path, call: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    for words in pages.commands(TUTORIAL):
        if words[0] == "resim":
            code, out, err = call(*words[1:])
            judged = words[1] == "verify" or "--criteria" in words  # and none of it is good
            assert code == judged, (words, out, err)
    out = folder / "out" / "tutorial"
    _gives_what_it_says(out)
    _verifies_what_it_says(out)
    _describes_its_columns(out)
    _tells_the_units(out)


def _gives_what_it_says(out: Path) -> None:
    """What the prose says of each result, in its words, and what the result is."""
    prose = " ".join(pages.text(TUTORIAL).split())
    braking = load(out / "assessed" / "assessment.json")["criteria"]["braking for comfort"]
    assert f"`braking for comfort` FAILs with {braking['value']:.2f} m/s²" in prose
    report = load(out / "run" / "report.json")
    (finding,) = report["findings"]
    assert f"one note, `{finding['code']}`" in prose
    assert f"it braked at {report['reaction']['GT']:.2f} s" in prose
    assert f"it brakes {-report['reaction_difference']['rGT']:.2f} s earlier" in prose
    assert report["decision"]["rGT"] == ["brake", "lane_change_left"]
    assert 0.005 < report["errors"]["FIT_GT"]["ego"]["d"]["mean"] < 0.015
    assert report["errors"]["SIM_GT"]["to"]["d"]["max"] < 1e-9
    verdicts = load(out / "run" / "assessment.json")
    assert [verdicts[s]["criteria"]["braking for comfort"]["verdict"] for s in ("GT", "rGT")] == [
        "FAIL",
        "PASS",
    ]
    assert load(out / "seen" / "report.json")["perception"]["same_decision"] == 5
    (first,) = load(out / "verified" / "verification.json")["recordings"]
    assert (first["verdict"], first["cause"]["step"]) == ("not verified", "sensor")


def _verifies_what_it_says(out: Path) -> None:
    """Two recordings with the model: how many seeds agree, and what it is where they do not."""
    prose = " ".join(pages.text(TUTORIAL).split())
    recordings = load(out / "verified_seen" / "verification.json")["recordings"]
    near, far = (recording["ways"]["rGT+M"] for recording in recordings)
    assert [near["verdict"], far["verdict"]] == ["not verified", "verified"]
    assert far["share"]["count"] == far["share"]["of"]
    assert f"all {far['share']['of']} seeds that it took agree" in prose
    assert f"in {near['share']['count']} of {near['share']['of']} seeds every criterion" in prose
    assert near["same_decision"]["count"] == near["same_decision"]["of"]
    flipped = Counter(text.partition(":")[0] for seed in near["seeds"] for text in seed["differences"])
    assert flipped == {"jerk for comfort": 5}
    assert "The other 5 seeds fail the comfort limit on jerk" in prose
    rows = duckdb.sql(f"select * from '{out}/sweep/runs/*.parquet'").df()
    comfortable = (rows["kpi braking for comfort"] == "PASS").groupby(rows["perception.latency.speed"]).sum()
    assert comfortable.to_dict() == {0.0: 2, 0.4: 1, 0.8: 0}
    assert (
        "without latency braking is comfortable in both runs, with 0.4 s in one, with 0.8 s in none" in prose
    )


def _describes_its_columns(out: Path) -> None:
    """The page of results names every column that was written, and no other."""
    for name in ("tracks", "answers", "plans", "kpis"):
        assert described(f"\n`{name}.parquet` ([read by one line](#read-a-table)), ") == columns(
            f"{out}/seen/{name}.parquet"
        )
    every = described("## Sweep")
    fixed = {name for name in every if not name.endswith("…")}
    families = tuple(name.removesuffix("…") for name in every if name.endswith("…"))
    written = set(columns(f"{out}/sweep/runs/*.parquet"))
    assert written == fixed | {name for name in written if name.startswith(families)}
    assert set(load(out / "seen" / "report.json")) == set(described("`report.json`:"))
    block = load(out / "run" / "assessment.json")["GT"]
    assert set(block) == set(described("A block holds:"))
    rows = pages.named(DOCS / "guides" / "sweep.md", "python")["rows.py"].replace("out/sweep", f"{out}/sweep")
    found: dict[str, Any] = {}
    exec(rows, found)
    assert len(found["rows"]) == 6


def _tells_the_units(out: Path) -> None:
    """The table of measures has the unit of each."""
    units = load(out / "assessed" / "assessment.json")["units"]
    rows = re.findall(r"^\| `(.*)` \| \w+ \| (\S+) \|", generated.measures(), re.MULTILINE)
    assert dict(rows) == units
