"""Drives that nobody would think of, and how they are compared."""

from __future__ import annotations

import numpy as np
from conftest import ROOT
from hypothesis import strategies as st

from resim.core.tracks import Tracks
from resim.recordings import Recording

MAP = ROOT / "networks" / "proving_ground.xodr"
NAMES = st.lists(
    st.text(st.characters(categories=("L", "N", "P", "S")), min_size=1, max_size=6).filter(lambda s: "~" not in s),
    min_size=2, max_size=4, unique=True,
)  # fmt: skip
NUMBERS = st.lists(st.integers(0, 2**63 - 1).map(str), min_size=2, max_size=4, unique=True)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Drives at any clock and place: objects that stand, turn, reverse, come, vanish and come back; SD of some."""
    ids = draw(st.one_of(NAMES, NUMBERS))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    begin = draw(st.sampled_from([0.0, -3.25, 12.5, 1_732_500_000.123]))
    far = draw(st.sampled_from([0.0, 1e6, -5.4e6]))
    step = draw(st.sampled_from([0.01, 0.04, 0.1, 1 / 3]))
    count = draw(st.integers(2, 12))
    optional = draw(st.sets(st.sampled_from(["a", "yaw_rate", "z"])))

    def tracks(names: list[str], every: str | None) -> Tracks:
        n = len(names)
        valid = rng.random((n, count)) < 0.7
        valid[[k for k, name in enumerate(names) if name == every]] = True
        valid[:, :2] |= ~valid.any(axis=1, keepdims=True)
        valid[-1, :2] = True  # somebody has two samples
        columns = {
            "x": far + rng.normal(0.0, 100.0, (n, count)), "y": 2.0 * far + rng.normal(0.0, 100.0, (n, count)),
            "heading": rng.uniform(-3.14, 3.14, (n, count)),
            "v": rng.normal(0.0, 20.0, (n, count)) * (rng.random((n, 1)) < 0.8),
        }  # fmt: skip
        more = {name: np.where(valid, rng.normal(0.0, 3.0, (n, count)), np.nan) for name in sorted(optional)}
        for name, values in more.items():
            if rng.random() < 0.3:  # not known of everybody at all times
                more[name] = np.where(rng.random(values.shape) < 0.3, np.nan, values)
        kinds = rng.choice(["car", "truck", "bus", "pedestrian", "bicycle", "unknown"], n)
        return Tracks(
            t=begin + step * np.arange(count), ids=np.array(names), kind=kinds.astype(str), valid=valid,
            length=rng.uniform(0.5, 18.0, n), width=rng.uniform(0.5, 3.0, n),
            **{name: np.where(valid, values, np.nan) for name, values in columns.items()}, **more,
        )  # fmt: skip

    gt = tracks(ids, ids[0])
    seen = draw(st.sampled_from(["none", "others", "all"]))
    sd = None if seen == "none" else tracks(ids if seen == "all" else ids[1:], ids[0])
    if sd is not None:
        box = {c: getattr(sd, c).copy() for c in ("kind", "length", "width")}
        if sd.ids[0] == ids[0]:  # who is of another kind or size is not taken for the EGO
            for c, values in box.items():
                values[0] = getattr(gt, c)[0]
        sd = Tracks(**{**vars(sd), **box, "a": None, "yaw_rate": None, "z": None})
    names = None if sd is None else sd.ids
    if sd is not None and draw(st.booleans()):  # the sensor's own names; one of them of nobody
        own = [name if name == ids[0] else f"s{k}" for k, name in enumerate(sd.ids.tolist())]
        names = np.array(
            ["" if k == len(own) - 1 and own[k] != ids[0] else n for k, n in enumerate(sd.ids.tolist())]
        )
        sd = Tracks(**{**vars(sd), "ids": np.array(own)})
    return Recording(
        name="d", map=MAP, ego=ids[0], gt=gt, gt_rate=1 / step, sd=sd,
        sd_gt_id=names,
    )  # fmt: skip


def assert_same(
    found: Tracks,
    true: Tracks,
    origin: float,
    ego: str = "",
    only: tuple[str, ...] = ("x", "y", "v", "a", "yaw_rate", "z"),
) -> None:
    """States to 1e-6 m, times to 1e-9 s or what a clock of 1.7e9 s holds; what was not measured is not made up."""
    assert sorted(found.ids.tolist()) == sorted(true.ids[true.valid.any(axis=1)].tolist())
    there = true.valid.any(axis=0)
    np.testing.assert_allclose(found.t, true.t[there] - origin, rtol=0, atol=2e-9 + 3e-16 * abs(origin))
    for name in found.ids.tolist():
        n, own = found.index(name), true.index(name)
        np.testing.assert_array_equal(found.valid[n], true.valid[own, there])
        own_valid = true.valid[own] & there
        assert found.kind[n] == true.kind[own] or name == ego  # a host vehicle has no kind of its own
        for column in only:
            a, b = getattr(found, column), getattr(true, column)
            if b is not None and np.isnan(b[true.valid]).any():
                b = None  # what is not known of everybody at all times is nobody's
            assert (a is None) == (b is None), column
            if a is not None:
                np.testing.assert_allclose(a[n, found.valid[n]], b[own, own_valid], rtol=0, atol=1e-6)
        turned = found.heading[n, found.valid[n]] - true.heading[own, own_valid]
        np.testing.assert_allclose(np.angle(np.exp(1j * turned)), 0.0, atol=1e-9)
        assert found.length[n] == true.length[own]
        assert found.width[n] == true.width[own]
