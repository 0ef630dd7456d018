"""A recording of tables that a mapping explains: SI units, the map's frame, centres of boxes; and what was derived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.files import file_hash, joined
from resim.core.geometry import Bools, Floats
from resim.core.schema import EXISTENCE, GT_ID
from resim.core.spelling import did_you_mean
from resim.core.tracks import KINDS, Tracks
from resim.recordings.mapped.bias import sensor_bias
from resim.recordings.mapped.frames import MapPositions, centred, place
from resim.recordings.mapped.mapping import (
    LEAST_RATE,
    MOST_RATE,
    HeadingColumn,
    Mapping,
    Match,
    TableMapping,
    read_mapping,
)
from resim.recordings.mapped.matching import assigned, at_times_of, distances
from resim.recordings.mapped.motion import (
    REACH,
    STANDING,
    TURN,
    along_velocity,
    counts_turns,
    headings,
    sized,
    speeds,
)
from resim.recordings.mapped.rows import SourceTable, read_rows
from resim.recordings.mapped.tracking import tracked
from resim.recordings.present import existing_map
from resim.recordings.settings import Settings
from resim.recordings.sides import sides_swapped
from resim.recordings.source import RecordingTables, check_extent
from resim.recordings.tables import complete_rows
from resim.recordings.window import beyond_ego, limits, window_of
from resim.road.opendrive import RoadNetwork, load

FOLLOWED = 3.0
"""How far [m] an object without an id may be from where it is expected."""
UNIX = 1e6
"""Time [s] from which on times are those of a calendar, and are counted from the first sample of GT."""


@dataclass(frozen=True, eq=False)
class _Timed:
    """Rows as they stand, with their times t (K,) [s], and as ns where they are known exactly."""

    rows: SourceTable
    t: Floats
    exact: NDArray[np.int64] | None

    def since(self, origin: int) -> Floats:
        """The times (K,) [s] from an origin [ns] on; 0: as they stand."""
        if not origin:
            return np.round(self.t, 9)
        return np.round(self.t - origin / 1e9, 6) if self.exact is None else (self.exact - origin) / 1e9


@dataclass(frozen=True, eq=False)
class _Table:
    """Rows in the map's frame, as a recording has them; which of them (K,) have a place; what was derived, by topic."""

    path: Path
    frame: pd.DataFrame
    placed: Bools
    notes: tuple[tuple[str, str], ...]


def read_mapped(
    file: Path,
    *,
    map: Path,
    columns: Path,
    ego: str | None = None,
    start: float | None = None,
    end: float | None = None,
    rate: float | None = None,
) -> RecordingTables:
    """Give the recording of a table, and of the tables that its mapping names beside it.

    Args:
        file: CSV or Parquet that the mapping's tables are in, where they name none.
        map: OpenDRIVE file.
        columns: The mapping (see `Mapping`).
        ego: Id of the EGO in place of the mapping's.
        start: First time [s] of the recording's clock; default: that of all rows.
        end: Last time [s]; default: that of all rows.
        rate: Frames a second [Hz] of times in frames, in place of the mapping's.

    Returns:
        The tables, faults that `resim check` tells left in; the provenance says what was derived.

    Raises:
        InputError: A file, column, unit, frame or value cannot be used; the EGO is not there; GT and SD have no common
            time.
    """
    mapping = read_mapping(columns)
    if rate is not None:
        _check_rate(rate, mapping)
    if (own := ego or mapping.ego) is None:
        raise InputError(columns, "names no ego, and --ego is missing", 'Give ego = "..." or --ego.')
    network = load(existing_map(map, map))
    truth, seen = (
        [_timed(table, where, file, columns, rate) for table in tables]
        for where, tables in (("gt", mapping.gt), ("sd", mapping.sd))
    )
    if all(one.rows.path.resolve() != file.resolve() for one in (*truth, *seen)):
        problem = f"is read by no table of {columns.name}, as each names a file of its own"
        raise InputError(file, problem, "Leave out `file` of the table that it is for, or give that file.")
    origin = _origin(truth)
    gt = _placed(truth, origin, network, own)
    sd = _placed(seen, origin, network, own, _ego_track(gt, own))
    gt, sd, notes = _windowed(gt, sd, own, start, end)
    told = {"source": ", ".join(dict.fromkeys(t.path.name for t in (*gt, *sd))), "format": "table"}
    told["mapping"] = f"{columns.name}, SHA-256 {file_hash(columns)[:12]}"
    if origin:
        told["original_start"] = _calendar(origin)
    told |= notes
    gt_frame, gt_notes = _together(gt, "gt")
    sd_frame, sd_notes = _together(sd, "sd") if sd else (None, {})
    if sd_frame is not None:
        sd_frame, found = matched(mapping.matching, gt_frame, sd_frame, sd[0].path, own)
        sd_notes |= found
    return RecordingTables(
        settings=Settings(name=file.stem, map=str(map), ego=own, provenance={**told, **gt_notes, **sd_notes}),
        map=network.path.resolve(), gt=gt_frame, sd=sd_frame, plan=None, folder=None,
        gt_file=gt[0].path, sd_file=sd[0].path if sd else file,
    )  # fmt: skip


def _check_rate(rate: float, mapping: Mapping) -> None:
    """Raise InputError for frames a second that are none, or that no table has a use for."""
    if not LEAST_RATE <= rate <= MOST_RATE:
        raise InputError(
            "--rate", f"{rate:g} Hz is no rate", f"Give frames a second, {LEAST_RATE:g} to {MOST_RATE:g}."
        )
    if all(table.t.unit != "frames" for table in (*mapping.gt, *mapping.sd)):
        raise InputError("--rate", "has no effect: no time of the mapping is in frames", "Leave it out.")


def _timed(told: TableMapping, where: str, file: Path, columns: Path, rate: float | None) -> _Timed:
    """A table's rows with their times."""
    rows = read_rows(joined(columns, told.file) if told.file else file, told, where)
    return _Timed(rows, rows.times(rate), rows.nanoseconds())


def _placed(
    tables: Sequence[_Timed], origin: int, network: RoadNetwork, ego: str, track: Tracks | None = None
) -> list[_Table]:
    """Every table of a source in the map, those in the EGO's frame after those that its track is of."""
    out: list[_Table] = []
    for one in sorted(tables, key=lambda one: one.rows.mapping.frame != "map"):
        told = one.rows.mapping
        if track is None and (told.frame != "map" or (told.vx is not None and told.vx.relative)):
            track = _ego_track(out, ego)
        out.append(_table(one.rows, one.since(origin), network, track))
    return out


def _table(rows: SourceTable, t: Floats, network: RoadNetwork, ego: Tracks | None) -> _Table:
    """A table's rows in the map's frame; t: (K,) s on the recording's clock."""
    placed = place(rows, t, network, ego)
    ids, followed = _ids(rows, t, placed)
    kind, unknown = _kinds(rows)
    heading, v, notes = _motion(rows, t, ids, placed)
    notes += [("ids", followed)] if followed else []
    frame = pd.DataFrame(
        {"t": t, "id": ids, "x": placed.x, "y": placed.y, "heading": heading, "v": v}, index=rows.frame.index
    )
    for side in ("length", "width"):
        given = rows.numbers(side)
        frame[side] = np.full(len(t), np.nan) if given is None else given
    frame, assumed = sized(frame.assign(kind=kind))
    sides = frame["length"].to_numpy(float), frame["width"].to_numpy(float)
    x, y = centred(rows.mapping, placed.x, placed.y, heading, *sides)
    frame = frame.assign(x=x, y=y, v=speeds(ids, t, x, y, heading) if v is None else v, **_optional(rows))
    notes += [
        (name, text)
        for name, text in (("sizes", assumed), ("kinds", unknown), ("left_out", rows.left_out))
        if text
    ]
    if not placed.known.any():
        problem = f"{rows.where} is in the frame of the EGO, which has no sample at any of its times"
        raise InputError(rows.path, problem, "Compare the clocks of the tables, and the units of t.")
    return _Table(rows.path, frame, placed.known, tuple(notes))


def _ids(rows: SourceTable, t: Floats, placed: MapPositions) -> tuple[pd.Series, str]:
    """The id of each row, and how it was found where the table has none."""
    ids, told = rows.texts("id"), rows.mapping
    if ids is not None and told.id is not None:
        rows.refuse(ids == "", "id", told.id, "a name")
        return ids, ""
    velocity, heading, v = _velocity(rows, placed), rows.numbers("heading"), rows.numbers("v")
    if velocity is not None:
        moved = velocity[0] + 1j * velocity[1]
    elif v is not None and heading is not None and told.heading is not None:
        moved = v * np.exp(1j * placed.heading(heading, told.heading))
    else:
        moved = np.full(len(t), np.nan, dtype=complex)
    found = tracked(t, placed.x + 1j * placed.y, moved, FOLLOWED, placed.vx + 1j * placed.vy)
    text = f"none: {len(np.unique(found))} objects followed from list to list, up to {FOLLOWED:g} m from where expected"
    return pd.Series(found, index=rows.frame.index, dtype=object), text


def _motion(
    rows: SourceTable, t: Floats, ids: pd.Series, placed: MapPositions
) -> tuple[Floats, Floats | None, list[tuple[str, str]]]:
    """Headings [rad] in the map and speeds [m/s], None where they are to follow; and how they were derived."""
    told, notes = rows.mapping, []
    velocity = _velocity(rows, placed)
    raw = rows.numbers("heading")
    if told.heading is not None and raw is not None:
        heading = placed.heading(raw, told.heading)
        _check_turns(rows, told.heading, raw, placed, ids, t)
    elif velocity is not None:
        heading = along_velocity(ids, t, *velocity)
        notes.append(("headings", f"along vx and vy, kept below {STANDING:g} m/s"))
    else:
        heading = headings(ids, t, placed.x, placed.y)
        notes.append(("headings", f"along the positions over {2 * REACH:g} s, kept below {STANDING:g} m/s"))
    if velocity is not None:
        return heading, velocity[0] * np.cos(heading) + velocity[1] * np.sin(heading), notes
    if told.v is None:
        return heading, None, [*notes, ("speeds", f"of the positions over {2 * REACH:g} s")]
    return heading, rows.numbers("v"), notes


def _check_turns(
    rows: SourceTable, told: HeadingColumn, raw: Floats, placed: MapPositions, ids: pd.Series, t: Floats
) -> None:
    """Refuse headings in radians beyond a whole turn, but where they count the turns that the positions drive."""
    beyond = (np.abs(raw) > TURN) & (told.unit != "deg")
    for name in ids[beyond].unique().tolist():
        own = (ids == name).to_numpy()
        if counts_turns(t[own], raw[own], placed.turned(raw, told)[own], placed.x[own], placed.y[own]):
            beyond &= ~own
    expected = f'radians from -{TURN:g} to {TURN:g} (in degrees: unit = "deg"), or the turns driven added up'
    rows.refuse(beyond, "heading", told, expected)


def _velocity(rows: SourceTable, placed: MapPositions) -> tuple[Floats, Floats] | None:
    """Velocity (K,), (K,) [m/s] in the map, None where the table has none."""
    told = rows.mapping
    vx, vy = rows.numbers("vx"), rows.numbers("vy")
    if vx is None or vy is None or told.vx is None:
        return None
    vy = -vy if told.mirrored else vy
    c, s = np.cos(placed.turn), np.sin(placed.turn)
    x, y = c * vx - s * vy, s * vx + c * vy
    return (x + placed.vx, y + placed.vy) if told.vx.relative else (x, y)


def _kinds(rows: SourceTable) -> tuple[pd.Series, str]:
    """The kind of each row, and the words of the file that are no kind."""
    raw, told = rows.texts("kind"), rows.mapping.kind
    if raw is None or told is None:
        return pd.Series("unknown", index=rows.frame.index), "none given: unknown"
    kinds = raw.map(lambda word: told.names.get(word, word.casefold()))
    strange = raw[~kinds.isin(KINDS)]
    words = [f"{word!r} ({count} rows)" for word, count in strange.value_counts().head(10).items()]
    return kinds.where(kinds.isin(KINDS), "unknown"), ", ".join(words) + " taken as unknown" if words else ""


def _optional(rows: SourceTable) -> dict[str, Floats | pd.Series]:
    """Columns that a recording may have."""
    out: dict[str, Floats | pd.Series] = {}
    told = rows.mapping
    if (rates := rows.numbers("yaw_rate")) is not None and told.yaw_rate is not None:
        out["yaw_rate"] = -rates if told.yaw_rate.clockwise else rates
    if (a := rows.numbers("a")) is not None:
        out["a"] = a
    if (z := rows.numbers("z")) is not None:
        out["z"] = z
    if (exists := rows.numbers("existence")) is not None and told.existence is not None:
        rows.refuse((exists < 0.0) | (exists > 1.0), "existence", told.existence, "0 to 1, or 0 to 100 %")
        out[EXISTENCE] = exists
    if (names := rows.texts("gt_id")) is not None:
        out[GT_ID] = names
    return out


def _ego_track(gt: Sequence[_Table], ego: str) -> Tracks:
    """The EGO's track, of the rows that lack nothing."""
    frame = pd.concat([t.frame for t in gt])
    known = frame["id"].drop_duplicates().tolist()
    if ego not in known:
        problem = f"ego {ego!r} was not found in gt{did_you_mean(ego, known)}"
        raise InputError(gt[0].path, problem, f"It has {', '.join(known[:20])}.")
    own = complete_rows(frame[frame["id"] == ego])
    if own.empty:
        raise InputError(gt[0].path, f"ego {ego!r} has no row with position, heading and speed")
    return Tracks.from_frame(own)


def _origin(gt: Sequence[_Timed]) -> int:
    """The time [ns] that is counted as 0."""
    first = min(gt, key=lambda one: float(one.t.min()))
    start = float(first.t.min())
    if abs(start) <= UNIX:
        return 0
    return round(start * 1e9) if first.exact is None else int(first.exact.min())


def _calendar(time: int) -> str:
    """A Unix time [ns] in words, to the last digit that is not 0, microseconds at least."""
    seconds, nanos = divmod(time, 10**9)
    return f"unix time {seconds}.{f'{nanos:09d}'.removesuffix('000')} s"


def _windowed(
    gt: list[_Table], sd: list[_Table], ego: str, start: float | None, end: float | None
) -> tuple[list[_Table], list[_Table], dict[str, str]]:
    """The rows from start to end [s], where they are given: nothing else cuts; and what was left out, or is beyond."""
    every = pd.concat([t.frame for t in gt])
    own = every.loc[every["id"] == ego, "t"].to_numpy(float)
    first, last = float(own.min()), float(own.max())
    _check_common(gt, sd, ego, first, last)
    begin, until = window_of(own, gt[0].path, ego=ego, start=start, end=end)
    out, notes = [], {}
    for name, tables in (("gt", gt), ("sd", sd)):
        inside = [t.frame["t"].between(*limits(start, end)).to_numpy() for t in tables]
        if lost := sum(int((~keep).sum()) for keep in inside):
            notes[f"{name}_outside"] = f"{lost} rows before {begin:g} s or after {until:g} s left out"
        kept = [
            replace(t, frame=t.frame[keep], placed=t.placed[keep])
            for t, keep in zip(tables, inside, strict=True)
        ]
        if lost := sum(int((~t.placed).sum()) for t in kept):
            text = f"{lost} rows at times at which the EGO has no sample: kept without a position"
            notes[f"{name}_without_place"] = text
        if beyond := beyond_ego(own, *(t.frame for t in kept)):
            notes[f"{name}_without_ego"] = beyond
        out.append(kept)
    return out[0], out[1], notes


def _check_common(gt: list[_Table], sd: list[_Table], ego: str, first: float, last: float) -> None:
    if not sd:
        return
    times = np.concatenate([t.frame["t"].to_numpy(float) for t in sd])
    if not ((times >= first - TICK) & (times <= last + TICK)).any():
        problem = (
            f"sd lasts from {times.min():.9g} to {times.max():.9g} s, the EGO {ego!r} of gt ({gt[0].path.name}) "
            f"from {first:.9g} to {last:.9g} s: they have no common time"
        )
        raise InputError(sd[0].path, problem, "Compare the units and the zero of t in both tables.")


def _together(tables: Sequence[_Table], source: str) -> tuple[pd.DataFrame, dict[str, str]]:
    """The tables of a source as one, by time, and its notes."""
    frame = tables[0].frame if len(tables) == 1 else pd.concat([t.frame for t in tables], ignore_index=True)
    frame = frame.sort_values("t", kind="stable")
    frame.index = pd.RangeIndex(2, len(frame) + 2)
    check_extent(tables[0].path, frame)
    notes: dict[str, list[str]] = {}
    for table in tables:
        for name, text in table.notes:
            own = f"{table.path.name}: {text}" if len(tables) > 1 else text
            notes.setdefault(f"{source}_{name}", []).append(own)
    if GT_ID in frame:
        frame[GT_ID] = frame[GT_ID].fillna("")
    return frame, {name: "; ".join(texts) for name, texts in notes.items()}


def matched(
    how: Match, gt: pd.DataFrame, sd: pd.DataFrame, path: Path, ego: str
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Give the SD with the GT id of each object, and what came of it, by topic.

    gt, sd: track tables; path: of the SD, for errors. Raises InputError where the SD has no whole row.
    """
    whole, seen = complete_rows(gt), complete_rows(sd)
    if seen.empty:
        raise InputError(path, "sd has no row with position, heading and speed", "Correct the mapping.")
    tracks = Tracks.from_frame(seen)
    truth = at_times_of(tracks, Tracks.from_frame(whole))
    known = set(truth.ids.tolist())
    if how.by == "nearest":
        found = assigned(whole, seen, how.gate, ego)
        of = dict(zip(tracks.ids.tolist(), found.gt_id.tolist(), strict=True))
    elif how.by == "id":
        of = {name: name for name in tracks.ids.tolist() if name in known}
    else:
        of = {str(name): str(own) for name, own in sd.groupby("id", sort=False)[GT_ID].first().items()}
        _check_named(sd, known, path)
    names = np.array([of.get(name, "") for name in tracks.ids.tolist()], dtype=str)
    text = _outcome(how, tracks, names, distances(truth, tracks, names), ego)
    if how.by == "nearest" and found.not_ego:
        told = [f"{name} ({why})" for name, why in list(found.not_ego.items())[:10]]
        text += f"; near the EGO, and not taken for it: {', '.join(told)}"
    notes = {"identity": text}
    if ego in truth.ids:
        if swapped := _swapped(truth, tracks, ego):
            notes["sd_sides"] = f"{swapped}. Is `mirrored` in [sd] right?"
        elif bias := sensor_bias(truth, tracks, names, ego):
            notes["sd_bias"] = bias
    if how.by == "column":  # as the rows say, which may contradict each other
        return sd, notes
    return sd.assign(**{GT_ID: sd["id"].map(of).fillna("")}), notes


def _swapped(truth: Tracks, sd: Tracks, ego: str) -> str:
    """How the SD fits better with left and right of the EGO swapped; truth: the GT at its times."""
    own, places = truth.index(ego), truth.x + 1j * truth.y
    others = np.delete(places, own, axis=0)
    return sides_swapped(places[own], truth.heading[own], sd.x + 1j * sd.y, others)


def _check_named(sd: pd.DataFrame, known: set[str], path: Path) -> None:
    strange = sorted({own for own in sd[GT_ID].unique().tolist() if own and own not in known})
    if strange:
        problem = f"gt_id {strange[0]!r} was not found in gt" + (
            f" (and {len(strange) - 1} more)" if len(strange) > 1 else ""
        )
        raise InputError(path, problem, f"gt has {', '.join(sorted(known)[:20])}.")


def _outcome(how: Match, sd: Tracks, names: np.ndarray, apart: Floats, ego: str) -> str:
    """How many SD ids have a GT id, how far off they are, and who is left over."""
    words = {
        "nearest": f"by assignment of the nearest within {how.gate:g} m, in most samples of an id",
        "id": "by the same ids",
        "column": "by gt_id",
    }[how.by]
    has = names != ""
    text = f"{words}: {int(has.sum())} of {len(sd)} ids matched"
    if np.isfinite(apart).any():
        text += f", median distance {float(np.nanmedian(apart)):.2f} m"
    left = sd.ids[~has].tolist()
    if left:
        text += f"; {len(left)} left over: {', '.join(left[:10])}" + (", ..." if len(left) > 10 else "")
    own = sd.ids[names == ego].tolist()
    detection = f"detected as {', '.join(own[:10])}" if own else "not detected by the sensor"
    return f"{text}; the EGO is {detection}"
