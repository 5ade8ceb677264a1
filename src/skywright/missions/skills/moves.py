"""Rest-to-rest moves of platform, arm and contact forces together, as one reference table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Table
from skywright.core.rotations import exp_so3, log_so3
from skywright.models.rigid_body import compute_tip
from skywright.vehicle.arms_interface import compute_joints_s
from skywright.vehicle.follower import copy_row
from skywright.vehicle.rest_to_rest import ROW_PERIOD, build_straight, duration

TURN_SPEED, TURN_ACCELERATION = 0.3, 0.6  # rad/s, rad/s^2, of the platform's attitude


STILL = (
    "t", "v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT", "track_tip", "dead_zone", "tare",
)  # fmt: skip
"""Fields that are zero in a row at rest. The hands keep their tasks, including `v_WH`, their speed.
"""
LEVEL = np.eye(3)


def set_rest(row: Any) -> Any:
    """Return a copy of a REFERENCE row at rest, with time 0."""
    row = copy_row(row)
    for field in STILL:
        row[field] = 0.0
    row["R_WS"] = LEVEL
    return row


def compute_move_s(
    distance: float, turn: float = 0.0, joints: float = 0.0, *, speed: float,
    acceleration: float = 0.5, least: float = 0.0,
) -> float:  # fmt: skip
    """Return the duration (s) of `build_move` by a distance (m), a turn and a bend (rad)."""
    return max(
        duration(distance, speed, acceleration),
        duration(turn, TURN_SPEED, TURN_ACCELERATION),
        compute_joints_s(np.array([joints])),
        least,
    )


class MoveSum:
    """Duration of straight moves, each from the end of the one before."""

    def __init__(
        self, p: Array, R: Array, q: Array | None = None, *, speed: float,
        acceleration: float = 0.5, least: float = 0.0,
    ) -> None:  # fmt: skip
        """Start at p (3,) m, R (3, 3) and q (n,) rad; moves below `least` (m, rad) are not flown.

        `speed` (m/s) and `acceleration` (m/s^2) are those of moves without their own.
        """
        self.p, self.R, self.q = p, R, np.zeros(0) if q is None else q
        self.speed, self.acceleration, self.least = speed, acceleration, least
        self.seconds = 0.0

    def go(
        self, p: Array, R: Array, q: Array | None = None, *, speed: float | None = None,
        acceleration: float | None = None,
    ) -> None:  # fmt: skip
        """Add a move to p (3,) m and R (3, 3), and to q (n,) rad unless the joints stay."""
        q = self.q if q is None else q
        turn = np.empty(3)
        log_so3(np.ascontiguousarray(self.R.T @ R), turn)
        distance, angle = float(np.linalg.norm(p - self.p)), float(np.linalg.norm(turn))
        bend = float(np.max(np.abs(q - self.q), initial=0.0))
        if max(distance, angle, bend) > self.least:
            self.seconds += compute_move_s(
                distance, angle, bend, speed=self.speed if speed is None else speed,
                acceleration=self.acceleration if acceleration is None else acceleration,
            )  # fmt: skip
        self.p, self.R, self.q = p, R, q


def build_move(
    model: NDArray[Any],
    n_joints: int,
    start: Any,
    end: Any,
    *,
    speed: float,
    acceleration: float = 0.5,
    least: float = 0.0,
) -> Table:
    """Move from one REFERENCE row to another in at least `least` s.

    The position moves on a straight line at up to `speed` (m/s), the attitude about one axis, and
    the joints in synchrony. Forces (`force`, `f_feet_B`, `t_feet_B`) change linearly in time. Flags
    (press, docked, mode) are those of `end` from the beginning. `model` is the robot's `BodyModel`.
    """
    start, end = set_rest(start), set_rest(end)
    delta = end["p_WB"] - start["p_WB"]
    turn = np.empty(3)
    log_so3(np.ascontiguousarray(start["R_WB"].T @ end["R_WB"]), turn)  # in the moving frame
    angle, joints = float(np.linalg.norm(turn)), end["q"] - start["q"]
    total = compute_move_s(
        float(np.linalg.norm(delta)), angle, float(np.max(np.abs(joints))),
        speed=speed, acceleration=acceleration, least=least,
    )  # fmt: skip
    table, u, s, ds, dds = build_straight(start, end, delta, total)
    table["w_WB_B"] = ds[:, None] * turn
    table["wd_WB_B"] = dds[:, None] * turn
    table["q"] = start["q"] + s[:, None] * joints
    table["qd"] = ds[:, None] * joints
    rotation = np.empty((3, 3))
    tip, R_BT = compute_tip(model, start["q"][:n_joints])
    moving = bool(np.any(joints))
    for i in range(len(table)):
        exp_so3(s[i] * turn, rotation)
        table["R_WB"][i] = start["R_WB"] @ rotation
        if moving:
            tip, R_BT = compute_tip(model, table["q"][i, :n_joints])
        table["p_WT"][i] = table["p_WB"][i] + table["R_WB"][i] @ tip
        table["R_WT"][i] = table["R_WB"][i] @ R_BT
    table["v_WT"] = np.gradient(table["p_WT"], ROW_PERIOD, axis=0)
    for field in ("f_feet_B", "t_feet_B"):
        table[field] = start[field] + u[:, None] * (end[field] - start[field])
    table["force"] = start["force"] + u * (end["force"] - start["force"])
    return table
