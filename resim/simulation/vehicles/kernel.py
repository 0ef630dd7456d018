"""The vehicle models' steps for many vehicles at once, compiled by numba.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import entry, inner

X, Y, HEADING, V, A, YAW_RATE, STEERING, SLIP = range(8)
"""Columns of a state (`resim.simulation.vehicles.model.VehicleState`)."""
FRONT, REAR, MASS, YAW_INERTIA, CENTRE_HEIGHT, CORNERING, FRICTION = range(7)
FASTEST, HARDEST, JERK, LATERAL, ANGLE, RATE, LAG, STEERING_LAG = range(7, 15)
"""Numbers of a vehicle, in the order of the fields of `resim.simulation.vehicles.model.Vehicle`."""
GRAVITY = 9.81
LONGEST = 0.01
"""s; of one step of the integration."""


@entry()
def kinematic(states, commands, dt, car):
    """Move vehicles by the kinematic model for dt [s]: states (B, 8) in place, commands (B, 2), car a tuple."""
    for b in range(len(states)):
        _kinematic(states[b], commands[b], dt, car)


@entry()
def single_track(states, commands, dt, car, slow):
    """Move vehicles by the dynamic model, as `kinematic`; slow: speed [m/s] below which it is the kinematic one."""
    for b in range(len(states)):
        if states[b, V] < slow:
            _kinematic(states[b], commands[b], dt, car)
        else:
            _single_track(states[b], commands[b], dt, car)


@inner
def _kinematic(state, command, dt, car):
    """Move the rear axle along an arc, with the mean speed and steering angle of the step."""
    wheelbase, rear = car[FRONT] + car[REAR], car[REAR]
    a, steering = _actuate(state, command, dt, car)
    v = max(min(state[V], 0.0), state[V] + 0.5 * (state[A] + a) * dt)  # brakes stop it, and hold it
    if v <= 0.0:
        a = max(a, 0.0)
    path = 0.5 * (state[V] + v) * dt
    bend = math.tan(0.5 * (state[STEERING] + steering)) / wheelbase
    before = state[HEADING]
    heading = before + path * bend
    middle = 0.5 * (before + heading)
    state[X] = state[X] + path * math.cos(middle) + rear * (math.cos(heading) - math.cos(before))
    state[Y] = state[Y] + path * math.sin(middle) + rear * (math.sin(heading) - math.sin(before))
    state[HEADING], state[V], state[A] = heading, v, a
    state[YAW_RATE], state[STEERING], state[SLIP] = v * math.tan(steering) / wheelbase, steering, 0.0


@inner
def _single_track(state, command, dt, car):
    """Integrate with the classical Runge-Kutta method over at most LONGEST at a time."""
    a, steering = _actuate(state, command, dt, car)
    pieces = max(1, math.ceil(dt / LONGEST))
    q = np.array([state[X], state[Y], state[HEADING], state[V], state[SLIP], state[YAW_RATE]])
    h = dt / pieces
    for i in range(pieces):
        part = (i + 0.5) / pieces
        now_a = state[A] + part * (a - state[A])
        now_steering = state[STEERING] + part * (steering - state[STEERING])
        k1 = _rates(q, now_a, now_steering, car)
        k2 = _rates(q + 0.5 * h * k1, now_a, now_steering, car)
        k3 = _rates(q + 0.5 * h * k2, now_a, now_steering, car)
        k4 = _rates(q + h * k3, now_a, now_steering, car)
        q = q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    state[X], state[Y], state[HEADING], state[V] = q[0], q[1], q[2], max(q[3], 0.0)
    state[A], state[YAW_RATE], state[STEERING], state[SLIP] = a, q[5], steering, q[4]


@inner
def _rates(q, a, steering, car):
    """Right-hand side of the single-track model (CommonRoad: Vehicle Models, Eq. of "ST")."""
    heading, v, slip, yaw_rate = q[2], q[3], q[4], q[5]
    wheelbase = car[FRONT] + car[REAR]
    front = car[CORNERING] * (GRAVITY * car[REAR] - a * car[CENTRE_HEIGHT]) / wheelbase
    rear = car[CORNERING] * (GRAVITY * car[FRONT] + a * car[CENTRE_HEIGHT]) / wheelbase
    front_slip = steering - slip - car[FRONT] * yaw_rate / v
    rear_slip = -slip + car[REAR] * yaw_rate / v
    turn = (
        car[FRICTION] * car[MASS] / car[YAW_INERTIA]
        * (car[FRONT] * front * front_slip - car[REAR] * rear * rear_slip)
    )  # fmt: skip
    slide = car[FRICTION] / v * (front * front_slip + rear * rear_slip) - yaw_rate
    course = heading + slip
    return np.array([v * math.cos(course), v * math.sin(course), yaw_rate, a, slide, turn])


@inner
def _actuate(state, command, dt, car):
    """Acceleration [m/s²] and steering angle [rad] after dt [s] of lag and limits."""
    acceleration, curvature = command[0], command[1]
    a = state[A] + _limited(
        (_limited(acceleration, -car[HARDEST], car[FASTEST]) - state[A]) * (1.0 - math.exp(-dt / car[LAG])),
        -car[JERK] * dt,
        car[JERK] * dt,
    )
    if state[V] * state[V] * abs(curvature) > car[LATERAL]:
        curvature = math.copysign(car[LATERAL] / (state[V] * state[V]), curvature)
    wanted = _limited(math.atan((car[FRONT] + car[REAR]) * curvature), -car[ANGLE], car[ANGLE])
    most = car[RATE] * dt
    change = (wanted - state[STEERING]) * (1.0 - math.exp(-dt / car[STEERING_LAG]))
    return a, state[STEERING] + _limited(change, -most, most)


@inner
def _limited(value, low, high):
    return low if value < low else high if value > high else value
