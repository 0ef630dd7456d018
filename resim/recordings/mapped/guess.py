"""A first mapping of a table, as far as names and numbers tell, each line with its reason."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import relative
from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import KINDS
from resim.recordings.mapped import names
from resim.recordings.mapped.mapping import TableMapping
from resim.recordings.mapped.motion import REACH
from resim.recordings.mapped.rows import Rows, read_any
from resim.recordings.mapped.units import SPEEDS, TIMES
from resim.road.opendrive import RoadNetwork

MOVES = 2.0
"""Speed [m/s] from which on the direction of motion, and its ratio to the speed, says something."""
FITS = 0.1
"""Median misfit of headings [rad], and of speeds [of 1], at which a unit or a convention is the right one."""
CLEAR = 2.0
"""Times by which another convention has to fit worse to be none."""
NEAR = 300.0
"""Distance [m] from 0 within which a sensor sees."""
STEPS = (("s", 1e-3, 2.1), ("ms", 4.9, 2100.0), ("us", 4900.0, 2.1e6), ("ns", 4.9e6, 2.1e9))
"""Time steps that are plausible in each unit."""
UNIX = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""From which number on a time is one of a calendar, in each unit."""
SIZES = {"length": (("m", 1.0, 40.0), ("cm", 100.0, 4000.0), ("mm", 1000.0, 4e4)),
         "width": (("m", 0.3, 5.0), ("cm", 30.0, 500.0), ("mm", 300.0, 5000.0))}  # fmt: skip
"""Median sizes that are plausible in each unit."""
METRE = np.pi / 180.0 * 6.371e6
"""m a degree of latitude."""
MOST_ROWS = 50_000
"""Rows that are looked at: the first of the table."""


@dataclass
class _Lines:
    """The lines of a mapping as they come to be known: sure ones, and those that somebody has to fill in."""

    lines: list[str] = field(default_factory=list)

    def sure(self, text: str, reason: str) -> None:
        self.lines.append(f"{text}  # {reason}")

    def ask(self, text: str, reason: str) -> None:
        self.lines.append(f"# {text}  # FILL IN: {reason}")


def guess(file: Path, out: Path, *, sensor: Path | None = None, network: RoadNetwork | None = None) -> str:
    """Give the text of a mapping of a table, and of a sensor's beside it.

    Args:
        file: CSV or Parquet of the ground truth.
        out: Where the mapping is to stand, as its paths are relative to it.
        sensor: CSV or Parquet of the sensor data.
        network: The map, which tells mirrored axes and zones.

    Returns:
        TOML; what the data do not tell is a line that is commented out, with FILL IN.

    Raises:
        InputError: A table cannot be read.
    """
    truth = _Guess("gt", file, network)
    tables = [truth] if sensor is None else [truth, _Guess("sd", sensor, network, truth)]
    head = _Lines()
    truth.ego(head)
    text = [
        "# A first mapping, by `resim import guess`: look at every line, fill in what says FILL IN, then",
        f"# resim import table {relative(file, out.parent)} --map MAP.xodr --columns {out.name} --out my_drive",
        "",
        *head.lines,
    ]
    for table in tables:
        path = relative(table.path, out.parent)
        text += ["", f"[{table.where}]", f"file = {_quoted(path)}", *table.all_lines()]
    if sensor is not None:
        text += ["", "[match]", 'by = "nearest"  # or "id" (both have the same ids), or "column" (gt_id in [sd])',
                 "gate = 3.0  # m; farther apart, two objects are not one"]  # fmt: skip
    return "\n".join("".join(c if c.isprintable() else "?" for c in line) for line in text) + "\n"


class _Guess:
    """What is known of a table: its columns by field, times [s], places [m], courses [rad] and speeds [m/s]."""

    def __init__(
        self, where: str, path: Path, network: RoadNetwork | None, truth: _Guess | None = None
    ) -> None:
        self.where, self.path, self.network, self.truth = where, path, network, truth
        self.separator, self.decimal = _dialect(path)
        self.frame = read_any(path, self.separator).head(MOST_ROWS)
        self.found = names.fields([str(c) for c in self.frame.columns])
        told = TableMapping.model_construct(separator=self.separator, decimal=self.decimal)
        self.rows = Rows(path, where, told, self.frame)
        self.relative = False
        self.mirrored = False

    def all_lines(self) -> list[str]:
        out = _Lines()
        if self.separator != "," and self.path.suffix != ".parquet":
            out.sure(f"separator = {_quoted(self.separator)}", "stands between the names of the header")
        if self.decimal == ",":
            out.sure('decimal = ","', "numbers such as 1,5")
        self._id(out)
        t = self._time(out)
        places = self._place(out)
        motion = None if t is None or places is None else self._motion(t, *places)
        motion = self._heading(out, motion, places)
        self._speed(out, motion)
        self._sizes(out)
        self._kind(out)
        for name in ("gt_id", "existence") if self.where == "sd" else ():
            if name in self.found:
                out.sure(f"{name} = {_quoted(self.found[name][0])}", "by its name")
        out.lines.append(
            '# reference = "rear axle"  # where positions are not those of the box\'s centre (see the docs)'
        )
        return out.lines

    def ego(self, out: _Lines) -> None:
        if "id" not in self.found:
            out.sure('ego = "ego"', "the only object of the table")
            return
        ids = self.frame[self.found["id"][0]].astype(str).str.strip()
        called = [name for name in ids.drop_duplicates() if names.plain(name) in names.EGOS]
        if called:
            out.sure(f"ego = {_quoted(called[0])}", "by its name")
        else:
            most = ids.value_counts().head(5)
            told = ", ".join(f"{name} ({count} rows)" for name, count in most.items())
            out.ask(
                f"ego = {_quoted(str(most.index[0]))}",
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
        return self.frame[self.found["id"][0]].astype(str).str.strip()

    def _id(self, out: _Lines) -> None:
        if "id" in self.found:
            ids = self._ids()
            out.sure(f"id = {_quoted(self.found['id'][0])}", f"by its name; {ids.nunique()} objects")
            return
        t = self._numbers("t")
        if t is not None and len(np.unique(t)) == len(t):
            out.sure('id = { value = "ego" }', "no column of ids, and each time once: one object")
        else:
            out.ask('id = "..."', f"the column of ids, among {', '.join(map(str, self.frame.columns))}")

    def _time(self, out: _Lines) -> Floats | None:
        if "t" not in self.found:
            out.ask(
                't = { column = "...", unit = "s" }',
                f"the time, among {', '.join(map(str, self.frame.columns))}",
            )
            return None
        column, unit = self.found["t"]
        raw = self._numbers("t")
        if raw is None:
            stamps = pd.to_datetime(self.frame[column], utc=True, format="ISO8601", errors="coerce")
            if stamps.isna().any():
                out.ask(
                    f't = {{ column = {_quoted(column)}, unit = "s" }}',
                    "neither numbers nor ISO 8601: convert it",
                )
                return None
            out.sure(
                f't = {{ column = {_quoted(column)}, unit = "iso" }}',
                f"text such as {self.frame[column].iloc[0]}",
            )
            return np.asarray(stamps.dt.as_unit("ns").astype("int64").to_numpy() / 1e9)
        step = _step(self._ids(), raw)
        if "frame" in names.plain(column) and (raw == np.round(raw)).all():
            out.ask(
                f't = {{ column = {_quoted(column)}, unit = "frames", rate = 25.0 }}', "the frames a second"
            )
            return None
        unit, reason = _time_unit(raw, step, unit)
        line = f't = {{ column = {_quoted(column)}, unit = "{unit or "s"}" }}'
        if not unit:
            out.ask(line, f"steps are {step:g}: s, ms, us, ns, or frames with rate?")
            return None
        out.sure(line, reason)
        return raw * TIMES[unit]

    def _place(self, out: _Lines) -> tuple[Floats, Floats] | None:
        """The lines of positions; and where they are [m] in axes to the east and north, as far as that is known."""
        lat, lon = self._numbers("lat"), self._numbers("lon")
        if lat is not None and lon is not None:
            unit, factor = ("deg", 1.0) if np.nanmax(np.abs(lat)) <= 90.0 else ("1e-7 deg", 1e-7)
            out.sure('crs = "EPSG:4326"', "columns of latitude and longitude: WGS84")
            for name, values in (("lat", lat), ("lon", lon)):
                text = f'{name} = {{ column = {_quoted(self.found[name][0])}, unit = "{unit}" }}'
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

    def _axes(self, out: _Lines, x: Floats, y: Floats) -> float:
        """The lines of x and y, and of the frame; and m of their unit."""
        unit = self.found["x"][1] if self.found["x"][1] in ("cm", "mm", "ft") else "m"
        factor = {"cm": 0.01, "mm": 0.001, "ft": 0.3048, "m": 1.0}[unit]
        reason = "by its name" if self.found["x"][1] else "by its name; m is taken"
        for name, values in (("x", x), ("y", y)):
            text = f'{name} = {{ column = {_quoted(self.found[name][0])}, unit = "{unit}" }}'
            out.sure(text, f"{reason}; {np.nanmin(values):.9g} to {np.nanmax(values):.9g}")
        far = float(np.nanmax(np.abs(np.concatenate([x, y])))) * factor
        if 1e5 < np.nanmedian(x) * factor < 9e5 and 0.0 < np.nanmedian(y) * factor < 1e7 and far > 1e6:
            zone = _zone(self.network)
            line = f'crs = "EPSG:{zone or "326.."}"'
            if zone:
                out.sure(line, "eastings and northings of UTM, in the zone of the map")
            else:
                out.ask(line, "eastings and northings: which zone of UTM? 32632 is zone 32 north")
        elif self.where == "sd" and far < NEAR:
            self.relative = True
            out.sure(
                'frame = "ego"', f"positions are within {far:.0f} m of 0: what a sensor sees from the EGO"
            )
            out.ask(
                'frame = "sensor"',
                "and mounting = [x, y, heading], if they count from the sensor, not the EGO's centre",
            )
        else:
            self._mirror(out, x * factor, y * factor)
        return factor

    def _mirror(self, out: _Lines, x: Floats, y: Floats) -> None:
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
        elif as_is < 0.5:
            out.ask(
                "offset = [0.0, 0.0, 0.0]",
                f"{told}: the pose of the table's axes in the map, or its crs, or frame",
            )
        else:
            out.lines.append(f'# frame = "map"  # {told}')

    def _motion(self, t: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats] | None:
        """Course [rad] and speed [m/s] of the positions, NaN where nothing moves; None in the EGO's frame."""
        if self.relative:
            return None
        course, speed = np.full(len(t), np.nan), np.full(len(t), np.nan)
        for indices in pd.Series(self._ids().to_numpy()).groupby(self._ids().to_numpy()).indices.values():
            rows = np.asarray(indices)
            own = rows[np.isfinite(x[rows]) & np.isfinite(y[rows])]
            own = own[np.argsort(t[own], kind="stable")]
            _, first = np.unique(t[own], return_index=True)
            own = own[first]
            if len(own) < 3:
                continue
            times, p = t[own], x[own] + 1j * y[own]
            reach = max(REACH, float(np.median(np.diff(times))))
            early, late = (np.clip(times + by, times[0], times[-1]) for by in (-reach, reach))
            velocity = (np.interp(late, times, p) - np.interp(early, times, p)) / (late - early)
            course[own], speed[own] = np.angle(velocity), np.abs(velocity)
        return course, speed

    def _heading(
        self, out: _Lines, motion: tuple[Floats, Floats] | None, places: tuple[Floats, Floats] | None
    ) -> tuple[Floats, Floats] | None:
        raw = self._numbers("heading")
        if raw is None:
            out.lines.append("# heading is not there: it follows from the velocity, or the positions")
            return motion
        column, unit = self.found["heading"]
        line = 'heading = {{ column = {}, unit = "{}", zero = "{}", clockwise = {} }}'.format
        if motion is None or not (motion[1] > MOVES).any():
            turns = "deg" if unit == "deg" or np.nanmax(np.abs(raw)) > 6.4 else "rad"
            out.ask(
                line(_quoted(column), turns, "x", "false"),
                "no motion in the map tells its unit, zero and direction",
            )
            return motion
        drives = (motion[1] > MOVES) & np.isfinite(raw)
        fits = sorted(_conventions(raw[drives], motion[0][drives], unit), key=lambda one: one[0])
        off, turns, zero, clockwise = fits[0]
        told = line(_quoted(column), turns, zero, str(clockwise).lower())
        words = f"{off:.3f} rad off the direction of motion"
        if off > FITS:
            out.ask(
                told, f"no convention fits, the best is {words}: is the time's or the positions' unit right?"
            )
            return motion
        rivals = [one for one in fits[1:] if one[0] < max(CLEAR * off, 0.02)]
        if rivals:
            words += "; as good: " + ", ".join(
                f"{u}, {z}, clockwise {str(c).lower()}" for _, u, z, c in rivals[:3]
            )
        out.sure(told, words)
        return motion

    def _speed(self, out: _Lines, motion: tuple[Floats, Floats] | None) -> None:
        raw = self._numbers("v")
        if raw is None:
            self._velocity(out)
            return
        column, unit = self.found["v"]
        line = 'v = {{ column = {}, unit = "{}" }}'.format
        drives = None if motion is None else (motion[1] > MOVES) & (np.abs(raw) > 0.1)
        if motion is None or drives is None or not drives.any():
            known = unit if unit in SPEEDS else ""
            if known:
                out.sure(line(_quoted(column), known), "by its name")
            else:
                out.ask(line(_quoted(column), "m/s"), f"its unit; up to {np.nanmax(np.abs(raw)):.4g}")
            return
        ratio = float(np.median(np.abs(raw[drives]) / motion[1][drives]))
        best = min(SPEEDS, key=lambda u: abs(ratio * SPEEDS[u] - 1.0))
        told = f"{ratio:.3g} times what the positions give"
        if abs(ratio * SPEEDS[best] - 1.0) < FITS:
            out.sure(line(_quoted(column), best), told)
        else:
            out.ask(
                line(_quoted(column), unit if unit in SPEEDS else "m/s"),
                f"{told}, which is no unit: is t's right?",
            )

    def _velocity(self, out: _Lines) -> None:
        if not {"vx", "vy"} <= set(self.found):
            out.lines.append("# v is not there: it follows from the positions")
            return
        for name in ("vx", "vy"):
            column, unit = self.found[name]
            line = f'{name} = {{ column = {_quoted(column)}, unit = "{unit if unit in SPEEDS else "m/s"}" }}'
            if self.relative:
                out.ask(line, "add relative = true where the EGO's velocity is still to be added")
            else:
                out.sure(line, "by its name; m/s is taken" if unit not in SPEEDS else "by its name")

    def _sizes(self, out: _Lines) -> None:
        for name, ranges in SIZES.items():
            raw = self._numbers(name)
            if raw is None:
                out.ask(
                    f"{name} = {{ value = {'4.7' if name == 'length' else '1.9'} }}",
                    "else it is assumed by kind",
                )
                continue
            middle = float(np.nanmedian(raw[raw > 0.0])) if (raw > 0.0).any() else 0.0
            unit = next((u for u, low, high in ranges if low <= middle <= high), "")
            line = f'{name} = {{ column = {_quoted(self.found[name][0])}, unit = "{unit or "m"}" }}'
            (out.sure if unit else out.ask)(line, f"the median is {middle:.4g}")

    def _kind(self, out: _Lines) -> None:
        if "kind" not in self.found:
            out.ask('kind = { value = "car" }', f"what the objects are: {', '.join(KINDS)}")
            return
        column = self.found["kind"][0]
        words = self.rows.words(column).drop_duplicates().head(30).tolist()
        known = {w: names.KINDS.get(names.plain(w), names.plain(w)) for w in words}
        strange = [w for w in words if known[w] not in KINDS]
        entries = ", ".join(
            f'{_quoted(w)} = "{known[w] if w not in strange else "unknown"}"' for w in words if w
        )
        line = f"kind = {{ column = {_quoted(column)}, names = {{ {entries} }} }}"
        if strange:
            line += f"  # FILL IN: what {', '.join(map(repr, strange))} are"
            out.lines.append(line)
        else:
            out.sure(line, "by its name")


def _conventions(raw: Floats, course: Floats, unit: str) -> Iterator[tuple[float, str, str, bool]]:
    """Median misfit [rad] of each unit, zero and direction; those of the name alone, where it has a unit."""
    for turns, factor in (("rad", 1.0), ("deg", np.pi / 180.0)):
        if unit in ("rad", "deg") and unit != turns:
            continue
        for zero, offset in (("x", 0.0), ("north", 0.5 * np.pi)):
            for clockwise in (False, True):
                heading = (-1.0 if clockwise else 1.0) * raw * factor + offset
                yield float(np.median(np.abs(wrap_angle(heading - course)))), turns, zero, clockwise


def _dialect(path: Path) -> tuple[str, str]:
    """What stands between values, and before decimals."""
    if path.suffix == ".parquet" or not path.is_file():
        return ",", "."
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = [line for _, line in zip(range(20), file, strict=False)]
    head = lines[0] if lines else ""
    separator = max(",;\t|", key=head.count)
    body = "".join(lines[1:])
    return separator, "," if separator != "," and body.count(",") > body.count(".") else "."


def _step(ids: pd.Series, t: Floats) -> float:
    """The usual step of an object's times."""
    steps = pd.Series(t).groupby(ids.to_numpy(), sort=False).diff().to_numpy(float)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0


def _time_unit(raw: Floats, step: float, told: str) -> tuple[str, str]:
    """The unit of times, "" where nothing tells; and why."""
    if told in TIMES:
        return told, f"by its name; steps of {step:g}"
    first = abs(float(np.nanmin(raw)))
    for unit, least in UNIX:
        if first > least:
            return unit, f"{first:.10g} is a Unix time in {unit}"
    fitting = [unit for unit, low, high in STEPS if low <= step <= high]
    whole = bool((raw == np.round(raw)).all())
    if len(fitting) != 1 or (whole and step < 2.0):
        return "", ""
    return fitting[0], f"steps of {step:g}"


def _zone(network: RoadNetwork | None) -> str:
    """EPSG code of the UTM zone that the map lies in, "" where it does not tell."""
    from pyproj import Transformer

    from resim.recordings.mapped.frames import map_crs

    if network is None or network.geo_reference is None:
        return ""
    first = next(iter(network.roads.values())).geometries[0]
    to_degrees = Transformer.from_crs(map_crs(network), "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(first.x + network.header.offset[0], first.y + network.header.offset[1])
    return f"{326 if lat >= 0.0 else 327}{int((lon + 180.0) // 6.0) + 1:02d}"


def _quoted(text: str) -> str:
    """A TOML string (JSON's escapes, and DEL)."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def fill_ins(text: str) -> Sequence[str]:
    """Give the lines of a guessed mapping that somebody has to look at."""
    return [line for line in text.splitlines() if "FILL IN:" in line]
