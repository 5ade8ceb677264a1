"""Quantities for samples only: joints, spring, normal force, power."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Integers, Record, Vec3
from skywright.core.types import MAX_JOINTS
from skywright.models.compliant_arms import is_compliant
from skywright.models.rotors import compute_power, compute_watt_per_n15
from skywright.vehicle.bus import MuJoCo, Reference, Truth
from skywright.vehicle.component import Component, Out, Output, Recorded, words
from skywright.vehicle.plant import SAMPLE_RATE, JointTruth, RotorState, Surface


class Samples(Component):
    """Fills JointTruth and Derived before a sample is recorded."""

    slot, side = "derive", "plant"

    class Me(Record):
        n: int
        qpos: Annotated[Integers, MAX_JOINTS]
        dof: Annotated[Integers, MAX_JOINTS]
        flex: Annotated[Integers, MAX_JOINTS]  # -1: no spring between shaft and link
        slider: int  # -1: no probe
        watt_per_n15: float
        avionics: float  # W

    class Derived(Output):
        spring: float  # m, compression of the probe's spring
        f_normal: float  # N, normal part of the force on the tip
        power: float  # W, electrical
        ref_normal_W: Vec3  # outward normal at the desired tip, zero in free flight

    columns = (
        Recorded("q", JointTruth, "q", "rad", "arm joints, output side", per="joint"),
        Recorded("qd", JointTruth, "qd", "rad/s", "arm joints, output side", per="joint"),
        Recorded("spring", Derived, "spring", "m", "compression of the probe's spring"),
        Recorded("f_normal", Derived, "f_normal", "N", "normal part of the contact force"),
        Recorded("power", Derived, "power", "W", "electrical, whole robot"),
        Recorded(
            "ref_normal_W", Derived, "ref_normal_W", "",
            "outward normal at the desired tip; zero in free flight",
        ),
    )  # fmt: skip

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints, and compute the power per thrust."""
        index, n, robot = context.scene.places, context.scene.n_joints, context.robot
        me.n, me.slider = n, index.slider_qpos
        me.qpos[:n], me.dof[:n], me.flex[:] = index.joint_qpos, index.joint_dof, -1
        if is_compliant(robot):
            me.flex[:n] = index.flex_qpos
        me.watt_per_n15 = compute_watt_per_n15(context.rotors, context.world.air_density_kg_m3)
        me.avionics = robot.battery.avionics_power_w

    def get_period(self, step: str, context: Any) -> float:
        """Once per sample."""
        return 1.0 / SAMPLE_RATE

    @staticmethod
    def step(
        me: Me,
        mj: MuJoCo,
        truth: Truth,
        ref: Reference,
        rotors: RotorState,
        surface: Surface,
        joints: Out[JointTruth],
        out: Out[Derived],
    ) -> None:
        qpos, qvel = words(mj.qpos, mj.nq), words(mj.qvel, mj.nv)
        for j in range(me.n):
            deflection = -qpos[me.flex[j]] if me.flex[j] >= 0 else 0.0
            joints.q[j] = qpos[me.qpos[j]] - deflection
            joints.qd[j] = qvel[me.dof[j]]
        out.spring = -qpos[me.slider] if me.slider >= 0 else 0.0
        pushing = 1.0 if ref.dead_zone > 0.0 else 0.0
        out.f_normal = 0.0
        for a in range(3):
            out.f_normal += surface.normal[a] * truth.f_contact[a]
            out.ref_normal_W[a] = pushing * ref.R_WS[a, 2]
        out.power = compute_power(rotors.thrust, rotors.n, me.watt_per_n15) + me.avionics

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has it."""
        yield cls("samples")
