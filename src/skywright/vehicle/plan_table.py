"""From a plan file to the reference table that a vehicle tracks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.core.types import REFERENCE
from skywright.models.compliant_arms import find_hands
from skywright.models.rigid_body import compute_tip
from skywright.planning.motion.plan_file import PlanFile

Table = NDArray[Any]


def build_plan_table(plan: PlanFile, model: NDArray[Any]) -> Table:
    """Return REFERENCE rows of a plan for the robot of `model` (1,) BODY_MODEL.

    The position loop is closed at the tip (`track_tip`): what wind makes the tip hang away from
    the plan, the platform gives way to.
    """
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
    return table
