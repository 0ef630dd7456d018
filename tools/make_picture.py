"""Make the picture in the README: the top of the corner case's report, as a browser shows it; and that of the player.

    make demo && .venv/bin/python tools/make_picture.py out/cut_in_brake/report.html docs/images/report.png
    .venv/bin/resim play out/cut_in_brake --out play.html
    .venv/bin/python tools/make_picture.py play.html docs/images/player.png --at t=7.1 --height 1200

Needs Chromium (`chromium` on the path) and Pillow, which matplotlib brings along.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

WIDTH, HEIGHT = 1280, 1500


def main(page: Path, picture: Path, at: str = "", height: int = HEIGHT) -> None:
    """Take the screenshot; at: what the address says after #. height: px."""
    with tempfile.TemporaryDirectory() as profile:
        options = [
            "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--disable-quic",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            f"--user-data-dir={profile}", "--virtual-time-budget=8000", f"--window-size={WIDTH},{height}",
            f"--screenshot={picture.resolve()}",
        ]  # fmt: skip
        subprocess.run(
            ["chromium", *options, f"{page.resolve().as_uri()}{at and f'#{at}'}"],
            check=True,
            capture_output=True,
        )
    Image.open(picture).convert("RGB").save(picture, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--at", default="", help="What the address says after #.")
    parser.add_argument("--height", type=int, default=HEIGHT, help="Height [px].")
    main(**vars(parser.parse_args()))
