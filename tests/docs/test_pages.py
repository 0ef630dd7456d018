"""What the pages say is there is there: files, links, commands, options, tables of columns and measures."""

from __future__ import annotations

import pkgutil
import re
import sys
from pathlib import Path

import draw_layers
import generated
import library_reference
import pages
import pytest
import yaml
from field_tables import schema
from pages import DOCS, PAGES, ROOT

from resim import __version__
from resim.cli import inputs
from resim.core.schema import COLUMNS, EXISTENCE, GT_ID, OPTIONAL_COLUMNS, PLAN_COLUMNS, REPAIRED, TOLD
from resim.core.tracks import KINDS
from resim.metrics.measures.registry import MEASURES

NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
WORKFLOW = DOCS / "examples" / "verify.yml"
MADE = ("scenarios/training", "scenarios/us101")
"""Folders that tools make."""


def first_column(page: Path, after: str) -> list[str]:
    """The code in the first column of the first table after a text."""
    table = re.search(r"(?:^\|.*\n)+", pages.text(page).partition(after)[2], re.MULTILINE)
    assert table is not None
    return [name for row in table[0].splitlines() for name in re.findall(r"`([^`]+)`", row.split("|")[1])]


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)]*))?\)", pages.text(page)):
        to = (page.parent / target).resolve() if target else page
        assert to.exists(), target
        if anchor:
            assert anchor in pages.anchors(to), (target, anchor)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_files_that_are_named_are_there(page: Path) -> None:
    for path in re.findall(
        r"(?<![\w/.])(?:scenarios|adfunc|networks|tools|resim|tests)/[\w./-]*\w", pages.text(page)
    ):
        new = page.parent.name == "extend" and path in pages.named(page, "python")
        assert (ROOT / path).exists() or path.startswith(MADE) or new, path


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_are_taken_as_they_stand(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(inputs, "_look", lambda look, path: None)  # what commands before it made is not there
    monkeypatch.setattr(sys.modules["resim.cli.app"], "unknown_vehicle", lambda name: "")  # a page adds one
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for words in [] if page.stem == "validation" else pages.commands(page):  # it has loops of the shell
        match words:
            case ["resim", *rest]:
                command, arguments = pages.command_of(rest)
                command.make_context("resim", arguments, **pages.SETTINGS)
            case ["make", target]:
                assert target in targets
            case [program, *_]:
                assert program in ("python", "ls", "c++", "docker"), words


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_code_that_is_named_is_there(page: Path) -> None:
    for name in re.findall(r"`(resim(?:\.\w+)+)", pages.text(page)):
        pkgutil.resolve_name(name)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_options_in_the_text_exist(page: Path) -> None:
    for words in pages.inline(page):
        command, _ = pages.command_of(words[1:])
        known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {
            "--help",
            "--version",
        }
        assert {w.partition("=")[0] for w in words if w.startswith("--")} <= known, words


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda p: p.stem)
def test_what_is_made_from_the_code_can_be_made(page: Path) -> None:
    said = pages.text(page)
    made = generated.fill(said, page.relative_to(DOCS).with_suffix("").as_posix())
    markers = re.compile("<!-- (?:generated|end of generated|on the site)")
    assert not markers.search(made)
    regions = len(
        re.findall("^<!-- generated: .*\n(?:(?!<!--).*\n)*<!-- end of generated -->$", said, re.MULTILINE)
    )
    alone = len(re.findall("^<!-- on the site: .* -->$", said, re.MULTILINE))
    assert len(markers.findall(said)) == 2 * regions + alone


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda p: p.stem)
def test_what_a_page_has_of_the_code_is_what_the_code_says_now(page: Path) -> None:
    said = pages.text(page)
    assert said == generated.written(said), f"write it anew: {generated.COMMAND}"


def test_the_site_has_the_headings_of_the_library_that_links_lead_to() -> None:
    heads = (
        re.findall(r"^## .*$", made(), re.MULTILINE)
        for made in (library_reference.api, library_reference.api_on_the_site)
    )
    listed, shown = heads
    assert listed == shown


def test_the_interface_of_functions_is_shown_in_full() -> None:
    shown = generated.PARTS["api"]("")
    assert "    route: Route = NO_ROUTE\n" in shown
    assert "`needs_truth = True`, as oracles do." in shown
    assert "        heading: ArrayLike | None = None,\n" in shown
    assert "def _" not in shown


def test_the_index_leads_to_every_page() -> None:
    linked = set(re.findall(r"\]\(([^)]+\.md)\)", pages.text(DOCS / "index.md")))
    assert linked >= {p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")} - {"index.md"}


def test_the_picture_of_the_layers_is_that_of_the_contracts() -> None:
    said = "draw it again: python docs/draw_layers.py"
    assert draw_layers.PICTURE.read_text() == draw_layers.picture(draw_layers.layers()), said


def test_a_field_table_says_what_docstrings_say() -> None:
    table = generated.schema("suite")
    assert '| `bases` | list of `"GT"`, `"SD"` | `["GT", "SD"]` | what is re-simulated |' in table
    assert (
        "| `agreement` | number, ≥ 0.5, ≤ 0.99 | `0.9` | more than this share of the seeds must agree"
        in table
    )


def test_every_measure_has_a_name_of_its_own_a_unit_and_a_source() -> None:
    assert len({measure.name for measure in MEASURES}) == len(MEASURES)
    rows = generated.measures().splitlines()[2:]
    assert [re.findall("`(.+?)`", row) for row in rows] == [[measure.name] for measure in MEASURES]
    assert all(cell.strip() for row in rows for cell in row.strip("|").split("|"))


def test_the_columns_of_a_recording_are_all_described() -> None:
    page = DOCS / "formats" / "recording.md"
    every = [*COLUMNS, *reversed(OPTIONAL_COLUMNS), GT_ID, EXISTENCE, REPAIRED, *TOLD.values()]
    assert sorted(first_column(page, "## `gt` and `sd`")) == sorted(every)
    assert first_column(page, "## `plan`") == list(PLAN_COLUMNS)
    assert all(f"`{kind}`" in pages.text(page) for kind in KINDS)


def test_the_index_of_tools_is_complete() -> None:
    tools = ROOT / "tools"
    there = {p.relative_to(tools).as_posix() for p in [*tools.glob("*.*"), *tools.glob("bench/*.py")]} - {
        "README.md"
    }
    named = re.findall(r"^\| `([^`]+)`", pages.text(tools / "README.md"), re.MULTILINE)
    assert sorted(named) == sorted(there | {"fuzzing/"})


def test_the_example_workflow_runs_commands_that_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inputs, "_look", lambda look, path: None)  # it is of another project
    steps = yaml.safe_load(WORKFLOW.read_text())["jobs"]["verify"]["steps"]
    (run,) = (step["run"] for step in steps if step.get("run", "").startswith("resim "))
    command, arguments = pages.command_of(run.split()[1:])
    out = Path(command.make_context("verify", arguments, **pages.SETTINGS).params["out"])
    assert [step["with"]["path"] for step in steps if "path" in step.get("with", {})] == [
        str(out / "junit.xml"),
        str(out),
    ]


def test_the_readme_is_short() -> None:
    assert (ROOT / "README.md").stat().st_size < 8000


def test_the_citation_is_of_this_version() -> None:
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == __version__


def test_nothing_is_installed_from_the_index_under_our_name() -> None:
    """There, resim is somebody else's package."""
    for path in [*PAGES, WORKFLOW, *(ROOT / "resim").rglob("*.py")]:
        assert not re.search(r"pip install\s+(-\S+\s+)*['\"]?resim\b", path.read_text(encoding="utf-8")), path


def test_fields_that_a_docstring_has_as_attributes_have_a_meaning_in_the_table() -> None:
    shown = schema("mapping")
    assert "Attributes:" not in shown
    assert "| field | type | default | meaning |" in shown
    assert re.search(
        r"^\| `gate` \| .* \| Farthest \[m\] that an SD object may be from its GT", shown, re.MULTILINE
    )
