"""The page of a re-simulation, made of real runs on the shipped drives."""

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hostile import FILE, HOSTILE, figures_of, harmless, scripts_of
from lxml import html as parser

from resim.core.finding import Finding
from resim.core.tracks import Tracks
from resim.perception.model import read_model
from resim.recordings import Recording, read_recording
from resim.report import write_report
from resim.resimulation import (
    AssessmentOptions,
    PerceptionSetup,
    Resimulation,
    ResimulationOptions,
    assess_resimulation,
    resimulate,
)
from resim.resimulation.report import provenance
from resim.simulation.function.interface import load_build

ROOT = Path(__file__).parents[2]
PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
NONE = read_model(ROOT / "adfunc" / "perception" / "none.json")


class Page(HTMLParser):
    """What a browser sees of the page: loads, ids, and the text outside of scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self._code = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._code = tag in ("script", "style")
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "data", "action"):
                self.loads.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        self._code = False

    def handle_data(self, data: str) -> None:
        if not self._code:
            self.text += data


def recording(name: str) -> Recording:
    return read_recording(ROOT / "scenarios" / name)


def html(result: Resimulation, folder: Path) -> str:
    write_report(result, assess_resimulation(result, AssessmentOptions()), folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def cut_in() -> Resimulation:
    return resimulate(recording("cut_in_brake"), load_build(PILOT))


@pytest.fixture(scope="module")
def cut_in_html(cut_in: Resimulation, tmp_path_factory: pytest.TempPathFactory) -> str:
    return html(cut_in, tmp_path_factory.mktemp("page"))


def test_one_file_that_loads_nothing(cut_in_html: str) -> None:
    page = Page(cut_in_html)
    assert page.loads == []
    assert "link" not in page.tags
    assert not re.search(r"@import|url\(\s*['\"]?http", cut_in_html.split("<script>")[0])
    library, *_ = scripts_of(parser.fromstring(cut_in_html))
    assert library.count("* plotly.js (cartesian - minified) v4.1.1") == 1
    assert cut_in_html.count('type="application/gzip" id="plotly"') == 1
    assert len(cut_in_html) < 1.5e6


def test_the_provenance_is_a_table_with_a_head_like_the_others(cut_in_html: str) -> None:
    assert (
        '<table class="provenance"><thead><tr><th scope="col">what</th><th scope="col">value</th>'
        in cut_in_html
    )
    assert cut_in_html.count('class="facts"') == 1


def test_same_result_same_bytes(cut_in: Resimulation, cut_in_html: str, tmp_path: Path) -> None:
    assert html(cut_in, tmp_path) == cut_in_html


def test_wall_clock_times_leave_no_trace(cut_in: Resimulation, cut_in_html: str, tmp_path: Path) -> None:
    slower = dataclasses.replace(cut_in, times=dict.fromkeys(cut_in.times, 9.87654))
    assert html(slower, tmp_path) == cut_in_html


def test_every_figure_has_its_own_id(cut_in_html: str) -> None:
    ids = Page(cut_in_html).ids
    assert len(ids) == len(set(ids))
    steps = [f"step-{s}" for s in ("S", "FIT_GT", "FIT_SD", "SIM_GT", "SIM_SD")]
    assert {"plan", "lateral", "distance", "boxes", "reaction-speed", *steps} <= set(ids)


def test_says_what_the_report_says(cut_in: Resimulation, cut_in_html: str) -> None:
    text, report = Page(cut_in_html).text, cut_in.report
    for run in ("rGT", "rSD"):
        change = report.reaction_difference[run]
        assert f"{abs(change):.2f} s {'later' if change > 0 else 'earlier'}" in text
        assert f"{report.reaction[run]:.2f} s" in text
        same = report.decision[run] == report.decision["GT"]
        assert ("= same decision" if same else "≠ different decision") in text
    for who in ("ego", "to"):
        assert f"{report.errors['S'][who]['d']['mean']:.3f}" in text
    assert f"{report.sums['PIPE_SD']['to']['d']['measured']:.4f}" in text
    assert cut_in.hashes["build"] in text


def test_without_sensor_data(tmp_path: Path) -> None:
    bare = dataclasses.replace(
        recording("rear_end"), sd=None, sd_rate=None, sd_gt_id=None, existence_probability=None
    )
    page = Page(html(resimulate(bare, load_build(PILOT)), tmp_path))
    assert "no sensor data" in page.text
    assert "rSD" not in page.text.split("Traces on the road")[0]
    assert "step-S" not in page.ids
    assert "step-SIM_GT" in page.ids


def test_without_traffic_objects(tmp_path: Path) -> None:
    full = recording("rear_end")
    alone = dataclasses.replace(
        full, gt=full.gt.select([full.ego]), sd=None, sd_gt_id=None, existence_probability=None
    )
    page = Page(html(resimulate(alone, load_build(PILOT)), tmp_path))
    assert "with 0 traffic objects" in page.text
    assert {"plan", "boxes", "reaction-speed"} <= set(page.ids)


@pytest.mark.parametrize("basis", ["GT", "SD"])
def test_one_basis(basis: str, tmp_path: Path) -> None:
    options = ResimulationOptions(bases=(basis,))  # type: ignore[arg-type]
    page = Page(html(resimulate(recording("rear_end"), load_build(PILOT), options), tmp_path))
    assert f"step-SIM_{basis}" in page.ids
    assert "not comparable" not in page.text  # the measured drive is there, whatever is re-simulated


FAULTY = """
from resim.simulation.function.interface import Command


class Faulty:
    def __init__(self, at: float) -> None:
        self.at = at

    def reset(self, setup: object) -> None: ...

    def step(self, perceived):
        if perceived.t >= self.at:
            raise ValueError("lost <the> lane")
        return Command(0.0, 0.0)

    def close(self) -> None: ...
"""


@pytest.mark.parametrize("at", [-9.0, 2.0, *(pytest.param(at, marks=pytest.mark.slow) for at in (0.0, 0.04))])
def test_failed_run_is_no_verdict_and_names_are_text(at: float, tmp_path: Path) -> None:
    (tmp_path / "faulty_for_report.py").write_text(FAULTY)
    build = tmp_path / "build.toml"
    build.write_text(
        'name = "<i>odd</i>"\nversion = "1&2"\nfactory = "faulty_for_report:Faulty"\n'
        f"[parameters]\nat = {at}\n"
    )
    named = dataclasses.replace(recording("rear_end"), name="</script><script>alert(1)</script>")
    source = html(resimulate(named, load_build(build)), tmp_path)
    page = Page(source)
    assert "run failed: not comparable" in page.text
    assert set(re.findall(r'class="badge (\w+)"', source)) == {"failed"}
    assert "lost <the> lane" in page.text
    assert "</script><script>alert(1)</script>" in page.text
    assert "alert(1)</script>" not in source
    assert "i" not in page.tags[: page.tags.index("section")]


@pytest.mark.parametrize("at", [-9.0, 2.0, *(pytest.param(at, marks=pytest.mark.slow) for at in (0.0, 0.04))])
def test_seeds_in_which_the_function_fails_decide_nothing_and_say_why(at: float, tmp_path: Path) -> None:
    (tmp_path / "faulty_for_report.py").write_text(FAULTY)
    build = tmp_path / "build.toml"
    build.write_text(
        f'name = "odd"\nversion = "1"\nfactory = "faulty_for_report:Faulty"\n[parameters]\nat = {at}\n'
    )
    result = resimulate(recording("rear_end"), load_build(build), perceiving=PerceptionSetup(NONE, (0, 1)))
    found = result.report.perception
    assert found is not None
    assert found.same_decision == 0
    for one, told in zip(found.seeds, provenance(result, {}).perception.seeds, strict=True):
        assert "lost <the> lane" in str(one.failure) == told.failure
        assert one.end_position_error is None
    text = Page(html(result, tmp_path)).text
    assert "0 of 2 seeds decide as measured" in text
    assert "2 of 2 ended before" in text
    assert ("PIPE_GT+M" in str(figures_of(parser.fromstring(html(result, tmp_path))))) == (at > 0.0)


@pytest.mark.slow
def test_a_perception_model_stands_beside_the_runs_without(cut_in: Resimulation, tmp_path: Path) -> None:
    model = read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")
    seen = PerceptionSetup(model, (0, 1, 2))
    result = resimulate(recording("cut_in_brake"), load_build(PILOT), perceiving=seen)
    source, seeds = html(result, tmp_path), result.report.perception.seeds
    table = source[source.index('<table class="outcome">') :].partition("</table>")[0]
    assert re.findall(r'scope="col">(.*?)</th>', table) == ["", "GT", "rGT", "rSD", "rGT+M"]
    late = sorted(s.reaction_difference for s in seeds)
    assert f"median <b>{late[1]:.2f} s</b> ({late[0]:.2f} to {late[2]:.2f})".replace("-", "−") in table
    off = sorted(s.end_position_error for s in seeds)
    assert f"median <b>{off[1]:.2f} m</b> ({off[0]:.2f} to {off[2]:.2f})" in table
    assert f"{cut_in.report.end_position_error['rGT']:.2f} m" in table
    slower = {name: dataclasses.replace(drive, time=9.87654) for name, drive in result.drives.items()}
    assert html(dataclasses.replace(result, drives=slower), tmp_path) == source


def test_collision_ends_the_run_and_is_said(tmp_path: Path) -> None:
    long = recording("rear_end")
    gt = long.gt
    row = gt.index(next(i for i in gt.ids.tolist() if i != long.ego))
    ego = gt.index(long.ego)
    ahead = gt.x.copy(), gt.y.copy()
    for axis, out in zip((gt.x, gt.y), ahead, strict=True):
        out[row] = axis[row] + 0.55 * (axis[ego, 0] - axis[row, 0])
    near = dataclasses.replace(
        long,
        gt=dataclasses.replace(gt, x=ahead[0], y=ahead[1]),
        sd=None,
        sd_gt_id=None,
        existence_probability=None,
    )
    result = resimulate(near, load_build(ROOT / "adfunc" / "builds" / "constant_velocity-1.0.toml"))
    assert result.report.end["rGT"] == "collision"
    text = Page(html(result, tmp_path)).text
    assert "up to its end at" in text
    assert "TO at " in text


def test_nothing_in_a_recording_a_build_or_a_model_makes_elements(tmp_path: Path) -> None:
    """The whole way: ids in the simulation, the map's file, names, findings, settings."""
    own, build = recording("cut_in_brake"), load_build(PILOT)
    road = tmp_path / f"{FILE}.xodr"
    road.write_bytes(own.map.read_bytes())

    def renamed(tracks: Tracks) -> Tracks:
        return dataclasses.replace(
            tracks.window(0.0, 1.5), ids=np.array([i + HOSTILE for i in tracks.ids.tolist()])
        )

    finding = Finding("odd" + HOSTILE, "warning", "gt", HOSTILE, 0.0, 1.0, 1.0, HOSTILE, HOSTILE, HOSTILE, "")
    evil = dataclasses.replace(
        own, name=HOSTILE, map=road, ego=own.ego + HOSTILE, gt=renamed(own.gt), sd=None, sd_gt_id=None,
        existence_probability=None, plan=None, build=HOSTILE, provenance={HOSTILE: HOSTILE},
        environment={HOSTILE: HOSTILE}, findings=(finding,),
    )  # fmt: skip
    model = NONE.model_copy(update={"name": HOSTILE, "provenance": HOSTILE})
    result = resimulate(
        evil, dataclasses.replace(build, name=HOSTILE, version=HOSTILE),
        perceiving=PerceptionSetup(model, (0,), (HOSTILE,)), accept=("odd" + HOSTILE,),
    )  # fmt: skip
    result = dataclasses.replace(result, warnings=(*result.warnings, HOSTILE))
    page = harmless(html(result, tmp_path))
    assert page.findtext(".//title").startswith("</td><script>")
