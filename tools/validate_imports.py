"""Imports every foreign recording of DATA, or says why it is refused: `python tools/validate_imports.py DATA`.

Prints tables for docs/validation.md. OpenSCENARIO files get the map that they name from DATA/xodr/alks, as they are
and with `--end 3`.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from resim.core.errors import InputError  # noqa: E402
from resim.recordings import Recording, RecordingTables, write_tables  # noqa: E402
from resim.recordings.formats.registry import FORMATS  # noqa: E402

Import = tuple[str, str, Path, dict[str, Any]]
"""What is shown, the format, the file, and the options of its reader."""


def main() -> None:
    """Import all, and print a table."""
    data = Path(sys.argv[1])
    print("| file | how | found |\n|---|---|---|")
    for name, form, file, how in [*_osi(data), *_tables(data)]:
        found = _imported(form, file, how).replace("|", "\\|").replace(f"{data}/", "")
        print(f"| {name} | {_words(form, how)} | {found} |")
    print("\n| scenario | as it is | with --end 3 |\n|---|---|---|")
    for name, file, road in _scenarios(data):
        first, cut = (_imported("openscenario", file, {"map": road, **end}) for end in ({}, {"end": 3.0}))
        print(f"| {name} | {first} | {'the same' if cut == first else cut} |")


def _words(form: str, how: dict[str, Any]) -> str:
    options = (f"--{key} {value.name if isinstance(value, Path) else value}" for key, value in how.items())
    return " ".join([form, *options])


def _imported(form: str, file: Path, how: dict[str, Any]) -> str:
    """How many objects over which time came in, or why none did."""
    reader = next(one for one in FORMATS if one.name == form).reader
    try:
        found = reader(file, **how)
        tables = RecordingTables.of(found) if isinstance(found, Recording) else found
        with tempfile.TemporaryDirectory() as folder:
            write_tables(tables, Path(folder) / "recording")
    except InputError as e:
        return f"refused: {_short(e.problem)}"
    gt, sd = tables.gt, tables.sd
    text = f"{gt['id'].nunique()} objects, {gt['t'].max() - gt['t'].min():.2f} s"
    return text if sd is None else f"{text}; sensor data of {sd['id'].nunique()}"


def _short(problem: str) -> str:
    """The element and the reason, without the way to the element."""
    text = re.sub(r"Storyboard/\S*?([^/\s]+)(?= )", r"\1", problem)
    return text if len(text) < 160 else f"{text[:150]} ..."


def _osi(data: Path) -> Iterator[Import]:
    osi = data / "osi"
    for name, road in (("acc-test.osi", "straight_500m"), ("alks_cut-in.osi", "straight_500m")):
        yield name, "osi", osi / name, {"map": osi / f"{road}.xodr", "ego": "0"}
    name = "osi_centerline_example.mcap"
    yield name, "osi", osi / name, {}
    yield name, "osi", osi / name, {"map": osi / "straight_500m.xodr"}


def _tables(data: Path) -> Iterator[Import]:
    for trial in (3, 4, 5, 11):
        yield "mcity", "mcity", data / "mcity", {"trial": str(trial)}
    ngsim = data / "ngsim"
    for name, ego in (
        ("USA_US101-5_1_T-1", "449"), ("USA_US101-10_1_T-1", "524"), ("USA_US101-12_1_T-1", "376"),
        ("USA_US101-22_1_T-1", "675"), ("USA_Lanker-1_17_T-1", "1545"),
    ):  # fmt: skip
        yield f"{name}.xml", "commonroad", ngsim / f"{name}.xml", {"map": ngsim / f"{name}.xodr", "ego": ego}
    road = ngsim / "USA_US101-22_1_T-1.xodr"
    for folder, ego in (("us101_22", "54"), ("ika_schema_example", "1")):
        yield folder, "highd", data / "highd_format" / folder / "01_tracks.csv", {"map": road, "ego": ego}
    columns = ROOT / "resim" / "recordings" / "logs" / "mappings" / "autoware_tracked.toml"
    comma = data / "comma2k19" / "CAN" / "radar" / "value"
    yield "comma2k19/CAN/radar", "table", comma, {"map": road, "columns": columns}


def _scenarios(data: Path) -> Iterator[tuple[str, Path, Path]]:
    for file in sorted((data / "xosc" / "alks").glob("*.xosc")):
        (road,) = set(re.findall(r"alks_road_\w+\.xodr", file.read_text(encoding="utf-8")))
        name = re.sub(r"alks_scenario_|_template.xosc", "", file.name)
        yield name, file, data / "xodr" / "alks" / road


if __name__ == "__main__":
    main()
