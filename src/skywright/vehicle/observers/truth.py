"""The state of platform and tip, read from MuJoCo at the start of a control tick."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Integers, Record
from skywright.core.rotations import quat_to_rot
from skywright.vehicle.bus import Clock, MuJoCo, Truth
from skywright.vehicle.component import Component, InOut, Out, Recorded, table, words
from skywright.vehicle.guard import COLLISION
from skywright.vehicle.plant import SAMPLE_RATE

MAX_CONTACTS = 16
COLLISION_LIMIT = 0.5
"""N, of an unintended contact that ends a mission tick."""


class TruthObserver(Component):
    """Fills Truth and guards against collisions. Tip and forces are one physics step old."""

    side = "plant"
    slots = {"step": "observe", "judge": "peaks"}

    class Me(Record):
        tip_site: int  # -1: no tip
        tip_force: int  # address of its contact sensor, -1: none
        n_contacts: int
        dt: float  # s, control period
        off: float  # s, since the last force on the tip
        contact: Annotated[Integers, MAX_CONTACTS]  # addresses of unintended contacts

    columns = (
        Recorded("p_WB", Truth, "p_WB", "m", "platform"),
        Recorded("q_WB", Truth, "R_WB", "", "platform, attitude", rotation=True),
        Recorded("v_WB", Truth, "v_WB", "m/s", "of the platform, in W"),
        Recorded("w_WB_B", Truth, "w_WB_B", "rad/s", "of the platform, in B"),
        Recorded("p_WT", Truth, "p_WT", "m", "probe's tip, z out of the robot"),
        Recorded("q_WT", Truth, "R_WT", "", "probe's tip, attitude", rotation=True),
        Recorded("f_contact", Truth, "f_contact", "N", "force of the surface on the tip, in W"),
        Recorded("off_s", Truth, "off_s", "s", "longest time without force on the tip by now"),
        Recorded(
            "f_collision",
            Truth,
            "f_collision",
            "N",
            "largest unintended force of a sample",
        ),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up addresses in the scene."""
        index = context.scene.places
        me.tip_site, me.tip_force = index.tip_site, index.sensor_tip_force
        me.n_contacts = len(index.sensor_collision)
        me.contact[: me.n_contacts] = index.sensor_collision
        me.dt = context.dt

    def get_period(self, step: str, context: Any) -> float:
        """Peaks are reset once per sample."""
        return 1.0 / SAMPLE_RATE if step == "judge" else 0.0

    @staticmethod
    def step(me: Me, mj: MuJoCo, truth: Out[Truth]) -> None:
        qpos, qvel = words(mj.qpos, mj.nq), words(mj.qvel, mj.nv)
        sensordata = words(mj.sensordata, mj.nsensor)
        for i in range(3):
            truth.p_WB[i] = qpos[i]
            truth.v_WB[i] = qvel[i]
            truth.w_WB_B[i] = qvel[3 + i]
        quat_to_rot(qpos[3:7], truth.R_WB)
        if me.tip_site < 0:
            for i in range(3):
                truth.p_WT[i] = truth.p_WB[i]
                for j in range(3):
                    truth.R_WT[i, j] = truth.R_WB[i, j]
        else:
            xpos, xmat = table(mj.site_xpos, mj.nsite, 3), table(mj.site_xmat, mj.nsite, 9)
            for i in range(3):
                truth.p_WT[i] = xpos[me.tip_site, i]
                for j in range(3):
                    truth.R_WT[i, j] = xmat[me.tip_site, 3 * i + j]
        if me.tip_force >= 0:
            for i in range(3):  # MuJoCo: force of the tip on the surface
                truth.f_contact[i] = -sensordata[me.tip_force + i]
            tip = truth.f_contact
            off = tip[0] == 0.0 and tip[1] == 0.0 and tip[2] == 0.0
            me.off = me.off + me.dt if off else 0.0
            truth.off_s = max(truth.off_s, me.off)
        for k in range(me.n_contacts):
            a = me.contact[k]
            f = math.sqrt(sensordata[a] ** 2 + sensordata[a + 1] ** 2 + sensordata[a + 2] ** 2)
            truth.f_collision = max(truth.f_collision, f)

    @staticmethod
    def judge(me: Me, clock: InOut[Clock], truth: InOut[Truth]) -> None:
        if truth.f_collision > COLLISION_LIMIT:
            clock.fired |= clock.mask & COLLISION
        truth.f_collision = truth.off_s = 0.0

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has it."""
        yield cls("truth")
