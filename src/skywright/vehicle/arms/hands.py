"""Hands of compliant arms: gravity torques, deflections without an encoder, kinematics."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from skywright.core.record import Record
from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import SIDES
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.compliant_arms import count_command_ticks
from skywright.models.rigid_body import fill_gravity_torque, fill_kinematics, fill_point_jacobian
from skywright.models.rigid_body import fill_hands as fill_hand_frames
from skywright.models.springs import joint_deflection
from skywright.vehicle.arms.joints import ArmComponent
from skywright.vehicle.arms.ports import ArmModel, Hands, HandsReference, Joints
from skywright.vehicle.bus import Estimate
from skywright.vehicle.component import InOut, Out, Recorded, helper

DEFLECTION_STEPS, DEFLECTION_TOLERANCE = 20, 2e-4  # most a tick; rad (encoders: 0.2 deg)


class HandKinematics(ArmComponent):
    """Fills Hands and the gravity torques at the servos' rate.

    It computes the deflections of joints without an encoder, and updates the joint angles in
    Estimate and the link poses in Kinematics with them.
    """

    slot = "control"

    class Me(Record):
        stiff: Kinematics  # at the shafts

    columns = tuple(
        column
        for h, side in enumerate(SIDES)
        for column in (
            Recorded(
                f"{side}_est_p_WH", Hands, "p_WH", "m", f"{side} hand, estimated", item=h,
                per="hand",
            ),
            Recorded(
                f"{side}_ref_p_WH", HandsReference, "p_WH", "m", f"{side} hand, desired", item=h,
                per="hand",
            ),
            Recorded(
                f"{side}_ref_f_W", HandsReference, "f_WH", "N",
                f"requested force of the {side} hand", item=h, per="hand",
            ),
        )
    )  # fmt: skip

    def get_period(self, step: str, context: Any) -> float:
        """Return the servos' period (s)."""
        return count_command_ticks(context.robot) * float(context.dt)

    @staticmethod
    def step(
        me: Me,
        model: BodyModel,
        arm: ArmModel,
        ref: HandsReference,
        kin: InOut[Kinematics],
        joints: InOut[Joints],
        est: InOut[Estimate],
        hands: Out[Hands],
    ) -> None:
        v = View(model, arm, ref, kin, joints, est)
        g_W, g_B, shafts = local(3), local(3), local(MAX_JOINTS)
        g_W[0], g_W[1], g_W[2] = 0.0, 0.0, -model.gravity
        mat_t_vec(est.R_WB, g_W, g_B)
        for _ in range(DEFLECTION_STEPS):
            fill_gravity_torque(model, kin, g_B, joints.t_gravity)
            fill_hand_frames(model, kin)
            add_load(v)
            if step_deflections(v) < DEFLECTION_TOLERANCE:
                break
            fill_kinematics(model, est.q, kin)
        for j in range(MAX_JOINTS):
            shafts[j] = est.q[j] + joints.deflection[j]
        fill_kinematics(model, shafts, me.stiff)
        fill_hand_frames(model, me.stiff)
        fill_base(v, hands)
        for h in range(arm.n_hands):
            fill_hand(v, me.stiff, hands, h)


class View(NamedTuple):
    """Records that the functions below read and write."""

    model: Any
    arm: Any
    ref: Any
    kin: Any
    joints: Any
    est: Any


@helper
def fill_base(v: View, hands: Any) -> None:
    """Fill the pose in B of frame A, the arms' base: B itself, or the frame of the passive link."""
    for a in range(3):
        hands.p_BA[a] = 0.0
        for c in range(3):
            hands.R_BA[a, c] = 1.0 if a == c else 0.0
    if v.arm.swing >= 0:
        for a in range(3):
            hands.p_BA[a] = v.kin.p[0, a]
            for c in range(3):
                hands.R_BA[a, c] = v.kin.R[0, a, c]


@helper
def fill_hand(v: View, stiff: Any, hands: Any, h: int) -> None:
    """Fill position, frame, Jacobians and velocity of a hand."""
    k, arm, est = v.kin, v.arm, v.est
    vec, spin, rate = local(3), local(3), local(3)
    for a in range(3):
        vec[a] = k.p_BH[h, a] - arm.pad[h] * k.R_BH[h, a, 2]
    fill_point_jacobian(v.model, k, v.model.hand_link[h], vec, hands.J_BP[h])
    for a in range(3):
        hands.p_BH[h, a] = k.p_BH[h, a]
        hands.p_BH_stiff[h, a] = stiff.p_BH[h, a]
        rate[a] = 0.0
        for c in range(3):
            hands.R_BH[h, a, c] = k.R_BH[h, a, c]
        for j in range(MAX_JOINTS):
            hands.J_BH[h, a, j] = k.J_BH[h, a, j]
            rate[a] += k.J_BH[h, a, j] * est.qd[j]
    mat_vec(est.R_WB, hands.p_BH[h], vec)
    for a in range(3):
        hands.p_WH[h, a] = est.p_WB[a] + vec[a]
    cross(est.w_WB_B, hands.p_BH[h], spin)
    for a in range(3):
        rate[a] += spin[a]
    mat_vec(est.R_WB, rate, vec)
    for a in range(3):
        hands.v_WH[h, a] = est.v_WB[a] + vec[a]
    elbow = arm.first[h] + arm.n - 1
    hands.manipulability[h] = arm.upper * arm.fore * abs(math.sin(est.q[elbow]))


@helper
def add_load(v: View) -> None:
    """Add the joint torques of a weight that hangs on the hands to `t_gravity`: J^T f.

    Feed-forward, deflection estimate and force estimate then include the load along with the arms'
    own weight.
    """
    arm = v.arm
    for h in range(arm.n_hands):
        if v.ref.load[h] == 0.0:
            continue
        for j in range(arm.first[h], arm.first[h] + arm.n):
            for a in range(3):  # row z of R_WB: the vertical, in B
                v.joints.t_gravity[j] += v.kin.J_BH[h, a, j] * v.est.R_WB[2, a] * v.ref.load[h]


@helper
def fill_weight_stiffness(v: View, stiffness: Any) -> None:
    """Fill `stiffness` (MAX_JOINTS,) N m/rad: derivative of t_gravity_j by q_j, load included.

    A weight w at r from the axis a adds w . r - (a . w) (a . r), positive if it hangs below.
    """
    m, k = v.model, v.kin
    r, up = local(3), v.est.R_WB[2]  # row z: the vertical, in B
    for j in range(MAX_JOINTS):
        stiffness[j] = 0.0
    for n in range(m.n_links + v.arm.n_hands):
        h = n - m.n_links
        if h < 0:
            i, weight = n, m.mass[n] * m.gravity
            mat_vec(k.R[n], m.com[n], r)
            px, py, pz = k.p[n, 0] + r[0], k.p[n, 1] + r[1], k.p[n, 2] + r[2]
        else:
            i, weight = m.hand_link[h], v.ref.load[h]
            px, py, pz = k.p_BH[h, 0], k.p_BH[h, 1], k.p_BH[h, 2]
        wx, wy, wz = -weight * up[0], -weight * up[1], -weight * up[2]
        while i >= 0:
            joint, axis = m.joint[i], m.axis[i]
            if joint >= 0 and not m.slide[i]:
                ax, ay, az = k.R[i, 0, axis], k.R[i, 1, axis], k.R[i, 2, axis]
                rx, ry, rz = px - k.p[i, 0], py - k.p[i, 1], pz - k.p[i, 2]
                stiffness[joint] += wx * rx + wy * ry + wz * rz
                stiffness[joint] -= (ax * wx + ay * wy + az * wz) * (ax * rx + ay * ry + az * rz)
            i = m.parent[i]


@helper
def step_deflections(v: View) -> float:
    """One step towards the deflections of joints without an encoder: D = spring^-1(t_gravity(q)).

    q is the shaft angle minus the deflection, so the stiffness G of the weight feeds back: a full
    step to D diverges if G exceeds the spring's k. The step is therefore scaled by
    1 / (1 + 2 trace G / k), with the trace over all joints of the arm without an encoder. The trace
    bounds the largest eigenvalue of G, and the factor 2 covers the slope of D within the gear's
    play. The iteration converges for any hanging load. Returns the largest step (rad).
    """
    arm, joints, est = v.arm, v.joints, v.est
    stiffness = local(MAX_JOINTS)
    fill_weight_stiffness(v, stiffness)
    largest = 0.0
    for h in range(arm.n_hands):
        trace = 0.0
        for j in range(arm.first[h], arm.first[h] + arm.n):
            if arm.k[j] > 0.0 and arm.sensed[j] == 0.0:
                trace += max(stiffness[j], 0.0)
        for j in range(arm.first[h], arm.first[h] + arm.n):
            if arm.k[j] > 0.0 and arm.sensed[j] == 0.0:
                step = joint_deflection(arm, j, joints.t_gravity[j]) - joints.deflection[j]
                step /= 1.0 + 2.0 * trace / arm.k[j]
                joints.deflection[j] += step
                est.q[j] -= step
                largest = max(largest, abs(step))
    return largest
