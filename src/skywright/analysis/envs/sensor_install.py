"""SensorInstall: press a sensor on a pipe from below with a hand of a long, compliant arm.

This is the end of `sensor-install`, with the hand a few centimetres below the contact point. The
learner commands the velocity of the hand. Its force is estimated from the springs of the joints.
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
from skywright.core.record import Mat3, Vec3
from skywright.core.scratch import local
from skywright.core.types import TASK_VELOCITY
from skywright.description.world.surface import level_axes
from skywright.missions.sensor_install.fly import SEARCH
from skywright.missions.skills.moves import set_rest
from skywright.vehicle.arms.ports import HandForce, Hands, HandsReference, HandState
from skywright.vehicle.arms.truth import HandTruth
from skywright.vehicle.bus import Estimate, Reference
from skywright.vehicle.component import InOut, Out

SPEED = 0.04  # m/s, of the hand
EXCESS_N = 8.0  # N, four times the desired force
TOLERANCE = 0.15  # of the desired force
HOLD_S = 2.0  # s, for which the force must be within the tolerance
LOST_M = 0.12  # m, distance of the hand from the contact point


class LeadHand(Act):
    """Command a velocity of the hand."""

    signals = (
        Signal("towards", "m/s", SPEED, "along the inward normal of the pipe"),
        Signal("along", "m/s", SPEED, "along the pipe"),
        Signal("around", "m/s", SPEED, "across both"),
    )

    class Me(Act.Me):
        frame: Mat3  # columns: towards, along, around; in W
        task: float

    @staticmethod
    def step(
        me: Me, ref: InOut[Reference], hands: InOut[HandsReference], steered: Out[Steered]
    ) -> None:
        if me.on < 0.5:
            return
        hands.task[0] = me.task
        for i in range(3):
            hands.v_WH[0, i] = 0.0
            for j in range(3):
                hands.v_WH[0, i] += me.frame[i, j] * me.size[j] * me.action[j]
        for j in range(3):
            steered.values[j] = me.size[j] * me.action[j]


class SeeHand(Observe):
    """Observe estimated force and position of the hand, and the limits of the arm."""

    signals = (
        Signal("force error", "N", 1.0, "estimated from the springs, less what is asked for"),
        Signal("slow force error", "N", 1.0, "the same, low-passed over 0.3 s"),
        Signal("force along", "N", 1.0, "estimated, along the pipe"),
        Signal("force around", "N", 1.0, ""),
        Signal("hand towards", "m", 0.03, "estimated place, beyond the expected surface"),
        Signal("hand along", "m", 0.03, ""),
        Signal("hand around", "m", 0.03, ""),
        Signal("lead towards", "m", 0.03, "of the hand's reference before the estimated hand"),
        Signal("speed towards", "m/s", SPEED, "estimated"),
        Signal("speed along", "m/s", SPEED, ""),
        Signal("speed around", "m/s", SPEED, ""),
        Signal("lever", "m", 0.1, "of the arm in the direction of its task"),
        Signal("limited", "", 1.0, "1: a limit of angle or workspace holds the hand back"),
        Signal("platform towards", "m", 0.03, "estimated, from its reference"),
    )

    class Me(Observe.Me):
        frame: Mat3
        p_W: Vec3  # m, expected contact point
        force: float  # N, desired
        slow: float  # N

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, hands: Hands, state: HandState, felt: HandForce,
        seen: Out[Observation],
    ) -> None:  # fmt: skip
        axis, place, lead, off = local(3), local(3), local(3), local(3)
        for i in range(3):
            place[i] = hands.p_WH[0, i] - me.p_W[i]
            lead[i] = state.p_ref[0, i] - hands.p_WH[0, i]
            off[i] = est.p_WB[i] - ref.p_WB[i]
        for j in range(3):
            for i in range(3):
                axis[i] = me.frame[i, j]
            force = dot(felt.f_WH[0], axis)
            if j == 0:
                error = force - me.force
                me.slow = low_pass(me.slow, error, me.dt / 0.3)
                see(me, seen, 0, error)
                see(me, seen, 1, me.slow)
                see(me, seen, 7, dot(lead, axis))
                see(me, seen, 13, dot(off, axis))
            else:
                see(me, seen, 1 + j, force)
            see(me, seen, 4 + j, dot(place, axis))
            see(me, seen, 8 + j, dot(hands.v_WH[0], axis))
        see(me, seen, 11, state.lever[0])
        see(me, seen, 12, state.saturated[0])


class JudgeHand(Judge):
    """Reward a force near the desired one; without contact, a position near the contact point."""

    class Me(Judge.Me):
        frame: Mat3
        p_W: Vec3  # m, contact point, from the hand's reference at the start of the episode
        force: float  # N
        tolerance: float  # share of `force`
        hold: float  # s
        excess: float  # N
        lost: float  # m
        held: float  # s, current duration

    @staticmethod
    def step(me: Me, hands: HandTruth, judged: Out[Judgement]) -> None:
        up, off = local(3), local(3)
        for i in range(3):
            up[i] = me.frame[i, 0]
            off[i] = hands.p_WH[0, i] - me.p_W[i]
        force = dot(hands.f_WH[0], up)
        across = dot(hands.f_WH[0], hands.f_WH[0]) - force * force
        error = abs(force - me.force)
        away = dot(off, off) ** 0.5
        judged.ticks += 1.0
        judged.reward -= min(error / max(me.force, 1e-9), 2.0)
        judged.reward -= 0.2 * min(max(across, 0.0) ** 0.5 / max(me.force, 1e-9), 2.0)
        if force <= 0.0:
            judged.reward -= min(away / 0.05, 2.0)
        judged.values[0] += force
        judged.values[1] += error
        judged.values[2] += away
        me.held = me.held + me.dt if error < me.tolerance * me.force else 0.0
        if me.held > me.hold:
            judged.success = 1.0
        if away > me.lost:
            judged.ended = 1.0
        if force > me.excess:
            judged.ended = 2.0


class SensorInstall(ContactEnv):
    """Bring a hand into contact and hold a force: the long-reach dual arm below a pipe."""

    mission, phase = "sensor-install", "touch"
    sets = ("mission.record_raw=false",)
    spread_s, episode_s = (0.0, 2.0), 12.0
    act, observe, judge = LeadHand, SeeHand, JudgeHand
    reasons = ("", "hand away from its place", "force too high")
    values = (
        Signal("force_n", "N", 1.0, "true force of the hand along the normal"),
        Signal("force_error_n", "N", 1.0, "mean distance of it from what is asked for"),
        Signal("away_m", "m", 1.0, "true distance of the hand from its place"),
    )

    @classmethod
    def begin(cls, s: Any, setup: Any, plan: Any, act: Any, observe: Any, judge: Any) -> None:
        """Hold the platform; the hand rests until its first velocity command."""
        row, way = set_rest(s.vehicle.reference), plan.get_way()
        up = np.asarray(way.normal)  # the hand approaches from below, along the normal
        contact = np.array(row["p_WH"][0]) - SEARCH * up
        row["v_WH"][0] = 0.0
        s.body.track(row[None])
        true = setup.true.cylinder
        for part, cylinder in ((act, setup.cylinder), (observe, setup.cylinder), (judge, true)):
            _, along, towards = level_axes(cylinder.R_WP).T
            part.frame[:] = np.column_stack([towards, along, np.cross(towards, along)])
        act.task = TASK_VELOCITY
        observe.p_W[:] = judge.p_W[:] = contact
        observe.force = judge.force = float(s.task.force_n)
        felt = s.vehicle.look(HandForce).f_WH[0]
        observe.slow = float(felt @ observe.frame[:, 0]) - observe.force
        judge.tolerance, judge.hold, judge.excess = TOLERANCE, HOLD_S, EXCESS_N
        judge.lost = LOST_M
