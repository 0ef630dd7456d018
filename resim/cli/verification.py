"""What a verification says, in the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from resim.cli.verdicts import console
from resim.resimulation.notes import OF_BUILD
from resim.verification.summary import VERDICTS, namesakes

Entry = Mapping[str, Any]


def print_verification(found: Mapping[str, Any]) -> None:
    """Print one row a recording, why those that are not good are not, and the summary."""
    if found["inputs"]["against"] is None:
        _verified(found)
    else:
        _compared(found)


def _verified(found: Mapping[str, Any]) -> None:
    table = Table(
        title=f"{found['inputs']['name']}: {found['inputs']['build']['label']}, simulated against measured"
    )
    for column in ("recording", "verdict", "by", "agrees", "decision measured", "first braking", "cause"):
        table.add_column(column)
    for r in found["recordings"]:
        if "way" not in r:
            table.add_row(r["name"], r["verdict"], "", "", "", "", "")
            continue
        way = r["ways"][r["way"]]
        table.add_row(
            r["name"], r["verdict"], r["way"], _equal(r), ", ".join(r["decision"]["GT"]) or "–",
            _reaction(way, r.get("reaction_spread")),
            "" if r["cause"] is None else r["cause"]["step"],
        )  # fmt: skip
    out = console()
    out.print(table)
    _print_errors(found, out)
    for r in found["recordings"]:
        if r["error"] is None and r["cause"] is not None:
            when = "" if r["cause"]["t"] is None else f" at {r['cause']['t']:.1f} s"
            out.print(
                f"{r['name']}: {r['verdict']}{when}: {r['cause']['step']}: {r['cause']['text']}",
                highlight=False,
            )
        _print_notes(r, out)
        for v in r.get("validity", []):
            out.print(f"{r['name']}: {_range(v)}", highlight=False)
    told = found["summary"]
    counts = ", ".join(f"{told[name]} {name}" for name in VERDICTS)
    out.print(f"{len(found['recordings'])} recordings: {counts}", highlight=False)


def _print_notes(r: Entry, out: Console) -> None:
    """Which code the verdict is not of."""
    for note in (n for n in r.get("notes", ()) if n.endswith(OF_BUILD)):
        out.print(f"{r['name']}: note: {note}", highlight=False)


def _print_errors(found: Mapping[str, Any], out: Console) -> None:
    """What is wrong with the recordings, and what is broken, apart from what is not good."""
    for r in found["recordings"]:
        for finding in r.get("findings", ()):
            out.print(f"{r['name']}: finding: {finding}", highlight=False)
        if r["error"] is not None:
            out.print(f"{r['name']}: error: {r['error']}", highlight=False)


def _equal(r: Entry) -> str:
    """How many KPIs are equal; over seeds in the share that the suite asks for."""
    way = r["way"]
    equal = [kpi["equal"][way] for kpi in r["kpis"].values()]
    if way == "rGT+M":
        share = r["ways"][way]["share"]
        return f"{share['count']} of {share['of']} seeds [{share['low']:.2f}, {share['high']:.2f}]"
    return f"{equal.count('equal')} of {len(equal)}"


def _reaction(way: Entry, off: float | None) -> str:
    late = (
        [s["reaction_difference"] for s in way["seeds"]] if "seeds" in way else [way["reaction_difference"]]
    )
    known = sorted(value for value in late if value is not None)
    if not known:
        return "–"
    if len(known) == 1:
        return f"{known[0]:+.2f} s" if off is None else f"{known[0]:+.2f} ± {off:.2f} s"
    return f"{known[len(known) // 2]:+.2f} s, {known[0]:+.2f} to {known[-1]:+.2f}"


def _range(v: Entry) -> str:
    ends = [
        f"{end['amount']:+.3g} {v['unit']} ({'then ' + ', '.join(end['flips']) if end['flips'] else 'as far as tried'})"
        for end in (v["low"], v["high"])
    ]
    return f"{v['parameter']} of object {v['object']}: no KPI flips from {ends[0]} to {ends[1]}"


def _compared(found: Mapping[str, Any]) -> None:
    inputs, told = found["inputs"], found["summary"]
    table = Table(title=f"{inputs['name']}: {inputs['build']['label']} against {inputs['against']['label']}")
    for column in ("recording", "verdict", "KPIs lost", "KPIs gained", "decisions changed", "risk", "from"):
        table.add_column(column)
    by_name = {r["name"]: r for r in found["recordings"]}
    order = [*told["worst"], *(n for n in by_name if n not in told["worst"])]
    for r in (by_name[name] for name in order):
        if "pairs" not in r:
            table.add_row(r["name"], r["verdict"], *[""] * 5)
            continue
        pairs = r["pairs"]
        lost, gained = (sorted({name for p in pairs for name in p[key]}) for key in ("lost", "gained"))
        changed = sum(p["decisions"][0] != p["decisions"][1] for p in pairs)
        risks = [p["risk"] for p in pairs if p["risk"] is not None]
        table.add_row(
            r["name"], r["verdict"], ", ".join(lost), ", ".join(gained), f"{changed} of {len(pairs)}",
            f"{max(risks, key=abs):+.3f}" if risks else "–", "" if r["t"] is None else f"{r['t']:.1f} s",
        )  # fmt: skip
    out = console()
    out.print(table)
    if same := namesakes(inputs):
        out.print(f"note: {same}", highlight=False)
    _print_errors(found, out)
    for r in found["recordings"]:
        _print_notes(r, out)
    risk = told["risk"]
    if risk is not None:
        between = "" if risk["low"] is None else f" [{risk['low']:+.4f}, {risk['high']:+.4f}]"
        out.print(
            f"largest risk, new less old, mean over {risk['of']} recordings: {risk['mean']:+.4f}{between}",
            highlight=False,
        )
    counts = ", ".join(f"{told[name]} {name}" for name in ("same", "changed", "better", "worse", "error"))
    out.print(f"{len(found['recordings'])} recordings: {counts}", highlight=False)
