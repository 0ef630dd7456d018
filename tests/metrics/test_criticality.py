"""Criticality measures against closed forms and an independent computation: boxes of shapely, stepped finely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from resim.core.errors import ResimError
from resim.metrics import measures as c
from resim.metrics.measures import Pairs, State
from resim.metrics.measures.contact import distance, first_contact
from resim.metrics.measures.motion import ctra
from resim.metrics.risk import PUBLISHED, Scenes

CAR = (4.7, 1.9)
TIMES = [c.ttc, c.ettc, c.thw, c.wttc, c.ttb, c.ttk, c.tts, c.ttr, c.pet, c.tpmd]
EVERY = [*TIMES, c.pmd, c.drac, c.gap_ahead, c.half_speedometer, c.overtaking_right]


def plan(v, *, a=0.0, rate=0.0, horizon=4.0, step=0.1):
    """The EGO's plan (M + 1, 4) from the origin along x."""
    t = np.arange(round(horizon / step) + 1) * step
    return ctra(np.array([[0.0, 0.0, 0.0, v, a, rate]]), t[None])[0]


def pairs(ego, objects, *, size=CAR, horizon=None, step=0.1, path=None):
    state = np.atleast_2d(np.asarray(objects, dtype=float))
    sizes = np.broadcast_to(np.asarray(size, dtype=float), (1, len(state), 2)).copy()
    return Pairs(ego[None], np.array([CAR]), state[None], sizes, step, horizon, path)


# name: EGO's speed, acceleration, yaw rate; the object
PAIRS = {
    "rear-end": ((21, 0, 0), (34.7, 0, 0, 10, 0, 0)),
    "rear-end, offset": ((21, 0, 0), (34.7, 1.2, 0.02, 10, 0, 0)),
    "oncoming": ((15, 0, 0), (80, 0.5, math.pi, 12, 0, 0)),
    "crossing": ((14, 0, 0), (30, -22, math.pi / 2, 11, 0, 0)),
    "crossing, turning": ((14, 0, 0), (35, -22, 1.2, 11, 1, 0.15)),
    "cut-in": ((20, 0, 0), (10, 3.5, -0.12, 15, 0, 0)),
    "cut-in, yawing": ((20, 0, 0), (12, 3.5, 0, 14, 0, -0.08)),
    "overlapping": ((20, 0, 0), (3, 1, 0.1, 15, 0, 0)),
    "separating": ((10, 0, 0), (20, 0, 0, 25, 0, 0)),
    "separating, passed": ((10, 0, 0), (-20, 0, math.pi, 25, 0, 0)),
    "side by side": ((20, 0, 0), (1, 3.3, 0, 20, 0, 0)),
    "both stand": ((0, 0, 0), (12, 0, 0, 0, 0, 0)),
    "EGO stands": ((0, 0, 0), (-30, 0, 0, 12, 0, 0)),
    "object stands": ((13, 0, 0), (30, 0.4, 0.6, 0, 0, 0)),
    "equal speeds": ((17, 0, 0), (25, 0, 0, 17, 0, 0)),
    "braking leader": ((20, 0, 0), (30, 0, 0, 20, -5, 0)),
    "leader brakes to standstill": ((12, -1, 0), (22, 0, 0, 4, -4, 0)),
    "EGO in a curve": ((14, 0, 0.25), (20, 16, 0.9, 4, 0, 0)),
}
SOME = [n if k % 3 == 0 else pytest.param(n, marks=pytest.mark.slow) for k, n in enumerate(PAIRS)]
"""For what takes seconds each: `make validate` has them all."""
STRAIGHT = [
    n if k % 2 == 0 else pytest.param(n, marks=pytest.mark.slow)
    for k, n in enumerate(name for name in PAIRS if PAIRS[name][0][2] == 0)
]
FINE = 1e-3  # s


def of(name):
    (v, a, rate), other = PAIRS[name]
    return pairs(plan(v, a=a, rate=rate), other)


def driven(x, y, heading, v, a, rate, t):
    """Euler's midpoint steps of the motion equations, on their own: (N, 3) at even times t."""
    out, h = [], t[1] - t[0]
    for _ in t:
        out.append((x, y, heading))
        if v > 0 or a > 0:
            middle_v, middle = max(v + 0.5 * a * h, 0.0), heading + 0.5 * rate * h
            x, y = x + middle_v * math.cos(middle) * h, y + middle_v * math.sin(middle) * h
            heading, v = heading + rate * h, max(v + a * h, 0.0)
    return np.array(out)


def boxes(poses, size=CAR):
    corners = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]) * size
    z = (poses[:, None, 0] + 1j * poses[:, None, 1]) + np.exp(1j * poses[:, None, 2]) * (corners @ [1, 1j])
    return shapely.polygons(np.stack([z.real, z.imag], axis=-1))


def first(a, b, t):
    """The first time at which boxes of shapely touch, None where never."""
    hit = shapely.intersects(boxes(a), boxes(b))
    return t[int(hit.argmax())] if hit.any() else None


def agrees(measure, expected, within=2.0 * FINE):
    if expected is None:
        assert measure.state[0, 0] == State.NO_CONFLICT
    else:
        assert measure.state[0, 0] == State.VALUE
        assert measure.value[0, 0] == pytest.approx(expected, abs=within)


@pytest.mark.parametrize("name", PAIRS)
def test_ttc_ettc_and_thw_agree_with_fine_steps(name):
    (v, a, rate), other = PAIRS[name]
    t = np.arange(0.0, 4.0, FINE)
    # the path of the plan at constant speed: the yaw rate keeps its curvature
    steady = driven(0, 0, 0, v, 0, rate, t)
    agrees(c.ttc(of(name)), first(steady, driven(*other[:4], 0, 0, t), t))
    agrees(c.ettc(of(name)), first(driven(0, 0, 0, v, a, rate, t), driven(*other, t), t))
    if v > 0:
        agrees(c.thw(of(name)), first(steady, driven(*other[:3], 0, 0, 0, t), t))
    else:
        assert c.thw(of(name)).state[0, 0] == State.NOT_DEFINED


@pytest.mark.parametrize("name", SOME)
def test_ttb_agrees_with_fine_steps(name):
    (v, a, rate), other = PAIRS[name]
    t = np.arange(0.0, 8.0, 4 * FINE)
    ego, to = driven(0, 0, 0, v, a, rate, t), driven(*other, t)
    contact = first(ego[t < 4.0], to[t < 4.0], t)
    expected = None
    if contact is not None:
        dense, dense_t = driven(0, 0, 0, v, a, rate, np.arange(0.0, 4.0, FINE)), np.arange(0.0, 4.0, FINE)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense[:, :2], axis=0).T))])
        expected = 0.0
        for start in np.arange(0.0, contact, 0.01)[::-1]:
            speed = max(v + a * start, 0.0)
            after = np.minimum(t, speed / 8.5)
            s = np.interp(start, dense_t, way) + speed * after - 0.5 * 8.5 * after**2
            braked = np.stack([np.interp(s, way, dense[:, k]) for k in range(3)], axis=1)
            object_then = driven(*other, np.arange(0.0, 12.0, 4 * FINE))[round(start / 0.004) :][: len(t)]
            if first(braked[t < 4.0], object_then[t < 4.0], t) is None:
                expected = start
                break
    agrees(c.ttb(of(name)), expected, within=0.015)


@pytest.mark.parametrize("name", STRAIGHT)
@pytest.mark.parametrize("measure", [c.ttk, c.tts])
def test_ttk_and_tts_agree_with_fine_steps(measure, name):
    (v, a, _), other = PAIRS[name]
    h = 0.005
    t = np.arange(0.0, 4.0, h)
    whole = driven(*other, np.arange(0.0, 8.0, h))
    contact = first(driven(0, 0, 0, v, a, 0, t), whole[: len(t)], t)
    expected = None
    if contact is not None:
        expected = 0.0
        for start in np.arange(0.0, contact, 0.02)[::-1]:
            after = min(start, v / -a) if a < 0 else start
            x, speed = v * after + 0.5 * a * after**2, max(v + a * start, 0.0)
            rate = min(7.0 / max(speed, 1e-9), 0.2 * speed)
            inputs = [(3.0, 0.0)] if measure is c.ttk else [(0.0, rate), (0.0, -rate)]
            then = whole[round(start / h) :][: len(t)]
            if any(first(driven(x, 0, 0, speed, *i, t), then, t) is None for i in inputs):
                expected = start
                break
    agrees(measure(of(name)), expected, within=0.03)


@pytest.mark.parametrize("name", PAIRS)
def test_pmd_agrees_with_fine_steps(name):
    (v, a, rate), other = PAIRS[name]
    t = np.arange(0.0, 4.0 + 0.5 * FINE, FINE)
    apart = shapely.distance(boxes(driven(0, 0, 0, v, a, rate, t)), boxes(driven(*other, t)))
    agrees(c.pmd(of(name)), apart.min(), within=1e-3)
    when = c.tpmd(of(name)).value[0, 0]
    assert apart[min(round(when / FINE), len(t) - 1)] == pytest.approx(apart.min(), abs=0.05)
    assert when <= t[np.argmax(apart <= apart.min() + 1e-9)] + 0.005


def hull(pose, phi):
    """The convex hull of a box turned by up to phi either way."""
    turns = phi * np.linspace(-1.0, 1.0, 41)
    return shapely.convex_hull(shapely.union_all(boxes(np.array([(*pose[:2], pose[2] + d) for d in turns]))))


@pytest.mark.parametrize("name", SOME)
def test_wttc_agrees_with_reachable_sets_of_shapely(name):
    (v, _, _), other = PAIRS[name]
    most, curvature, step = 8.829, 0.2, 0.01

    def rate(v0, s):
        pace = np.linspace(max(v0 - most * s, 0.0), v0 + most * s, 400)
        return np.minimum(most / np.maximum(pace, 1e-9), curvature * pace).max()

    bound, phi, phi2 = None, 0.0, 0.0
    for s in np.arange(0.0, 4.0, step):
        dx, dy = other[3] * math.cos(other[2]) * s - v * s, other[3] * math.sin(other[2]) * s
        there = (other[0] + dx, other[1] + dy, other[2])
        if shapely.distance(hull((0, 0, 0), phi), hull(there, phi2)) <= most * s * s:
            bound = s
            break
        phi, phi2 = (f + step * rate(w, s + 0.5 * step) for f, w in ((phi, v), (phi2, other[3])))
    agrees(c.wttc(of(name)), bound, within=1.5 * step)


def test_no_drivable_motion_touches_before_wttc():
    rng = np.random.default_rng(1)
    most, curvature, h = 8.829, 0.2, 0.01
    t = np.arange(0.0, 4.0, h)

    def driven_anyhow(x, y, heading, v, count):
        """Bicycles whose acceleration stays on Kamm's circle, its direction changed now and then."""
        pose = np.tile([x, y, heading, float(v)], (count, 1))
        angle, out = rng.uniform(0, 2 * np.pi, count), []
        for _ in t:
            out.append(pose.copy())
            change = rng.random(count) < 0.01
            angle = np.where(change, rng.uniform(0, 2 * np.pi, count), angle)
            pace = np.maximum(np.abs(pose[:, 3]), 1e-6)
            yaw = np.clip(most * np.sin(angle) / pace, -curvature * pace, curvature * pace)
            pose[:, 0] += h * pose[:, 3] * np.cos(pose[:, 2])
            pose[:, 1] += h * pose[:, 3] * np.sin(pose[:, 2])
            pose[:, 2] += h * yaw
            pose[:, 3] += h * most * np.cos(angle)
        return np.stack(out, axis=1)

    for name, ((v, _, _), other) in PAIRS.items():
        ego, to = driven_anyhow(0, 0, 0, v, 400), driven_anyhow(*other[:4], 400)
        size = np.tile(CAR, (400, 1))
        soonest = first_contact(ego, to, np.full(400, h), size, size).min()
        wttc = c.wttc(of(name))
        bound = wttc.value[0, 0] if wttc.state[0, 0] == State.VALUE else np.inf
        assert bound <= soonest + 0.005, name


@pytest.mark.parametrize(("gap", "ttc", "thw"), [(52.0, 4.73, 2.48), (30.0, 2.73, 1.43), (12.1, 1.1, 0.576)])
def test_the_rear_end_pair_has_its_closed_forms(gap, ttc, thw):
    """21 against 10 m/s."""
    p = pairs(plan(21.0), [gap + 4.7, 0, 0, 10, 0, 0], horizon=8.0)
    assert c.ttc(p).value[0, 0] == pytest.approx(ttc, abs=0.005)
    assert c.ttc(p).value[0, 0] == pytest.approx(gap / 11.0, abs=1e-9)
    assert c.thw(p).value[0, 0] == pytest.approx(thw, abs=0.005)
    assert c.thw(p).value[0, 0] == pytest.approx(gap / 21.0, abs=1e-9)
    assert c.ettc(p).value[0, 0] == pytest.approx(gap / 11.0, abs=1e-9)
    assert c.drac(p).value[0, 0] == pytest.approx(121.0 / (2.0 * gap), abs=1e-3)
    assert c.ttb(p).value[0, 0] == pytest.approx((gap - 121.0 / 17.0) / 11.0, abs=1e-3)
    assert c.ttk(p).value[0, 0] == 0.0
    assert c.ttr(p).value[0, 0] == max(f(p).value[0, 0] for f in (c.ttb, c.ttk, c.tts))
    assert c.gap_ahead(p).value[0, 0] == pytest.approx(gap, abs=1e-6)
    assert c.half_speedometer(p).value[0, 0] == pytest.approx(gap - 37.8, abs=1e-6)
    assert c.half_speedometer(p, urban=True).value[0, 0] == pytest.approx(gap - 21.0, abs=1e-6)
    # both at full throttle and brake, 0.36 m of turned corners at most
    straight_on, turned = ((-11 + math.sqrt(121 + 4 * 8.829 * d)) / (2 * 8.829) for d in (gap, gap - 0.37))
    assert turned - 1e-3 <= c.wttc(p).value[0, 0] <= straight_on


def test_ettc_of_a_braking_leader_is_equation_3_4():
    """With the sign that makes it a time: v_rel² > -2 a_rel d."""
    d, v, a = 25.3, 11.0, 4.0
    p = pairs(plan(21.0), [d + 4.7, 0, 0, 10, -a, 0])
    assert c.ettc(p).value[0, 0] == pytest.approx((math.sqrt(v * v + 2 * a * d) - v) / a, abs=1e-4)
    opening = pairs(plan(12.0), [30, 0, 0, 10, 2, 0])  # v_rel² < -2 a_rel d
    assert c.ettc(opening).state[0, 0] == State.NO_CONFLICT
    assert c.ttc(pairs(plan(12.0), [12, 0, 0, 10, 2, 0])).state[0, 0] == State.VALUE


def test_a_cut_in_counts_from_its_first_sideways_metre():
    """4 m/s sideways and slower: contact as soon as the boxes' sides meet, though both are in lanes of their own."""
    ttc = c.ttc(pairs(plan(20.0), [10.0, 3.5, -0.12, 15.0, 0, 0]))
    assert ttc.value[0, 0] < 1.1
    assert c.ttc(pairs(plan(20.0), [10.0, 3.5, 0.0, 15.0, 0, 0])).state[0, 0] == State.NO_CONFLICT


def test_pet_of_crossing_paths_is_the_time_between_leaving_and_entering():
    p = pairs(plan(14.0, horizon=6.0), [30, -40, math.pi / 2, 11, 0, 0])
    # EGO's rear leaves the far border of the object's strip; the object's front enters the EGO's strip
    leaves, enters = (30 + 0.95 + 2.35) / 14, (40 - 0.95 - 2.35) / 11
    assert c.pet(p).value[0, 0] == pytest.approx(enters - leaves, abs=0.003)
    swapped = pairs(plan(6.0, horizon=8.0), [30, -22, math.pi / 2, 11, 0, 0])
    assert c.pet(swapped).value[0, 0] == pytest.approx(
        (30 - 0.95 - 2.35) / 6 - (22 + 0.95 + 2.35) / 11, abs=0.003
    )
    assert c.pet(of("crossing")).value[0, 0] == 0.0
    assert c.pet(pairs(plan(10.0), [0, 10, 0, 10, 0, 0])).state[0, 0] == State.NO_CONFLICT


def test_driven_paths_take_the_place_of_predicted_ones():
    other = plan(10.0, a=-6.0) + [20.0, 0, 0, 0]
    p = pairs(plan(15.0), [20, 0, 0, 10, 0, 0], path=other[None, None])
    braking = pairs(plan(15.0), [20, 0, 0, 10, -6, 0])
    for f in (c.ettc, c.ttb, c.tts, c.pmd):
        assert f(p).value[0, 0] == pytest.approx(f(braking).value[0, 0], abs=0.01), f.__name__
    assert c.ttc(p).value[0, 0] == c.ttc(braking).value[0, 0]


def random_pairs(seed, scenes=40, objects=6):
    rng = np.random.default_rng(seed)
    shape = (scenes, objects)
    state = np.stack([
        rng.uniform(-20, 60, shape), rng.uniform(-20, 20, shape), rng.uniform(-3, 3, shape), rng.uniform(0, 25, shape),
        rng.normal(0, 1.5, shape), rng.normal(0, 0.1, shape),
    ], axis=-1)  # fmt: skip
    ego = np.stack([plan(v, rate=w) for v, w in rng.uniform([0, -0.2], [25, 0.2], (scenes, 2))])
    size = rng.uniform([1.0, 0.6], [12.0, 2.6], (*shape, 2))
    return ego, np.tile(CAR, (scenes, 1)), state, size


def same(one, two, within=1e-6):
    assert np.array_equal(one.state, two.state), one.name
    np.testing.assert_allclose(one.value, two.value, atol=within, err_msg=one.name)


@pytest.mark.parametrize("f", EVERY)
def test_turning_shifting_and_order_change_nothing(f):
    ego, ego_size, state, size = random_pairs(3)
    whole = f(Pairs(ego, ego_size, state, size, 0.1))

    def moved(poses, angle=0.77):
        out = poses.copy()
        z = (poses[..., 0] + 1j * poses[..., 1]) * np.exp(1j * angle) + 500 - 300j
        out[..., 0], out[..., 1], out[..., 2] = z.real, z.imag, poses[..., 2] + angle + 2 * np.pi
        return out

    same(whole, f(Pairs(moved(ego), ego_size, moved(state), size, 0.1)), within=1e-5)
    order = np.array([3, 0, 5, 1, 4, 2])
    again = f(Pairs(ego, ego_size, state[:, order], size[:, order], 0.1))
    assert np.array_equal(again.state, whole.state[:, order])
    np.testing.assert_array_equal(again.value, whole.value[:, order])


def test_times_stand_in_their_order():
    """WTTC <= ETTC; TTB, TTK, TTS <= TTR <= ETTC; PMD 0 exactly where ETTC has a value; TTC 0 only on contact."""
    p = Pairs(*random_pairs(5, scenes=100), 0.1)
    m = {f.__name__: f(p) for f in EVERY}
    hit = m["ettc"].state == State.VALUE
    assert hit.sum() > 40
    assert (m["wttc"].value[hit] <= m["ettc"].value[hit] + 1e-3).all()
    assert (m["wttc"].value[m["ttc"].state == 0] <= m["ttc"].value[m["ttc"].state == 0] + 1e-3).all()
    for name in ("ttb", "ttk", "tts"):
        assert np.array_equal(m[name].state, m["ettc"].state)
        assert (m[name].value[hit] <= m["ttr"].value[hit]).all()
    assert (m["ttr"].value[hit] <= m["ettc"].value[hit]).all()
    assert np.array_equal(m["pmd"].value == 0.0, hit)
    np.testing.assert_array_equal(m["tpmd"].value[hit], m["ettc"].value[hit])
    assert m["pet"].value[hit] == pytest.approx(0.0, abs=1e-3)


def test_contact_is_found_however_short_and_at_the_right_time():
    """Fast, small, turning: fine steps of shapely find no contact that is missed, none that is not there."""
    rng = np.random.default_rng(8)
    size, t = np.array([[1.2, 0.5]]), np.arange(0.0, 1.0 + 1e-9, 0.1)
    fine = np.arange(0.0, 1.0, 5e-4)
    found = 0
    for _ in range(60):
        one = np.array([[0, 0, rng.uniform(-3, 3), rng.uniform(0, 30), rng.normal(0, 3), rng.normal(0, 0.4)]])
        meet = ctra(one, np.array([[rng.uniform(0.1, 0.9)]]))[0, 0]
        two = np.array([[0, 0, rng.uniform(-3, 3), rng.uniform(0, 40), rng.normal(0, 3), rng.normal(0, 0.4)]])
        two[:, :2] = meet[:2] - ctra(two, np.array([[rng.uniform(0.3, 0.7)]]))[0, 0, :2] + rng.normal(0, 1, 2)
        at = first_contact(ctra(one, t[None]), ctra(two, t[None]), np.array([0.1]), size, size)[0]
        small = shapely.intersects(
            boxes(ctra(one, fine[None])[0], size[0]), boxes(ctra(two, fine[None])[0], size[0])
        )
        expected = fine[small.argmax()] if small.any() else None
        if expected is None:
            if np.isfinite(at) and at < fine[-1]:  # grazing: nearer than what is left of the growing
                apart = shapely.distance(
                    boxes(ctra(one, fine[None])[0], size[0]), boxes(ctra(two, fine[None])[0], size[0])
                )
                assert apart.min() < 0.01
        else:
            found += 1
            assert at == pytest.approx(expected, abs=2e-3)
    assert found > 15


def test_the_distance_of_boxes_is_that_of_shapely():
    rng = np.random.default_rng(2)
    a, b = (rng.uniform([-8, -8, -4], [8, 8, 4], (500, 3)) for _ in range(2))
    size_a, size_b = (rng.uniform(0.5, 6.0, (500, 2)) for _ in range(2))
    expected = [
        shapely.distance(boxes(p[None], s), boxes(q[None], r))[0]
        for p, s, q, r in zip(a, size_a, b, size_b, strict=True)
    ]
    found = distance(*(np.insert(c, 3, 0.0, axis=1)[:, None] for c in (a, b)), size_a, size_b)
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("f", EVERY)
def test_missing_input_is_not_computed_and_spoils_nothing_else(f):
    ego, ego_size, state, size = random_pairs(4, scenes=6, objects=4)
    whole = f(Pairs(ego, ego_size, state, size, 0.1))
    gone = [a.copy() for a in (ego, ego_size, state, size)]
    gone[0][0, 7, 1] = np.nan  # scene 0: a hole in the plan
    gone[1][1, 0] = 0.0  # scene 1: an EGO without length
    gone[2][2, 0, 3] = np.nan
    gone[3][2, 1] = 0.0
    gone[3][2, 2, 1] = np.nan
    m = f(Pairs(*gone, 0.1))
    lost = np.zeros((6, 4), dtype=bool)
    lost[:2], lost[2, :3] = True, True
    assert (m.state[lost] == State.NOT_COMPUTED).all()
    assert np.isnan(m.value[lost]).all()
    assert np.array_equal(m.state[~lost], whole.state[~lost])
    np.testing.assert_array_equal(m.value[~lost], whole.value[~lost])


def test_ttc_needs_no_acceleration_and_ettc_does():
    p = pairs(plan(21.0), [34.7, 0, 0, 10, np.nan, np.nan])
    assert c.ttc(p).state[0, 0] == c.thw(p).state[0, 0] == c.wttc(p).state[0, 0] == State.VALUE
    assert c.ettc(p).state[0, 0] == c.ttb(p).state[0, 0] == State.NOT_COMPUTED


def test_no_conflict_not_defined_and_not_computed_are_three_things():
    p = pairs(plan(0.0), [[30, 20, 0, 5, 0, 0], [30, 0, 0, np.nan, 0, 0]])
    thw, ttc = c.thw(p), c.ttc(p)
    assert thw.state.tolist() == [[State.NOT_DEFINED, State.NOT_COMPUTED]]
    assert ttc.state.tolist() == [[State.NO_CONFLICT, State.NOT_COMPUTED]]
    assert np.isnan([thw.value, ttc.value]).all()
    assert ttc.worst_value() is None
    assert ttc.count(State.NO_CONFLICT) == 1


def test_the_worst_is_named_with_its_place():
    p = pairs(plan(21.0), [[56.7, 0, 0, 10, 0, 0], [16.8, 0, 0, 10, 0, 0], [30, 20, 0, 5, 0, 0]], horizon=8.0)
    assert c.ttc(p).worst_value() == (pytest.approx(1.1), (0, 1))
    assert c.drac(p).worst_value() == (pytest.approx(5.0, abs=1e-3), (0, 1))
    oncoming = c.drac(pairs(plan(21.0), [[30, 0, 0, 10, 0, 0], [60, 0, math.pi, 10, 0, 0]]))
    assert oncoming.worst_value() == (np.inf, (0, 1))


def test_arrays_that_do_not_fit_are_told():
    with pytest.raises(ResimError, match=r"pairs: size has shape \(1, 2, 2\), expected \(1, 1, 2\)"):
        Pairs(plan(1.0)[None], np.array([CAR]), np.zeros((1, 1, 6)), np.ones((1, 2, 2)), 0.1)


def test_risk_scenes_are_pairs():
    state = np.array([[[34.7, 0, 0, 10, 0, 0]]], dtype=float)
    scenes = Scenes(
        plan(21.0)[None],
        np.array([CAR]),
        state,
        np.array([[CAR]]),
        PUBLISHED.inputs(*np.moveaxis(state[..., 3:], 2, 0)),
    )
    assert c.ttc(Pairs.of(scenes, 0.1)).value[0, 0] == pytest.approx(30.0 / 11.0)


def test_drac_is_what_the_ego_needs_and_nothing_for_who_comes_from_behind_or_never_meets():
    t = np.arange(41) * 0.1
    plan = np.stack([20.0 * t, 0.0 * t, 0.0 * t, 20.0 + 0.0 * t], axis=1)[None]

    def drac(x, v, heading=0.0):
        state = np.array([[[x, 0.0, heading, v, 0.0, 0.0]]])
        found = c.drac(c.Pairs(plan, np.array([[4.7, 1.9]]), state, np.array([[[4.7, 1.9]]]), 0.1))
        return found.value[0, 0], State(found.state[0, 0])

    assert drac(-15.0, 30.0) == (0.0, State.VALUE)  # faster, from behind: the EGO does not close in
    assert drac(-15.0, 10.0)[1] == State.NO_CONFLICT  # behind, and never meets
    assert drac(-15.0, 20.0)[1] == State.NO_CONFLICT
    assert drac(25.0, 10.0)[0] == pytest.approx(10.0**2 / (2.0 * (25.0 - 4.7)), abs=1e-3)
    for unavoidable in (drac(40.0, 20.0, np.pi), drac(1.0, 20.0), drac(-1.0, 20.0)):  # oncoming, touching
        assert unavoidable == (np.inf, State.VALUE)
    assert drac(80.0, 20.0)[1] == State.NO_CONFLICT


@pytest.mark.parametrize(("x", "v"), [(-20.0, 5.0), (20.0, -9.0), (20.0, -3.0), (-60.0, 1.0)])
def test_drac_of_who_reverses_is_that_of_its_mirror_image(x, v):
    """The EGO turned round, with the other sign of its speed, drives the same way."""
    t, size = np.arange(41) * 0.1, np.array([[4.7, 1.9]])

    def drac(heading, speed):
        plan = np.stack([-5.0 * t, 0.0 * t, heading + 0.0 * t, speed + 0.0 * t], axis=1)[None]
        state = np.array([[[x, 0.0, 0.0, v, 0.0, 0.0]]])
        found = c.drac(c.Pairs(plan, size, state, size[None], 0.1))
        return found.value[0, 0], State(found.state[0, 0])

    (reversing, state), (forward, same) = drac(0.0, -5.0), drac(np.pi, 5.0)
    assert (reversing, state) == (pytest.approx(forward, nan_ok=True), same)
