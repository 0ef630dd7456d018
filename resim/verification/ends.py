"""Two runs that end badly: whether the new build's collides or leaves the road sooner, or harder, than the old one's;
and whether a simulated collision is the measured one."""

from __future__ import annotations

from collections.abc import Iterator

from resim.resimulation.drive_outcome import BadEnd, DriveOutcome

ENDED = "lasts to the end"
"""Stands among KPIs lost where the new build's run ended early and the old one's did not."""
SOONER = "ends no sooner"
HITS = "does not collide"
HARDER = "collides no harder"
"""The same where the new build's run ends sooner, by a collision in place of leaving the road, or by a harder one."""
EARLIER = 0.2
"""Time [s] by which a bad end has to be earlier to be a loss. Both builds have the same scenario and seed, so that
nothing differs by chance; it is what first braking may be off by in a suite, five steps, 4 m at 20 m/s."""
FASTER = 0.5
"""Closing speed [m/s] by which a collision has to be harder: that from which on two EGOs drive differently."""


def worse_ends(old: DriveOutcome, new: DriveOutcome) -> Iterator[str]:
    """Give what the new build's run loses by how it ends; nothing where it ends no worse."""
    if old.whole and not new.whole:  # what it would have passed or failed later is not known
        yield ENDED
        return
    before, now = old.bad, new.bad
    if now is None:
        return
    if before is None:
        if now.by == "collision" and old.whole:
            yield HITS
        return
    if now.t < before.t - EARLIER:
        yield SOONER
    if now.by == "collision" and before.by != "collision":
        yield HITS
    elif now.speed is not None and before.speed is not None and now.speed > before.speed + FASTER:
        yield HARDER


def another_collision(measured: DriveOutcome, simulated: DriveOutcome) -> str:
    """Say how the collision of a simulated drive is another than the measured one; "" where it is the same.

    The same is with the same object, within EARLIER.
    """
    before, now = measured.bad, simulated.bad
    if before is None or now is None or not (before.by == now.by == "collision"):
        return ""
    if before.object == now.object and abs(now.t - before.t) <= EARLIER:
        return ""
    told = (f"with {end.object} at {end.t:.1f} s" for end in (before, now))
    return "the EGO collides {} in the drive, {} in simulation".format(*told)


def ends_text(old: DriveOutcome, new: DriveOutcome, lost: tuple[str, ...]) -> str:
    """Say how the runs end where that is a loss, or the old one ended badly and the new one otherwise; else ""."""
    if ENDED in lost:
        return f"it ends by {_by(new.end)} now" + ("" if new.bad is None else f" at {new.bad.t:.1f} s")
    before, now = old.bad, new.bad
    if {SOONER, HITS, HARDER} & set(lost) or (before is not None and _parted(before, now)):
        return f"{_told(before)} before, {_told(now)} now"
    return ""


def _parted(before: BadEnd, now: BadEnd | None) -> bool:
    return now is None or now.by != before.by or abs(now.t - before.t) > EARLIER


def _told(end: BadEnd | None) -> str:
    """`collision at 4.2 s, 12 m/s`."""
    if end is None:
        return "no bad end"
    speed = "" if end.speed is None else f", {end.speed:.1f} m/s"
    return f"{_by(end.by)} at {end.t:.1f} s{speed}"


def _by(end: str) -> str:
    return end.replace("_", " ")
