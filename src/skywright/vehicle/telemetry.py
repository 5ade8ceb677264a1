"""What a vehicle tells of itself, by name: the streams of UAL and of the arms.

Each is read from the robot's side, as it is at the last control tick. W is ENU, B the platform
(FLU); quaternions are wxyz.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_to_quat
from skywright.description.robot.limbs import SIDES
from skywright.errors import InputError
from skywright.vehicle.arms.ports import ArmModel, Deflections, HandForce, Hands, Joints
from skywright.vehicle.interface import Backend
from skywright.vehicle.preflight import read_charge

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """A pose in its parent's frame."""

    t: float  # s
    p: Array  # (3,) m
    q: Array  # (4,) wxyz


class Odometry(NamedTuple):
    """Pose of B in W and its speeds."""

    pose: Pose
    v_WB: Array  # (3,) m/s
    w_WB_B: Array  # (3,) rad/s, in B


class JointState(NamedTuple):
    """The arms' joints."""

    t: float  # s
    q: Array  # (n,) rad, output side, as estimated
    qd: Array  # (n,) rad/s
    q_reference: Array  # (n,) rad


class HandStates(NamedTuple):
    """Compliant arms, by hand ("left", "right"); empty where nothing tells it."""

    tips: dict[str, Array]  # (3,) m in W
    forces: dict[str, Array]  # (3,) N in W, on what the hand touches, as estimated
    deflections: Array  # (n,) rad, as measured
    torques: Array  # (n,) N m, that the springs carry: stiffness times deflection


def read_odometry(b: Backend) -> Odometry:
    """Return pose and speeds of the platform as estimated."""
    est = b.estimate
    return Odometry(
        _pose(b.t, est["p_WB"], est["R_WB"]), np.array(est["v_WB"]), np.array(est["w_WB_B"])
    )


def read_transforms(b: Backend) -> dict[tuple[str, str], Pose]:
    """Return poses by (parent, child): platform in the world, tip and hands on the platform."""
    est = b.estimate
    R = np.array(est["R_WB"])
    out = {("world", "platform"): _pose(b.t, est["p_WB"], R)}
    if b.n_joints:
        p_BT = R.T @ (np.array(est["p_WT"]) - est["p_WB"])
        out["platform", "tip"] = _pose(b.t, p_BT, R.T @ np.array(est["R_WT"]))
    if "hands" in b.offers:
        hands = b.look(Hands)
        for h in range(int(b.look(ArmModel).n_hands)):
            out["platform", f"{SIDES[h]}_hand"] = _pose(b.t, hands.p_BH[h], hands.R_BH[h])
    return out


def read_reference(b: Backend) -> Odometry:
    """Return the commanded pose and velocity of the platform."""
    row = b.reference_now
    return Odometry(
        _pose(b.t, row["p_WB"], row["R_WB"]), np.array(row["v_WB"]), np.array(row["w_WB_B"])
    )


def read_joints(b: Backend) -> JointState:
    """Return the joints of the arms, empty without any."""
    n, est = b.n_joints, b.estimate
    return JointState(
        b.t, np.array(est["q"])[:n], np.array(est["qd"])[:n], np.array(b.reference_now["q"])[:n]
    )


def read_hands(b: Backend) -> HandStates:
    """Return hands, forces, deflections and torques of compliant arms."""
    if "hands" not in b.offers:
        return HandStates({}, {}, np.zeros(0), np.zeros(0))
    arm, n = b.look(ArmModel), b.n_joints
    names = SIDES[: int(arm.n_hands)]
    force, deflection = _find(b, HandForce), _find(b, Deflections)
    sprung = np.array(b.look(Joints).deflection)[:n]
    return HandStates(
        {name: np.array(b.look(Hands).p_WH[h]) for h, name in enumerate(names)},
        {} if force is None else {n: np.array(force.f_WH[h]) for h, n in enumerate(names)},
        np.zeros(0) if deflection is None else np.array(deflection.deflection)[:n],
        np.array(arm.k)[:n] * sprung,
    )


def read_battery(b: Backend) -> float:
    """Return the share of the battery's energy that is left; NaN where nothing measures it."""
    return read_charge(b)


def _find(b: Backend, record: type[Any]) -> Any:
    try:
        return b.look(record)
    except InputError:
        return None


def _pose(t: float, p: Array, R: Array) -> Pose:
    q = np.empty(4)
    rot_to_quat(np.ascontiguousarray(R), q)
    return Pose(t, np.array(p), q)
