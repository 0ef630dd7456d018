"""What others wrote is printed as it is written: no control character, markup or emoji of theirs reaches a terminal."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from conftest import ROOT, Call
from rich.table import Table

from resim.cli.entries import print_list
from resim.cli.terminal import say, visible
from resim.cli.verdicts import console
from resim.results.entry import CatalogEntry

STEERING = "\n\x1b]8;;http://a.b\x07[red]x[/red][link=http://a.b]y[/link]:warning:\x9b31m\r\u202e\x7f"
SHOWN = r"\n\x1b]8;;http://a.b\x07[red]x[/red][link=http://a.b]y[/link]:warning:\x9b31m\r\u202e\x7f"


def test_control_characters_are_written_out_and_everything_else_stays() -> None:
    assert visible(STEERING) == SHOWN
    assert visible("Straße 1 –\t½ 速 [µ] 🚗") == "Straße 1 –\t½ 速 [µ] 🚗"


def test_lines_cells_heads_and_titles_are_told_alike(capsys: pytest.CaptureFixture[str]) -> None:
    say(STEERING)
    say(STEERING, err=True)
    assert tuple(capsys.readouterr()) == (SHOWN + "\n", SHOWN + "\n")
    table = Table(STEERING, title=STEERING)
    table.add_row(STEERING)
    with redirect_stdout(io.StringIO()) as screen:
        console().print(table)
        console().print(STEERING)
    assert screen.getvalue().count(SHOWN) == 4
    assert not set(screen.getvalue()) & set("\x1b\x07\x9b\r\u202e\x7f")


def test_a_name_in_a_list_of_results_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing but the list itself ends a line: a name could look like another result, or a finding."""
    name = "drive\nPASS\u2028PASS\rPASS"
    print_list(
        [
            CatalogEntry(
                "run", name, Path(f"/{name}"), "here", "2026-01-01T00:00:00", "0" * 64, "0.1.0", "PASS"
            )
        ]
    )
    out = capsys.readouterr().out
    assert r"drive\nPASS\u2028PASS\rPASS" in "".join(out.split())
    assert not any(line.lstrip().startswith("PASS") for line in out.splitlines())


def test_the_names_of_an_own_measure_cannot_steer_the_terminal(call: Call, tmp_path) -> None:
    (tmp_path / "steering_measures.py").write_text("def beside(drive, network):\n    return drive.t\n")
    text = json.dumps(STEERING).replace("\\u009b", "\\u009B")
    (tmp_path / "own.toml").write_text(
        f'name = {text}\n[[measure]]\nname = {text}\nfunction = "steering_measures:beside"\nunit = {text}\n'
        f'kind = "quantitative"\nworst = "low"\n[[criterion]]\nname = {text}\nmeasure = {text}\nbelow = 50.0\n'
    )
    code, out, error = call("assess", ROOT / "scenarios" / "overtake", "--criteria", tmp_path / "own.toml")
    assert code == 1
    assert "[red]" in out
    assert not set(out + error) & set("\x1b\x07\x9b\r\u202e\x7f")
