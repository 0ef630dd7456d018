"""Variations: consistent motion, the noise that is asked for, the same for a seed, and no overlap or finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from resim.core.distribution import RandomNumber, constant
from resim.core.errors import InputError
from resim.core.geometry import to_frame
from resim.core.overlaps import first_overlaps
from resim.jobs.augment import augment, shipped_augmentation
from resim.jobs.check import check
from resim.jobs.generate import generate_recording
from resim.recordings import read_recording
from resim.scenario.augmentation.augment import augmentations
from resim.scenario.augmentation.settings import (
    AugmentationSettings,
    PathNoise,
    SpeedNoise,
    read_augmentation,
)

ROOT = Path(__file__).parents[3]
Call = Callable[..., tuple[int, str, str]]
RECIPE = ROOT / "scenarios" / "catalog" / "generate" / "highway_one_passes.toml"


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("origin") / "drive"
    generate_recording(RECIPE, folder)
    return folder


def drawn(origin: Path, number: int = 0, **told: object):
    recording = read_recording(origin)
    settings = AugmentationSettings(**told)
    return recording.gt, next(augmentations(recording.gt, recording.ego, settings, 1, number))


def test_without_noise_a_variation_is_its_origin(origin: Path) -> None:
    gt, made = drawn(origin)
    assert np.nanmax(np.hypot(made.tracks.x - gt.x, made.tracks.y - gt.y)) < 0.02
    assert np.nanmax(np.abs(made.tracks.v - gt.v)) < 0.05


def test_an_offset_moves_the_whole_path_to_the_left(origin: Path) -> None:
    path = PathNoise(offset=constant(0.4), noise=constant(0.0))
    gt, made = drawn(origin, path=path)
    _, aside = to_frame(made.tracks.x, made.tracks.y, gt.x, gt.y, gt.heading)
    assert aside[:, :100] == pytest.approx(np.full((2, 100), 0.4), abs=0.02)


def test_motion_is_consistent_with_its_positions(origin: Path) -> None:
    path = PathNoise(offset=RandomNumber(sd=0.2, mean=0.0), noise=RandomNumber(sd=0.4, mean=0.0))
    speed = SpeedNoise(noise=RandomNumber(mean=0.0, sd=2.0))
    _, made = drawn(origin, path=path, speed=speed)
    k = made.tracks
    dt = k.t[2:] - k.t[:-2]
    velocity = ((k.x[:, 2:] - k.x[:, :-2]) + 1j * (k.y[:, 2:] - k.y[:, :-2])) / dt
    told = (k.v * np.exp(1j * k.heading))[:, 1:-1]
    assert np.nanmax(np.abs(velocity - told)) < 0.05
    assert np.nanmax(np.abs(np.diff(np.unwrap(k.heading, axis=1), axis=1))) / 0.04 < 0.2  # no sharp turns


def test_the_noise_has_the_spread_that_smoothing_leaves(origin: Path) -> None:
    """Independent points of sd 1 under a Gaussian of g points have the sd (4 pi g²)^-1/4 behind it."""
    path = PathNoise(offset=constant(0.0), noise=RandomNumber(mean=0.0, sd=0.1), spacing=2.0, smoothing=8.0)
    asides = []
    for number in range(40):
        gt, made = drawn(origin, number, path=path, ego=False)
        row = gt.index("other")
        _, aside = to_frame(made.tracks.x[row], made.tracks.y[row], gt.x[row], gt.y[row], gt.heading[row])
        asides.append(aside[40:160:20])
    expected = 0.1 * (4.0 * np.pi * 4.0**2) ** -0.25
    assert np.nanstd(np.array(asides)) == pytest.approx(expected, rel=0.2)


def test_who_stands_stays(origin: Path) -> None:
    gt = read_recording(origin).gt
    stopped = replace(gt, x=gt.x[:, :1] + 0.0 * gt.x, y=gt.y[:, :1] + 0.0 * gt.y, v=0.0 * gt.v, a=None)
    settings = AugmentationSettings(speed=SpeedNoise(noise=RandomNumber(mean=0.0, sd=3.0)))
    made = next(augmentations(stopped, "ego", settings, 1, 0))
    assert (made.tracks.v == 0.0).all()


def test_variations_have_no_overlaps_and_no_findings_and_the_truth_of_their_origin(
    origin: Path, tmp_path: Path, call: Call
) -> None:
    code, said, error = call("augment", origin, "--count", 3, "--out", tmp_path / "out")
    assert (code, error) == (0, "")
    assert "3 variations" in said
    told = read_augmentation(shipped_augmentation())
    for folder in sorted((tmp_path / "out").iterdir()):
        found = read_recording(folder)
        assert not check(folder).findings
        assert not first_overlaps(found.gt)
        truth = pd.read_csv(folder / "truth.csv")
        assert (truth["recording"].astype(str).str.zfill(3) == folder.name).all()
        assert found.provenance["colors"].count("#") == len(found.gt)
        assert told.day is not None
        assert told.day[0].isoformat() <= found.environment["dateTime"] <= told.day[1].isoformat()
        assert found.environment["precipitationDensity"]
    first, second = (read_recording(tmp_path / "out" / name).gt for name in ("000", "001"))
    assert np.nanmax(np.abs(first.x[:, :150] - second.x[:, :150])) > 0.2


def test_the_same_seed_gives_the_same_bytes(origin: Path, tmp_path: Path) -> None:
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        augment(origin, tmp_path / name, count=1, seed=seed)
    one, two, three = ((tmp_path / name / "000" / "gt.csv").read_bytes() for name in "abc")
    assert one == two
    assert one != three


def test_types_are_those_that_can_drive_so(origin: Path, tmp_path: Path) -> None:
    """At 31 m/s no truck is drawn, whose limiter is at 25 m/s."""
    made = augment(origin, tmp_path / "out", count=6, seed=2)
    kinds = {kind for one in made for kind in one.types.values()}
    assert kinds
    assert not any("truck" in kind for kind in kinds)


WIDE = """change_type = 1.0
[[type]]
name = "wider than any car"
kind = "car"
length = 5.0
width = 4.0
top_speed = 90.0
acceleration = 20.0
"""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[path]\noffset = { mean = 0.0, sdd = 0.2 }", "path.offset.sdd: there is no such field"),
        ("change_type = 0.5", "type: expected types of vehicles"),
        ('[[weather]]\nprecipitation = "rain"', "intensity: expected 0 where it is dry"),
        ("[path]\nspacing = 0.0", "path.spacing: expected 0.05 or more, found 0.0"),
    ],
)
def test_faults_are_told(origin: Path, tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError) as e:
        augment(origin, tmp_path / "out", count=1, settings=tmp_path / "a.toml")
    assert told in str(e.value)


def test_a_variation_without_room_is_refused(origin: Path, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(WIDE)
    with pytest.raises(InputError, match="variation 0: no draw is without overlaps and findings"):
        augment(origin, tmp_path / "out", count=1, settings=tmp_path / "a.toml")
    assert not (tmp_path / "out" / "000").exists()
