"""The nominal rigid body at the estimated joints, every tick."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import fill
from skywright.core.types import MAX_JOINTS
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.compliant_arms import is_compliant
from skywright.models.rigid_body import fill_body, fill_kinematics
from skywright.vehicle.bus import Body, Estimate
from skywright.vehicle.component import Component, Out
from skywright.vehicle.readings import Shafts


class JointAngles(Component):
    """Copies the joint angles and rates from the encoders (arms without springs)."""

    slot = "body"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Arms with springs have their own estimate."""
        if not is_compliant(context.robot):
            yield cls("joints")

    @staticmethod
    def step(shafts: Shafts, est: Out[Estimate]) -> None:
        for j in range(MAX_JOINTS):
            est.q[j], est.qd[j] = shafts.q[j], shafts.qd[j]


class NominalBody(Component):
    """Fills the link tree and the composite body of the nominal model."""

    slot = "body"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has one."""
        yield cls("body")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Copy the nominal model; the attitude is identity until the first tick."""
        fill(context.records[BodyModel, ""][0], context.model)
        body, est = context.records[Body, ""][0], context.records[Estimate, ""][0]
        body["mass"], body["gravity"] = context.mass, context.world.gravity_mps2
        est["R_WB"] = est["R_WT"] = np.eye(3)

    @staticmethod
    def step(model: Out[BodyModel], kin: Out[Kinematics], est: Estimate, body: Out[Body]) -> None:
        fill_kinematics(model, est.q, kin)
        fill_body(model, kin, body)
