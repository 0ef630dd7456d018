"""Put a version of plotly.js into resim/report/plotly: its cartesian bundle, packed, and its licence.

    python tools/vendor_plotly.py 4.1.1

Needs npm. The same version and zlib give the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import subprocess
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
OUT = ROOT / "resim" / "report" / "plotly"
PACKAGE = "plotly.js-cartesian-dist-min"
BUNDLE = "plotly-cartesian.min.js"


def vendor(version: str, out: Path = OUT) -> None:
    """Write the bundle and the licence of a version into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["npm", "pack", "--silent", f"{PACKAGE}@{version}"]
        subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        (packed,) = Path(folder).glob("*.tgz")
        with tarfile.open(packed) as archive:
            bundle, licence = (_member(archive, name) for name in (BUNDLE, "LICENSE"))
    out.mkdir(exist_ok=True)
    (out / f"{BUNDLE}.gz").write_bytes(gzip.compress(bundle, 9, mtime=0))
    (out / "LICENSE").write_bytes(licence)


def _member(archive: tarfile.TarFile, name: str) -> bytes:
    file = archive.extractfile(f"package/{name}")
    assert file is not None
    return file.read()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("version", help="such as 4.1.1")
    vendor(parser.parse_args().version)


if __name__ == "__main__":
    main()
