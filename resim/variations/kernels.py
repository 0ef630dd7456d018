"""Maneuver kernels: the principal components of a kind of maneuver (Wagner 2021, 6.1.2.2, B.1), and their file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from resim.core.errors import InputError, ResimError
from resim.core.geometry import Floats
from resim.core.sealed import sealed
from resim.core.spec import EXACT, ArrayInFile, NumberOrNan, read_sealed_json, to_json
from resim.results import write_json

COMPONENTS = 20
"""N_C of the source."""
WRITER, REMEDY = "resim vary train", "Train kernels with `resim vary train`."
NOTHING = 1e-9
"""Spread of a component, by that of the first, below which it is rounding and no component."""
LARGEST = 200_000_000
"""Bytes of a file of kernels at most."""
MANEUVERS = (
    "cut_in_left", "cut_in_right", "lane_change_left", "lane_change_right", "turn_left", "turn_right",
    "strong_braking", "follow_lane",
)  # fmt: skip
"""Labels of `resim mine` that kernels are trained for, the more special before the more general: where two of an
object share a time, its way is cut at the first."""


@dataclass(frozen=True, eq=False)
class ManeuverKernel:
    """The components of one kind of maneuver, C of them, over F = 3 points features.

    Attributes:
        label: The maneuver, as `resim mine` labels it.
        traces: On how many traces it was trained.
        held_out: How many were held out.
        mean: (F,) the mean of the features: s, m, m.
        axes: (C, F) the principal directions.
        sd: (C,) standard deviation of each component over the traces it was trained on.
        low: (C,) the least of each component, c_min.
        high: (C,) its largest, c_max.
        explained: (C,) share of the variance.
        reconstruction: Mean relative error of the way to components and back, of the traces it was trained on.
        reconstruction_held_out: The same of the traces held out; NaN where there are none.
    """

    label: str
    traces: int
    held_out: int
    mean: ArrayInFile
    axes: ArrayInFile
    sd: ArrayInFile
    low: ArrayInFile
    high: ArrayInFile
    explained: ArrayInFile
    reconstruction: float
    reconstruction_held_out: NumberOrNan

    @property
    def count(self) -> int:
        """How many components."""
        return len(self.axes)

    def components(self, features: Floats) -> Floats:
        """Give the components (..., C) of features (..., F)."""
        return np.asarray((features - self.mean) @ self.axes.T)

    def features(self, components: Floats) -> Floats:
        """Give the features (..., F) of components (..., C)."""
        return np.asarray(components @ self.axes + self.mean)

    @cached_property
    def box(self) -> Floats:
        """The length (C,) of each component's range, c_max - c_min."""
        return np.asarray(self.high - self.low)


@dataclass(frozen=True)
class KernelSource:
    """A recording that traces come from.

    Attributes:
        recording: Its name.
        hash: Of its content.
        source: What its provenance says.
        traces: How many traces, by maneuver.
        left_out: How many were left out, by reason.
    """

    recording: str
    hash: str
    source: str
    traces: Mapping[str, int]
    left_out: Mapping[str, int]


@dataclass(frozen=True)
class KernelFile:
    """What a file of kernels says.

    Attributes:
        schema: Its kind.
        resim: Version that trained it.
        data: Where the traces come from: "real" where the user vouches that people drove, else "synthetic".
        points: N_F points of each trace.
        longest: s; longer stretches of a lane are cut into equal parts.
        sources: The recordings.
        kernels: By maneuver.
        not_made: By maneuver, why there is no kernel.
    """

    __pydantic_config__ = EXACT

    schema: Literal["resim-kernels-1"]
    resim: str
    data: Literal["real", "synthetic"]
    points: int
    longest: float
    sources: tuple[KernelSource, ...]
    kernels: Mapping[str, ManeuverKernel]
    not_made: Mapping[str, str]


def fit_kernel(
    label: str,
    features: Floats,
    held_out: Floats,
    *,
    components: int = COMPONENTS,
    error: float | None = None,
) -> ManeuverKernel:
    """Fit a kernel to features (N, F); held_out (M, F) are for its errors alone.

    components: at most; those without any spread in the data are none. error: take as few components as bring the mean
    relative reconstruction error of the training traces down to it, in place of a number of them. Raises ResimError for
    too few traces, and for an error that is out of reach.
    """
    from sklearn.decomposition import PCA  # takes long to load

    most = min(len(features) - 1, features.shape[1])
    if most < 1:
        raise ResimError(f"{len(features)} traces of {label} are too few for a kernel")
    wanted = most if error is not None else min(components, most)
    made = PCA(n_components=wanted, svd_solver="full").fit(features)
    spread = made.singular_values_ > NOTHING * made.singular_values_[0]
    count = int(spread.sum())
    if error is not None:
        count = _fewest(made.components_[:count], made.mean_, features, error)
    axes, mean = made.components_[:count], made.mean_
    scores = (features - mean) @ axes.T
    return ManeuverKernel(
        label, len(features), len(held_out), mean, axes, scores.std(axis=0), scores.min(axis=0), scores.max(axis=0),
        made.explained_variance_ratio_[:count], reconstruction_error(axes, mean, features),
        reconstruction_error(axes, mean, held_out) if len(held_out) else float("nan"),
    )  # fmt: skip


def reconstruction_error(axes: Floats, mean: Floats, features: Floats) -> float:
    """Give the mean over traces (N, F) of what is lost on the way to components and back, by the trace's own norm."""
    rest = features - mean
    lost = np.linalg.norm(rest - rest @ axes.T @ axes, axis=1)
    return float(np.mean(lost / np.linalg.norm(features, axis=1)))


def _fewest(axes: Floats, mean: Floats, features: Floats, error: float) -> int:
    """How many components bring the error down to this; it falls with each."""
    for count in range(1, len(axes) + 1):
        if reconstruction_error(axes[:count], mean, features) <= error:
            return count
    raise ResimError(f"no number of components reconstructs to {error:g}")


def write_kernels(kernels: KernelFile, path: Path) -> None:
    """Write a file of kernels."""
    write_json(sealed(to_json(kernels)), path)


def read_kernels(path: Path) -> KernelFile:
    """Read a file of kernels. Raises InputError for what is none."""
    found = read_sealed_json(path, KernelFile, WRITER, REMEDY, largest=LARGEST)
    for name, kernel in found.kernels.items():
        count = len(kernel.sd)
        wanted = {"mean": (3 * found.points,), "axes": (count, 3 * found.points)}
        wanted |= dict.fromkeys(("sd", "low", "high", "explained"), (count,))
        for field, shape in wanted.items():
            if (has := getattr(kernel, field).shape) != shape:
                raise InputError(path, f"kernel {name}: {field} has shape {has}, expected {shape}", REMEDY)
    return found
