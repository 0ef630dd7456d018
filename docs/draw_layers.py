"""Draw images/layers.svg from the import contracts in pyproject.toml: `python docs/draw_layers.py`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

HERE = Path(__file__).parent
PICTURE = HERE / "images" / "layers.svg"
ROW, BOX, PAD, WIDTH = 44, 32, 8, 900
COLOURS = 'fill="#e8eef7" stroke="#4a6fa5"'
STYLE = 'text-anchor="middle" font-family="sans-serif" font-size="14"'


def layers() -> list[list[str]]:
    """Give the packages of each layer, the uppermost first."""
    settings = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (found,) = (c["layers"] for c in contracts if c["type"] == "layers")
    return [[name.strip(" ()").removeprefix("resim.") for name in line.split("|")] for line in found]


def picture(rows: list[list[str]]) -> str:
    """Give the SVG: a row for each layer, a box for each package."""
    height = ROW * len(rows) + PAD
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}">',
        "<title>Layers of resim: each imports only what is below it</title>",
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
    ]
    for n, names in enumerate(rows):
        width = (WIDTH - PAD) / len(names) - PAD
        for k, name in enumerate(names):
            x, y = PAD + k * (width + PAD), PAD + n * ROW
            out += [
                f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{BOX}" rx="4" {COLOURS}/>',
                f'<text x="{x + width / 2:.1f}" y="{y + 21}" {STYLE}>{escape(name)}</text>',
            ]
    return "\n".join([*out, "</svg>"]) + "\n"


def draw() -> None:
    """Write the picture, if it is not the same already."""
    made = picture(layers())
    if not PICTURE.is_file() or PICTURE.read_text(encoding="utf-8") != made:
        PICTURE.write_text(made, encoding="utf-8")


if __name__ == "__main__":
    draw()
