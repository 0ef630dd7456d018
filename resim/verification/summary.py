"""A suite in numbers: how many recordings have which verdict, and what two builds differ in on the whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from resim.resimulation.outcome import COMFORT
from resim.verification.paired import RegressionLimits, difference

VERDICTS = ("verified", "not verified", "undecided", "invalid", "error")
CHANGES = ("same", "changed", "better", "worse", "error")

Entry = Mapping[str, Any]
"""What verification.json holds of a recording."""


def summary(recordings: Sequence[Entry], limits: RegressionLimits | None) -> dict[str, Any]:
    """Give counts by verdict, and whether all is good; limits: of two builds, None for measured against simulated."""
    if limits is not None:
        return _builds(recordings, limits)
    counts = Counter(r["verdict"] for r in recordings)
    causes = Counter(r["cause"]["step"] for r in recordings if r.get("cause"))
    return {
        **{verdict: counts[verdict] for verdict in VERDICTS},
        "causes": dict(sorted(causes.items())),
        "worst": [
            r["name"]
            for verdict in ("not verified", "undecided", "invalid")
            for r in recordings
            if r["verdict"] == verdict
        ],
        "good": counts["verified"] == len(recordings),
    }


def _builds(recordings: Sequence[Entry], limits: RegressionLimits) -> dict[str, Any]:
    counts = Counter(r["verdict"] for r in recordings)
    pairs = {r["name"]: r["pairs"] for r in recordings if r["verdict"] != "error"}
    every = [p for each in pairs.values() for p in each]
    found: dict[str, float | int | None] = {
        "lost": sum(len(p["lost"]) for p in every),
        "changed": sum(p["decisions"][0] != p["decisions"][1] for p in every),
        "risk": max((p["risk"] for p in every if p["risk"] is not None), default=None),
    }
    kept = {
        name: {"value": value, "limit": limit, "kept": limit is None or value is None or value <= limit}
        for name, value in found.items()
        for limit in (getattr(limits, name),)
    }
    risk = difference([[p["risk"] for p in each] for each in pairs.values()])
    comfort = {
        name: difference([[p["comfort"][name] for p in each] for each in pairs.values()]) for name in COMFORT
    }
    return {
        **{change: counts[change] for change in CHANGES},
        "gained": sum(len(p["gained"]) for p in every),
        "limits": kept,
        "risk": None if risk is None else asdict(risk),
        "comfort": {name: None if d is None else asdict(d) for name, d in comfort.items()},
        "worst": [r["name"] for r in ranked(recordings)],
        "good": all(limit["kept"] for limit in kept.values()),
    }


def namesakes(inputs: Entry) -> str:
    """Say that two builds have one name and other code or parameters; "" where they have not."""
    new, old = inputs["build"], inputs["against"]
    if new["label"] != old["label"] or new["hash"] == old["hash"]:
        return ""
    return (
        f"both builds are called {new['label']}, and are not the same: "
        f"the older one has the hash {old['hash'][:12]}, the newer one {new['hash'][:12]}"
    )


def ranked(recordings: Sequence[Entry]) -> list[Entry]:
    """Give the recordings that the new build is worse or otherwise on, the worst first: weight lost, then risk."""

    def badness(entry: Entry) -> tuple[float, float]:
        risks = [p["risk"] for p in entry["pairs"] if p["risk"] is not None]
        return max(p["weight_lost"] for p in entry["pairs"]), max(risks, default=0.0)

    differ = [r for r in recordings if r["verdict"] in ("worse", "changed")]
    return sorted(differ, key=badness, reverse=True)
