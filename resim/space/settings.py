"""How a space is built."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from resim.core.spec import Strict
from resim.space.clustering import PUBLISHED_THRESHOLD, Choice, Linkage
from resim.space.distance import PUBLISHED, DistanceOptions

LARGEST = 20_000
"""Scenarios of a bucket up to which the full matrix is made: 1.6 GB."""
SAMPLE = 4_000
"""Scenarios of a larger bucket that are clustered at once."""


class SpaceSettings(Strict):
    """How scenarios are compared and clustered.

    Attributes:
        distance: What counts beside the published distance.
        linkage: Of the clustering; the published one is complete.
        threshold: Up to and with which clusters are merged: a distance, or `silhouette` or `stability`, by which one is
            chosen in each bucket.
        bucket: What scenarios must share to be compared: map, road, direction, lanes and vehicles; or lanes and
            vehicles; or vehicles alone.
        largest: Scenarios of a bucket up to which all distances are computed.
        sample: Of larger buckets, how many are clustered at once.
        seed: Of the draws of samples.
    """

    distance: DistanceOptions = PUBLISHED
    linkage: Linkage = "complete"
    threshold: Annotated[float, Field(strict=True, gt=0.0)] | Choice = PUBLISHED_THRESHOLD
    bucket: Literal["road", "lanes", "vehicles"] = "road"
    largest: Annotated[int, Field(strict=True, ge=3)] = LARGEST
    sample: Annotated[int, Field(strict=True, ge=3)] = SAMPLE
    seed: Annotated[int, Field(strict=True, ge=0)] = 0


DEFAULT_SETTINGS = SpaceSettings()
