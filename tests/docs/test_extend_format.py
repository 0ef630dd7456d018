"""A new recording format, as docs/extend/format.md says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from extend import Extended, extended
from pages import ROOT

from resim.core.tracks import Tracks
from resim.recordings import read_recording

DRIVEN = ROOT / "scenarios" / "rear_end"


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("format.md", tmp_path_factory.mktemp("format"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_a_drive_comes_back_as_it_was_written(copy: Extended) -> None:
    gt = read_recording(DRIVEN).gt
    (copy.folder / "fcd.xml").write_text("".join(_fcd(gt)), encoding="utf-8")
    assert "EGO ego" in copy.commands("format.md")
    found = read_recording(copy.folder / "out" / "imported").gt
    assert (found.ids.tolist(), found.kind.tolist()) == (gt.ids.tolist(), gt.kind.tolist())
    for name in ("t", "x", "y", "v", "length"):
        assert getattr(found, name) == pytest.approx(getattr(gt, name), abs=1e-6, nan_ok=True), name
    assert "Import from SUMO's floating car data" in copy.resim("import", "--help")


def test_what_the_file_does_not_hold_is_told(copy: Extended) -> None:
    path: Path = copy.folder / "none.xml"
    path.write_text("<fcd-export></fcd-export>")
    words = (
        "import",
        "fcd",
        path,
        "--map",
        "networks/proving_ground.xodr",
        "--ego",
        "ego",
        "--out",
        "out/none",
    )
    done = copy.run("-m", "resim", *words)
    assert (done.returncode, "none.xml: holds no vehicle" in done.stderr) == (2, True), done.stderr


def _fcd(gt: Tracks) -> Iterator[str]:
    """The tracks as SUMO writes them."""
    yield "<fcd-export>\n"
    for k, t in enumerate(gt.t.tolist()):
        yield f'<timestep time="{t!r}">\n'
        for n in gt.valid[:, k].nonzero()[0].tolist():
            heading, ahead = float(gt.heading[n, k]), 0.5 * float(gt.length[n])
            x, y = gt.x[n, k] + ahead * math.cos(heading), gt.y[n, k] + ahead * math.sin(heading)
            yield (
                f'<vehicle id="{gt.ids[n]}" x="{x}" y="{y}" angle="{90.0 - math.degrees(heading)}" '
                f'type="{gt.kind[n]}" speed="{gt.v[n, k]}"/>\n'
            )
        yield "</timestep>\n"
    yield "</fcd-export>\n"
