"""Precision and recall of mined labels on planted maneuvers: every kind, on every map that can express it.

    python tools/validate_planted.py [DATA] [--count N] [--varied M] [--seed S]

On each map each kind is planted N times, at a place, with speeds, lanes and figures drawn by chance; beside what ships,
public maps are read from DATA, where they are, and maps of ramps and U-turns are drawn. What everybody does follows
from how it was planted (tools/mining_rules.py), and all of it, of every kind, must be found, and nothing else. With
--varied, M variations of each (`resim augment`) are mined as well.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import mining_catalog_rules as rules
import numpy as np
from mining_catalog_scenes import (
    CATALOG_KINDS,
    CATALOG_SCENES,
    CHANGING,
    CRASHING,
    NEARLY,
    PASSING,
    meeting,
    waiting,
)
from mining_ground import Ground, changing, crossing_junctions, pieces, room, strip, way_through, ways
from mining_maps import maps
from mining_plants import Plant, placed, seen, tracks_of, truth, two_ways
from mining_rules import Event
from mining_scenes import LABELS, SCENES, WAYS, through
from validate_mining import Table, compare

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.jobs.augment import augment
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.recordings import Recording, read_recording, write_recording
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[1]
TRIES, MORE_TRIES, LONGEST, LEAST = 40, 1500, 420.0, 60.0
"""Draws of a plant before a map is said not to express it; m of a strip at most, and at least."""
ON_WAYS = ("tailgating_minor", "speeding", "standing", "strong_braking", "strong_acceleration", "reversing",
           "walking_on_road", "collision")  # fmt: skip
"""Kinds of one lane, half of which are planted on ways through junctions where the map has them."""
AT_EDGES, EDGES = ("leave_road", "enter_parking", "leave_parking"), 110.0
"""Kinds that need the same beside the lanes all along, and m of their strips at most."""
MOMENTS = {"pass", "overtaking_right", "enter_highway", "exit_highway"}
"""Kinds of which the truth is told of a moment, and not from when to when."""
LIKELY = {"crash_right_across_lateral": ("crash_right_into_path",)}
"""What the lines of two ways tell beforehand, where it is more than the kind."""
KINDS = (*LABELS, *CATALOG_KINDS)


@dataclass
class Tally:
    """Counts of labels, and on which maps each kind was planted on purpose, how often.

    off: by label, s that starts and ends differ from the truth at most.
    """

    table: Table = field(default_factory=dict)
    planted: dict[str, dict[str, int]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(int)))
    off: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    drives: int = 0


@dataclass(frozen=True, eq=False)
class Places:
    """Where on a map maneuvers can be planted."""

    network: RoadNetwork
    strips: tuple
    ways: tuple[Ground, ...]
    changing: tuple[Ground, ...]


@cache
def places(file: Path) -> Places:
    network = load(file)
    counts = crossing_junctions(network)
    through_them = [one for way in ways(network) if (one := way_through(network, way, counts)) is not None]
    found = tuple(one for one in pieces(network) if room(one) >= LEAST)
    return Places(network, found, tuple(through_them), tuple(changing(network)))


def draw_ground(here: Places, kind: str, rng: np.random.Generator) -> Ground | None:
    """Draw where a kind is planted; bends are preferred."""
    if kind in WAYS:
        fitting = [one for one in here.ways if one.turns[0][2] == kind]
        return fitting[int(rng.integers(len(fitting)))] if fitting else None
    if kind in PASSING or kind in CHANGING:
        fitting = here.ways if kind in PASSING else here.changing
        return fitting[int(rng.integers(len(fitting)))] if fitting else None
    if here.ways and kind in ON_WAYS and (rng.random() < 0.5 or not here.strips):
        return here.ways[int(rng.integers(len(here.ways)))]
    if not here.strips:
        return None
    best = None
    for _ in range(2):
        piece = here.strips[int(rng.integers(len(here.strips)))]
        lanes = [number for number, _, kind_ in piece.lanes]
        own = int(rng.choice(lanes))
        length = float(min(room(piece), rng.uniform(0.6, 1.0) * (EDGES if kind in AT_EDGES else LONGEST)))
        one = strip(here.network, piece, own, float(rng.uniform(0.0, room(piece) - length)), length)
        if best is None or (one.bend > best.bend and one.length >= 0.7 * best.length):
            best = one
    return best


def draw_plant(here: Places, kind: str, rng: np.random.Generator) -> Plant | None:
    """Draw a plant of a kind; None where the map has no room for it."""
    if kind in CRASHING or kind == "protected_way":
        return draw_pair(here, kind, rng)
    for _ in range(TRIES):
        ground = draw_ground(here, kind, rng)
        if ground is None:
            return None
        scenes = (through,) if kind in WAYS else {**SCENES, **CATALOG_SCENES}[kind]
        made = scenes[int(rng.integers(len(scenes)))](ground, rng)
        if made is not None and any(label == kind for _, label, _, _ in made.told):
            return made
        if made is not None and not made.told:
            return made  # nearly one, but none
    return None


def draw_pair(here: Places, kind: str, rng: np.random.Generator) -> Plant | None:
    """Draw a plant on two ways through a junction that come from two roads."""
    late = rng.random() < NEARLY
    for _ in range(MORE_TRIES if here.ways else 0):
        one, two = (here.ways[int(rng.integers(len(here.ways)))] for _ in range(2))
        if one.junction != two.junction or one.before == two.before:
            continue
        if kind == "protected_way":
            made = waiting(one, two, rng)
        elif late or crossing_paths(one, two) in LIKELY.get(kind, (kind,)):
            made = meeting(one, two, rng, late=late)
        else:
            continue
        if made is None:
            continue
        labels = {label for _, label, _, _ in two_ways(made)[1]}
        if kind == "protected_way" or kind in labels or (late and not labels & set(CRASHING)):
            return made
    return None


def crossing_paths(one: Ground, two: Ground) -> str:
    """Give how two would collide on two ways through a junction, told of the first, by the lines alone."""
    ways = []
    for ground in (one, two):
        heading = float(np.interp(ground.turns[0][0], ground.path.s, ground.path.heading))
        ways.append(rules.Through(ground.junction, 0.0, 0.0, heading, ground.turn, np.zeros(0)))
    return rules.crossing_paths(ways[0], ways[1], 0.0)


def mined(tracks: Tracks, network: RoadNetwork) -> list[Event]:
    found = features(tracks, network)
    t, ids = found.samples.t, tracks.ids.tolist()
    return [(ids[m.object], m.label, float(t[m.start]), float(t[m.end])) for m in find_maneuvers(found)]


def check_told(plant: Plant, true: Sequence[Event]) -> None:
    """What was planted on purpose is in the truth. Raises ValueError: then the plant or the truth is wrong."""
    for who, label, start, end in plant.told:
        if not any(
            one[:2] == (who, label) and one[2] <= end + 0.05 and start <= one[3] + 0.05 for one in true
        ):
            raise ValueError(
                f"{label} of {who} at {start:.2f} s was planted on {plant.ground.name}, but is not so"
            )


def plants(
    files: Sequence[Path], kinds: Sequence[str], count: int, seed: int
) -> Iterator[tuple[str, str, Plant]]:
    """Give name, kind and plant."""
    for file in files:
        for number, kind in enumerate(KINDS):
            if kind not in kinds or kind == "follow_lane":
                continue
            for k in range(count):
                rng = np.random.default_rng([seed, number, k, *file.stem.encode()])
                made = draw_plant(places(file), kind, rng)
                if made is not None:
                    yield f"{file.stem}: {kind} {k}", kind, made


def plant_all(
    files: Sequence[Path],
    kinds: Sequence[str],
    count: int,
    seed: int,
    varied: int = 0,
    scratch: Path | None = None,
) -> tuple[Tally, Tally, list[str]]:
    """Plant, mine and compare; give the tallies without and with variations, and what could not be varied."""
    plain, other, refused = Tally(), Tally(), []
    for number, (name, kind, plant) in enumerate(plants(files, kinds, count, seed)):
        if plant.beside is None:
            tracks, way, aside = tracks_of(plant.ground, plant.drives)
            true, labels = truth(plant.ground, seen(plant.ground, tracks, way, aside)), set(KINDS)
        else:
            tracks, true, labels = two_ways(plant)
        check_told(plant, true)
        _count(plain, name, kind, plant, (tracks, true, labels))
        if varied and plant.beside is None and scratch is not None:
            try:
                for one in _varied(plant, tracks, scratch / f"{number}", varied, seed):
                    of = truth(plant.ground, seen(plant.ground, one, *placed(plant.ground, one)))
                    _count(other, name, kind, plant, (one, of, set(KINDS)))
            except ResimError as e:
                refused.append(f"{name}: {e}")
    return plain, other, refused


def _count(
    tally: Tally, name: str, kind: str, plant: Plant, of: tuple[Tracks, Sequence[Event], set[str]]
) -> None:
    """Compare what is mined of tracks with all that is true of these labels."""
    tracks, true, labels = of
    found = mined(tracks, plant.ground.network)
    compare(tally.table, name, true, found, labels)
    for label in labels - MOMENTS:
        _compare_times(tally, label, true, found)
    tally.drives += 1
    for label in {label for _, label, _, _ in true}:
        if label == kind or label == "follow_lane":
            tally.planted[label][plant.ground.name] += 1


def _compare_times(tally: Tally, label: str, true: Sequence[Event], found: Sequence[Event]) -> None:
    """Note how far starts and ends are from the truth, where there are as many labels as there should be."""
    times = [sorted((who, a, b) for who, of, a, b in side if of == label) for side in (true, found)]
    if [one[0] for one in times[0]] == [one[0] for one in times[1]]:
        for (_, a, b), (_, c, d) in zip(*times, strict=True):
            tally.off[label] = max(tally.off[label], abs(a - c), abs(b - d))


def _varied(plant: Plant, tracks: Tracks, folder: Path, count: int, seed: int) -> Iterator[Tracks]:
    """Variations of a plant, by `resim augment`."""
    whole = Recording("planted", plant.ground.network.path.absolute(), "a", tracks, 25.0)
    write_recording(whole, folder / "origin")
    for one in augment(folder / "origin", folder / "varied", count=count, seed=seed):
        yield read_recording(one.folder).gt


def print_tally(tally: Tally, listed: int) -> None:
    print("| maneuver | maps | truth | found | precision | recall | starts and ends off by |")
    print("|---|---|---|---|---|---|---|")
    for label in KINDS:
        one = tally.table.get(label)
        if one is None:
            print(f"| `{label}` | 0 | 0 | 0 | – | – | – |")
            continue
        precision = f"{100.0 * one.right / one.found:.1f} %" if one.found else "–"
        recall = f"{100.0 * one.right / one.truth:.1f} %" if one.truth else "–"
        on = len(tally.planted[label])
        print(
            f"| `{label}` | {on} | {one.truth} | {one.found} | {precision} | {recall} | {tally.off[label]:.2f} s |"
        )
        for what, lines in (("missed", one.misses), ("wrong", one.wrong)):
            for line in lines[:listed]:
                print(f"  {label} {what} in {line}", file=sys.stderr)
    print()


def print_maps(tally: Tally, files: Sequence[Path]) -> None:
    """Say on which maps each kind was planted, and on which it could not be."""
    names = [file.stem for file in files]
    print("Kinds that a map cannot express:\n")
    for name in names:
        lacking = [kind for kind in KINDS if not tally.planted[kind].get(name)]
        print(f"- {name}: {', '.join(lacking) or 'none'}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, nargs="?", help="folder with public maps (xodr/)")
    parser.add_argument("--count", type=int, default=3, help="plants of each kind on each map")
    parser.add_argument("--varied", type=int, default=0, help="variations of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drawn", type=int, default=4, help="maps that are drawn of each sort")
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    parser.add_argument(
        "--listed", type=int, default=20, help="misses of each label that are listed (stderr)"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        files = maps(ROOT / "networks", asked.data, scratch, asked.drawn, asked.seed)
        plain, other, refused = plant_all(
            files, asked.kinds, asked.count, asked.seed, asked.varied, scratch / "varied"
        )
        print(f"{plain.drives} drives on {len(files)} maps, without augmentation:\n")
        print_tally(plain, asked.listed)
        if asked.varied:
            print(f"{other.drives} drives with augmentation; {len(refused)} could not be varied:\n")
            print_tally(other, asked.listed)
            for line in refused[: asked.listed]:
                print(f"  not varied: {line}", file=sys.stderr)
        print_maps(plain, files)


if __name__ == "__main__":
    main()
