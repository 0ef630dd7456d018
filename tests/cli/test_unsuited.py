"""Whatever import somebody tries on comma2k19, the answer is what it lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Call

from resim.recordings.formats.registry import FORMATS

MAP = ROOT / "networks" / "proving_ground.xodr"


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    """A segment as comma2k19 has it: arrays without an ending."""
    for name in ("global_pose/frame_positions", "CAN/speed/value"):
        path = tmp_path / "segment" / name
        path.parent.mkdir(parents=True)
        with path.open("wb") as file:
            np.save(file, np.zeros((3, 3)))
    return tmp_path / "segment"


@pytest.mark.parametrize("what", ["", "global_pose/frame_positions", "CAN/speed/value"])
def test_every_import_says_what_comma2k19_lacks(call: Call, segment: Path, tmp_path: Path, what: str) -> None:
    import resim.recordings.formats  # noqa: F401  the registry is filled by its import

    for name in [form.name for form in FORMATS] + ["guess"]:
        more = ["--map", MAP, "--out", tmp_path / "out"]
        code, _, error = call("import", name, segment / what, *more)
        if code == 2 and "Missing option" in error:  # asked for before the file is looked at
            more += ["--ego", "1", *(["--columns", "m.toml"] if name == "table" else [])]
            code, _, error = call("import", name, segment / what, *more)
        assert code == 2
        assert "lacks what a recording needs: true tracks of the other vehicles" in " ".join(error.split()), (
            name
        )
        assert "OpenDRIVE map" in " ".join(error.split())
