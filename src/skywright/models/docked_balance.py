"""Balance of load between rotors and feet of a docked robot that presses.

`models/docked.py` computes the largest press for any feasible foot forces. A docked robot with
stiff rotors and soft feet has no such freedom: the gear is rigid and its feet are equal springs, so
that their normal forces lie on a plane over the contact points. This module finds the balance under
that condition, with every foot loaded, friction well inside its cone, and the rotors as far from
their limits as possible:

    maximise s   subject to   B T + W_feet + F w_tip + w_weight + w_drag = 0,
                              t_min + s r <= T <= t_max - s r,  N_i = c_0 + c_1 x_i + c_2 y_i

The law uses W_feet as feedforward. It interpolates linearly over the press between two such
solutions, because every condition is linear.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from skywright.core.arrays import Array
from skywright.models.docked import DockedRobot, Stance
from skywright.models.statics import wrench_at

SIDES = 16
FRICTION_SHARE = (0.25, 0.5, 0.7, 0.95)
"""Usable shares of a foot's friction. The smallest share that leaves the rotors MARGIN is used; the
rest is reserved for gusts and model errors."""
MARGIN = 0.05
"""Share of a rotor's range: during a press, a rotor's thrust varies by 1 % (one sigma)."""
HALF, LEAST_N = 0.5, 0.5  # with plant errors: usable share of friction; N, least load of a foot


class Spread(NamedTuple):
    """The stated errors of a plant (defaults of the root `plant`)."""

    weight: float = 0.03
    thrust: float = 0.03  # of all rotors together
    rotors: float = 0.02  # one sigma, difference between rotors
    center: float = 0.004  # m, of the centre of mass, per axis
    drag: float = 0.2


SPREAD = Spread()


class DockedBalance(NamedTuple):
    """One balance of rotors, feet and press; frame B, about its origin."""

    f_feet: Array  # (3,) N, of the structure on the feet
    t_feet: Array  # (3,) N m
    thrust: Array  # (n,) N
    foot_load: Array  # (feet,) N, normal
    foot_friction: Array  # (feet,) tangential over normal force
    margin: float  # least distance of a rotor from its limits, over its range


def compute_docked_balance(
    docked: DockedRobot,
    stance: Stance,
    press: float,
    *,
    R_WB: Array,
    foot_load: float | None = None,
    drag_B: Array | None = None,
) -> DockedBalance | None:
    """Return the balance at a press (N), or None if none exists.

    `R_WB` (3, 3) is the docked attitude, `foot_load` (N) the least load of each foot (default: the
    docking gear's), `drag_B` (6,) an additional wrench.
    """
    up_B = R_WB[2]
    load = wrench_at(-stance.mass * docked.gravity * up_B, stance.p_BC)
    load = load + press * wrench_at(np.array([0.0, 0.0, -1.0]), stance.tip)
    if drag_B is not None:
        load = load + drag_B
    least = docked.docking.foot_load_n if foot_load is None else foot_load
    best: DockedBalance | None = None
    for share in FRICTION_SHARE:
        found = _solve(docked, load, least, share)
        if found is not None and found.margin >= MARGIN:
            return found
        if found is not None and (best is None or found.margin > best.margin + 1e-6):
            best = found
    return best


def compute_borne_press(
    docked: DockedRobot,
    stance: Stance,
    *,
    R_WB: Array,
    drag_B: Array | None = None,
    reserve: float = MARGIN,
    friction: float = HALF,
) -> float:
    """Return the largest press (N) that a robot can hold under the plant's stated errors.

    Each error of SPREAD has its worst sign. The feet use `friction` of their friction limit, carry
    at least LEAST_N each, and the rotors keep `reserve` of their range. The docked robot's layout
    must have the full thrust, without `thrust_fraction`, because SPREAD already covers that
    reserve. Returns NaN if the robot cannot rest under these conditions.
    """
    e, up_B = SPREAD, R_WB[2]
    weight = -(1.0 + e.weight) * stance.mass * docked.gravity * up_B
    drag = np.zeros(6) if drag_B is None else (1.0 + e.drag) * drag_B
    layout = docked.layout
    kept = (1.0 - e.thrust) * (1.0 - 2.0 * e.rotors)  # two deviations, of one rotor
    docked = docked._replace(layout=layout._replace(t_max=kept * layout.t_max))
    push = wrench_at(np.array([0.0, 0.0, -1.0]), stance.tip)
    most = math.inf
    for x, y in product((-e.center, e.center), repeat=2):
        load = wrench_at(weight, stance.p_BC + [x, y, e.center]) + drag
        rest = _solve(docked, load, LEAST_N, friction)
        if rest is None or rest.margin < reserve:
            return math.nan
        most = min(most, _solve_most(docked, load, push, reserve, friction))
    return most


def _solve_most(
    docked: DockedRobot, load: Array, push: Array, reserve: float, friction: float
) -> float:
    """Return the largest feasible multiple of the wrench `push` (6,) in addition to `load`."""
    p = _build_programme(docked, LEAST_N, friction)
    cost = np.zeros(p.balance.shape[1] + 1)
    cost[-1] = -1.0
    bounds = [(None, None)] * (len(cost) - 2) + [(reserve, None), (0.0, None)]
    found = linprog(
        cost, A_ub=np.column_stack([p.rows, np.zeros(len(p.rows))]), b_ub=p.limits,
        A_eq=np.column_stack([p.balance, push]), b_eq=-load, bounds=bounds, method="highs",
    )  # fmt: skip
    return float(found.x[-1]) if found.status == 0 else 0.0


class _Programme(NamedTuple):
    """Constraints on (thrusts n, plane of normals 3, tangential 2 per foot, margin)."""

    balance: Array  # (6, size), wrenches
    rows: Array  # (k, size)
    limits: Array  # (k,)
    plane: Array  # (feet, 3)


def _build_programme(docked: DockedRobot, least: float, share: float) -> _Programme:
    layout, feet = docked.layout, docked.feet
    n, m = len(layout.t_max), len(feet)
    size = n + 3 + 2 * m + 1
    plane = np.column_stack([np.ones(m), feet[:, 0], feet[:, 1]])
    balance = np.zeros((6, size))
    balance[:, :n] = layout.B
    for i, foot in enumerate(feet):
        balance[:, n : n + 3] += np.outer(wrench_at(np.array([0.0, 0.0, -1.0]), foot), plane[i])
        for k in range(2):
            balance[:, n + 3 + 2 * i + k] = wrench_at(np.eye(3)[k], foot)
    rows, limits = [], []
    turn = 2.0 * math.pi * np.arange(SIDES) / SIDES
    hold = share * docked.docking.friction * math.cos(math.pi / SIDES)
    for i in range(m):
        row = np.zeros(size)
        row[n : n + 3] = -plane[i]
        rows.append(row)
        limits.append(-least)
        for a in turn:
            row = np.zeros(size)
            row[n : n + 3] = -hold * plane[i]
            row[n + 3 + 2 * i : n + 5 + 2 * i] = [math.cos(a), math.sin(a)]
            rows.append(row)
            limits.append(0.0)
    reach = layout.t_max - layout.t_min
    for i in range(n):
        for sign, limit in ((1.0, layout.t_max[i]), (-1.0, -layout.t_min[i])):
            row = np.zeros(size)
            row[i], row[-1] = sign, reach[i]
            rows.append(row)
            limits.append(limit)
    return _Programme(balance, np.array(rows), np.array(limits), plane)


def _solve(docked: DockedRobot, load: Array, least: float, share: float) -> DockedBalance | None:
    """Find the balance of a load with the largest margin."""
    balance, rows, limits, plane = _build_programme(docked, least, share)
    n, m, size = len(docked.layout.t_max), len(docked.feet), balance.shape[1]
    cost = np.zeros(size)
    cost[-1] = -1.0
    bounds = [(None, None)] * (size - 1) + [(0.0, 0.5)]
    found = linprog(
        cost, A_ub=rows, b_ub=limits, A_eq=balance, b_eq=-load, bounds=bounds, method="highs"
    )
    if found.status != 0:
        return None
    x = np.asarray(found.x)
    normal = plane @ x[n : n + 3]
    sideways = x[n + 3 : n + 3 + 2 * m].reshape(m, 2)
    wrench = balance[:, n:-1] @ x[n:-1]
    ratio = np.linalg.norm(sideways, axis=1) / np.maximum(normal, 1e-12)
    return DockedBalance(wrench[:3], wrench[3:], x[:n], normal, ratio, float(x[-1]))
