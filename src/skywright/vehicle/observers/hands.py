"""Poses and contact forces of the hands of compliant arms."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Integers, Record
from skywright.core.types import MAX_HANDS
from skywright.description.robot.limbs import SIDES
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.arms.truth import HandTruth, TapePull
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Recorded, table, words


class HandObserver(Component):
    """Fills HandTruth; forces are one physics step old. A tape's tension counts as a force."""

    slot, side = "observe", "plant"

    class Me(Record):
        n: int
        site: Annotated[Integers, MAX_HANDS]
        force: Annotated[Integers, MAX_HANDS]  # address of the contact sensor, -1: none

    columns = tuple(
        column
        for h, side in enumerate(SIDES)
        for column in (
            Recorded(f"{side}_p_WH", HandTruth, "p_WH", "m", f"{side} hand", item=h, per="hand"),
            Recorded(
                f"{side}_q_WH", HandTruth, "R_WH", "", f"{side} hand, attitude", rotation=True,
                item=h, per="hand",
            ),
            Recorded(
                f"{side}_f_W", HandTruth, "f_WH", "N",
                f"force that the {side} hand exerts on what it touches", item=h, per="hand",
            ),
        )
    )  # fmt: skip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with compliant arms have it."""
        if is_compliant(context.robot):
            yield cls("hand truth")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up addresses in the scene."""
        index = context.scene.places
        me.n = len(index.hand_sites)
        me.site[: me.n] = index.hand_sites
        me.force[:] = -1
        me.force[: me.n] = index.sensor_hand_force

    @staticmethod
    def step(me: Me, mj: MuJoCo, tape: TapePull | None, out: Out[HandTruth]) -> None:
        sensordata = words(mj.sensordata, mj.nsensor)
        xpos, xmat = table(mj.site_xpos, mj.nsite, 3), table(mj.site_xmat, mj.nsite, 9)
        for h in range(me.n):
            for i in range(3):
                out.p_WH[h, i] = xpos[me.site[h], i]
                out.f_WH[h, i] = sensordata[me.force[h] + i] if me.force[h] >= 0 else 0.0
                for j in range(3):
                    out.R_WH[h, i, j] = xmat[me.site[h], 3 * i + j]
        if tape is not None:
            for i in range(3):
                out.f_WH[tape.hand, i] -= tape.pull * tape.normal_W[i]
