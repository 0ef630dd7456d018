"""Holds exported drives against ASAM's checker: `python tools/validate_openscenario.py CHECKER DATA`.

CHECKER: `qc_openscenario` of the package asam-qc-openscenarioxml, in an environment of its own
(`make checked_openscenario`). DATA: folder with real recordings; those that ship are checked without.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

from resim.jobs.export import export_openscenario
from resim.scenario.openscenario import STYLES, VERSIONS

ROOT = Path(__file__).parents[1]
REAL = ("USA_US101-5_1_T-1", "USA_US101-12_1_T-1", "USA_US101-22_1_T-1", "USA_Lanker-1_17_T-1")


def drives(data: Path, home: Path) -> dict[str, Path]:
    """The recordings that ship, and those of the data folder with their longest vehicle as EGO."""
    found = {name: ROOT / "scenarios" / name for name in ("cut_in_brake", "rear_end", "overtake")}
    for name in REAL:
        source = data / "ngsim" / f"{name}.xml"
        if not source.is_file():
            continue
        counts = {
            one.get("id", ""): len(one.findall(".//state"))
            for one in ElementTree.parse(source).getroot()
            if one.tag in ("obstacle", "dynamicObstacle")
        }
        order = ["import", "commonroad", source, "--map", source.with_suffix(".xodr")]
        order += ["--ego", max(counts, key=lambda one: (counts[one], one)), "--out", home / name]
        subprocess.run([sys.executable, "-m", "resim", *map(str, order)], check=True, capture_output=True)
        found[name] = home / name
    return found


def findings(checker: Path, file: Path, home: Path) -> tuple[int, int, list[str]]:
    """How many checks ended, how many did not, and what the others found."""
    result = home / "result.xqar"
    result.unlink(missing_ok=True)
    (home / "config.xml").write_text(
        f'<?xml version="1.0"?><Config><Param name="InputFile" value="{file}"/>'
        f'<CheckerBundle application="xoscBundle"><Param name="resultFile" value="{result}"/></CheckerBundle></Config>'
    )
    order = [checker, "-c", home / "config.xml"]
    subprocess.run(list(map(str, order)), check=True, capture_output=True, cwd=home)
    told = ElementTree.parse(result).getroot()
    status = [one.get("status") for one in told.iter("Checker")]
    issues = [f"{one.get('description')}" for one in told.iter("Issue")]
    return status.count("completed"), len(status) - status.count("completed"), issues


def main(checker: Path, data: Path) -> None:
    """Print a table."""
    print("| drive | files | entities | s to export | checks that ended | others | findings |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        for name, drive in drives(data, home).items():
            ended, others, issues, files, count, taken = 0, 0, list[str](), 0, 0, 0.0
            for version, style in product(VERSIONS, STYLES):
                begin = time.perf_counter()
                report = export_openscenario(drive, home / "out", version=version, style=style)
                taken += time.perf_counter() - begin
                for source in report.sources.values():
                    text = home / "out" / source
                    count = len(ElementTree.parse(text).getroot().findall("Entities/ScenarioObject"))
                    done, lost, told = findings(checker, text, home)
                    ended, others, issues, files = ended + done, others + lost, issues + told, files + 1
            taken /= len(VERSIONS) * len(STYLES)
            said = "; ".join(sorted(set(issues))) or "none"
            print(
                f"| {name} | {files} | {count} | {taken:.1f} | {ended} | {others} | {said} |",
                flush=True,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute(), Path(sys.argv[2]))
