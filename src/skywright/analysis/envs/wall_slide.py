"""WallSlide: slide a probe along a wall in flight, fast and without losing contact.

This is the slide of `wall-contact`. The learner commands the speed of the platform along the wall
and the force of the arm (law `backstepping`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.analysis.envs.env import ContactEnv
from skywright.analysis.envs.parts import (
    Act,
    Judge,
    Judgement,
    Observation,
    Observe,
    Signal,
    Steered,
    dot,
    low_pass,
    see,
)
from skywright.core.record import Vec3
from skywright.missions.skills.moves import set_rest
from skywright.vehicle.bus import Estimate, Reference, Truth
from skywright.vehicle.component import InOut, Out
from skywright.vehicle.follower import Press
from skywright.vehicle.plant import Surface

SPEED = 0.1  # m/s, twice the speed of the mission
ACCELERATION = 0.2  # m/s^2, of the platform along the wall
FORCE_RANGE = 0.8  # share of the desired force that the learner may add or subtract
LOST_S = 0.5  # s without contact
EXCESS_N = 6.0  # N


class SlideAndPress(Act):
    """Command a speed along the wall with bounded acceleration, and a rate of force."""

    signals = (
        Signal("speed", "m/s", SPEED, "wanted along the way; backwards where it is negative"),
        Signal("rate of force", "N/s", 4.0, "added to the asked force"),
    )

    class Me(Act.Me):
        way: Vec3  # unit, in W
        length: float  # m
        most: float  # N, maximum of |push|
        least: float  # N, minimum desired force
        acceleration: float  # m/s^2
        v: float  # m/s, current speed
        s: float  # m
        push: float  # N

    @staticmethod
    def step(me: Me, ref: InOut[Reference], press: InOut[Press], steered: Out[Steered]) -> None:
        if me.on < 0.5:
            return
        change = me.size[0] * me.action[0] - me.v
        most = me.acceleration * me.dt
        me.v += min(max(change, -most), most)
        me.s += me.dt * me.v
        if me.s < 0.0 or me.s > me.length:  # ends of the path
            me.s = min(max(me.s, 0.0), me.length)
            me.v = 0.0
        me.push += me.dt * me.size[1] * me.action[1]
        me.push = min(max(me.push, -me.most), me.most)
        for i in range(3):
            ref.p_WB[i] += me.s * me.way[i]
            ref.p_WT[i] += me.s * me.way[i]
            ref.v_WB[i] = me.v * me.way[i]
            ref.v_WT[i] = me.v * me.way[i]
        press.force = max(press.force + me.push, me.least)
        steered.values[0], steered.values[1], steered.values[2] = me.s, me.v, me.push


class SeeSlide(Observe):
    """Observe measured force, remaining path, and motion of tip and platform."""

    signals = (
        Signal("force error", "N", 1.0, "measured, less what is asked for"),
        Signal("slow force error", "N", 1.0, "the same, low-passed over 0.2 s"),
        Signal("push", "N", 1.0, "what the action has added by now"),
        Signal("speed", "m/s", SPEED, "desired, along the way"),
        Signal("way left", "m", 0.1, "of the desired platform"),
        Signal("lag", "m", 0.02, "of the estimated platform behind the desired one, along the way"),
        Signal("platform speed", "m/s", SPEED, "estimated, along the way"),
        Signal("tip speed", "m/s", SPEED, "estimated, along the way"),
        Signal("tip speed out", "m/s", 0.05, "estimated, along the probe, out of the wall"),
        Signal("drag", "N", 2.0, "estimated external force along the way: friction and wind"),
    )

    class Me(Observe.Me):
        way: Vec3
        length: float  # m
        force: float  # N, desired
        slow: float  # N

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, steered: Steered, seen: Out[Observation]
    ) -> None:
        error = est.f_tip - me.force
        me.slow = low_pass(me.slow, error, me.dt / 0.2)
        lag = out = 0.0
        for i in range(3):
            lag += me.way[i] * (ref.p_WB[i] - est.p_WB[i])
            out -= est.R_WT[i, 2] * est.v_WT[i]
        see(me, seen, 0, error)
        see(me, seen, 1, me.slow)
        see(me, seen, 2, steered.values[2])
        see(me, seen, 3, steered.values[1])
        see(me, seen, 4, me.length - steered.values[0])
        see(me, seen, 5, lag)
        see(me, seen, 6, dot(est.v_WB, me.way))
        see(me, seen, 7, dot(est.v_WT, me.way))
        see(me, seen, 8, out)
        see(me, seen, 9, dot(est.f_ext_W, me.way))


class JudgeSlide(Judge):
    """Reward progress of the tip in contact; penalize the force error."""

    class Me(Judge.Me):
        on: float  # 1: `last` and `begin` are set; WallSlide.begin clears it
        way: Vec3
        speed: float  # m/s, at which a step earns 1
        length: float  # m
        force: float  # N, desired
        excess: float  # N
        patience: float  # s
        off: float  # s, current duration without contact
        last: float  # m, position of the tip along the path
        begin: float  # m

    @staticmethod
    def step(me: Me, truth: Truth, surface: Surface, judged: Out[Judgement]) -> None:
        force = dot(truth.f_contact, surface.normal)
        error = abs(force - me.force)
        place = dot(truth.p_WT, me.way)
        if me.on < 0.5:
            me.on, me.last, me.begin = 1.0, place, place
        touches = 1.0 if force > 0.0 else 0.0
        me.off = 0.0 if force > 0.0 else me.off + me.dt
        come = (place - me.last) / (me.speed * me.dt) if me.speed > 0.0 else 0.0
        me.last = place
        judged.ticks += 1.0
        judged.reward += touches * come - 0.5 * min(error / max(me.force, 1e-9), 2.0)
        judged.values[0] += force
        judged.values[1] += error
        judged.values[2] += touches
        judged.values[3] += place - me.begin
        if me.off > me.patience:
            judged.ended = 1.0
        if force > me.excess:
            judged.ended = 2.0
        if place - me.begin > me.length:
            judged.success = 1.0


class WallSlide(ContactEnv):
    """Slide along a wall under force: the F550 with its arm in the tunnel."""

    mission, phase = "wall-contact", "slide"
    sets = ("mission.record_raw=false",)
    spread_s, episode_s = (0.2, 1.5), 10.0
    act, observe, judge = SlideAndPress, SeeSlide, JudgeSlide
    reasons = ("", "contact lost", "force too high")
    values = (
        Signal("force_n", "N", 1.0, "true normal force of the tip"),
        Signal("force_error_n", "N", 1.0, "mean distance of it from what is asked for"),
        Signal("touches", "", 1.0, "share of the time with a force"),
        Signal("way_m", "m", 1.0, "that the tip has come since the episode began"),
    )

    @classmethod
    def begin(cls, s: Any, setup: Any, plan: Any, act: Any, observe: Any, judge: Any) -> None:
        """Hold the first point of the slide; the path is the mission's, and the way of the tip is
        measured from its position after this call."""
        table, _ = s.vehicle.tracking
        way = table["p_WB"][-1] - table["p_WB"][0]
        length = float(np.linalg.norm(way))
        s.body.track(set_rest(table[0])[None])
        force = float(table["force"][0])
        for part in (act, observe, judge):
            part.way[:], part.length = way / length, length
        observe.force = judge.force = force
        observe.slow -= force  # until now the filter ran with a desired force of zero
        act.most, act.least, act.acceleration = FORCE_RANGE * force, 0.1 * force, ACCELERATION
        judge.speed, judge.excess, judge.patience = SPEED, EXCESS_N, LOST_S
        judge.length = 0.98 * length  # the tip may stop slightly behind the platform
        judge.on = 0.0  # the judge has run since take-off, without a way
