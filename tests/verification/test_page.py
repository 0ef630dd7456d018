"""The page of a verification, and its JUnit XML."""

from __future__ import annotations

import copy
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from hostile import HOSTILE, harmless, poisoned
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from lxml import etree, html

from resim.core.json_text import json_text
from resim.core.spec import from_json, to_json
from resim.verification.cases import Traces
from resim.verification.execution import verify
from resim.verification.junit import junit
from resim.verification.page import write_verification_page
from resim.verification.page.axes import SEEN, seen, ticks
from resim.verification.report import VerificationReport
from resim.verification.request import VerifyOptions, make_request
from resim.verification.suite import read_suite

BUILDS = ROOT / "adfunc" / "builds"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
PILOT, BLIND = BUILDS / "highway_pilot-1.0.toml", BUILDS / "constant_velocity-1.0.toml"
SCHEMA = Path(__file__).with_name("junit-10.xsd")
SUITE = """name = "try <this>"
criteria = "{root}/scenarios/criteria/highway.toml"
driven_by = ["constant_velocity-1.0"]
agreement = 0.5
recording = [{{folder = "{root}/scenarios/cut_in_brake"}}, {{folder = "{root}/scenarios/rear_end"}},
             {{folder = "broken"}}]
"""
RANGE = {
    "parameter": "gap", "unit": "m", "object": "<1>", "resolution": 0.25, "tried": 11, "agreement": 0.9,
    "low": {"amount": -6.5625, "flips": ["accident risk", "time headway"], "others": ["the EGO collides"]},
    "high": {"amount": 30.0, "flips": [], "others": []},
}  # fmt: skip


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    folder = tmp_path_factory.mktemp("suite")
    shutil.copytree(ROOT / "scenarios" / "overtake", folder / "broken")
    settings = (folder / "broken" / "recording.toml").read_text(encoding="utf-8")
    settings = re.sub(r'(?m)^map = ".*"$', 'map = "no<where>.xodr"', settings)
    (folder / "broken" / "recording.toml").write_text(settings, encoding="utf-8")
    (folder / "suite.toml").write_text(SUITE.format(root=ROOT), encoding="utf-8")
    return read_suite(folder / "suite.toml")


def as_json(found, traces):
    """What was found as JSON, to be changed."""
    return json.loads(json_text(to_json(found))), {name: to_json(one) for name, one in traces.items()}


def report(found):
    return from_json(found, VerificationReport, Path("verification.json"), "resim verify", "")


def drawn(found, traces, path):
    """The page of JSON."""
    speeds = {name: from_json(one, Traces, path, "resim verify", "") for name, one in traces.items()}
    write_verification_page(report(found), speeds, path)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def measured(suite, tmp_path_factory):
    """A corner case of which GT with the model agrees or not, a drive of another build, and a broken recording."""
    out = tmp_path_factory.mktemp("measured")
    wanted = make_request(suite, PILOT, None, VerifyOptions(perception=MODEL, seeds=5), out)
    return as_json(*verify(wanted, out, out, workers=1))


@pytest.fixture(scope="module")
def builds(suite, tmp_path_factory):
    out = tmp_path_factory.mktemp("builds")
    wanted = make_request(suite, BLIND, PILOT, VerifyOptions(), out)
    return as_json(*verify(wanted, out, out, workers=1))


@pytest.fixture
def write(tmp_path):
    """Write the page; gives its text and its document."""

    def page(found, traces):
        text = drawn(found, traces, tmp_path / "page.html")
        return text, html.fromstring(text)

    return page


def by_name(found):
    return {r["name"]: r for r in found["recordings"]}


def select(element, path):
    """What a path of tags and classes leads to, such as `.overview tbody tr`."""
    found = "."
    for step in path.split():
        tag, _, css = step.partition(".")
        has = f"[contains(concat(' ', @class, ' '), ' {css} ')]" if css else ""
        found += f"//{tag or '*'}{has}"
    return element.xpath(found)


def words(element):
    """The text, with a space between the cells of a table."""
    for cell in element.iter("th", "td"):
        cell.text = f" {cell.text or ''}"
    return " ".join(element.text_content().split())


def part(document, name):
    """The part of a recording, by the link that leads to it."""
    (row,) = (r for r in select(document, ".overview tbody tr") if select(r, "a")[0].text == name)
    return row, document.get_element_by_id(select(row, "a")[0].get("href")[1:])


def test_same_verification_same_bytes_and_all_is_in_the_file(measured, builds, write):
    for found, traces in (measured, builds):
        text, document = write(found, traces)
        assert write(copy.deepcopy(found), traces)[0] == text
        assert not document.xpath("//@src | //link")
        assert {href for href in document.xpath("//@href") if "://" in href} == set()
        assert text.count("<script") == 2  # the filters, and what looks after the tables


def test_what_needs_attention_is_first_and_filters_know_each_verdict(measured, write):
    found, traces = measured
    _, document = write(found, traces)
    rows = select(document, ".overview tbody tr")
    verdicts = [row.get("data-verdict") for row in rows]
    order = ["error", "not verified", "undecided", "invalid", "verified"]
    assert verdicts == sorted(verdicts, key=order.index)
    assert len(verdicts) == 3
    counts = {b.get("data-verdict"): words(b) for b in select(document, "button")}
    assert counts == {v: f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)}


def test_a_recording_tells_its_cause_its_kpis_and_its_errors(measured, write):
    found, traces = measured
    _, document = write(found, traces)
    entry = by_name(found)["rear_end"]
    row, detail = part(document, "rear_end")
    assert entry["verdict"] == "not verified"
    assert words(row).endswith(f"{entry['cause']['step']} {entry['cause']['t']:.1f} s")
    said = words(detail)
    assert f"First cause: {entry['cause']['step']}, from {entry['cause']['t']:.1f} s" in said
    for text in entry["ways"]["rGT+M"]["seeds"][0]["differences"]:
        assert text in said
    kpis = select(detail, ".kpis tbody tr")
    assert len(kpis) == len(entry["kpis"])
    off = entry["kpis"]["accident risk"]["difference"]["rGT+M"]
    assert words(kpis[list(entry["kpis"]).index("accident risk")]).endswith(f"{off:+.2g}".replace("-", "−"))
    marked = {tr[0].text.strip() for tr in kpis if select(tr[3], ".off")}
    assert marked == {n for n, kpi in entry["kpis"].items() if kpi["equal"]["rGT"] != "equal"}
    speed = entry["errors"]["PIPE_GT"]["ego"]["v"]
    assert f"> {speed:.3f}" in [words(off) for off in select(detail, ".rms .off")]
    assert f"{entry['errors']['S']['to']['v']:.3f}" in words(select(detail, ".rms")[0])
    assert [a.get("href") for a in select(detail, "a")] == [entry["drive"], *entry["reports"]]
    assert entry["reports"] == ["reports/rear_end.html"]


def test_a_broken_limit_is_told_with_its_measure_its_moment_and_its_object(measured, write):
    found, traces = measured
    _, document = write(found, traces)
    _, detail = part(document, "cut_in_brake")
    kpi = by_name(found)["cut_in_brake"]["kpis"]["distance"]["GT"]
    assert (kpi["verdict"], kpi["object"]) == ("FAIL", "1")
    assert kpi["reason"] == "tailgating above 0 s for 2.7 s"
    (row,) = (tr for tr in select(detail, ".kpis tbody tr") if tr[0].text.strip() == "distance")
    assert words(row[1]) == "FAIL 2.7 at 9.2 s, object 1 tailgating above 0 s for 2.7 s"


def test_the_figure_has_every_drive_first_braking_and_the_second(measured, write):
    found, traces = measured
    _, document = write(found, traces)
    _, detail = part(document, "rear_end")
    (figure,) = select(detail, "figure")
    drawn = [path.get("class") for path in select(figure, "path")]
    assert {"gt", "rgt", "rsd", "m", "area m", "mark"} <= set(drawn)
    assert words(figure).count("first difference") == 1
    assert [c.get("class") for c in select(figure, "circle")] == [
        "rgt",
        "rsd",
        "m",
    ]  # the drive did not brake
    assert [words(k) for k in select(figure, ".k")][:3] == ["GT", "rGT", "rSD"]


def test_errors_are_apart_and_have_a_row(measured, builds, write):
    for found, traces in (measured, builds):
        text, document = write(found, traces)
        (box,) = select(document, ".errors")
        assert "broken: " in words(box)
        assert "no<where>.xodr" in words(box)
        assert "no<where>" not in text
        row, detail = part(document, "broken")
        assert row.get("data-verdict") == "error"
        assert words(row).startswith("broken error")
        assert not select(detail, "figure")


def test_without_a_report_the_command_that_makes_it(measured, write):
    found, traces = copy.deepcopy(measured)
    entry = by_name(found)["cut_in_brake"]
    entry["reports"] = []
    entry["folder"] = "drives/cut in"
    found["inputs"]["settings"] = ["latency.speed=0.4"]
    _, document = write(found, traces)
    command = words(select(part(document, "cut_in_brake")[1], "pre")[0])
    assert command.startswith("resim run 'drives/cut in' --build ")
    assert "--seeds 5 --seed 0 --set latency.speed=0.4" in command
    assert command.endswith("--out ../cut_in_brake.highway_pilot-1.0")


def test_local_validity_is_told_as_no_more_than_it_is(measured, write):
    found, traces = copy.deepcopy(measured)
    by_name(found)["cut_in_brake"]["validity"] = [RANGE]
    _, document = write(found, traces)
    detail = part(document, "cut_in_brake")[1]
    said = words(detail)
    assert "more than 0.9 of the seeds: each variation passed the test by which" in said
    assert "one real re-check at its end would legitimise, and no further (Groh 2018, III.C)" in said
    (row,) = select(detail, ".ranges tbody tr")
    assert words(row[0]) == "gap of object <1>"
    assert words(row[1]) == "−6.56 m then accident risk, time headway flip; the EGO collides"
    assert words(row[3]) == "+30 m no KPI flips in the tested range"
    assert [p.get("class") for p in select(row, "path")] == ["grid", "held", "frame", "stop", "open"]


def test_text_from_files_is_text(measured, write):
    found, traces = copy.deepcopy(measured)
    evil = "<script>alert('&')</script>"
    entry = by_name(found)["cut_in_brake"]
    entry["notes"] = [evil]
    entry["kpis"] = {evil + name: kpi for name, kpi in entry["kpis"].items()}
    entry["cause"] = {"step": "sensor", "text": evil, "t": None}
    found["inputs"]["build"]["label"] = evil
    text, document = write(found, traces)
    assert text.count("<script") == 2
    assert evil in words(part(document, "cut_in_brake")[1])
    assert select(document, "h1")[0].text == "try <this>"


def test_runs_that_came_to_nothing_are_dashes(measured, write):
    found, traces = copy.deepcopy(measured)
    entry = by_name(found)["cut_in_brake"]
    entry |= {"verdict": "error", "error": "decide() raised ValueError('boom')", "cause": None}
    for kpi in entry["kpis"].values():
        kpi["rGT"], kpi["rGT+M"] = None, [None] * 5
    for seed in entry["ways"]["rGT+M"]["seeds"]:
        seed |= {"errors": None, "verdict": "error", "failure": "boom"}
    nothing = [None] * len(traces["cut_in_brake"]["t"])
    traces["cut_in_brake"] |= {"rGT": nothing, "rGT+M": [nothing] * 5}
    _, document = write(found, traces)
    row, detail = part(document, "cut_in_brake")
    assert row.get("data-verdict") == "error"
    assert "boom" in words(detail)
    assert words(select(detail, ".kpis tbody tr")[0][3]) == "–"


def test_build_against_build_worst_first_with_both_reports(builds, write):
    found, traces = builds
    _, document = write(found, traces)
    names = [select(row, "a")[0].text for row in select(document, ".overview tbody tr")]
    assert names == ["broken", *found["summary"]["worst"]]
    assert "highway_pilot-1.0" in words(select(document, ".facts")[0])
    limits = words(select(document, ".limits")[0])
    assert f"KPIs lost in all runs {found['summary']['limits']['lost']['value']} 0 exceeded" in limits
    mean = found["summary"]["risk"]
    assert f"largest risk {mean['mean']:+.4f}" in words(select(document, ".limits")[1])
    entry = by_name(found)["rear_end"]
    row, detail = part(document, "rear_end")
    assert words(row).startswith("rear_end worse no collision, accident risk, time to collision")
    assert f"from {entry['t']:.1f} s" in words(detail)
    for text in entry["differences"]:
        assert text in words(detail)
    assert [a.get("href") for a in select(detail, "a")] == [entry["drive"], *entry["reports"]]
    drawn = [path.get("class") for path in select(detail, "figure path")]
    assert {"before", "now", "thin", "mark"} <= set(drawn)


def test_a_suite_of_a_hundred_stays_small(measured, write):
    found, traces = copy.deepcopy(measured)
    entry, speeds = by_name(found)["cut_in_brake"], traces["cut_in_brake"]
    entry["ways"]["rGT+M"]["seeds"] *= 4
    for kpi in entry["kpis"].values():
        kpi["rGT+M"] *= 4
    names = [f"drive_{k}" for k in range(100)]
    found["recordings"] = [{**entry, "name": name} for name in names]
    found["inputs"]["recordings"] = dict.fromkeys(names, found["inputs"]["recordings"]["cut_in_brake"])
    text, _ = write(found, {name: {**speeds, "rGT+M": speeds["rGT+M"] * 4} for name in names})
    assert len(text.encode()) < 1.2e6  # of which 0.66e6 draw the figures


@given(arrays(float, st.integers(2, 60), elements=st.floats(-200.0, 200.0)))
def test_points_left_out_of_a_curve_cannot_be_seen(y):
    x = np.arange(len(y)) * 5.0
    kept = seen(x, y)
    assert kept[0] == 0
    assert kept[-1] == len(y) - 1
    for k in range(len(y)):
        ends = np.clip(np.searchsorted(kept, k, side="left"), 1, len(kept) - 1)
        a, b = kept[ends - 1], kept[ends]
        along, up = x[b] - x[a], y[b] - y[a]
        assert abs(along * (y[k] - y[a]) - up * (x[k] - x[a])) / np.hypot(along, up) <= SEEN + 1e-6


@pytest.mark.parametrize(
    ("span", "expected"),
    [
        ((0.0, 9.2), [0, 2, 4, 6, 8]),
        ((-0.5, 0.5), [-0.4, -0.2, 0, 0.2, 0.4]),
        ((15.5, 24.2), [16, 18, 20, 22, 24]),
    ],
)
def test_ticks_are_round(span, expected):
    assert ticks(*span) == pytest.approx(expected)


@pytest.fixture(scope="module")
def schema():
    return etree.XMLSchema(etree.parse(SCHEMA))


def cases(found, schema):
    """The test cases by name, of JUnit that fits its schema and whose counts are right."""
    root = etree.fromstring(junit(found).encode())
    schema.assertValid(root)
    (suite,) = root
    for what in ("failure", "error"):
        assert (
            int(suite.get(f"{what}s")) == int(root.get(f"{what}s")) == len(suite.findall(f"testcase/{what}"))
        )
    assert int(suite.get("tests")) == len(suite.findall("testcase"))
    return {case.get("name"): case for case in suite.findall("testcase")}


def test_junit_has_failures_and_errors_apart(measured, schema):
    found, _ = measured
    each = cases(report(found), schema)
    entry = by_name(found)["rear_end"]
    assert [child.tag for child in each["rear_end"]] == ["failure"]
    failure = each["rear_end"][0]
    assert failure.get("type") == "not verified"
    assert failure.get("message").startswith(
        f"not verified, from {entry['cause']['t']:.1f} s: {entry['cause']['step']}"
    )
    for seed in entry["ways"]["rGT+M"]["seeds"]:
        assert all(text in failure.text for text in seed["differences"])
    assert "report: reports/rear_end.html" in failure.text
    assert [child.tag for child in each["broken"]] == ["error"]
    assert each["broken"][0].get("type") == "broken recording"
    assert "no<where>.xodr" in each["broken"][0].get("message")
    properties = {p.get("name"): p.get("value") for p in each["broken"].getparent().iter("property")}
    assert properties["build.sha256"] == found["inputs"]["build"]["hash"]
    assert properties["recording.rear_end.sha256"] == entry["hash"]


def test_junit_of_builds_fails_where_limits_are_broken(builds, schema):
    found, _ = builds
    each = cases(report(found), schema)
    worse = each["rear_end"].find("failure")
    assert worse.get("message").startswith(
        f"worse, from {by_name(found)['rear_end']['t']:.1f} s: no collision: PASS"
    )
    assert each["limit: lost"].find("failure").get("message").startswith("lost: ")
    kept = copy.deepcopy(found)
    kept["summary"]["good"] = True
    for limit in kept["summary"]["limits"].values():
        limit |= {"kept": True, "limit": 99}
    each = cases(report(kept), schema)
    assert [name for name, case in each.items() if len(case)] == ["broken"]


def test_junit_says_crashed_where_the_function_did_and_survives_control_characters(measured, schema):
    json_of = copy.deepcopy(measured[0])
    json_of["inputs"]["name"] = "a\x07b"
    found = report(json_of)
    (entry,) = (r for r in found.recordings if r.name == "cut_in_brake")
    failed = replace(entry, verdict="error", error="boom \x00\x1b[31m\ud800 \U0001f600", cause=None)
    error = cases(replace(found, recordings=(failed,)), schema)["cut_in_brake"].find("error")
    assert error.get("type") == "crashed"
    assert error.get("message") == "boom \ufffd\ufffd[31m\ufffd \U0001f600"


OURS = {"verdict", "way", "who", "quantity", "bases", "tolerances", "errors", "summary", "equal", "difference", "ways",
        "reaction", "driven", "step", "schema"}  # fmt: skip
"""What the page looks up in tables of its own, and numbers by such names."""
NAMED = {"kpis", "versions", "recordings", "comfort"}


@pytest.mark.parametrize("kind", ["measured", "builds"])
def test_nothing_in_a_verification_makes_elements(kind, request, tmp_path):
    found, traces = request.getfixturevalue(kind)
    evil = poisoned(found, OURS, NAMED)
    evil["summary"] = copy.deepcopy(found["summary"])
    evil["summary"]["worst"] = [name + HOSTILE for name in found["summary"].get("worst", [])]
    evil["recordings"] = poisoned(found["recordings"], OURS, NAMED)
    for r, was in zip(evil["recordings"], found["recordings"], strict=True):
        if "ways" in was:
            r["ways"] = poisoned(was["ways"], {"verdict", "who", "quantity", "step"})
            r["way"], r["comfort"] = was["way"], was["comfort"]
        r["reports"] = ["javascript:alert(1)"] * 2
        if "notes" in r:
            r["notes"] = [HOSTILE]
        if "validity" in r:
            r["validity"] = [{**RANGE, "parameter": HOSTILE, "unit": HOSTILE, "object": HOSTILE}]
    speeds = {name + HOSTILE: one for name, one in traces.items()}
    harmless(drawn(evil, speeds, tmp_path / "page.html"))
    root = etree.fromstring(junit(report(evil)).encode())
    assert {e.tag for e in root.iter()} <= {
        "testsuites", "testsuite", "properties", "property", "testcase", "failure", "error",
    }  # fmt: skip
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", junit(report(evil)))
