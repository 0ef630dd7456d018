"""What is compiled for contact and motions, against plain numpy that looks at every step and part of all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from resim.core.geometry import Boxes, boxes_overlap, wrap_angle
from resim.metrics.measures import motion
from resim.metrics.measures.contact import first_contact

PARTS, BULGE = 16, 4.0 / 27.0


def velocity(b, a):
    ends = ((m[..., 3:4], np.stack([np.cos(m[..., 2]), np.sin(m[..., 2])], axis=-1)) for m in (b, a))
    (v, way), (v0, way0) = ends
    return v * way - v0 * way0


def entry(p0, p1, heading_a, heading_b, size_a, size_b, slack):
    """Share at which boxes of fixed headings first touch while b goes straight from p0 to p1 (..., 2)."""
    c, s = np.abs(np.cos(heading_b - heading_a)), np.abs(np.sin(heading_b - heading_a))
    low, high = np.zeros(c.shape), np.ones(c.shape)
    for axis, own, other in ((heading_a, size_a, size_b), (heading_b, size_b, size_a)):
        ca, sa = np.cos(axis), np.sin(axis)
        for way, r in (
            (np.stack([ca, sa], -1), own[0] + c * other[0] + s * other[1]),
            (np.stack([-sa, ca], -1), own[1] + s * other[0] + c * other[1]),
        ):
            q0, q1 = (p0 * way).sum(-1), (p1 * way).sum(-1)
            still, r = np.abs(q1 - q0) < 1e-12, 0.5 * r + slack
            d = np.where(still, 1.0, q1 - q0)
            one, two = (-r - q0) / d, (r - q0) / d
            low = np.maximum(
                low, np.where(still, np.where(np.abs(q0) > r, np.inf, 0.0), np.minimum(one, two))
            )
            high = np.minimum(high, np.where(still, 1.0, np.maximum(one, two)))
    return np.where(low <= high, low, np.inf)


def plain_contact(a, b, h, size_a, size_b):
    """`first_contact` without circles or early ends: every part of every step (P, N - 1, PARTS)."""
    place, heading = b[..., :2] - a[..., :2], (a[..., 2], b[..., 2])
    start, chord = place[:, :-1], np.diff(place, axis=1)
    v = velocity(b, a) * h[:, None, None]
    first, second = v[:, :-1] - chord, v[:, 1:] - chord
    turn = [wrap_angle(np.diff(of, axis=1)) for of in heading]
    bulge = BULGE * (np.linalg.norm(first, axis=2) + np.linalg.norm(second, axis=2))
    radii = (0.5 * np.hypot(*size.T)[:, None] for size in (size_a, size_b))
    turned = 0.5 * sum(r * np.abs(w) for r, w in zip(radii, turn, strict=True))
    f = np.linspace(0.0, 1.0, PARTS + 1)[:, None]
    node = (
        start[:, :, None] + f * chord[:, :, None]
        + f * (1 - f) ** 2 * first[:, :, None] + f * f * (f - 1) * second[:, :, None]
    )  # fmt: skip
    middle = (np.arange(PARTS) + 0.5) / PARTS
    turning = [o[:, :-1, None] + middle * w[..., None] for o, w in zip(heading, turn, strict=True)]
    sizes = [size.T[:, :, None, None] for size in (size_a, size_b)]
    slack = (turned / PARTS + bulge / PARTS**2)[..., None]
    share = entry(node[:, :, :-1], node[:, :, 1:], *turning, *sizes, slack)
    half = [o[:, :-1] + 0.5 * w for o, w in zip(heading, turn, strict=True)]
    whole = entry(start, place[:, 1:], *half, *(size[..., 0] for size in sizes), turned + bulge)
    at = np.arange(start.shape[1])[:, None] + (np.arange(PARTS) + share) / PARTS
    at = np.where(np.isfinite(whole)[..., None], at, np.inf).min(axis=(1, 2), initial=np.inf) * h
    now = boxes_overlap(Boxes(*a[:, 0, :3].T, *size_a.T), Boxes(*b[:, 0, :3].T, *size_b.T))
    return np.where(now, 0.0, at)


KINDS = ["any", "straight", "standing", "turning", "grazing", "touching", "apart", "unknown"]


def motions(kind, seed, pairs=300, points=21):
    """Motions of pairs of boxes a, b (P, N, 4), their step h (P,) and sizes (P, 2)."""
    rng = np.random.default_rng(seed)
    t = np.tile(np.arange(points) * 0.2, (pairs, 1))
    size_a, size_b = rng.uniform(0.4, 12.0, (2, pairs, 2))
    spread = {"touching": 3.0, "apart": 1.0, "turning": 12.0}.get(kind, 40.0)
    states = np.concatenate(
        [
            rng.uniform(-spread, spread, (2, pairs, 2)), rng.uniform(-4.0, 4.0, (2, pairs, 1)),
            rng.uniform(-5.0, 25.0, (2, pairs, 1)), rng.uniform(-6.0, 3.0, (2, pairs, 1)),
            rng.uniform(-0.7, 0.7, (2, pairs, 1)),
        ],
        axis=2,
    )  # fmt: skip
    if kind in ("straight", "grazing"):
        states[..., 4:] = 0.0
    if kind == "standing":
        states[rng.integers(0, 2, pairs), np.arange(pairs), 3:] = 0.0
        states[:, ::7, 3:] = 0.0
    if kind == "turning":
        states[..., 3], states[..., 5] = 0.3, rng.uniform(-3.0, 3.0, (2, pairs))
    if kind == "grazing":  # one passes the other along its axis, their sides all but touching
        states[..., 2] = 0.0
        gap = rng.choice([-1e-6, -1e-9, 1e-9, 1e-6], pairs)
        states[1, :, 1] = states[0, :, 1] + 0.5 * (size_a[:, 1] + size_b[:, 1]) + gap
    if kind == "apart":
        states[1, :, :2] += 1e3
    a, b = (motion.ctra(state, t) for state in states)
    if kind == "unknown":
        b[rng.integers(0, pairs, 60), rng.integers(0, points, 60), rng.integers(0, 4, 60)] = np.nan
        size_b[::9] = np.nan
    return a, b, np.full(pairs, 0.2), size_a, size_b


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_contact_is_that_of_every_step_and_part(kind, seed):
    a, b, h, size_a, size_b = motions(kind, seed)
    found, expected = first_contact(a, b, h, size_a, size_b), plain_contact(a, b, h, size_a, size_b)
    expected[np.isnan(size_b[:, 0])] = np.inf
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    share = {"apart": 0.0, "unknown": 0.0, "turning": 0.2, "touching": 0.9}
    assert np.isfinite(found).mean() >= share.get(kind, 0.04)
    assert (found == 0.0).any() == (kind != "apart")


def test_contact_takes_arrays_of_any_kind_and_none():
    a, b, h, size_a, size_b = motions("any", 5)
    expected = first_contact(a, b, h, size_a, size_b)
    fixed = np.broadcast_to(size_a[:1], size_a.shape)
    turned = np.asfortranarray(a)
    b.setflags(write=False)
    np.testing.assert_array_equal(
        first_contact(turned, b, h, fixed, size_b), first_contact(a, b, h, fixed.copy(), size_b)
    )
    np.testing.assert_array_equal(
        first_contact(turned[::2], b[::2], h[::2], size_a[::2], size_b[::2]), expected[::2]
    )
    assert first_contact(a[:0], b[:0], h[:0], size_a[:0], size_b[:0]).shape == (0,)


def hermite(f, p0, m0, p1, m1):
    return (
        (2 * f**3 - 3 * f**2 + 1) * p0
        + (f**3 - 2 * f**2 + f) * m0
        + (3 * f**2 - 2 * f**3) * p1
        + (f**3 - f**2) * m1
    )


def placed(a, b, f, tangent_a, tangent_b, beyond):
    """Pose at share f from a to b (4,), then straight on; its v left out."""
    out = [
        hermite(f, a[i], tangent_a * turn(a[2]), b[i], tangent_b * turn(b[2])) + beyond * turn(b[2])
        for i, turn in enumerate((np.cos, np.sin))
    ]
    return [*out, a[2] + f * float(wrap_angle(b[2] - a[2]))]


@pytest.mark.parametrize("seed", range(3))
def test_a_path_is_sampled_by_time_and_by_way_as_said(seed):
    path, _, _, _, _ = motions("any", seed, pairs=6)
    rng = np.random.default_rng(seed)
    path[1, 4:9] = path[1, 4]  # stands for a while
    t, s = rng.uniform(0.0, 6.0, (6, 40)), np.sort(rng.uniform(0.0, 150.0, (6, 40)))
    s[::2] = rng.permuted(s[::2], axis=1)
    by_time, by_way = motion.sample(path, 0.2, t), motion.along(path, s, np.full(s.shape, 7.0))
    for p, rows in enumerate(path):
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
        on = -1.0 if rows[0, 3] < 0.0 else 1.0  # constant acceleration till a stop: nobody turns round
        for n in range(40):
            j = min(int(t[p, n] / 0.2), 19)
            a, b, f = rows[j], rows[j + 1], min(t[p, n] / 0.2 - j, 1.0)
            beyond = max(t[p, n] - 4.0, 0.0) * b[3]
            expected = [*placed(a, b, f, 0.2 * a[3], 0.2 * b[3], beyond), a[3] + f * (b[3] - a[3])]
            np.testing.assert_allclose(by_time[p, n], expected, rtol=1e-12, atol=1e-9)
            j = min(int(np.searchsorted(way, s[p, n], side="right")) - 1, 19)
            a, b, ds = rows[j], rows[j + 1], way[j + 1] - way[j]
            f, beyond = min((s[p, n] - way[j]) / (ds if ds > 1e-9 else 1.0), 1.0), max(s[p, n] - way[-1], 0.0)
            expected = [*placed(a, b, f, on * ds, on * ds, on * beyond), on * 7.0]
            np.testing.assert_allclose(by_way[p, n], expected, rtol=1e-12, atol=1e-9)


def test_arrays_that_do_not_match_are_refused():
    """Compiled code looks where it is told to, also beyond an array's end."""
    path, t = np.zeros((2, 5, 4)), np.zeros((2, 3))
    with pytest.raises(ValueError, match="pairs do not match"):
        motion.straight(np.zeros((1, 6)), t)
    with pytest.raises(ValueError, match="has no length"):
        motion.sample(path[:, :1], 0.1, t)
    with pytest.raises(ValueError, match="way and pace do not match"):
        motion.along(path, t, t[:, :2])
    with pytest.raises(ValueError, match="motions do not match"):
        first_contact(path, path[:, :4], np.ones(2), np.ones((2, 2)), np.ones((2, 2)))
