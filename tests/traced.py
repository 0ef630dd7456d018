"""Kernels of plainly made traces, and a straight road: what tests of variations share."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats
from resim.variations.features import POINTS
from resim.variations.kernels import KernelFile, KernelSource, ManeuverKernel, fit_kernel


def lane_changes(count: int, seed: int = 0, side: float = -1.0) -> Floats:
    """Features of lane changes with speeds, durations, widths, shapes and swerves of their own."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 1.0, POINTS)
    out = []
    for _ in range(count):
        v, a, duration = rng.normal(32.0, 4.0), rng.normal(0.0, 0.4), rng.uniform(3.0, 7.0)
        t = duration * phase
        bent = phase + rng.normal(0.0, 0.06) * np.sin(np.pi * phase)
        d = side * rng.normal(3.75, 0.2) * (bent - np.sin(2.0 * np.pi * bent) / (2.0 * np.pi))
        d += rng.normal(0.0, 0.05) * np.sin(3.0 * np.pi * phase)
        s = v * t + 0.5 * a * t**2 + rng.normal(0.0, 0.1) * np.sin(2.0 * np.pi * phase) * duration
        out.append(np.concatenate([t, s, d - d[0]]))
    return np.array(out)


def following(count: int, seed: int = 1) -> Floats:
    """Features of following a lane, swaying in it."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 1.0, POINTS)
    out = []
    for _ in range(count):
        duration = rng.uniform(2.0, 15.0)
        t = duration * phase
        s = rng.normal(30.0, 5.0) * t + 0.5 * rng.normal(0.0, 0.3) * t**2
        d = rng.normal(0.0, 0.2) * (1.0 - np.cos(np.pi * phase)) + rng.normal(0.0, 0.1) * np.sin(
            2.0 * np.pi * phase
        )
        out.append(np.concatenate([t, s, d]))
    return np.array(out)


def kernel(label: str = "lane_change_right", count: int = 400, components: int = 20) -> ManeuverKernel:
    made = following if label == "follow_lane" else lane_changes
    return fit_kernel(label, made(count, 0), made(count // 4, 9), components=components)


def kernel_file(*labels: str, components: int = 6) -> KernelFile:
    kernels = {label: kernel(label, components=components) for label in labels}
    source = KernelSource("made", "0" * 64, "tests", {"lane_change_right": 400}, {})
    return KernelFile("resim-kernels-1", "0", "synthetic", POINTS, 15.0, (source,), kernels, {})
