"""The figures of a space's page."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import dendrogram, linkage

from resim.space.page.figures import ABOVE, _by_color


def test_a_cluster_has_one_colour_in_the_dendrogram() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(0.0, 1.0, 20) + 100.0 * k for k in range(3)])
    links = linkage(points[:, None], "complete")
    told = dendrogram(links, no_plot=True)
    found = _by_color(np.array(told["icoord"]), np.array(told["dcoord"]), links, 10.0)
    assert [len(x) for _, (x, _) in found] == [2, 19, 19, 19]
    assert found[0][0] == ABOVE
    assert len({color for color, _ in found}) == 4
