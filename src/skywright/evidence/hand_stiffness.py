"""Stiffness of a compliant hand: `python -m skywright.evidence.hand_stiffness [ROBOT]`.

A hand held at rest has the stiffness of the springs of its arm, (27) of Suarez 2020: the inverse of
C = J K^-1 J^T. Control can make it softer: the force loop, with the bandwidth w, would track
k (p_ref - p), which moves a free hand towards p_ref at the rate w C k. The link of a free hand
oscillates on its spring with little damping, and the encoder is on the side of the link: the rate
must not exceed the bandwidth w_p that `deflection_bandwidth_rad_s` gives every position loop of
this arm. Thus k <= w_p / (w C). A stiffness above 1 / C is out of reach for the same reason.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import click
import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.limbs import SIDES
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.evidence.command import Command
from skywright.models.compliant_arms import find_hands, is_compliant
from skywright.models.rigid_body import build_body_model, posture
from skywright.vehicle.arms.joints import build_arm_model

STEP = 1e-6  # rad, of the difference quotient


class Row(NamedTuple):
    """Stiffness of a hand in its softest direction (N/m)."""

    hand: str
    own: float
    """Of the springs of all joints."""
    active: float
    """Largest one that control permits; NaN if no joint of the arm measures its deflection."""


def measure(name: str, pose: str = "working") -> list[Row]:
    """Compute the stiffness of every hand. Raises InputError for arms without springs."""
    robot, _ = load_robot(name)
    if not is_compliant(robot) or not np.any(build_arm_model(robot)[0]["k"]):
        raise InputError(
            f"the arms of robot {name!r} have no springs (flex_stiffness_nm_per_rad); valid: a "
            "robot such as bimanual"
        )
    arm, c = build_arm_model(robot)[0], robot.control
    model, q = build_body_model(robot), posture(robot, pose)
    force = (np.pi / 6.0) / (arm["servo_tau"] + 1.5 * arm["dt"])  # as laws/compliant.py
    rows = []
    for h in range(int(arm["n_hands"])):
        mine = np.arange(arm["first"][h], arm["first"][h] + arm["n"])
        J = np.stack([_move(model, q, j, h) for j in mine], axis=1)
        soft = np.linalg.eigvalsh(_comply(J, arm["k"][mine]))[-1]
        sensed = np.where(arm["sensed"][mine] > 0.0, arm["k"][mine], 0.0)
        felt = np.linalg.eigvalsh(_comply(J, sensed))[-1]
        active = c.deflection_bandwidth_rad_s / (force * felt) if felt > 0.0 else np.nan
        rows.append(Row(SIDES[h], float(1.0 / soft), float(active)))
    return rows


def _move(model: object, q: Array, j: int, h: int) -> Array:
    """Return the motion (3,) m/rad of hand h with joint j."""
    turn = np.zeros(len(q))
    turn[j] = STEP
    return np.asarray(
        (find_hands(model, q + turn)[h] - find_hands(model, q - turn)[h]) / (2.0 * STEP)
    )


def _comply(J: Array, k: Array) -> Array:
    """Return J K^-1 J^T (3, 3) m/N of the joints whose stiffness is above 0."""
    has = k > 0.0
    return np.asarray(J[:, has] @ np.diag(1.0 / k[has]) @ J[:, has].T)


@click.command("hand-stiffness", cls=Command)
@click.argument("robot", default="bimanual")
@click.option("--json", "as_json", is_flag=True)
def main(robot: str, as_json: bool) -> None:
    """Print the stiffness of each hand in its softest direction."""
    rows = measure(robot)
    if as_json:
        found = [r._asdict() | {"active": None if np.isnan(r.active) else r.active} for r in rows]
        print(json.dumps({"robot": robot, "hands": found}))
        return
    for r in rows:
        told = f"by control at most {r.active:.2g} N/m"
        if np.isnan(r.active):
            told = "no force control: no joint of the arm measures its deflection"
        print(f"{robot}, {r.hand} hand: springs {r.own:.1f} N/m; {told}")


if __name__ == "__main__":
    main()
