"""WeldPress: hold the force of a probe that slides along a pipe, in wind and gusts.

The scan of `pipe-weld-scan` continues; the learner changes the force of the law. The law is the
paper's impedance (Tognon 2018, law (4)): with the desired tip at depth d inside the surface it
presses with m wn^2 d. An additional force is therefore an offset of the desired tip along the
normal.
"""

from __future__ import annotations

from typing import Any

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
from skywright.core.scratch import local
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT
from skywright.vehicle.bus import Body, Estimate, Reference, Truth
from skywright.vehicle.component import InOut, Out
from skywright.vehicle.follower import Press
from skywright.vehicle.plant import Surface

PUSH_MAX = 3.0
"""N, maximum force that the learner may add or subtract."""
LOST_S = 0.5  # s without contact, after which the mission backs off as well
EXCESS_N = 7.8  # N, end of the soft range of the probe's sensor


class PushMore(Act):
    """Integrate a rate of force to an offset of the desired tip and of the desired force."""

    signals = (Signal("rate of force", "N/s", 8.0, "added to what the scan presses with"),)

    class Me(Act.Me):
        push: float  # N, current value
        most: float  # N
        wn: float  # rad/s, of the position loop

    @staticmethod
    def step(
        me: Me, body: Body, ref: InOut[Reference], press: InOut[Press], steered: Out[Steered]
    ) -> None:
        if me.on < 0.5:
            return
        me.push += me.dt * me.size[0] * me.action[0]
        me.push = min(max(me.push, -me.most), me.most)
        deeper = me.push / (body.mass * me.wn * me.wn)
        for i in range(3):
            ref.p_WT[i] -= deeper * ref.R_WS[i, 2]
        ref.dead_zone += abs(deeper)  # still in contact: keeps the integral off along the normal
        press.force = max(press.force + me.push, 0.0)
        steered.values[0] = me.push


class SeeContact(Observe):
    """Observe the measured force and the motion of the tip along the normal."""

    signals = (
        Signal("force error", "N", 1.0, "measured by the probe's sensor, less what is asked for"),
        Signal("slow force error", "N", 1.0, "the same, low-passed over 0.2 s"),
        Signal("push", "N", 3.0, "what the action has added by now"),
        Signal("tip speed out", "m/s", 0.05, "estimated, along the normal"),
        Signal("platform speed out", "m/s", 0.05, "estimated, along the normal"),
        Signal("depth", "m", 0.05, "of the desired tip below the estimated one"),
        Signal("external force out", "N", 3.0, "estimated from motion: contact and wind"),
        Signal("sliding speed", "m/s", 0.02, "of the desired tip"),
    )

    class Me(Observe.Me):
        force: float  # N, desired
        slow: float  # N

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, steered: Steered, seen: Out[Observation]
    ) -> None:
        n, e = local(3), local(3)
        for i in range(3):
            n[i] = ref.R_WS[i, 2]
            e[i] = est.p_WT[i] - ref.p_WT[i]
        error = est.f_tip - me.force
        me.slow = low_pass(me.slow, error, me.dt / 0.2)
        see(me, seen, 0, error)
        see(me, seen, 1, me.slow)
        see(me, seen, 2, steered.values[0])
        see(me, seen, 3, dot(est.v_WT, n))
        see(me, seen, 4, dot(est.v_WB, n))
        see(me, seen, 5, dot(e, n))
        see(me, seen, 6, dot(est.f_ext_W, n))
        see(me, seen, 7, dot(ref.v_WT, ref.v_WT) ** 0.5)


class JudgeContact(Judge):
    """Reward a tip pose at which a reading counts; penalize the force error."""

    class Me(Judge.Me):
        force: float  # N, desired
        excess: float  # N
        gap: float  # m
        tilt: float  # rad
        patience: float  # s
        off: float  # s, current duration without contact

    @staticmethod
    def step(me: Me, truth: Truth, surface: Surface, judged: Out[Judgement]) -> None:
        force = dot(truth.f_contact, surface.normal)
        error = abs(force - me.force)
        reads = 1.0 if surface.gap < me.gap and surface.tilt < me.tilt else 0.0
        me.off = 0.0 if force > 0.0 else me.off + me.dt
        judged.ticks += 1.0
        judged.reward += reads - min(error / max(me.force, 1e-9), 2.0)
        judged.values[0] += force
        judged.values[1] += error
        judged.values[2] += reads
        if me.off > me.patience:
            judged.ended = 1.0
        if force > me.excess:
            judged.ended = 2.0


class WeldPress(ContactEnv):
    """Hold the force of a sliding probe: the OTHex with a force sensor on a pipe."""

    mission, robot, phase = "pipe-weld-scan", "othex-force", "scan"
    sets = ("mission.law=push_and_slide", "mission.record_raw=false")
    spread_s, episode_s, has_goal = (1.0, 6.0), 6.0, False
    act, observe, judge = PushMore, SeeContact, JudgeContact
    reasons = ("", "contact lost", "force too high")
    values = (
        Signal("force_n", "N", 1.0, "true normal force of the tip"),
        Signal("force_error_n", "N", 1.0, "mean distance of it from what is asked for"),
        Signal("reads", "", 1.0, "share of the time at which a reading counts"),
    )

    @classmethod
    def begin(cls, s: Any, setup: Any, plan: Any, act: Any, observe: Any, judge: Any) -> None:
        """Continue the scan of the mission."""
        force = float(plan.get_way().push_force_n)
        act.most, act.wn = PUSH_MAX, setup.robot.control.position_bandwidth_rad_s
        observe.force = judge.force = force
        judge.excess, judge.patience = EXCESS_N, LOST_S
        judge.gap, judge.tilt = GAP_LIMIT, TILT_LIMIT
