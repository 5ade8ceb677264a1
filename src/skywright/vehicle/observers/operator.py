"""What the operator does at a stick, for the recording."""

from __future__ import annotations

from typing import Any

from skywright.core.record import Record, Vec3
from skywright.vehicle.component import Component, Out, Output, Recorded
from skywright.vehicle.plant import SAMPLE_RATE


class Stick(Output):
    """The operator's input."""

    stick: Vec3  # each axis from -1 to 1
    button: float  # 1: pressed


class Operator(Component):
    """Fills Stick from what the mission was told last."""

    slot, side = "derive", "plant"

    class Me(Record):
        stick: Vec3
        button: float

    columns = (
        Recorded("operator_stick", Stick, "stick", "", "each axis from -1 to 1"),
        Recorded("operator_button", Stick, "button", "", "1: pressed"),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initially the stick is centred."""
        self._me = me

    def get_period(self, step: str, context: Any) -> float:
        """Once a sample."""
        return 1.0 / SAMPLE_RATE

    def set(self, stick: Any, button: bool) -> None:
        """Note the input (3,) and the button from now on."""
        self._me.stick[:], self._me.button = stick, float(button)

    @staticmethod
    def step(me: Me, out: Out[Stick]) -> None:
        for a in range(3):
            out.stick[a] = me.stick[a]
        out.button = me.button
