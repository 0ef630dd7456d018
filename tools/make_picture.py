"""Make the picture in the README: the top of the corner case's report, as a browser shows it.

    make demo && .venv/bin/python tools/make_picture.py out/cut_in_brake/report.html docs/images/report.png

Needs Chromium (`chromium` on the path) and Pillow, which matplotlib brings along.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

WIDTH, HEIGHT = 1280, 1500


def main(page: Path, picture: Path) -> None:
    """Take the screenshot, with few colours for a small file."""
    with tempfile.TemporaryDirectory() as profile:
        options = [
            "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--disable-quic",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            f"--user-data-dir={profile}", "--virtual-time-budget=8000", f"--window-size={WIDTH},{HEIGHT}",
            f"--screenshot={picture.resolve()}",
        ]  # fmt: skip
        subprocess.run(["chromium", *options, page.resolve().as_uri()], check=True, capture_output=True)
    Image.open(picture).convert("RGB").quantize(64).save(picture, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
