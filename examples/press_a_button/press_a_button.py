"""A mission kind of one's own: press a push button on a wall, in flight.

Everything that a kind is stands here: what may be asked (`Button`), how it is planned and flown,
what is measured, and what a report shows. Skywright finds the class by file
(`kind = "press_a_button.py:PressAButton"`) or, with the package installed, by name
(`kind = "press-a-button"`).
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skywright.core.rotations import rot_z
from skywright.core.spec import Coordinate, NonNegative
from skywright.description.mission.spec import Task
from skywright.description.world.structure import locate_point
from skywright.errors import InputError
from skywright.run.kind import Chart, Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.result import RunResult
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]

EXTRA = 1.3  # of the actuation force, that the tip presses with
FRACTION = 0.8  # of the press that the capability analysis computes, at most
STAND_OFF = 0.4  # m, of the tip, on the way in and out
CLEAR = 0.1  # m, kept from everything on the way
BACK = 0.5  # of the actuation force, at which a pressed button comes back
FELT_S = 0.1  # s, that the actuation force has to last


class Button(Task):
    """A push button on the structure (its frame S), and how often it is pressed."""

    x_m: Coordinate = 0.0  # along the structure, from its middle
    y_m: Coordinate = 0.0  # across
    actuation_n: float = Field(default=1.5, ge=0.3, le=8)  # force at which the button gives way
    times: int = Field(default=1, ge=1, le=20)
    ramp_s: float = Field(default=1.0, ge=0.1, le=60)  # in which the force is reached
    settle_s: NonNegative = 1.0
    hold_s: float = Field(default=1.0, ge=0.2, le=60)


class ButtonWay(NamedTuple):
    """Where the platform is while it presses."""

    p_press: Array  # (3,) m, tip on the button
    p_near: Array  # just before it
    p_back: Array  # at the stand-off
    R_WB: Array  # (3, 3)
    q: Array  # (n_joints,) rad
    force: float  # N, that is pressed with


class PressAButton(MissionKind[Button, ButtonWay]):
    """Fly to a button on a wall, press it, come back."""

    task = Button
    needs = frozenset({"uav", "whole_body", "probe"})

    @property
    def measures(self) -> Measures:
        return {
            "button.presses": ("", "times that the button was held down for 0.1 s and let go"),
            "button.force_max_n": ("N", "largest force of the tip on the button"),
        }

    def plan(self, setup: Setup[Button]) -> MissionPlan[ButtonWay]:
        from skywright.description.world.wind import compute_direction, compute_speed
        from skywright.missions.skills.pressing import TIP_GAP, check_can_press
        from skywright.missions.skills.ways import check_line
        from skywright.models.contact_stance import compute_flying_press, find_free_stance
        from skywright.run.planning import MissionPlan

        began = time.perf_counter()
        robot, world, task = setup.robot, setup.world, setup.task
        if setup.surface is None or world.structure is None or world.structure.facing == "down":
            raise InputError(
                f"world {world.name!r} has no wall for a button: give it a [world.structure] that "
                "faces to the side, as world tunnel has"
            )
        check_can_press(robot, setup.description.mission)
        p, R = locate_point(setup.surface, np.array([task.x_m, task.y_m]))
        normal = np.array(R[:, 2])
        R_WB = rot_z(math.atan2(-normal[1], -normal[0]))
        stance = find_free_stance(robot, world.structure.facing)
        p_press = p - R_WB @ stance.tip
        way = ButtonWay(
            p_press, p_press + TIP_GAP * normal, p_press + STAND_OFF * normal, R_WB, stance.q,
            EXTRA * task.actuation_n,
        )  # fmt: skip
        wind = compute_speed(world.wind) * compute_direction(world.wind)
        limit = compute_flying_press(
            robot, stance, R_WB, world.gravity_mps2, wind=wind, air_density=world.air_density_kg_m3
        )
        room, what = check_line(setup.clearance, setup.hover[:3], way.p_back, R_WB, stance.q)
        blocked = None
        if not way.force <= FRACTION * limit:
            blocked = (
                f"a button of {task.actuation_n:g} N takes a press of {way.force:.2f} N, which "
                f"exceeds {FRACTION:.0%} of the {limit:.2f} N that {robot.name} can make in flight"
            )
        elif room < CLEAR:
            blocked = f"on the way to the button {what} come within {max(room, 0.0):.3f} m"
        each = 2.0 * task.ramp_s + task.settle_s + task.hold_s + 5.0
        return MissionPlan(
            blocked is None, blocked, time.perf_counter() - began, 30.0 + task.times * each, room,
            way=way,
        )  # fmt: skip

    def fly(self, s: Supervisor[Button], way: ButtonWay) -> Flight:
        from skywright.missions.skills.pressing import Presser
        from skywright.run.flight import Flight

        pilot, home, reason = Presser(s, s.task), np.array(s.vehicle.reference), ""
        pilot.go("approach", p=way.p_back, R=way.R_WB, q=way.q)
        for i in range(s.task.times):
            pilot.go(f"near {i + 1}", p=way.p_near, speed=0.1)
            s.wait(1.0)
            reason = pilot.press("button", "flying", [way.force], f"{i + 1}: ")
            pilot.go("back", p=way.p_back, speed=0.2)
            if reason:
                break
        folded = home["q"][: s.vehicle.n_joints]
        pilot.go("return", p=home["p_WB"], R=home["R_WB"], q=folded)
        return Flight(not reason, reason)

    def metrics(self, run: Flown[Button, ButtonWay]) -> dict[str, float]:
        force, t = compute_force(run.samples), run.samples["t"]
        presses, since = 0, math.inf
        for f, now in zip(force, t, strict=True):
            if f >= run.task.actuation_n:
                since = min(since, now)
            elif f < BACK * run.task.actuation_n:  # a button snaps: it comes back at less
                presses, since = presses + (now - since >= FELT_S), math.inf
        return {
            "button.presses": float(presses),
            "button.force_max_n": float(np.max(force, initial=0.0)),
        }

    def figures(self) -> Figures:
        return Figures(
            describe,
            charts={
                "button": Chart(
                    "The button",
                    "Force of the tip; dashed: the force at which the button gives way.",
                    draw_button,
                )
            },
            phases={"approach": "To the stand-off before the button, the arm out."},
        )


def compute_force(samples: NDArray[Any]) -> Array:
    """Return the true force (n,) N of the tip along the probe."""
    from skywright.models.drawing import rotate_vectors

    axis = rotate_vectors(samples["q_WT"], np.tile([0.0, 0.0, 1.0], (len(samples), 1)))
    return np.asarray(-np.sum(samples["f_contact"] * axis, axis=1))


def describe(result: RunResult[Button, ButtonWay]) -> str:
    """Say what was pressed."""
    presses = result.metrics.get("button.presses", 0.0)
    return f"{result.description.robot.name} pressed a button {presses:.0f} times"


def draw_button(result: RunResult[Button, ButtonWay]) -> Any:
    """Draw the force over the flight."""
    from skywright.reports.figures.style import BLUE, WIDTH, draw_limit, draw_line, new_figure

    if len(result.samples) < 2:
        return None
    figure = new_figure(WIDTH, 2.8)
    ax = figure.add_axes((0.08, 0.2, 0.9, 0.7))
    draw_line(ax, result.samples["t"], compute_force(result.samples), color=BLUE)
    draw_limit(ax, result.description.mission.task.actuation_n, "the button gives way")
    ax.set_xlabel("time (s)")
    ax.set_ylabel("force (N)")
    return figure
