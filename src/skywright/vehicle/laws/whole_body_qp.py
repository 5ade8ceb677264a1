"""Whole-body control as a quadratic program: rotor thrusts, joint accelerations, contact force.

The task is that of Tognon et al. 2018, laws (2) to (4). While no limit is active, the platform's
force is that of law (4) and the joint speeds are those of law (2). Each control tick solves

    minimise   |W (B T + G f - L q'' - w)|^2 + w_f^2 |f - f^d|^2 + w_q^2 |q'' - q''^d|^2
               + w_T^2 |T - T^d|^2
    over       T (n,) rotor thrusts, q'' (m,) joint accelerations, f (3,) force of the surface
    such that  T_min <= T <= T_max
               |q''| <= a_max,   |motor speeds of q' + T_v q''| <= their maximum
               k (q_min - q) <= q' + T_v q'' <= k (q_max - q)          (Faverjon, Tournassoud 1987)
               f within the friction cone, as a pyramid of eight sides inside it

- Dynamics: B T + G f - L q'' = w, force and torque about the centre of mass. w is the wrench that
  the accelerations of laws (3) and (4) require: M a + gravity + gyroscopic terms + integrals. L
  holds the arm's columns of the mass matrix (`fill_reaction`); G applies f at the tip. These rows
  are part of the cost, so that a solution exists at all limits. The weights rank them: height, roll
  and pitch first, then yaw, then the lateral force, then the push. The arm ranks above all of them:
  its reaction lasts only while it accelerates, so it cannot replace thrust, and joints yield at
  their own limits.
- Contact: law (4) presses with N = K^P |e_n| and feeds the friction mu N of the desired sliding
  forward. Both form f^d here. Their moment about the centre of mass, (p_T - c) x f, is therefore
  part of the balance; law (3) leaves it to its integral. While no limit is active, this is the only
  difference to `push_and_slide`. One vertex of the pyramid lies in the direction of sliding, so
  that f^d is inside.
- Servos follow a speed command as T_v q'' = speed - q'. q''^d is therefore that of law (2)'s speed,
  and the command is q' + T_v q''.
- T^d are the thrusts of the allocation. If T^d, q''^d and f^d are within all limits, they are the
  solution, because the cost is zero there, and no solver runs. Otherwise DAQP solves the program.
- Beyond a stop, the rows of a joint may contradict each other; they may then be violated at a
  penalty. If no solution exists even then, the allocation realises the wrench instead
  (`ThrustCommand.limits`).

Weights replace the strict hierarchy of Escande, Mansard, Wieber 2014 (Hierarchical quadratic
programming, IJRR 33(7)): one program, with ranks far enough apart to act as one.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from skywright.core.record import Array
from skywright.core.scratch import local
from skywright.core.spec import Positive
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.compliant_arms import is_compliant
from skywright.models.link_motion import compute_joint_inertia
from skywright.models.rigid_body import posture
from skywright.models.rotor_loss import RotorsLeft
from skywright.vehicle.allocation import compute_yaw_share
from skywright.vehicle.bus import (
    Allocated,
    Body,
    Estimate,
    Reference,
    ThrustCommand,
    WrenchCommand,
)
from skywright.vehicle.component import Out, Recorded
from skywright.vehicle.laws._daqp import build_program, load_solver
from skywright.vehicle.laws._qp_task import FACETS, Wanted, fill_wanted, is_free, solve_task
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import (
    LoopsTable,
    arm_velocity,
    hold_attitude,
    position_force,
    rest,
    to_body,
)

Weight = Annotated[float, Field(ge=1e-6, le=1e9)]
"""Cost of a missing part of the wrench. Only ratios matter; the solver's tolerance limits them."""


class WholeBodyQp(ThreeLoops):
    """Fills f_B, t_B, qd and the thrusts that realise them within the limits."""

    needs_full_actuation = True
    columns = (
        Recorded(
            "qp_limits",
            ThrustCommand,
            "limits",
            "",
            "0: no limit binds, 1: some do, 2: joint limits had to give way, 3: no solution",
        ),
    )

    class Table(LoopsTable):
        """Bandwidths of the loops, and the cost of each missing part of the wrench: per newton, or
        per newton metre over the lever of a rotor."""

        height_weight: Weight = 100.0  # vertical force
        attitude_weight: Weight = 100.0  # roll and pitch torque
        yaw_weight: Weight = 30.0  # torque about z
        lateral_weight: Weight = 10.0  # horizontal force
        contact_weight: Weight = 3.0  # force on the surface
        arm_weight: Weight = 1000.0  # relative to the largest acceleration of a joint
        stop_rate_1_s: Positive = 12.5  # k, speed limit of a joint over its distance to the stop
        # mu; None: that of the law's friction feed-forward
        friction_cone: float | None = Field(default=None, ge=0.0, le=5.0)

    class Me(ThreeLoops.Me):
        n: int  # rotors
        m: int  # joints
        mu: float
        lever: float  # m
        weight: Annotated[Array, 6]  # of vertical, lateral, roll and pitch, yaw, contact, arm
        stop_rate: float  # 1/s
        share: float  # per tick, low-pass of the torque about z (vehicle/allocation.py)
        t_z: float  # N m, low-passed torque about z
        B: Annotated[Array, 6, MAX_ROTORS]
        P: Annotated[Array, MAX_ROTORS, 6]
        preload: Annotated[Array, MAX_ROTORS]  # N
        t_min: Annotated[Array, MAX_ROTORS]  # N
        t_max: Annotated[Array, MAX_ROTORS]
        q_min: Annotated[Array, MAX_JOINTS]  # rad
        q_max: Annotated[Array, MAX_JOINTS]
        a_max: Annotated[Array, MAX_JOINTS]  # rad/s^2
        T_v: Annotated[Array, MAX_JOINTS]  # s, of the joints' servos
        solver: int  # addresses of the solver, its records and its arrays
        problem: int
        result: int
        H: int
        f: int
        A: int
        upper: int
        lower: int
        sense: int
        x: int

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError for a robot with joints whose speeds the law cannot command."""
        why = ""
        if is_compliant(robot):
            why = "the arms of {} have springs and servos that take angles"
        elif any(limb.servo < 0 for limb in list_joints(robot)):
            why = "{} has a joint without a servo"
        if why:
            raise InputError(
                f"control law 'whole_body_qp' commands the speed of each joint's servo; "
                f"{why.format(repr(robot.name))}: use a robot such as 'othex'"
            )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill gains, limits and the program; raise RuntimeError if the layout of DAQP differs."""
        super().build(me, table, context)
        a, model, robot = context.allocator, context.model, context.robot
        n, m = len(a.t_min), int(model["n_joints"])
        me.n, me.m, me.share = n, m, compute_yaw_share(context)
        me.B[:, :n], me.P[:n], me.preload[:n] = a.B, a.P, a.preload
        me.t_min[:n], me.t_max[:n] = a.t_min + a.preload, a.t_max + a.preload
        me.q_min, me.q_max, me.stop_rate = model["q_min"], model["q_max"], table.stop_rate_1_s
        me.mu = me.friction if table.friction_cone is None else table.friction_cone
        me.lever = float(np.max(np.linalg.norm(context.rotors.position, axis=1)))
        me.weight = [
            table.height_weight, table.lateral_weight, table.attitude_weight, table.yaw_weight,
            table.contact_weight, table.arm_weight,
        ]  # fmt: skip
        if m:
            servos = [list_servos(robot)[limb.servo][1] for limb in list_joints(robot)]
            moved = np.diag(compute_joint_inertia(model.reshape(1), posture(robot, "working")))
            me.T_v[:m] = [servo.velocity_time_constant_s for servo in servos]
            me.a_max[:m] = [
                servo.stall_torque_nm / (servo.armature_kgm2 + inertia)
                for servo, inertia in zip(servos, moved, strict=True)
            ]
        p = build_program(n + m + 3, 2 * m + FACETS)
        me.solver = load_solver()
        for name in ("problem", "result", "H", "f", "A", "upper", "lower", "sense", "x"):
            me[name] = context.keep(getattr(p, name))
        context.keep(p.lam)

    def give_up_rotor(self, me: Any, left: RotorsLeft) -> None:
        """Fix the thrust of a lost rotor, and take over the allocation of the remaining ones."""
        n = len(left.preload)
        me.P[:n], me.preload[:n] = left.P, left.preload
        me.t_min[:n], me.t_max[:n] = left.t_min + left.preload, left.t_max + left.preload

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        model: BodyModel,
        kin: Kinematics,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
        told: Out[ThrustCommand],
    ) -> None:
        arm_velocity(me, ref, est, body, cmd.qd)
        told.given = told.limits = 0.0
        if ref.active < 0.5:
            rest(me, cmd)
            me.t_z = 0.0
            return
        f_W = local(3)
        position_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)
        want = Wanted(
            local(3, 3), local(3), local(MAX_JOINTS), local(MAX_ROTORS), local(6, MAX_JOINTS)
        )
        if not fill_wanted(me, ref, est, body, model, kin, cmd, want):
            return  # not finite: the allocation handles the wrench as that of any law
        if is_free(me, est, cmd, want):
            for i in range(me.n):
                told.thrust[i] = want.thrust[i]
        else:
            told.limits = solve_task(me, est, body, cmd, want, told.thrust)
        told.given = 1.0 if told.limits < 2.5 else 0.0
