"""Examine the shipped and the real recordings, and print every finding for docs/validation.md.

    python tools/check_real.py ../shared/data [--only NAME]

NGSIM through the CommonRoad reader (the vehicle that is there longest is EGO), once more through the highD
reader, and Mcity through its reader.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from validate_real import NGSIM, candidates

from resim.core.errors import ResimError
from resim.recordings import Alignment, RecordingTables, read_commonroad, read_highd, read_tables
from resim.recordings.checks import examine
from resim.recordings.formats.mcity import import_trial
from resim.recordings.formats.mcity_frames import trials
from resim.road.opendrive import load

SCENARIOS = Path(__file__).parents[1] / "scenarios"


def recordings(data: Path) -> Iterator[RecordingTables]:
    """The tables of every recording there is."""
    for folder in sorted(SCENARIOS.iterdir()):
        if (folder / "recording.toml").is_file():
            yield read_tables(folder)
    for name in NGSIM:
        xml, road = data / "ngsim" / f"{name}.xml", data / "ngsim" / f"{name}.xodr"
        yield RecordingTables.of(read_commonroad(xml, map=road, ego=candidates(xml, 1)[0]))
    csv = data / "highd_format" / "us101_22" / "01_tracks.csv"
    road = data / "ngsim" / "USA_US101-22_1_T-1.xodr"
    sample = read_highd(csv, map=road, ego="10", alignment=Alignment(-21.7293, 51.5141, -0.71823))
    yield RecordingTables.of(replace(sample, name="highd_us101_22"))
    mcity = data / "mcity"
    network = load(mcity / "mcity.xodr")
    for trial in trials(mcity):
        yield import_trial(trial, mcity, network)


def main() -> None:
    warnings.simplefilter("error", RuntimeWarning)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    print("| recording | severity | code | source | object | start | end | value | finding |\n|" + "---|" * 9)
    for tables in recordings(arguments.data):
        name = tables.settings.name
        if arguments.only not in name:
            continue
        try:
            network = load(tables.map)
        except ResimError as e:
            print(f"| {name} | map not readable: {e} |")
            network = None
        begin = time.perf_counter()
        findings = examine(tables, network)
        took = time.perf_counter() - begin
        for f in findings:
            span = f"{f.start:.2f} | {f.end:.2f} | {f.value:.3g} {f.unit}"
            print(f"| {name} | {f.severity} | {f.code} | {f.source} | {f.object} | {span} | {f.text} |")
        print(f"| {name} | | {len(findings)} findings in {took:.2f} s | | | | | | |", flush=True)


if __name__ == "__main__":
    main()
