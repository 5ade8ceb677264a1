"""Users' files of all groups, which import each other: for tests of plug-ins."""

from __future__ import annotations

from pathlib import Path

GAINS = "STIFFNESS = 60.0\nHEIGHT = 0.15\nRATE = 50.0\n"

HOVER = """
cmd.qd[:] = 0.0
if ref.active < 0.5:
    cmd.f_B[:] = 0.0
    cmd.t_B[:] = 0.0
    return
R = est.R_WB
f = body.mass * (25.0 * (ref.p_WB - est.p_WB) + 12.0 * (ref.v_WB - est.v_WB))
f[2] += body.mass * body.gravity
e = R.T @ ref.R_WB
e = 0.5 * np.array([e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]])
cmd.f_B[:] = R.T @ f
cmd.t_B[:] = body.I_B @ (81.0 * e - 18.0 * est.w_WB_B) + np.cross(body.p_BC, cmd.f_B)
"""
"""Body of a plain-Python law that flies a fully actuated robot."""

OWN_LAW = """
import numpy as np
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws.push_and_slide import PushAndSlide

class Mine(PushAndSlide):
    compiled = {compiled}

    @staticmethod
    def step(me: PushAndSlide.Me, ref: Reference, est: Estimate, body: Body,
             allocated: Allocated, cmd: Out[WrenchCommand]) -> None:
{body}
"""

SENSOR = '''
from skywright.core.record import Record
from skywright.core.spec import Positive, Spec
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Normal, Out, Output, Recorded, Sensor


class Height(Sensor):
    """The height over the ground, with noise."""

    class Table(Spec):
        noise_m: Positive = 0.01

    class Me(Record):
        noise: float

    class Noise(Normal):
        white: float

    class Reading(Output):
        h: float

    columns = (Recorded("height_meas", Reading, "h", "m", "measured height"),)

    def build(self, me, table, context):
        me.noise = table.noise_m

    @staticmethod
    def step(me: Me, clock: Clock, truth: Truth, noise: Noise, out: Out[Reading]) -> None:
        out.h = truth.p_WB[2] + me.noise * noise.white
'''

LAW = '''
from typing import Any

from skywright.core.record import Vec3
from skywright.core.scratch import local
from skywright.core.spec import Positive
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Law, Out, helper
from skywright.vehicle.loops import (
    ArmLoop, ArmTable, AttitudeLoop, AttitudeTable, arm_velocity, fill_arm, fill_attitude,
    hold_attitude, to_body,
)

import gains
from .heights import Height


class Springs(Law):
    """A spring, a damper and the measured height."""

    needs_full_actuation = True

    class Table(AttitudeTable, ArmTable):
        stiffness_n_per_m: Positive = gains.STIFFNESS

    class Me(AttitudeLoop, ArmLoop):
        stiffness: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        fill_attitude(me, table, context)
        fill_arm(me, table, context)
        me.stiffness = table.stiffness_n_per_m

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, body: Body, allocated: Allocated,
        height: Height.Reading, cmd: Out[WrenchCommand],
    ) -> None:
        arm_velocity(me, ref, est, body, cmd.qd)
        f_W = local(3)
        for i in range(3):
            if ref.active < 0.5:
                cmd.f_B[i] = cmd.t_B[i] = me.theta[i] = 0.0
                continue
            f_W[i] = body.mass * ref.a_WB[i] + me.stiffness * (ref.p_WB[i] - est.p_WB[i])
            f_W[i] += 25.0 * (ref.v_WB[i] - est.v_WB[i])
        if ref.active < 0.5:
            return
        f_W[2] += body.mass * body.gravity + 5.0 * (est.p_WB[2] - height.h)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)
'''

EFFECT = '''
from skywright.core.record import Record
from skywright.core.spec import NonNegative, Spec
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Effect, Out, Output, Recorded, table


class Tug(Effect):
    """A pull on the platform along x, from a time on."""

    class Table(Spec):
        force_n: NonNegative = 1.0
        from_s: NonNegative = 0.0

    class Me(Record):
        force: float
        start: float
        body: int

    class Pull(Output):
        f: float

    columns = (Recorded("f_tug", Pull, "f", "N", "pull along x"),)

    def build(self, me, table, context):
        me.force, me.start = table.force_n, table.from_s
        me.body = context.scene.places.platform_body

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, out: Out[Pull]) -> None:
        xfrc = table(mj.xfrc, mj.nbody, 6)
        out.f = me.force if clock.t >= me.start else 0.0
        xfrc[me.body, 0] += out.f
'''

THING = '''
from gains import HEIGHT
from skywright.core.spec import Positive
from skywright.description.world.thing import Part, Placed, Solid


class Post(Placed):
    """A post to fly around."""

    height_m: Positive = HEIGHT

    def list_parts(self):
        return [Part([Solid("cylinder", [0.05, 0.5 * self.height_m])])]
'''

KIND = '''
from typing import NamedTuple

import numpy as np
from skywright.core.spec import NonNegative
from skywright.description.mission.spec import Task
from skywright.run.kind import Figures, MissionKind


class HopTask(Task):
    wait_s: NonNegative = 0.5


class Way(NamedTuple):
    p_WB: np.ndarray


class Hop(MissionKind[HopTask, Way]):
    """Up, wait, down."""

    task = HopTask
    needs = frozenset({"uav"})

    @property
    def measures(self):
        return {"hop.height_m": ("m", "largest height")}

    def plan(self, setup):
        from skywright.run.planning import MissionPlan

        return MissionPlan(True, None, 0.0, 1.0, way=Way(setup.hover[:3]))

    def fly(self, s, way):
        from skywright.run.flight import Flight

        s.begin("hop")
        s.wait(s.task.wait_s)
        return Flight(True, "")

    def metrics(self, run):
        from gains import HEIGHT  # only when it is called

        return {"hop.height_m": float(np.max(run.samples["p_WB"][:, 2])) + 0.0 * HEIGHT}

    def figures(self):
        return Figures(lambda result: "It hopped")
'''

FILES = {
    "gains.py": GAINS, "heights.py": SENSOR, "springs.py": LAW, "tug.py": EFFECT, "post.py": THING,
    "hop.py": KIND,
}  # fmt: skip

MISSION = """
[mission]
name = "hop"
kind = "hop.py:Hop"
robot = "othex"
world = "open"
hover_height_m = 0.6
law = "springs.py:Springs"
estimator = "{estimator}"

[mission.task]
wait_s = 0.3

[mission.requirements]
"hop.height_m" = {{ limit = 0.3, sense = ">=", unit = "m" }}

[robot.sensors.height]
kind = "heights.py:Height"
noise_m = 0.005

[world.effects.tug]
kind = "tug.py:Tug"
force_n = 0.5

[world.things.post]
kind = "post.py:Post"
x_m = 3.0
y_m = 0.0
z_m = 0.1
"""


def write_parts(folder: Path, estimator: str = "filter") -> Path:
    """Write a mission whose kind, law, sensor, effect and thing are users'; return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    mission = folder / "mission.toml"
    mission.write_text(MISSION.format(estimator=estimator))
    return mission


def write_law(folder: Path, body: str, compiled: bool = False) -> list[str]:
    """Write a law with that body of a step; returns what sets it."""
    path = folder / "my_law.py"
    lines = "\n".join("        " + line for line in body.strip("\n").splitlines())
    path.write_text(OWN_LAW.format(body=lines, compiled=compiled))
    return [f"mission.law={path}:Mine"]
