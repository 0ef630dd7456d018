"""From mined drives to kernels and their page, by the command line: what is claimed, and what is not shown."""

from pathlib import Path

import pytest
from calling import called

from resim.variations.kernels import read_kernels

DRIVES = [Path(__file__).parents[2] / "scenarios" / name for name in ("cut_in_brake", "overtake")]


@pytest.fixture(scope="module")
def mined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("mined") / "mined"
    assert called("mine", *DRIVES, "--scenarios", "rows", "--workers", 1, "--out", out) == 0
    return out


def test_few_traces_give_kernels_that_show_nothing(
    mined: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "kernels.json", tmp_path / "kernels.html"
    assert called("vary", "train", mined, "--out", out, "--report", page, "--least", 2) == 0
    told = capsys.readouterr().out
    assert f"{out}: from synthetic drives" in told
    for name, one in read_kernels(out).kernels.items():
        missing = f"not shown: {one.held_out} of 500 held-out traces, {500 - one.held_out} are missing"
        assert any(line.startswith(f"{name}: ") and missing in line for line in told.splitlines())
        assert missing in page.read_text("utf-8")
    assert "nothing here says how humans drive" in page.read_text("utf-8")


def test_nobody_can_vouch_for_what_resim_made(
    mined: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called("vary", "train", mined, "--out", tmp_path / "kernels.json", "--least", 2, "--real") == 2
    assert "was made by a program" in capsys.readouterr().err
    assert not (tmp_path / "kernels.json").exists()
