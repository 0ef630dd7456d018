"""Risk and criticality of an EGO that stands, creeps, stops or reverses: brute force and symmetry are the oracles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from resim.metrics import measures as c
from resim.metrics.measures import motion
from resim.metrics.risk import PUBLISHED, RiskParameters, Scenes, accident_risk

CAR = np.array([4.7, 1.9])
STEP, HORIZON = 0.1, 4.0
T = np.arange(41) * STEP
SIGMA = (0.4, 0.06)
MEASURES = (c.ttc, c.ettc, c.wttc, c.ttb, c.ttk, c.tts, c.pmd)


def driven(v, braking, t):
    """Way and speed (T,) of an EGO that starts with v, either way, and brakes to a stop or not at all."""
    pace = np.maximum(abs(v) - braking * t, 0.0)
    way = (v * v - pace**2) / (2.0 * braking) if braking else abs(v) * t
    side = math.copysign(1.0, v)
    return side * way, side * pace


def scene(v, braking, state, *, heading=0.0, inputs=None, step=STEP):
    """An EGO from (0, 0) on that looks along `heading`, and an object."""
    way, speed = driven(v, braking, np.arange(round(HORIZON / step) + 1) * step)
    plan = np.stack([way * np.cos(heading), way * np.sin(heading), heading + 0.0 * way, speed], axis=1)
    state = np.asarray(state, dtype=float)
    if inputs is None:
        inputs = PUBLISHED.inputs(*state[3:6])
    size = CAR.reshape(1, 1, 2)
    return Scenes(plan[None], CAR[None], state[None, None], size, np.asarray(inputs).reshape(1, 1, 4))


def risk(made, **parameters):
    return float(accident_risk(made, RiskParameters(**parameters)).r_ind[0])


# brute force: everything by small steps, contact by projection on the boxes' axes


def overlap(one, other):
    """Whether cars (..., 3) x, y, heading touch: on no axis of either are they farther apart than they reach."""
    dx, dy, turn = (other[..., k] - one[..., k] for k in range(3))
    reach = 0.5 * (CAR + np.abs(np.cos(turn))[..., None] * CAR + np.abs(np.sin(turn))[..., None] * CAR[::-1])
    touch = True
    for heading in (one[..., 2], other[..., 2]):
        z = (dx + 1j * dy) * np.exp(-1j * heading)
        touch = touch & (np.abs(z.real) <= reach[..., 0]) & (np.abs(z.imag) <= reach[..., 1])
    return touch


def integrated(x, y, heading, v, a, rate, count, h):
    """Poses (..., count, 3) by steps of h; who comes to a stop stays."""
    x, y, heading, v, a, rate = np.broadcast_arrays(x, y, heading, v, a, rate)
    side, poses = np.where(v == 0.0, 1.0, np.sign(v)), []
    pace, gain = np.abs(v), np.where(v == 0.0, a, np.sign(v) * a)
    for _ in range(count):
        poses.append(np.stack([x, y, heading], axis=-1))
        after = np.maximum(pace + gain * h, 0.0)
        way, turn = 0.5 * side * (pace + after) * h, np.where(after > 0.0, rate * h, 0.0)
        x, y = x + way * np.cos(heading + 0.5 * turn), y + way * np.sin(heading + 0.5 * turn)
        heading, pace = heading + turn, after
    return np.stack(poses, axis=-2)


def brute_force(v, braking, state, h=0.05, cells=15):
    """Eq. 4.5 to 4.7 of one object on a grid of samples; TTR is the last step from which one of four evasions helps."""
    t = np.arange(round(HORIZON / h) + 1) * h
    middle = (2.0 * np.arange(cells) + 1.0) / cells - 1.0
    u, w = (g.ravel() for g in np.meshgrid(middle, middle))
    share = np.exp(-4.5 * (u * u + w * w))
    share /= share.sum()
    x, y, heading, speed = state[:4]
    other = integrated(x, y, heading, speed, 3 * SIGMA[0] * u, 3 * SIGMA[1] * w, len(t), h)
    way, speeds = driven(v, braking, t)
    zero = 0.0 * t
    hits = overlap(np.stack([way, zero, zero], axis=-1), other)
    touched = hits.any(axis=1)
    other, share, contact = other[touched], share[touched], hits[touched].argmax(axis=1)
    ttr = np.full(len(other), -1.0)
    side = math.copysign(1.0, v)
    for j in range(contact.max(initial=-1) + 1):
        pace = abs(speeds[j])
        rate = min(7.0 / pace, 0.2 * pace) if pace > 0.0 else 0.0
        options = ((0.0, rate), (0.0, -rate), (-8.5, 0.0), (3.0, 0.0))
        for gain, turn in options:
            # the sign of a speed of 0 tells the way as well: a car that stopped in reverse leaves in reverse
            start = side * max(pace, 1e-9)
            ego = integrated(way[j], 0.0, 0.0, start, side * gain, turn, len(t) - j, h)
            free = ~overlap(ego, other[:, j:]).any(axis=1)
            ttr[free & (contact >= j)] = j * h
    tail = math.exp(-2.0 * 3.0)
    g = np.clip((np.exp(-2.0 * (ttr + 0.5 * h - 0.5)) - tail) / (1.0 - tail), 0.0, 1.0)
    return float((share * np.where(ttr < 0.0, 1.0, g)).sum())


CROSSING, BEHIND = [1.5, -14.0, 0.5 * np.pi, 6.0, 0.0, 0.0], [-21.0, 0.0, 0.0, 8.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("v", "braking", "state"),
    [
        (0.0, 0.0, BEHIND),
        (0.0, 0.0, [-2.5, *CROSSING[1:]]),
        (0.05, 0.0, [-2.5, *CROSSING[1:]]),
        (5.0, 4.0, [0.5, -18.0, 0.5 * np.pi, 6.0, 0.0, 0.0]),
        (-5.0, 4.0, [-0.5, -18.0, 0.5 * np.pi, 6.0, 0.0, 0.0]),
        (-4.0, 0.0, [-9.0, -14.0, 0.5 * np.pi, 6.0, 0.0, 0.0]),
        (-8.0, 0.0, [-24.0, 0.5, 0.0, 2.0, 0.0, 0.0]),
        (-8.0, 3.0, [-22.0, 0.8, 0.0, 1.0, 0.0, 0.0]),
    ],
)
def test_risk_is_that_of_brute_force(v, braking, state):
    expected, inputs = brute_force(v, braking, state), (0.0, SIGMA[0], 0.0, SIGMA[1])
    fine = scene(v, braking, state, inputs=inputs, step=0.02)
    assert risk(fine, step=0.02, samples=256) == pytest.approx(expected, abs=0.012)
    coarse = scene(v, braking, state, inputs=inputs)
    assert risk(coarse) == pytest.approx(expected, abs=0.04)
    assert risk(coarse, mode="published") == pytest.approx(expected, abs=0.08)
    assert 0.01 < expected < 0.99


# symmetry: an EGO that reverses is one that drives forward and looks the other way

speeds = st.floats(0.06, 15.0)
states = st.tuples(
    st.floats(-30.0, 40.0), st.floats(-15.0, 15.0), st.floats(-3.2, 3.2), st.floats(0.0, 15.0),
    st.floats(-4.0, 2.0), st.floats(-0.3, 0.3),
)  # fmt: skip


@settings(max_examples=150, deadline=None, derandomize=True)
@given(speeds, st.sampled_from([0.0, 1.0, 4.0]), states)
def test_who_reverses_has_the_risk_of_who_drives_forward_the_other_way_round(v, braking, state):
    ahead, back = scene(v, braking, state), scene(-v, braking, state, heading=np.pi)
    assert risk(back) == pytest.approx(risk(ahead), abs=1e-6)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(speeds, states)
def test_an_object_that_reverses_is_predicted_as_one_that_drives_forward_the_other_way_round(v, state):
    x, y, heading, pace, a, rate = state
    pace = max(pace, 0.06)
    mirrored = [x, y, heading + np.pi, -pace, -a, rate]
    # Sobol samples have no mirror image: the prediction itself is compared
    one, other = (np.array([[x, y, heading, pace, a, rate]]), np.array([mirrored]))
    np.testing.assert_allclose(
        motion.ctra(other, T[None])[..., :2], motion.ctra(one, T[None])[..., :2], atol=1e-9
    )
    np.testing.assert_allclose(
        PUBLISHED.inputs(-pace, -a, rate), PUBLISHED.inputs(pace, a, rate) * [-1, 1, 1, 1], atol=1e-12
    )
    sure = PUBLISHED.inputs(pace, a, rate) * [1, 0, 1, 0]
    assert risk(scene(v, 0.0, mirrored, inputs=sure * [-1, 1, 1, 1])) == pytest.approx(
        risk(scene(v, 0.0, (x, y, heading, pace, a, rate), inputs=sure)), abs=1e-6
    )


def pairs(made):
    return c.Pairs.of(made, STEP)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(speeds, st.sampled_from([0.0, 1.0, 4.0]), states)
@example(5.0, 4.0, (8.0, 0.0, 0.0, 0.0, 0.0, 0.0))
def test_criticality_of_who_reverses_is_that_of_who_drives_forward_the_other_way_round(v, braking, state):
    ahead, back = (
        pairs(scene(v, braking, state)),
        pairs(scene(-v, braking, state, heading=np.pi)),
    )
    for measure in MEASURES:
        one, other = measure(ahead), measure(back)
        assert one.state[0, 0] == other.state[0, 0], one.name
        np.testing.assert_allclose(other.value, one.value, atol=2e-3, err_msg=one.name)


# continuity: standing is the limit of creeping, either way


@settings(max_examples=100, deadline=None, derandomize=True)
@given(states)
@example((-2.5, -14.0, 0.5 * np.pi, 6.0, 0.0, 0.0))
def test_who_stands_has_the_risk_of_who_creeps(state):
    stands = risk(scene(0.0, 0.0, state))
    for v in (1e-7, -1e-7):
        assert risk(scene(v, 0.0, state)) == pytest.approx(stands, abs=1e-4)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(speeds, states)
def test_an_object_that_stands_is_predicted_as_one_that_creeps(v, state):
    x, y, heading, _, a, rate = state
    inputs = (a, 0.3, rate, 0.02)
    found = [risk(scene(v, 0.0, (x, y, heading, pace, a, rate), inputs=inputs)) for pace in (-1e-7, 0.0)]
    assert found[1] == pytest.approx(found[0], abs=1e-4)
    creeps, stands = (
        motion.ctra(np.array([[x, y, heading, pace, a, rate]]), T[None])[..., :2] for pace in (-1e-7, 0.0)
    )
    np.testing.assert_allclose(creeps, stands, atol=1e-5)


@pytest.mark.parametrize("mode", ["published", "continuous"])
def test_a_stop_in_the_plan_is_left_in_time(mode):
    """A car stops 1 m into a crossing; who comes from the side is 14 m away, and 3 m on it is out of his way."""
    state = [-2.0, -22.0, 0.5 * np.pi, 7.0, 0.0, 0.0]
    stops, rolls = (risk(scene(v, braking, state), mode=mode) for v, braking in ((0.0, 0.0), (0.06, 0.0)))
    assert stops == pytest.approx(rolls, abs=0.05)
    assert stops < 0.3


def test_a_plan_that_turns_round_is_not_accelerated_through_its_turn():
    """Back out for 1 s, then forward: who accelerates at the start goes on backwards, and is not hit ahead."""
    v = np.where(T < 1.0, -2.0, 2.0)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * STEP)])
    plan = np.stack([x, 0.0 * T, 0.0 * T, v], axis=1)
    pose = motion.along(plan[None], np.array([[0.0, 5.0, 10.0]]), np.full((1, 3), 4.0))
    np.testing.assert_allclose(pose[0, :, 0], [0.0, -5.0, -10.0], atol=0.02)
    np.testing.assert_allclose(pose[0, :, 3], -4.0)
