"""Shaft angles and spring deflections of compliant joints, for the recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.arms.truth import SpringTruth
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Recorded, words
from skywright.vehicle.plant import SAMPLE_RATE


class SpringObserver(Component):
    """Fills SpringTruth before a sample is recorded."""

    slot, side = "derive", "plant"

    class Me(Record):
        n: int
        qpos: Annotated[Integers, MAX_JOINTS]
        flex: Annotated[Integers, MAX_JOINTS]  # -1: rigid

    columns = (
        Recorded("theta", SpringTruth, "theta", "rad", "servo shafts", per="joint"),
        Recorded("deflection", SpringTruth, "deflection", "rad", "theta less q", per="joint"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with compliant arms have it."""
        if is_compliant(context.robot):
            yield cls("springs")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up addresses in the scene."""
        index, me.n = context.scene.places, context.scene.n_joints
        me.qpos[: me.n], me.flex[: me.n] = index.joint_qpos, index.flex_qpos

    def get_period(self, step: str, context: Any) -> float:
        """Once per sample."""
        return 1.0 / SAMPLE_RATE

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: Out[SpringTruth]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for j in range(me.n):
            out.theta[j] = qpos[me.qpos[j]]
            out.deflection[j] = -qpos[me.flex[j]] if me.flex[j] >= 0 else 0.0
