"""PegInHole: insert the peg below a bar, which hangs in both hooks, into a hole in flight.

This is the end of `bar-insertion`, with the bar above the socket. The learner commands the velocity
of the platform and the rate at which the hands release the bar's weight. Motion capture measures
the poses of peg and hole to one millimetre.
"""

from __future__ import annotations

import math
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
    low_pass,
    see,
)
from skywright.core.record import Mat3, Vec3
from skywright.core.rotations import mat_t_mat, mat_t_vec, mat_vec, quat_to_rot
from skywright.core.scratch import local
from skywright.description.world.things import list_movers, locate_thing
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.tool_pose import find_marker
from skywright.models.deviation import build_socket_error
from skywright.models.things._build import find_offsets
from skywright.models.things.peg import Peg
from skywright.vehicle.arms.ports import HandsReference, Marker
from skywright.vehicle.arms.truth import HandTruth
from skywright.vehicle.bus import Estimate, Reference
from skywright.vehicle.component import InOut, Out
from skywright.vehicle.observers.objects import Objects

SPEED, ACCELERATION = 0.04, 0.2  # m/s and m/s^2, of the platform; the speed is the mission's
ASIDE, ABOVE, BELOW = 0.06, 0.06, 0.2  # m, limits of the platform's displacement
EXCESS_N = 20.0  # N, maximum force of the socket on the peg
LOST_ANGLE = math.radians(15.0)  # tilt beyond which the bar has left the hooks
LOST_M = 0.3  # m, horizontal distance of the peg's end from the hole beyond which the bar is lost
SEATED = 0.95  # insertion depth for success, as a share of the peg's length
SEATED_S = 0.2  # s, for which the depth must be exceeded
WATCH_TICKS = 50
"""Mission ticks over which the external force is averaged, to find its value without the bar."""


class LeadBar(Act):
    """Command the platform's velocity and the rate at which the hands release the weight."""

    signals = (
        Signal("forward", "m/s", SPEED, "along x of the socket"),
        Signal("left", "m/s", SPEED, "along y of the socket, along the bar"),
        Signal("up", "m/s", SPEED, ""),
        Signal("let go", "1/s", 1.0, "share of the bar's weight that is fed forward no more"),
    )

    class Me(Act.Me):
        R_WS: Mat3
        acceleration: float  # m/s^2
        low: Vec3  # m
        high: Vec3
        p: Vec3  # m, displacement since the start of the episode, in S
        v: Vec3  # m/s
        share: float  # share of the weight that is released

    @staticmethod
    def step(
        me: Me, ref: InOut[Reference], hands: InOut[HandsReference], steered: Out[Steered]
    ) -> None:
        if me.on < 0.5:
            return
        p_W, v_W, most = local(3), local(3), me.acceleration * me.dt
        for i in range(3):
            me.v[i] += min(max(me.size[i] * me.action[i] - me.v[i], -most), most)
            wanted = me.p[i] + me.dt * me.v[i]
            me.p[i] = min(max(wanted, me.low[i]), me.high[i])
            if me.p[i] != wanted:
                me.v[i] = 0.0
        mat_vec(me.R_WS, me.p, p_W)
        mat_vec(me.R_WS, me.v, v_W)
        for i in range(3):
            ref.p_WB[i] += p_W[i]
            ref.v_WB[i] = v_W[i]
        me.share = min(max(me.share + me.dt * me.size[3] * me.action[3], 0.0), 1.0)
        hands.load[0] *= 1.0 - me.share
        hands.load[1] *= 1.0 - me.share
        steered.values[0] = me.share


class SeePeg(Observe):
    """Observe peg relative to hole by motion capture, the estimated weight, and the platform."""

    signals = (
        Signal("peg forward", "m", 0.01, "end of the peg from the hole, along x of the socket"),
        Signal("peg left", "m", 0.01, "along y"),
        Signal("peg up", "m", 0.03, "along z: negative inside"),
        Signal("tilt forward", "rad", 0.1, "of the bar against the hole"),
        Signal("tilt left", "rad", 0.1, ""),
        Signal("turn", "rad", 0.1, "of the bar about the hole's axis"),
        Signal("platform forward", "m/s", SPEED, "estimated velocity, along x of the socket"),
        Signal("platform left", "m/s", SPEED, ""),
        Signal("platform up", "m/s", SPEED, ""),
        Signal("lag forward", "m", 0.01, "of the estimated platform behind the desired one"),
        Signal("lag left", "m", 0.01, ""),
        Signal("lag up", "m", 0.01, ""),
        Signal("weight", "", 1.0, "share of the bar's weight that the hands carry, as felt"),
        Signal("let go", "", 1.0, "share that is fed forward no more"),
    )

    class Me(Observe.Me):
        p_WS: Vec3  # m, surveyed position of the hole
        R_WS: Mat3
        p_OM: Vec3  # m, marker on the bar
        R_OM: Mat3
        tip: Vec3  # m, end of the peg, in O
        zero: float  # N, upward external force without the bar
        weight: float  # N
        felt: float  # N

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, marker: Marker, steered: Steered,
        seen: Out[Observation],
    ) -> None:  # fmt: skip
        R_MO, R_WO, R_SO, e, arm, e_S = (
            local(3, 3), local(3, 3), local(3, 3), local(3), local(3), local(3)
        )  # fmt: skip
        for i in range(3):
            for j in range(3):
                R_MO[i, j] = me.R_OM[j, i]
        for i in range(3):
            for j in range(3):
                R_WO[i, j] = 0.0
                for k in range(3):
                    R_WO[i, j] += marker.R_WO[i, k] * R_MO[k, j]
        for i in range(3):
            arm[i] = me.tip[i] - me.p_OM[i]
        mat_vec(R_WO, arm, e)
        for i in range(3):
            e[i] += marker.p_WO[i] - me.p_WS[i]
        mat_t_vec(me.R_WS, e, e_S)
        mat_t_mat(me.R_WS, R_WO, R_SO)
        for i in range(3):
            see(me, seen, i, e_S[i])
        see(me, seen, 3, R_SO[0, 2])
        see(me, seen, 4, R_SO[1, 2])
        see(me, seen, 5, math.atan2(-R_SO[0, 1], R_SO[1, 1]))
        mat_t_vec(me.R_WS, est.v_WB, e)
        for i in range(3):
            see(me, seen, 6 + i, e[i])
            arm[i] = ref.p_WB[i] - est.p_WB[i]
        mat_t_vec(me.R_WS, arm, e)
        for i in range(3):
            see(me, seen, 9 + i, e[i])
        me.felt = low_pass(me.felt, me.zero - est.f_ext_W[2], me.dt / 0.4)
        see(me, seen, 12, me.felt / max(me.weight, 1e-9))
        see(me, seen, 13, steered.values[0])


class JudgePeg(Judge):
    """Reward true depth in the hole; penalize lateral distance and force."""

    class Me(Judge.Me):
        bar: int  # index among the movable things
        p_WS: Vec3  # m, true position of the hole
        R_WS: Mat3
        length: float  # m, of the peg
        weight: float  # N
        excess: float  # N
        lost_m: float
        upright: float  # cosine of the maximum tilt of the bar
        seated: float  # m
        seated_s: float  # s
        inside: float  # s, current duration

    @staticmethod
    def step(me: Me, things: Objects, hands: HandTruth, judged: Out[Judgement]) -> None:
        R, e, e_S = local(3, 3), local(3), local(3)
        quat_to_rot(things.q_WO[me.bar], R)
        for i in range(3):
            e[i] = things.p_WO[me.bar, i] - me.length * R[i, 2] - me.p_WS[i]
        mat_t_vec(me.R_WS, e, e_S)
        force = 0.0
        for i in range(3):
            f = hands.f_WH[0, i] + hands.f_WH[1, i] - (me.weight if i == 2 else 0.0)
            force += f * f
        force = math.sqrt(force)
        aside, depth = math.sqrt(e_S[0] ** 2 + e_S[1] ** 2), -e_S[2]
        judged.ticks += 1.0
        deep = min(max(depth / max(me.length, 1e-9), -0.5), 1.0)
        judged.reward += deep - 0.2 * min(aside / 0.01, 3.0)
        judged.reward -= 0.1 * min(max(force / max(me.weight, 1e-9) - 1.0, 0.0), 5.0)
        judged.values[0] += depth
        judged.values[1] += aside
        judged.values[2] += force
        me.inside = me.inside + me.dt if depth > me.seated else 0.0
        if me.inside > me.seated_s:
            judged.success = 1.0
        if R[2, 2] < me.upright or aside > me.lost_m:
            judged.ended = 1.0
        if force > me.excess:
            judged.ended = 2.0


class PegInHole(ContactEnv):
    """Insert a peg, 2 mm narrower than its hole, from above the socket."""

    mission, phase = "bar-insertion", "align"
    sets = ("mission.record_raw=false",)
    spread_s, episode_s = (0.0, 2.0), 20.0
    act, observe, judge = LeadBar, SeePeg, JudgePeg
    reasons = ("", "bar lost", "force too high")
    values = (
        Signal("depth_m", "m", 1.0, "true depth of the peg's end below the opening"),
        Signal("aside_m", "m", 1.0, "true distance of it from the hole's axis"),
        Signal("force_n", "N", 1.0, "true force on the socket, inertia left out"),
    )

    @classmethod
    def begin(cls, s: Any, setup: Any, plan: Any, act: Any, observe: Any, judge: Any) -> None:
        """Hold the bar at rest and measure the external force with its weight."""
        vehicle, d = s.vehicle, setup.description
        row = set_rest(vehicle.reference)
        s.body.track(row[None])
        seen = []
        for _ in range(WATCH_TICKS):
            vehicle.tick()
            seen.append(float(vehicle.estimate["f_ext_W"][2]))
        weight = float(np.sum(row["load"][:2]))
        p_WS, R_WS = vehicle.devices.surveyor.survey(s.task.socket)
        marker, peg = find_marker(vehicle.world), d.world.find_thing(s.task.bar, Peg)
        act.R_WS[:], act.acceleration = R_WS, ACCELERATION
        act.low[:], act.high[:] = [-ASIDE, -ASIDE, -BELOW], [ASIDE, ASIDE, ABOVE]
        observe.p_WS[:], observe.R_WS[:] = p_WS, R_WS
        observe.p_OM[:], observe.R_OM[:] = marker.p, marker.R
        observe.tip[:] = peg.list_frames()["tip"].p
        observe.zero = float(np.mean(seen)) + weight
        observe.weight = observe.felt = weight
        things = d.world.things
        true = locate_thing(
            things, s.task.socket, offsets=find_offsets(things, build_socket_error(d.plant))
        )
        judge.p_WS[:], judge.R_WS[:] = true.p, true.R
        judge.bar, judge.length = list_movers(things).index(s.task.bar), peg.length_m
        judge.weight = peg.mass_kg * d.world.gravity_mps2
        judge.excess, judge.lost_m, judge.upright = EXCESS_N, LOST_M, math.cos(LOST_ANGLE)
        judge.seated, judge.seated_s = SEATED * peg.length_m, SEATED_S
