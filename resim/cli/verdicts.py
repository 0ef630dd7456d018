"""What an assessment says, in the terminal: the worst of everything, and the verdicts."""

from __future__ import annotations

import io
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from resim.cli.terminal import is_text_wanted, say, visible

if TYPE_CHECKING:
    from resim.metrics.assessment import Worst
    from resim.metrics.criteria import Outcome, Verdict
    from resim.resimulation import ResimulationAssessment


class _Screen(io.StringIO):
    """Text that is meant for standard output, of this process or its parent's."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@contextmanager
def captured(terminal: bool) -> Iterator[io.StringIO]:
    """Give what is printed within as text. terminal: whether a terminal is to show it."""
    with redirect_stdout(_Screen(terminal)) as screen:
        yield screen


class _Plain(Console):
    """A console to which texts are just that: no control characters, no [markup], no :emoji:."""

    def render_str(self, text: str, **how: Any) -> Text:
        """Render a text, of a cell as well as of a line."""
        return super().render_str(visible(text), **how)


def console() -> Console:
    """Give standard output, 120 wide where it is no terminal; what is in names has no effect."""
    width = None if sys.stdout.isatty() else 120
    return _Plain(width=width, markup=False, emoji=False, quiet=not is_text_wanted())


def print_worst(found: ResimulationAssessment) -> None:
    """Print the worst of every measure: value, time and object; a column for each of GT, SD, rGT, rSD."""
    from resim.metrics.measures.definition import KINDS

    table = Table(title=f"{found.name}: the worst of each measure, with time and object")
    table.add_column("measure")
    for name in found.blocks:
        table.add_column(name)
    worst = {name: {w.name: w for w in a.worst()} for name, a in found.blocks.items()}
    kinds = next(iter(found.blocks.values())).kinds
    for kind in KINDS:
        for name in (n for n, k in kinds.items() if k == kind):
            cells = [worst[block].get(name) for block in found.blocks]
            if any(cell is not None for cell in cells):
                table.add_row(name, *map(_worst, cells))
        table.add_section()
    console().print(table)


def print_verdicts(found: ResimulationAssessment) -> None:
    """Print criteria against sources; below, why those that did not pass did not."""
    if found.criteria is None:
        return
    from resim.metrics.criteria import reason_words

    table = Table(title=f"criteria {found.criteria.name!r}: verdict, worst value, time and object")
    table.add_column("criterion")
    for name in found.blocks:
        table.add_column(name)
    if found.model is not None:
        table.add_column("rGT+M")
    for criterion in found.criteria.criteria:
        cells = [_cell(a.verdicts[criterion.name]) for a in found.blocks.values()]
        if found.model is not None:
            cells.append(_seeds(found.model.counts(criterion.name)))
        table.add_row(criterion.name, *cells)
    out = console()
    out.print(table)
    for name, a in found.blocks.items():
        for verdict in a.verdicts.values():
            if verdict.outcome != "PASS":
                told = f"{name}: {verdict.outcome} {verdict.criterion}: {reason_words(verdict)}"
                out.print(told, highlight=False)
    for reason in () if found.model is None else found.model.reasons():
        out.print(f"rGT+M: {reason}", highlight=False)


def print_findings(found: ResimulationAssessment) -> None:
    """Print what is wrong with the recording."""
    for finding in found.findings:
        say(f"finding: {finding}")


def print_notes(found: ResimulationAssessment, told: Collection[str] = ()) -> None:
    """Print what one has to know to compare and believe the values. told: notes that are printed already."""
    for note in found.notes():
        if note not in told:
            say(f"note: {note}")


def _worst(worst: Worst | None) -> str:
    from resim.metrics.criteria import worst_words

    return "–" if worst is None else worst_words(worst.value, worst.unit, worst.t, worst.object)


def _cell(verdict: Verdict) -> str:
    from resim.metrics.criteria import worst_words

    if verdict.value is None or verdict.t is None:
        return f"{verdict.outcome}: {verdict.reason}"
    return f"{verdict.outcome} {worst_words(verdict.value, verdict.unit, verdict.t, verdict.object)}"


def _seeds(counts: Mapping[Outcome, int]) -> str:
    """How many seeds pass, fail, cannot be judged."""
    return ", ".join(f"{outcome} {count}" for outcome, count in counts.items() if count) + " seeds"
