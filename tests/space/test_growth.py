"""A space is built, and grows; how much was seen of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from space.families import drawn, lasting
from space.spaces import KINDS, source, space_of

from resim.core.errors import InputError
from resim.space.agreement import adjusted_rand
from resim.space.build import build_space, cluster_buckets, grow_space
from resim.space.clustering import Linkage
from resim.space.comparison import together as comparison_of
from resim.space.coverage import SeenScenarios, coverage, expands
from resim.space.described import report
from resim.space.draws import Driven
from resim.space.folder import read_space, write_space
from resim.space.members import MEMBER_COLUMNS
from resim.space.risk import cluster_risks
from resim.space.settings import SpaceSettings
from resim.space.sources import DrivenRecording, _driven_until
from resim.space.traces import joined


def kinds(count: int, seed: int, of: tuple[str, ...] = KINDS) -> list[str]:
    return np.random.default_rng(seed).choice(of, count).tolist()


def test_clusters_have_names_medoids_and_rates() -> None:
    told = report(space_of(list(KINDS) * 4, hours=2.0), {})
    clusters = told.clusters()
    assert len(clusters) == len(KINDS)
    one = clusters["1.1"]
    assert (one.members, one.occasions) == (4, 4)
    assert one.per_hour.value == pytest.approx(2.0)
    assert one.per_hour.low < 2.0 < one.per_hour.high
    assert one.per_kilometre.value == pytest.approx(0.02)
    assert one.medoid.startswith("one_")
    assert told.coverage.kinds.seen == len(KINDS)


LINKAGES = ("single", "complete", "average", "weighted")


@pytest.mark.parametrize("how", LINKAGES)
def test_growth_does_not_depend_on_the_order_of_drives(how: Linkage) -> None:
    base = [*KINDS[:6]] * 5
    first, second, third = (source(f"s{k}", kinds(25, k), k) for k in range(1, 4))
    built = space_of(base, settings=SpaceSettings(linkage=how))
    label = {}
    for order in ((first, second, third), (third, first, second)):
        grown = built
        for one in order:
            grown = grow_space(grown, [one])
        rows = grown.rows.sort_values("scenario")
        label[order[0].name] = (rows["scenario"].tolist(), rows["cluster"].tolist(), rows["medoid"].tolist())
    assert label["s1"] == label["s3"]
    together = grow_space(built, [first, second, third]).rows.sort_values("scenario")
    assert label["s1"][1] == together["cluster"].tolist()


@pytest.mark.parametrize("how", LINKAGES)
def test_nor_does_it_where_drives_have_scenarios_of_one_name_and_new_roads(how: Linkage) -> None:
    drives = [replace(source("day", kinds(25, k), k), folder=Path(f"/{k}")) for k in range(1, 5)]
    for one, lanes in zip(drives, (3, 2, 3, 4), strict=True):
        one.rows["lanes"] = lanes
    found = []
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)):
        grown = space_of([*KINDS[:6]] * 5, settings=SpaceSettings(linkage=how))
        for k in order:
            grown = grow_space(grown, [drives[k]])
        drive = {one.name: one.hash for one in grown.sources}
        rows = grown.rows.assign(drive=[drive[str(one)] for one in grown.rows["source"]])
        with_whom = rows.groupby("cluster").apply(lambda c: (frozenset(zip(c["drive"], c["name"], strict=True)),
                                                             tuple(c.loc[c["medoid"], "name"])))  # fmt: skip
        names = [name for name in with_whom.index if name.startswith("1.")]
        found.append((set(with_whom), with_whom[names].to_dict()))
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("how", LINKAGES)
def test_growth_keeps_what_was_built_and_is_near_a_space_built_anew(how: Linkage) -> None:
    built = space_of([*KINDS[:6]] * 5, settings=SpaceSettings(linkage=how))
    more = source("more", [*KINDS] * 4, 5)
    grown = grow_space(built, [more])
    before = grown.rows.iloc[: len(built.rows)]
    assert before["cluster"].tolist() == built.rows["cluster"].tolist()
    assert before["medoid"].tolist() == built.rows["medoid"].tolist()
    new = {name for name in grown.rows["cluster"] if ".n" in name}
    assert len(new) == len(KINDS) - 6
    anew = build_space([source("one", [*KINDS[:6]] * 5, 0), more], built.settings)
    assert adjusted_rand(grown.rows["cluster"].to_numpy(str), anew.rows["cluster"].to_numpy(str)) >= 0.95
    told = report(grown, {})
    assert sum(one.members for one in told.clusters().values()) == len(grown.rows)


def test_a_source_is_in_a_space_once_and_another_bucket_is_added() -> None:
    built = space_of([*KINDS])
    with pytest.raises(InputError, match="in the space already"):
        grow_space(built, [source("one", [*KINDS], 0)])
    other = source("other", [*KINDS[:3]], 9)
    other.rows["lanes"] = 2
    grown = grow_space(built, [other])
    assert sorted(set(grown.rows["number"])) == [1, 2]
    assert grown.rows["cluster"].iloc[-1].startswith("2.n")
    alike = grow_space(space_of([*KINDS], settings=SpaceSettings(bucket="vehicles")), [other])
    assert set(alike.rows["number"]) == {1}
    assert not any(".n" in name for name in alike.rows["cluster"])


def test_a_drive_is_in_a_space_once_and_names_may_be_those_of_another_source(tmp_path: Path) -> None:
    one, other = (replace(source("day", [*KINDS[:3]] * 2, seed), folder=Path(f"/{seed}")) for seed in (1, 2))
    built = build_space([one, other])
    assert built.traces.names.tolist() == built.rows["scenario"].tolist()
    write_space(built, tmp_path)
    again, _ = read_space(tmp_path)
    assert len(set(again.rows["scenario"])) == 12
    first = replace(one, recordings=(replace(one.recordings[0], tracks="abc"), *one.recordings[1:]))
    mined_again = replace(
        other, recordings=(replace(other.recordings[0], tracks="abc"), *other.recordings[1:])
    )
    with pytest.raises(InputError, match="recording day/0 is in the space already"):
        build_space([first, mined_again])
    with pytest.raises(InputError, match="recording day/0 is in the space already"):
        grow_space(build_space([first]), [mined_again])


@pytest.mark.parametrize("how", ["digits", "ego", "cut"])
def test_a_drive_that_is_there_again_is_refused_whatever_its_file_is(how: str) -> None:
    """As CSV with fewer digits, around another EGO of a study of all, or cut anew so that scenarios are missing."""
    names = kinds(25, 1)
    first, other = source("day", names, 1), source("night", kinds(25, 2), 2)
    again = replace(source("again", names, 1), hash="of other bytes")
    if how == "digits":
        again = replace(again, traces=replace(again.traces, offset=np.round(again.traces.offset, 3)))
    if how == "ego":
        again = replace(
            again, recordings=(replace(again.recordings[0], tracks="another", ego="b"), *again.recordings[1:])
        )
    if how == "cut":
        again = replace(
            again, rows=again.rows.iloc[10:].reset_index(drop=True), traces=again.traces.take(range(10, 25))
        )
    with pytest.raises(InputError, match="see the same traffic to the centimetre"):
        build_space([first, other, again])
    with pytest.raises(InputError, match="see the same traffic to the centimetre"):
        grow_space(build_space([first]), [again])
    assert len(build_space([first, other]).rows) == 50
    standing = [replace(one.traces, offset=np.full_like(one.traces.offset, 12.0), speed=np.zeros_like(one.traces.speed))
                for one in (first, again)]  # fmt: skip
    queues = [replace(one, traces=told) for one, told in zip((first, again), standing, strict=True)]
    assert len(build_space(queues).rows) == 25 + len(again.rows)  # a queue looks like any other


def test_hours_of_a_drive_without_a_scenario_count_once_whatever_its_bytes_are() -> None:
    quiet = replace(
        source("day", kinds(5, 1), 1).recordings[0], name="quiet", tracks="bytes", traffic="where"
    )
    day, night = (source(name, kinds(5, k), k) for k, name in enumerate(("day", "night")))
    first = replace(day, recordings=(*day.recordings, quiet))
    again = replace(night, recordings=(*night.recordings, replace(quiet, name="again", tracks="other bytes")))
    with pytest.raises(InputError, match="recording again is in the space already"):
        build_space([first, again])
    with pytest.raises(InputError, match="recording again is in the space already"):
        grow_space(build_space([first]), [again])


def test_what_is_cut_short_is_of_no_kind_that_was_seen() -> None:
    """In its first second every cut-out is following, and harmless."""
    whole = space_of([*KINDS[:3]] * 8, build="b")
    each = [whole.traces.take([k]) for k in range(len(whole.traces))]
    rows = whole.rows[~whole.rows["medoid"]].index[:4].tolist()
    short = replace(
        whole, traces=joined([lasting(one, 5) if k in rows else one for k, one in enumerate(each)])
    )
    assert not whole.unsure.any()
    assert np.flatnonzero(short.unsure).tolist() == rows
    before, after = (report(one, {}) for one in (whole, short))
    assert after.coverage.kinds.seen == before.coverage.kinds.seen + 4
    assert after.coverage.convergence.unseen.high > before.coverage.convergence.unseen.high
    assert any("4 scenarios last for less than 50%" in note for note in after.notes)
    nobody = pd.DataFrame(columns=list(MEMBER_COLUMNS)).astype(
        {"collided": "boolean", "risk": float, "counts": bool}
    )
    driven = [sum(one.measured for one in cluster_risks(space, nobody, "b")) for space in (whole, short)]
    assert driven == [24, 20]


def test_what_was_mined_for_other_scenarios_is_refused() -> None:
    """In its hours nobody looked for those of the first: they would seem rare."""
    first, other = source("day", kinds(25, 1), 1), source("night", kinds(25, 2), 2)
    lanes = replace(first, trigger=("lane_change_left",))
    with pytest.raises(
        InputError, match="was mined around collision, day around lane_change_left: scenarios of one"
    ):
        build_space([lanes, replace(other, trigger=("collision",))])
    with pytest.raises(InputError, match="was mined with other thresholds than day"):
        grow_space(build_space([lanes]), [replace(other, trigger=("lane_change_left",), rules="mine")])
    with pytest.raises(InputError, match="mined with other thresholds or triggers"):
        comparison_of(build_space([lanes]), build_space([other]))


def test_several_egos_that_see_the_same_do_not_make_a_kind_seen_twice() -> None:
    alone = report(build_space([source("a", [*KINDS] * 2, 1)]), {}).coverage
    twice = report(
        build_space([source("b", [k for k in KINDS for _ in range(2)], 1, together=2)]), {}
    ).coverage
    assert alone.convergence.unseen.value == 0.0
    assert twice.convergence.unseen.value == 1.0


def test_a_scenario_on_no_lane_is_of_no_kind_that_was_seen() -> None:
    """Without a lane all slots are empty: all such would be of one kind, which is seen often."""
    space = space_of(list(KINDS[:8]))
    nobody = np.full_like(space.traces.offset, np.nan)
    empty = replace(space.traces, offset=nobody, speed=nobody)
    of_lanes = (empty.lane, np.full_like(empty.lane, -1))
    free, lost = (
        report(cluster_buckets(replace(space, traces=replace(empty, lane=lane))), {}) for lane in of_lanes
    )
    assert free.coverage.convergence.unseen.value == 0.0
    assert lost.coverage.convergence.unseen.value == 1.0
    assert lost.buckets[0].coverage.convergence.unseen.value == 1.0
    assert any("a kind of its own" in note for note in lost.notes)


def test_what_the_last_recording_brings_is_found_late() -> None:
    """Also its only scenario, which was said to come as the recording begins: in the first half of 1 + 0.9 h."""
    frame = pd.DataFrame({"recording": ["a", "a", "b"], "start": [0.0, 50.0, 7.0], "end": [10.0, 100.0, 9.0]})
    recordings = tuple(DrivenRecording(name, h, h, "m", "e", "") for name, h in (("a", 0.9), ("b", 1.0)))
    hours, _ = _driven_until(frame, recordings)
    assert hours == pytest.approx([0.09, 0.9, 1.9])


def test_discovery_stops_where_nothing_new_comes() -> None:
    few = report(space_of([*KINDS[:3]] * 3), {}).coverage.convergence
    assert not few.converged
    assert few.missing > 50
    assert few.missing_hours > 1.0
    of = Driven((600.0, 600.0), 150, np.full((150, 2), 4.0))
    many = SeenScenarios(
        np.arange(600) % 6,
        np.arange(600),
        np.full(600, 0.1),
        np.arange(600.0),
        np.arange(600.0),
        of,
        np.arange(600) // 4,
    )
    found = coverage(many)
    assert found.convergence.converged
    assert found.discovery_per_hour.value == 0.0
    assert found.discovery_per_hour.high > 0.0
    few_drives = coverage(replace(many, driven=replace(of, drives=29)))  # they may have most of what comes
    assert np.isnan(few_drives.discovery_per_hour.high)
    assert np.isnan(few_drives.discovery_per_kilometre.high)
    whole = coverage(replace(many, drive=np.zeros(600, int)))
    assert set(whole.curve.unseen) == {1.0}
    alone = whole.convergence  # the next drive may have others
    assert (alone.converged, alone.unseen.value) == (False, 1.0)
    assert alone.missing > 600
    growing = SeenScenarios(
        np.arange(600) % 6,
        np.arange(600),
        np.arange(600.0) / 100.0,
        np.arange(600.0),
        np.arange(600.0),
        of,
        np.arange(600) // 4,
    )
    assert not coverage(growing).convergence.converged


@pytest.mark.parametrize("lost", [{"left_out": 1}, {"failed": ("one/7",)}])
def test_nothing_is_converged_where_something_was_left_out(lost: dict[str, Any]) -> None:
    """Of which kinds it is, nobody says."""
    whole = space_of([*KINDS[:2]] * 150)
    whole = replace(whole, traces=replace(whole.traces, offset=np.round(whole.traces.offset, -2)))
    whole = cluster_buckets(whole)
    of_all = report(whole, {})
    less = report(replace(whole, sources=tuple(replace(one, **lost) for one in whole.sources)), {})
    before, after = (
        [one.coverage.convergence, one.buckets[0].coverage.convergence] for one in (of_all, less)
    )
    assert [one.converged for one in (*before, *after)] == [True, True, False, False]
    assert all(np.isnan(one.missing) for one in after)
    assert any("nothing is converged" in note for note in less.notes)


def test_who_expands_a_kind() -> None:
    kind, distance = np.array([0, 0, 0, 1, 0]), np.array([0.0, 0.04, 0.2, 0.0, 0.22])
    assert expands(kind, distance).tolist() == [True, False, True, True, False]


def test_a_large_bucket_is_clustered_by_samples() -> None:
    asked = kinds(300, 3)
    exact, sampled = (
        space_of(asked, settings=one) for one in (SpaceSettings(), SpaceSettings(largest=200, sample=90))
    )
    assert next(iter(sampled.links.values())).method == "samples"
    found = [one.rows["cluster"].to_numpy(str) for one in (exact, sampled)]
    assert adjusted_rand(*found) >= 0.95
    again = space_of(asked, settings=SpaceSettings(largest=200, sample=90))
    assert again.rows["cluster"].tolist() == sampled.rows["cluster"].tolist()


def test_a_threshold_is_chosen_for_each_bucket() -> None:
    found = space_of([*KINDS] * 6, settings=SpaceSettings(threshold="stability"))
    how = next(iter(found.links.values()))
    assert how.chosen == "stability"
    assert len(set(found.rows["cluster"])) == len(KINDS)
    assert len(drawn("follows", "x", np.random.default_rng(0))) == 1
