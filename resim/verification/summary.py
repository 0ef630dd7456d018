"""A suite in numbers: how many recordings have which verdict, and what two builds differ in on the whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from resim.resimulation.drive_outcome import COMFORT
from resim.verification.entries import ComparedRecording, VerifiedRecording
from resim.verification.inputs import VerificationRequest
from resim.verification.limits import RegressionLimits
from resim.verification.paired import RunPair, difference
from resim.verification.report import (
    ComparisonSummary,
    LimitCheck,
    RecordingResult,
    Summary,
    VerificationSummary,
)


def summary(recordings: Sequence[RecordingResult], limits: RegressionLimits | None) -> Summary:
    """Give counts by verdict, and whether all is good; limits: of two builds, None for measured against simulated."""
    if limits is not None:
        return _builds(recordings, limits)
    counts = Counter(r.verdict for r in recordings)
    causes = Counter(r.cause.step for r in recordings if isinstance(r, VerifiedRecording) and r.cause)
    return VerificationSummary(
        verified=counts["verified"],
        not_verified=counts["not verified"],
        undecided=counts["undecided"],
        invalid=counts["invalid"],
        error=counts["error"],
        causes=dict(sorted(causes.items())),
        worst=tuple(
            r.name
            for verdict in ("not verified", "undecided", "invalid")
            for r in recordings
            if r.verdict == verdict
        ),
        good=counts["verified"] == len(recordings),
    )


def _builds(recordings: Sequence[RecordingResult], limits: RegressionLimits) -> ComparisonSummary:
    counts = Counter(r.verdict for r in recordings)
    pairs = [r.pairs for r in compared(recordings) if r.verdict != "error"]
    every = [p for each in pairs for p in each]
    kept = _limits(every, limits)
    return ComparisonSummary(
        same=counts["same"],
        changed=counts["changed"],
        better=counts["better"],
        worse=counts["worse"],
        error=counts["error"],
        gained=sum(len(p.gained) for p in every),
        limits=kept,
        risk=difference([[p.risk for p in each] for each in pairs]),
        comfort={name: difference([[p.comfort[name] for p in each] for each in pairs]) for name in COMFORT},
        worst=tuple(r.name for r in ranked(recordings)),
        good=all(limit.kept for limit in kept.values()),
    )


def _limits(pairs: Sequence[RunPair], limits: RegressionLimits) -> dict[str, LimitCheck]:
    """What was found beside each limit of the suite, by its name."""
    found: dict[str, tuple[float | None, float | None]] = {
        "lost": (sum(len(p.lost) for p in pairs), limits.lost),
        "changed": (sum(p.changed for p in pairs), limits.changed),
        "risk": (max((p.risk for p in pairs if p.risk is not None), default=None), limits.risk),
    }
    return {
        name: LimitCheck(value, limit, limit is None or value is None or value <= limit)
        for name, (value, limit) in found.items()
    }


def namesakes(inputs: VerificationRequest) -> str:
    """Say that two builds have one name and other code or parameters; "" where they have not."""
    new, old = inputs.build, inputs.against
    if old is None or new.label != old.label or new.hash == old.hash:
        return ""
    return (
        f"both builds are called {new.label}, and are not the same: "
        f"the older one has the hash {str(old.hash)[:12]}, the newer one {str(new.hash)[:12]}"
    )


def compared(recordings: Sequence[RecordingResult]) -> list[ComparedRecording]:
    """Give those that two builds drove."""
    return [r for r in recordings if isinstance(r, ComparedRecording)]


def ranked(recordings: Sequence[RecordingResult]) -> list[ComparedRecording]:
    """Give the recordings that the new build is worse or otherwise on, the worst first: weight lost, then risk."""

    def badness(entry: ComparedRecording) -> tuple[float, float]:
        risks = [p.risk for p in entry.pairs if p.risk is not None]
        return max(p.weight_lost for p in entry.pairs), max(risks, default=0.0)

    differ = [r for r in compared(recordings) if r.verdict in ("worse", "changed")]
    return sorted(differ, key=badness, reverse=True)
