"""The contact force on the docking feet."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Recorded, words
from skywright.vehicle.plant import Docking


class DockingObserver(Component):
    """Fills Docking from the feet's contact sensor."""

    slot, side = "observe", "plant"

    class Me(Record):
        force: int  # address in sensordata

    columns = (
        Recorded("f_docking_W", Docking, "f_W", "N", "of the structure on the docking feet"),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the sensor's address."""
        me.force = context.scene.places.sensor_docking

    @staticmethod
    def step(me: Me, mj: MuJoCo, docking: Out[Docking]) -> None:
        sensordata = words(mj.sensordata, mj.nsensor)
        for i in range(3):
            docking.f_W[i] = -sensordata[me.force + i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with docking gear have it."""
        if context.scene.places.sensor_docking >= 0:
            yield cls("docking")
