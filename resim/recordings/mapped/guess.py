"""A first mapping of a table, as far as names and numbers tell, each line with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import relative
from resim.core.geometry import Floats
from resim.core.tracks import KINDS
from resim.recordings.logs.kinds import log_kind
from resim.recordings.logs.known import MAPPINGS, known_mappings
from resim.recordings.logs.topics import topics
from resim.recordings.mapped import candidates, conventions, names
from resim.recordings.mapped.lines import MappingLines, quoted
from resim.recordings.mapped.mapping import TableMapping
from resim.recordings.mapped.motion import TURN
from resim.recordings.mapped.rows import SourceTable, calendar_seconds, column_of, read_any
from resim.recordings.mapped.units import LENGTHS, SPEEDS, TIMES
from resim.road.opendrive import RoadNetwork

NEAR = 300.0
"""Distance [m] from 0 within which a sensor sees."""
METRE = np.pi / 180.0 * 6.371e6
"""m a degree of latitude."""
MOST_ROWS = 50_000
"""Rows that are looked at: the first of the table."""


def guess(file: Path, out: Path, *, sensor: Path | None = None, network: RoadNetwork | None = None) -> str:
    """Give the text of a mapping of a table, and of a sensor's beside it.

    Args:
        file: CSV or Parquet of the ground truth, or a log that Autoware recorded, whose mapping ships.
        out: Where the mapping is to stand, as its paths are relative to it.
        sensor: CSV or Parquet of the sensor data.
        network: The map, which tells mirrored axes and zones.

    Returns:
        TOML; what the data do not tell is a line that is commented out, with FILL IN.

    Raises:
        InputError: A table cannot be read, or a log is of topics that no mapping that ships takes.
    """
    if (known := _known(file, out)) is not None:
        if sensor is not None:
            raise InputError(
                sensor, f"--sd is for tables, and {file} is a log", "Its topics are tables of the mapping."
            )
        return known
    truth = _Guess("gt", file, network)
    tables = [truth] if sensor is None else [truth, _Guess("sd", sensor, network, truth)]
    head = MappingLines()
    truth.ego(head)
    text = [
        "# A first mapping, by `resim import guess`: look at every line, fill in what says FILL IN, then",
        f"# resim import table {relative(file, out.parent)} --map MAP.xodr --columns {out.name} --out my_drive",
        "",
        *head.lines,
    ]
    for table in tables:
        path = relative(table.path, out.parent)
        text += ["", f"[{table.where}]", f"file = {quoted(path)}", *table.all_lines()]
    if sensor is not None:
        text += ["", "[match]", 'by = "nearest"  # or "id" (both have the same ids), or "column" (gt_id in [sd])',
                 "gate = 3.0  # m; farther apart, two objects are not one"]  # fmt: skip
    return "\n".join("".join(c if c.isprintable() else "?" for c in line) for line in text) + "\n"


def _known(file: Path, out: Path) -> str | None:
    """The mapping that ships for a log of these topics, None where there is none; it takes most of them."""
    if (kind := log_kind(file)) is None or not (fitting := known_mappings(topics(file, kind))):
        return None
    text = fitting[0].read_text(encoding="utf-8").replace("table BAG", f"table {relative(file, out.parent)}")
    others = ", ".join(path.name for path in fitting[1:])
    also = [f"# It fits as well: {others}, in {MAPPINGS}"] if others else []
    return "\n".join([*also, text.replace(fitting[0].name, out.name)])


class _Guess:
    """What is known of a table: its columns by field, times [s], places [m], courses [rad] and speeds [m/s]."""

    def __init__(
        self, where: str, path: Path, network: RoadNetwork | None, truth: _Guess | None = None
    ) -> None:
        self.where, self.path, self.network, self.truth = where, path, network, truth
        self.separator, self.decimal = conventions.dialect(path)
        self.frame = read_any(path, self.separator, rows=MOST_ROWS).head(MOST_ROWS)
        self.found = names.fields([str(c) for c in self.frame.columns])
        for name, (column, _) in self.found.items():
            column_of(path, self.frame, column, f"{where}.{name}")
        told = TableMapping.model_construct(separator=self.separator, decimal=self.decimal)
        self.rows = SourceTable(path, where, told, self.frame)
        if "id" in self.found and (self._ids() == "").all():
            del self.found["id"]  # a column that names nobody
        self.relative = False
        self.corners: list[tuple[float, float]] | None = None
        self.mirrored = False

    def all_lines(self) -> list[str]:
        out = MappingLines()
        if self.separator != "," and self.path.suffix != ".parquet":
            out.sure(f"separator = {quoted(self.separator)}", "stands between the names of the header")
        if self.decimal == ",":
            out.sure('decimal = ","', "numbers such as 1,5")
        self._id(out)
        t = self._time(out)
        places = self._place(out)
        moves = (
            None
            if t is None or places is None or self.relative
            else conventions.motion(self._ids(), t, *places)
        )
        self._heading(out, moves)
        self._speed(out, moves)
        self._height(out)
        self._sizes(out)
        self._kind(out)
        for name in ("gt_id", "existence") if self.where == "sd" else ():
            if name in self.found:
                out.sure(f"{name} = {quoted(self.found[name][0])}", "by its name")
        out.lines.append(
            '# reference = "rear axle"  # where positions are not of the centre of the object\'s box (see the docs)'
        )
        return out.lines

    def ego(self, out: MappingLines) -> None:
        if "id" not in self.found:
            how = out.sure if self._alone() else out.ask
            how('ego = "ego"', "the only object of the table" if self._alone() else "the EGO's id")
            return
        ids = self._ids()
        ids = ids[ids != ""]
        called = [name for name in ids.drop_duplicates() if names.plain(name) in names.EGOS]
        if called:
            out.sure(f"ego = {quoted(called[0])}", "by its name")
        else:
            most = ids.value_counts().head(5)
            told = ", ".join(f"{name} ({count} rows)" for name, count in most.items())
            out.ask(
                f"ego = {quoted(str(most.index[0]))}",
                f"the EGO's id in {self.found['id'][0]}; most rows: {told}",
            )

    def _numbers(self, name: str) -> Floats | None:
        """The column of a field as it stands; None where it is not there, or holds no number."""
        if name not in self.found:
            return None
        column = self.found[name][0]
        try:
            found = self.rows.plain_numbers(column)
        except InputError:
            return None
        return found if np.isfinite(found).any() else None

    def _ids(self) -> pd.Series:
        if "id" not in self.found:
            return pd.Series("ego", index=self.frame.index)
        return self.rows.words(self.found["id"][0])

    def _id(self, out: MappingLines) -> None:
        if "id" in self.found:
            ids = self._ids()
            out.sure(f"id = {quoted(self.found['id'][0])}", f"by its name; {ids.nunique()} objects")
            return
        if self._alone():
            out.sure('id = { value = "ego" }', "no column of ids, and each time once: one object")
        elif self.where == "sd":
            out.lines.append("# id is not there: objects are followed from list to list")
        else:
            fits = candidates.id_like(self.rows, self._taken(), self._numbers("t"))
            self._propose(out, "id", "{}", "the column of ids", fits)

    def _taken(self) -> set[str]:
        """The columns that have a field by their names."""
        return {column for column, _ in self.found.values()}

    def _propose(
        self, out: MappingLines, field: str, line: str, what: str, fits: list[candidates.Candidate]
    ) -> None:
        """A line to fill in, with the columns that fit by their numbers; line: around the column in quotes."""
        if not fits:
            every = ", ".join(map(str, self.frame.columns))
            out.ask(f"{field} = {line.format(quoted('...'))}", f"{what}, among {every}")
            return
        told = "; or ".join(f"{column}: {why}" for column, why in fits[:3])
        out.ask(f"{field} = {line.format(quoted(fits[0][0]))}", f"{what}; by its numbers {told}")

    def _alone(self) -> bool:
        """Whether each time is there once, as of one object."""
        t = self._numbers("t")
        return t is not None and len(np.unique(t)) == len(t)

    def _time(self, out: MappingLines) -> Floats | None:
        if "t" not in self.found:
            ids = self._ids() if "id" in self.found else None
            fits = candidates.time_like(self.rows, self._taken(), ids)
            self._propose(out, "t", '{{ column = {}, unit = "s" }}', "the time and its unit", fits)
            return None
        column, unit = self.found["t"]
        raw = self._numbers("t")
        if raw is None:
            stamps = calendar_seconds(self.frame[column])
            if not np.isfinite(stamps).all():
                out.ask(
                    f't = {{ column = {quoted(column)}, unit = "s" }}',
                    "neither numbers nor ISO 8601: convert it",
                )
                return None
            out.sure(
                f't = {{ column = {quoted(column)}, unit = "iso" }}',
                f"text such as {self.frame[column].iloc[0]}",
            )
            return stamps
        step = conventions.usual_step(self._ids(), raw)
        if "frame" in names.plain(column) and (raw == np.round(raw)).all():
            out.ask(
                f't = {{ column = {quoted(column)}, unit = "frames", rate = 25.0 }}', "the frames a second"
            )
            return None
        unit, reason = conventions.time_unit(raw, step, unit)
        line = f't = {{ column = {quoted(column)}, unit = "{unit or "s"}" }}'
        if not unit:
            out.ask(line, f"steps are {step:g}: s, ms, us, ns, or frames with rate?")
            return None
        out.sure(line, reason)
        return raw * TIMES[unit]

    def _place(self, out: MappingLines) -> tuple[Floats, Floats] | None:
        """The lines of positions; and where they are [m] in axes to the east and north, as far as that is known."""
        lat, lon = self._numbers("lat"), self._numbers("lon")
        if lat is not None and lon is not None:
            unit, factor = ("deg", 1.0) if np.nanmax(np.abs(lat)) <= 90.0 else ("1e-7 deg", 1e-7)
            out.sure('crs = "EPSG:4326"', "columns of latitude and longitude: WGS84")
            for name, values in (("lat", lat), ("lon", lon)):
                text = f'{name} = {{ column = {quoted(self.found[name][0])}, unit = "{unit}" }}'
                out.sure(text, f"by its name; {np.nanmin(values):.9g} to {np.nanmax(values):.9g}")
            lat, lon = lat * factor, lon * factor
            return METRE * np.cos(np.radians(np.nanmean(lat))) * (lon - np.nanmean(lon)), METRE * (
                lat - np.nanmean(lat)
            )
        x, y = self._numbers("x"), self._numbers("y")
        if x is None or y is None:
            out.ask('x = "..."', f"the positions, among {', '.join(map(str, self.frame.columns))}")
            out.ask('y = "..."', "likewise; or lat and lon with crs")
            return None
        factor = self._axes(out, x, y)
        return x * factor, (-y if self.mirrored else y) * factor

    def _axes(self, out: MappingLines, x: Floats, y: Floats) -> float:
        """The lines of x and y, and of the frame; and m of their unit."""
        unit = self.found["x"][1] if self.found["x"][1] in ("cm", "mm", "ft") else "m"
        factor = {"cm": 0.01, "mm": 0.001, "ft": 0.3048, "m": 1.0}[unit]
        reason = "by its name" if self.found["x"][1] else "by its name; m is taken"
        for name, values in (("x", x), ("y", y)):
            text = f'{name} = {{ column = {quoted(self.found[name][0])}, unit = "{unit}" }}'
            out.sure(text, f"{reason}; {np.nanmin(values):.9g} to {np.nanmax(values):.9g}")
        far = float(np.nanmax(np.abs(np.concatenate([x, y])))) * factor
        if 1e5 < np.nanmedian(x) * factor < 9e5 and 0.0 < np.nanmedian(y) * factor < 1e7 and far > 1e6:
            zone = conventions.utm_zone(self.network)
            line = f'crs = "EPSG:{zone or "326.."}"'
            if zone:
                out.sure(line, "eastings and northings of UTM, in the zone of the map")
            else:
                out.ask(line, "eastings and northings: which zone of UTM? 32632 is zone 32 north")
        elif self.where == "sd" and far < NEAR:
            self.relative = True
            reason = f"positions are within {far:.0f} m of 0: what a sensor sees from the EGO"
            if self._may_be_in_the_map(x * factor, y * factor):
                out.choose(
                    "frame", f'"ego": {reason}; "sensor": likewise, with mounting; "map": as the roads'
                )
            else:
                out.sure('frame = "ego"', reason)
                out.ask(
                    'frame = "sensor"',
                    "if they count from the sensor or the rear axle, not the EGO's box centre",
                )
            text = "with a sensor's frame: where it is, ahead and left of the box centre [m], and its heading [rad]"
            out.ask("mounting = [-1.4, 0.0, 0.0]", text)
        else:
            self.corners = [(np.nanmin(z) * factor, np.nanmax(z) * factor) for z in (x, y)]
            self._mirror(out, x * factor, y * factor)
        return factor

    def _may_be_in_the_map(self, x: Floats, y: Floats) -> bool:
        """Whether most positions [m] are as near to the map's roads, or else to the truth, as a sensor sees."""
        corners = None if self.truth is None else self.truth.corners
        if self.network is not None:
            edges = [np.vstack([lane.left, lane.right]) for lane in self.network.lane_shapes(50.0)]
            ends = np.vstack(edges) if edges else np.zeros((1, 2))
            corners = [(low, high) for low, high in zip(ends.min(axis=0), ends.max(axis=0), strict=True)]
        if corners is None:
            return True
        inside = [
            (z >= low - NEAR) & (z <= high + NEAR) for z, (low, high) in zip((x, y), corners, strict=True)
        ]
        return bool((inside[0] & inside[1]).mean() > 0.5)

    def _mirror(self, out: MappingLines, x: Floats, y: Floats) -> None:
        """Whether the map has roads at the positions, or at their mirror images."""
        if self.network is None:
            out.ask("mirrored = true", "whether y points to the right, or down; give --map to guess that")
            return
        some = np.flatnonzero(np.isfinite(x) & np.isfinite(y))[:: max(len(x) // 500, 1)]
        as_is, turned = (
            float(self.network.to_road(x[some], sign * y[some]).on_road.mean()) for sign in (1.0, -1.0)
        )
        self.mirrored = turned > 0.8 and as_is < 0.3
        told = (
            f"{100 * as_is:.0f} % of the positions are on the map's lanes, {100 * turned:.0f} % with y turned"
        )
        if self.mirrored:
            out.sure("mirrored = true", told)
        elif turned > as_is:
            out.ask("mirrored = true", f"{told}: does y point to the right, or down?")
        if self.mirrored:
            return
        if as_is < 0.5:
            out.ask(
                "offset = [0.0, 0.0, 0.0]",
                f"{told}: the pose of the table's axes in the map, or its crs, or frame",
            )
        else:
            out.lines.append(f'# frame = "map"  # {told}')

    def _heading(self, out: MappingLines, moves: tuple[Floats, Floats] | None) -> None:
        raw = self._numbers("heading")
        if raw is None:
            out.lines.append("# heading is not there: it follows from the velocity, or the positions")
            return
        column, unit = self.found["heading"]
        line = 'heading = {{ column = {}, unit = "{}", zero = "{}", clockwise = {} }}'.format
        units = conventions.units_of(raw, unit)
        if units == ("rad",) and np.nanmax(np.abs(raw)) > TURN:
            text = f"numbers up to {np.nanmax(np.abs(raw)):.4g} are no radians, unless they count the turns driven"
            out.ask(line(quoted(column), "rad", "x", "false"), text)
            return
        if moves is None or not (moves[1] > conventions.MOVES).any():
            out.ask(
                line(quoted(column), units[0], "x", "false"),
                "no motion in the map tells its unit, zero and direction",
            )
            return
        drives = (moves[1] > conventions.MOVES) & np.isfinite(raw)
        if not drives.any():
            out.ask(line(quoted(column), units[0], "x", "false"), "moving objects have no heading")
            return
        fits = conventions.ranked(raw, moves[0], drives, unit)
        off, turns, zero, clockwise = fits[0]
        told = line(quoted(column), turns, zero, str(clockwise).lower())
        words = f"{off:.3f} rad off the direction of motion"
        if off > conventions.FITS:
            out.ask(
                told, f"no convention fits, the best is {words}: is the time's or the positions' unit right?"
            )
            return
        rivals = [one for one in fits[1:] if one[0] < max(conventions.CLEAR * off, 0.02)]
        if not rivals:
            out.sure(told, words)
            return
        others = "; or ".join(f"{u}, {z}, clockwise {str(c).lower()}" for _, u, z, c in rivals)
        out.ask(
            told,
            f"{words}, and equally good: {others}. A turning or sideways vehicle would distinguish them",
        )

    def _speed(self, out: MappingLines, moves: tuple[Floats, Floats] | None) -> None:
        raw = self._numbers("v")
        if raw is None:
            self._velocity(out)
            return
        column, unit = self.found["v"]
        line = 'v = {{ column = {}, unit = "{}" }}'.format
        drives = None if moves is None else (moves[1] > conventions.MOVES) & (np.abs(raw) > 0.1)
        if moves is None or drives is None or not drives.any():
            known = unit if unit in SPEEDS else ""
            if known:
                out.sure(line(quoted(column), known), "by its name")
            else:
                out.ask(line(quoted(column), "m/s"), f"its unit; up to {np.nanmax(np.abs(raw)):.4g}")
            return
        ratio = float(np.median(np.abs(raw[drives]) / moves[1][drives]))
        best = min(SPEEDS, key=lambda u: abs(ratio * SPEEDS[u] - 1.0))
        told = f"{ratio:.3g} times what the positions give"
        fits = abs(ratio * SPEEDS[best] - 1.0) < conventions.FITS
        if fits and unit in SPEEDS and best != unit:
            text = f"by its name; but {told}, as of {best}: is it relative to the EGO, or its name wrong?"
            out.ask(line(quoted(column), unit), text)
        elif fits:
            out.sure(line(quoted(column), best), told)
        else:
            out.ask(
                line(quoted(column), unit if unit in SPEEDS else "m/s"),
                f"{told}, which is no unit: is t's right?",
            )

    def _velocity(self, out: MappingLines) -> None:
        if not {"vx", "vy"} <= set(self.found):
            out.lines.append("# v is not there: it follows from the positions")
            return
        for name in ("vx", "vy"):
            column, unit = self.found[name]
            line = f'{name} = {{ column = {quoted(column)}, unit = "{unit if unit in SPEEDS else "m/s"}" }}'
            if "rel" in names.plain(column):
                out.sure(
                    line.replace(" }", ", relative = true }"), "by its name: the EGO's is still to be added"
                )
            elif self.relative:
                out.ask(line, "add relative = true where the EGO's velocity is still to be added")
            else:
                out.sure(line, "by its name; m/s is taken" if unit not in SPEEDS else "by its name")

    def _sizes(self, out: MappingLines) -> None:
        for name, ranges in conventions.SIZES.items():
            raw = self._numbers(name)
            if raw is None:
                out.ask(
                    f"{name} = {{ value = {'4.7' if name == 'length' else '1.9'} }}",
                    "else it is assumed by kind",
                )
                continue
            middle = float(np.nanmedian(raw[raw > 0.0])) if (raw > 0.0).any() else 0.0
            unit = next((u for u, low, high in ranges if low <= middle <= high), "")
            line = f'{name} = {{ column = {quoted(self.found[name][0])}, unit = "{unit or "m"}" }}'
            (out.sure if unit else out.ask)(line, f"the median is {middle:.4g}")

    def _height(self, out: MappingLines) -> None:
        if self._numbers("z") is None:
            return
        column, unit = self.found["z"]
        line = f'z = {{ column = {quoted(column)}, unit = "{unit if unit in LENGTHS else "m"}" }}'
        out.sure(line, "by its name; the height of the road, or off it by one amount for all objects")

    def _kind(self, out: MappingLines) -> None:
        if "kind" not in self.found:
            out.ask('kind = { value = "car" }', f"what the objects are: {', '.join(KINDS)}")
            return
        column = self.found["kind"][0]
        words = self.rows.words(column).drop_duplicates().head(30).tolist()
        known = {w: names.KINDS.get(names.plain(w), names.plain(w)) for w in words}
        strange = [w for w in words if known[w] not in KINDS]
        entries = ", ".join(
            f'{quoted(w)} = "{known[w] if w not in strange else "unknown"}"' for w in words if w
        )
        line = f"kind = {{ column = {quoted(column)}, names = {{ {entries} }} }}"
        if strange:
            line += f"  # FILL IN: what {', '.join(map(repr, strange))} are"
            out.lines.append(line)
        else:
            out.sure(line, "by its name")


def fill_ins(text: str) -> Sequence[str]:
    """Give the lines of a guessed mapping that somebody has to look at."""
    return [line for line in text.splitlines() if "FILL IN:" in line]
