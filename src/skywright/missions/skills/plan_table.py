"""Conversion of a plan file into the reference table that a vehicle tracks."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_z
from skywright.core.types import REFERENCE
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.rigid_body import compute_tip
from skywright.planning.motion.plan_file import PlanFile
from skywright.vehicle.rest_to_rest import ROW_PERIOD

LEAD_S = 1.0  # s, width of the window that smooths the acceleration


def build_plan_table(plan: PlanFile, model: NDArray[Any]) -> Table:
    """Return REFERENCE rows of a plan for the robot of `model` (1,) `BodyModel`.

    The position loop is closed at the tip (`track_tip`): the platform compensates the wind's
    displacement of the tip. With a passive joint the suspended arms lag z a / g behind an
    acceleration a, and the platform leans by as much. `p_WB` is therefore ahead of the plan by this
    lag. The table is then LEAD_S longer than the plan, with half of it at rest at either end.
    """
    swings = len(plan.joints) > 0 and find_swing(model, np.ones(len(plan.joints)))[0] != 1.0
    if swings:
        plan = _extend(plan)
    table = np.zeros(len(plan.t), REFERENCE)
    n = len(plan.joints)
    table["t"], table["p_WB"] = plan.t, plan.pose[:, :3]
    table["v_WB"], table["a_WB"] = plan.rate[:, :3], plan.acceleration[:, :3]
    table["w_WB_B"][:, 2], table["wd_WB_B"][:, 2] = plan.rate[:, 3], plan.acceleration[:, 3]
    table["q"][:, :n], table["qd"][:, :n] = plan.q, plan.qd
    table["R_WS"], table["track_tip"], table["active"] = np.eye(3), 1.0, 1.0
    for row, yaw in zip(table, plan.pose[:, 3], strict=True):
        R = rot_z(float(yaw))
        p_BT, R_BT = compute_tip(model, row["q"])
        row["R_WB"], row["p_WT"], row["R_WT"] = R, row["p_WB"] + R @ p_BT, R @ R_BT
        hands = find_hands(model, row["q"])
        row["p_WH"][: len(hands)] = row["p_WB"] + hands @ R.T
    if len(table) > 1:
        table["v_WT"] = np.gradient(table["p_WT"], plan.t, axis=0)
    if swings:
        _lead(table, float(model[0]["gravity"]))
    return table


def _extend(plan: PlanFile) -> PlanFile:
    """Resample a plan every ROW_PERIOD, with half of LEAD_S at rest before and after it."""
    half = round(0.5 * LEAD_S / ROW_PERIOD)
    n = math.ceil(plan.t[-1] / ROW_PERIOD - 1e-9) + 2 * half + 1
    t = ROW_PERIOD * (np.arange(n) - half)

    def take(columns: Array, still: bool) -> Array:
        ends = {"left": 0.0, "right": 0.0} if still else {}
        return np.column_stack([np.interp(t, plan.t, c, **ends) for c in columns.T])

    return plan._replace(
        t=t - t[0], pose=take(plan.pose, False), rate=take(plan.rate, True),
        acceleration=take(plan.acceleration, True), q=take(plan.q, False), qd=take(plan.qd, True),
    )  # fmt: skip


def _lead(table: Table, gravity: float) -> None:
    """Move the platform ahead by the lag of the tip, computed from the smoothed acceleration."""
    half = round(0.5 * LEAD_S / ROW_PERIOD)
    kernel = np.hanning(2 * half + 1)
    kernel /= kernel.sum()
    below = (table["p_WB"][:, 2] - table["p_WT"][:, 2]) / gravity
    for axis in (0, 1):
        lead = below * np.convolve(table["a_WB"][:, axis], kernel, mode="same")
        rate = np.gradient(lead, ROW_PERIOD)
        table["p_WB"][:, axis] += lead
        table["v_WB"][:, axis] += rate
        table["a_WB"][:, axis] += np.gradient(rate, ROW_PERIOD)
