"""Double-sided tape on a hand: pressing builds up a bond, pulling breaks it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record, Vec3
from skywright.description.world.things import find_first
from skywright.models.compliant_arms import is_compliant
from skywright.models.things.tape import Tape as TapeThing
from skywright.vehicle.arms.truth import HandTruth, TapePull
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Component, Effect, Out, table

TOUCH = 0.02  # N, force above which the tape is pressed


class Tape(Effect):
    """Advances the bond and pulls the hand along the direction of pressing."""

    class Me(Record):
        hand: int
        body: int
        strength: float
        press: float  # N s
        release: float  # N
        stiffness: float  # N/m
        impulse: float  # N s, impulse of pressing so far
        bond: float  # N
        anchor_W: Vec3  # m, position of the hand when it last pressed
        parted: int  # 1: the holder released, the sensor stays attached; 2: the bond broke

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with a tape have this effect if the robot has that hand."""
        tape = find_first(context.world.things, TapeThing)
        if tape is not None and is_compliant(context.robot):
            bodies, hand = context.scene.places.hand_bodies, int(tape.hand == "right")
            if hand < len(bodies) and bodies[hand] >= 0:
                yield cls("tape", tape)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the data of the tape."""
        me.hand = int(table.hand == "right")
        me.body = context.scene.places.hand_bodies[me.hand]
        me.strength, me.press = table.strength_n, table.press_n_s
        me.release, me.stiffness = table.release_n, table.stiffness_n_per_m
        context.records[TapePull, ""]["hand"] = me.hand

    @staticmethod
    def step(me: Me, clock: Clock, hands: HandTruth, mj: MuJoCo, out: Out[TapePull]) -> None:
        xfrc = table(mj.xfrc, mj.nbody, 6)
        p_WH, f_WH = hands.p_WH[me.hand], hands.f_WH[me.hand]
        if me.bond == 0.0:
            force = math.sqrt(f_WH[0] ** 2 + f_WH[1] ** 2 + f_WH[2] ** 2)
        else:  # only compression along the normal counts as pressing
            force = 0.0
            for a in range(3):
                force += f_WH[a] * out.normal_W[a]
        out.pull = 0.0
        if me.parted == 0 and force > TOUCH:
            me.impulse += force * clock.dt
            me.bond = me.strength * (1.0 - math.exp(-me.impulse / me.press))
            size = math.sqrt(f_WH[0] ** 2 + f_WH[1] ** 2 + f_WH[2] ** 2)
            for a in range(3):
                me.anchor_W[a] = p_WH[a]
                out.normal_W[a] = f_WH[a] / size
        elif me.parted == 0 and me.bond > 0.0:
            back = 0.0
            for a in range(3):
                back += (me.anchor_W[a] - p_WH[a]) * out.normal_W[a]
            out.pull = me.stiffness * max(back, 0.0)
            if out.pull > min(me.bond, me.release):
                me.parted = 1 if me.bond >= me.release else 2
                out.pull = 0.0
        for a in range(3):
            xfrc[me.body, a] += out.pull * out.normal_W[a]
