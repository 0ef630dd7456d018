"""Files of thresholds and kinds: the shipped ones say what the program does without them; wrong ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mining.planted import Drive, path_of, steady, tracks_of, write_motorway

from resim.core.errors import FunctionError, InputError
from resim.mining.catalog import KindQuery, matching, read_kinds
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.maneuver import label_names
from resim.mining.own_labels import read_rules
from resim.mining.settings import DEFAULT_SETTINGS, settings_of
from resim.road.opendrive import load

SCENARIOS = Path(__file__).parents[2] / "scenarios"
KINDS = SCENARIOS / "catalog" / "kinds.toml"


def test_the_shipped_file_says_what_holds_without_it() -> None:
    file = SCENARIOS / "mining" / "labels.toml"
    assert settings_of(file.read_bytes(), file) == DEFAULT_SETTINGS
    told = file.read_text("utf-8")
    for name, part in DEFAULT_SETTINGS:
        if hasattr(part, "model_fields"):
            assert f"[{name}]" in told
            assert all(
                f"\n{field} = " in told or f"# {field} = " in told for field in type(part).model_fields
            ), name


def test_every_row_of_the_catalogs_is_there_with_a_query_or_a_reason() -> None:
    kinds = read_kinds(KINDS)
    assert [sum(k.catalog == name for k in kinds) for name in ("highway", "urban and rural")] == [58, 85]
    assert len({(k.catalog, k.group, k.name) for k in kinds}) == len(kinds)
    named = set[str]().union(*(k.find.labels() for k in kinds if k.find is not None))
    assert named <= set(label_names())
    assert all(len(k.never) > 20 for k in kinds if k.find is None)


def test_queries_look_at_partners_others_and_what_was_before() -> None:
    rows = [("r", "a", "follow_lane", 0.0, 10.0, "b", "car", "truck", 0.0, 200.0),
            ("r", "b", "strong_braking", 5.0, 6.0, "", "truck", "", 150.0, 160.0),
            ("r", "c", "strong_braking", 2.0, 3.0, "", "bicycle", "", 60.0, 80.0),
            ("r", "b", "lane_change_left", 1.0, 3.0, "", "truck", "", 110.0, 130.0),
            ("q", "b", "strong_braking", 5.0, 6.0, "", "car", "", 0.0, 0.0),
            ("r", "d", "standing", 2.0, 3.0, "", "car", "", 900.0, 900.0)]  # fmt: skip
    columns = [
        "recording",
        "object",
        "label",
        "start",
        "end",
        "partner",
        "kind",
        "partner_kind",
        "x_from",
        "x_to",
    ]
    table = pd.DataFrame(rows, columns=columns).assign(y_from=0.0, y_to=0.0)

    def found(**query: object) -> list[int]:
        return matching(KindQuery.model_validate(query), table).index.tolist()

    assert found(label=["follow_lane"], partner=["strong_braking"]) == [0]
    assert found(label=["strong_braking"], other=["lane_change_left"]) == [2]
    assert found(label=["strong_braking"], before=["lane_change_left"]) == [1]
    assert found(label=["strong_braking"], not_before=["lane_change_left"]) == [2, 4]
    assert found(label=["strong_braking"], before=["lane_change_left"], within=1.0) == []
    assert found(label=["follow_lane"], alone=True) == []
    assert found(label=["lane_change_left"], before=["lane_change_left"]) == []
    assert found(label=["strong_braking"], kind=["bicycle", "car"]) == [2, 4]
    assert found(label=["follow_lane"], partner_kind=["truck"]) == [0]
    assert found(label=["follow_lane"], partner_kind=["bicycle"]) == []
    assert found(label=["strong_braking"], other=["lane_change_left"], other_kind=["truck"]) == [2]
    assert found(label=["strong_braking"], other=["lane_change_left"], other_kind=["car"]) == []
    assert found(label=["lane_change_left"], other=["standing"]) == []  # further away than 100 m
    with pytest.raises(ValueError, match="other_kind"):
        KindQuery.model_validate({"label": ["standing"], "other_kind": ["car"]})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[lane_change]\nclose = -1.0", "close"),
        ("[lane_change]\nnear = 1.0", "near"),
        ('[cut]\ndistance = "far"', "distance"),
        ('[[way]]\nlabel = "x"\nfirst = "1"\nthen = "2"', "no region"),
        ('[extraction]\ntrigger = ["cut_inn"]', "no label 'cut_inn'"),
    ],
)
def test_what_is_wrong_in_a_file_is_said(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "labels.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=problem):
        read_rules(file)


OWN = """
from resim.mining.maneuver import LabelledManeuver

def fast(features, found):
    s = features.samples
    for n in range(len(s.tracks)):
        own = range(s.first[n], s.first[n + 1])
        quick = [k for k in own if s.v[k] > 15.0]
        if quick:
            yield LabelledManeuver("fast", n, quick[0], quick[-1], quick[0])

def broken(features, found):
    return [1]
"""


def test_a_label_of_ones_own_is_a_function_named_in_the_file(tmp_path: Path) -> None:
    (tmp_path / "mine_own_labels.py").write_text(OWN)
    file = tmp_path / "labels.toml"
    file.write_text(
        '[extraction]\ntrigger = ["fast"]\n[[label]]\nname = "fast"\nfunction = "mine_own_labels:fast"\n'
    )
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 500.0)
    found = features(
        tracks_of(path, [Drive("a", steady(20.0), end=5.0), Drive("b", lambda t: 90.0 + 12.0 * t, end=5.0)]),
        network,
    )
    rules = read_rules(file)
    labels = [
        (m.object, m.label) for m in find_maneuvers(found, rules.settings, rules.own) if m.label == "fast"
    ]
    assert labels == [(0, "fast")]
    file.write_text('[[label]]\nname = "broken"\nfunction = "mine_own_labels:broken"\n')
    rules = read_rules(file)
    with pytest.raises(FunctionError, match="broken"):
        find_maneuvers(found, rules.settings, rules.own)


def test_regions_label_who_passes_one_and_then_another(tmp_path: Path) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 500.0)
    boxes = []
    for s in (50.0, 150.0):
        x, y = path.xy([s - 3.0, s + 3.0, s + 3.0, s - 3.0], [-2.0, -2.0, 2.0, 2.0])
        boxes.append(np.stack([x, y], axis=1).round(3).tolist())
    file = tmp_path / "labels.toml"
    file.write_text(
        "".join(
            f'[[region]]\nname = "{k}"\ncorners = {box}\nmap = "motor*.xodr"\n' for k, box in enumerate(boxes)
        )
        + '[[way]]\nlabel = "turn_right"\nfirst = "0"\nthen = "1"\n[[way]]\nlabel = "back"\nfirst = "1"\nthen = "0"\n'
    )
    rules = read_rules(file)
    found = features(tracks_of(path, [Drive("a", steady(20.0), end=12.0)]), network)
    (way,) = [m for m in find_maneuvers(found, rules.settings) if m.label in ("turn_right", "back")]
    assert way.label == "turn_right"
    assert found.samples.t[[way.start, way.end]] == pytest.approx([53.0 / 20.0, 147.0 / 20.0], abs=0.05)
