"""What the kernel is given and gives, and what it reuses from scene to scene."""

# mypy: ignore-errors
from __future__ import annotations

from collections import namedtuple

import numpy as np

from resim.core.compiled import inner
from resim.metrics.risk.kernel.consolidation import weights
from resim.metrics.risk.kernel.motion import ROWS, SAMPLED

LEFT, RIGHT, BRAKE, ACCELERATE = 0, 1, 2, 3
"""Evasions."""
OPTIONS = 4
PAD = 7
"""Room behind the samples: columns a power of two apart would share few lines of the processor's cache."""

SceneArrays = namedtuple("SceneArrays", "plan ego_size state size inputs motion")
"""See `resim.metrics.risk.metric.Scenes`."""

Road = namedtuple("Road", "points begin first count s d")
"""See `resim.metrics.risk.lane_paths.LanePaths`."""

Sampling = namedtuple("Sampling", "sample weight limits times h swept")
"""What holds for all scenes.

sample (N, 2), in units of 3 sigma, and weight (N,) of Eq. 4.5. limits: lateral, braking and forward acceleration
[m/s²] and curvature [1/m] of evasions. times: T_PNR, T_max [s] and slope of Eq. 4.6. h: step [s]. swept: whether
boxes are looked at between the grid's times too.
"""

RiskArrays = namedtuple("RiskArrays", "r_to r_ind r_dep collision ttc ttr")
"""See `resim.metrics.risk.metric.Risk`."""

Work = namedtuple(
    "Work",
    "paths plan one arc made s speed samples scratch a b share near hint helped table mass"
    " sample weight limits h swept",
)
"""What is reused from scene to scene.

paths: of evasions by begin and option, as far as made; then, as paths number plan, one and arc, of the plan, the
object's sample and the EGO's turn. s, speed: the plan's way [m] and speed [m/s]. samples: of an object, of inputs a and
b (N,), with share (N,) of its probability. near (N,): the first step in which a sample is near. hint: by option the
last witness of a contact. helped: the option that helped last. table: Eq. 4.6 by time; mass (K, M + 2): an object's
probability by time to react. The rest: see `Sampling`.
"""


@inner
def new_work(sampling, steps, objects):
    """Room for plans of so many steps, and for so many objects."""
    points, samples = steps + 1, len(sampling.weight)
    plan = OPTIONS * points
    return Work(
        np.full((plan + 3, ROWS, points), np.nan), plan, plan + 1, plan + 2, np.zeros(plan, dtype=np.bool_),
        np.zeros(points), np.empty(points), np.empty((SAMPLED, points, samples + PAD)), np.empty((6, samples + PAD)),
        np.empty(samples), np.empty(samples), np.empty(samples), np.empty(samples, dtype=np.int64),
        np.empty((OPTIONS, 2), dtype=np.int64), np.zeros(1, dtype=np.int64),
        weights(points, sampling.times, sampling.h, sampling.swept), np.empty((objects, points + 1)),
        sampling.sample, sampling.weight, sampling.limits, sampling.h, sampling.swept,
    )  # fmt: skip
