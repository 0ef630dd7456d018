"""A page of the player as a video: its frames as Chromium draws them, encoded by ffmpeg (mp4) or Pillow (gif)."""

from __future__ import annotations

import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from pathlib import Path

from resim.core.clock import regular
from resim.core.errors import InputError

RATE = 10
"""Frames a second of the drive and of the video."""
SIZE = (1000, 1000)
"""Width and height [px] of the window that is filmed."""
LONGEST = 120.0
"""s of a drive that are filmed."""
BARE = """header, .player .side, .player .transport > :not(#clock), .player details, .player p.note, #trails, #labels,
#plans { display: none !important; } .player .stage { height: 420px !important; }"""
"""What has no place in a video."""
DRAWN = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


def check_video(out: Path) -> None:
    """Raise InputError, before any work is done, where there is no browser or encoder for this kind of file."""
    if out.suffix.lower() not in (".mp4", ".gif"):
        raise InputError(
            out, f"is no video of a known kind ({out.suffix or 'no suffix'})", "Name a .mp4 or .gif file."
        )
    if out.exists():
        raise InputError(out, "exists already", "Remove it or name another with --video.")
    if out.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(
            out, "needs ffmpeg, which is not on the path", "Install ffmpeg, or name a .gif file."
        )
    if shutil.which("chromium") is None:
        raise InputError(out, "needs chromium, which is not on the path", "Install chromium.")
    needed = ("playwright.sync_api", *(["PIL.Image"] if out.suffix.lower() == ".gif" else []))
    for name in needed:
        try:
            __import__(name)
        except ImportError:
            package = {"PIL.Image": "pillow"}.get(name, "playwright")
            raise InputError(out, f"needs the package {package}", f"pip install {package}") from None


def write_video(page: Path, out: Path, kind: str, start: float, end: float) -> int:
    """Film a page from start to end [s] and give the number of frames; kind: .mp4 or .gif, whatever `out` is called.

    Raises InputError where it lasts too long, or the encoder fails.
    """
    if end - start > LONGEST:
        problem = f"the drive lasts {end - start:.0f} s; up to {LONGEST:.0f} s are filmed"
        raise InputError("--video", problem, "Play it, or cut the recording.")
    times = regular(start, end - start, 1.0 / RATE).tolist()
    with ThreadPoolExecutor(1) as own:  # a notebook has an event loop in its thread, which playwright refuses
        frames = own.submit(_frames, page, times).result()
    return _gif(frames, out) if kind == ".gif" else _mp4(frames, out)


def _frames(page: Path, times: list[float]) -> list[bytes]:
    """The page as PNG at each time [s]."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        as_root = ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium refuses its sandbox to root
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=as_root)
        try:
            view = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
            view.goto(page.resolve().as_uri())
            view.add_style_tag(content=BARE)
            view.evaluate(DRAWN)
            out = []
            for t in times:
                view.evaluate("t => { location.hash = `#t=${t}`; }", round(t, 4))
                view.evaluate(DRAWN)
                out.append(view.locator("main").screenshot())
            return out
        finally:
            browser.close()


def _mp4(frames: list[bytes], out: Path) -> int:
    even = "pad=ceil(iw/2)*2:ceil(ih/2)*2"
    how = [
        "-f",
        "image2pipe",
        "-framerate",
        str(RATE),
        "-i",
        "-",
        "-vf",
        even,
        "-pix_fmt",
        "yuv420p",
        "-f",
        "mp4",
    ]
    command = ["ffmpeg", "-v", "error", "-y", *how, str(out.resolve())]
    done = subprocess.run(command, input=b"".join(frames), capture_output=True, check=False)
    if done.returncode:
        told = done.stderr.decode("utf-8", "replace").strip().splitlines() or [f"exit code {done.returncode}"]
        raise InputError("--video", f"ffmpeg failed: {told[-1]}", "Name a .gif file.")
    return len(frames)


def _gif(frames: list[bytes], out: Path) -> int:
    from PIL import Image

    pictures = [Image.open(BytesIO(frame)).convert("RGB").quantize(256) for frame in frames]
    pictures[0].save(
        out, format="GIF", save_all=True, append_images=pictures[1:], duration=1000 // RATE, loop=0
    )
    return len(pictures)
