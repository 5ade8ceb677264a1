"""Conditions for sliding the probe along a structure in flight.

Sliding causes friction along the path: F mu at the tip, in addition to the press F. Both load the
rotors, and friction also rotates the robot. If the path lies in the arm's plane, this rotation
moves the tip to or from the surface. With mass m, inertia I, and the tip at x along and z off the
surface from the centre of mass, a normal force N accelerates the tip away from the surface by

    N (1 / m + x (x - mu z) / I)

in one direction of motion, and with a plus in the other. Under a deck, z = 0.45 m above, this is a
fifth of the frictionless value at mu = 0.6 and negative from mu = 0.75: the advancing tip jams and
jumps, as a piece of chalk does (Painleve). The robot therefore slides across its arm's plane there.
"""

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.description.world.structure import Structure, build_surface
from skywright.errors import InputError
from skywright.missions.bridge_contact.task import Contact
from skywright.models.contact_stance import ContactStance, compute_flying_press
from skywright.models.rigid_body import build_body_model, compute_body

WOBBLE = {"mocap": 0.2e-3, "total-station": 1.0e-3}
"""m rms, motion of a platform that presses in flight above the bandwidth of the force loop: the
errors of its estimate. Measured, as `free.rms_error_n` over the spring's stiffness (0.15 to 0.29 N
and 0.5 to 1.4 N of the F550); satellite navigation is no better than the station."""


def find_way(task: Contact, structure: Structure) -> Array:
    """Return the displacement (3,) m in W from a spot to the far end of the slide."""
    surface = build_surface(structure)
    return np.asarray(task.slide_m * surface.R_WS[:, surface.along])


def check_slide_ends(task: Contact, structure: Structure) -> None:
    """Raise InputError if a slide would leave the structure."""
    along = build_surface(structure).along
    half = 0.5 * (structure.length_m, structure.width_m)[along]
    for i, spot in enumerate(task.spots if task.slide_m else ()):
        start = (spot.x_m, spot.y_m)[along]
        if abs(start + task.slide_m) > half:
            raise InputError(
                f"mission.task.slide_m = {task.slide_m:g} m from mission.task.spots[{i}] ends at "
                f"{'xy'[along]} = {start + task.slide_m:g} m, beside the structure, which reaches "
                f"{half:g} m: valid is {-half - start:g} to {half - start:g} m"
            )


def check_wobble(robot: Robot, localisation: str, task: Contact, most: float) -> str:
    """Return why a slide presses too lightly to keep contact, or "".

    `most` (N) is the largest press of the rotors, stated in the message.
    """
    assert robot.probe is not None
    spring = robot.probe.spring_n_per_m
    wobble = WOBBLE.get(localisation, WOBBLE["total-station"])
    force, least = task.slide_force_n, task.slide_sigmas * wobble * spring
    if force >= least:
        return ""
    other = "" if localisation == "mocap" else "set world.localisation='mocap', or "
    return (
        f"sliding at {force:g} N would lose contact: with {localisation} the platform "
        f"moves by about {1000.0 * wobble:.1f} mm rms, {wobble * spring:.2f} N at the "
        f"probe's spring; {task.slide_sigmas:g} times that (mission.task.slide_sigmas) is "
        f"{least:.2f} N, of at most {most:.2f} N here: {other}omit the slide "
        "(mission.task.slide_m=0)"
    )


def check_mobility(
    robot: Robot, stance: ContactStance, R_WB: Array, gravity: float, structure: Structure,
    least: float,
) -> str:  # fmt: skip
    """Return a refusal if friction leaves less than `least` of the tip's mobility, or "".

    The mobility is that off the surface. At a third (a pillar at friction 0.6) half of the flights
    lost contact, at 0.55 (0.4) none of three.
    """
    mass, p_BC, I_B = compute_body(build_body_model(robot, gravity), stance.q)
    I_C = I_B - mass * (p_BC @ p_BC * np.eye(3) - np.outer(p_BC, p_BC))
    surface, lever = build_surface(structure), stance.tip - p_BC
    off, along = R_WB.T @ surface.R_WS[:, 2], R_WB.T @ surface.R_WS[:, surface.along]

    def answer(f: Array) -> float:  # acceleration of the tip off the surface under a force
        turn = np.linalg.solve(I_C, np.cross(lever, f))
        return float(off @ (f / mass + np.cross(turn, lever)))

    drag = structure.friction * along
    share = min(answer(off + drag), answer(off - drag)) / answer(off)
    if share >= least:
        return ""
    return (
        f"sliding at friction {structure.friction:g} rotates the robot towards the "
        f"surface: the tip retains {share:.0%} of its mobility off the surface, below "
        f"{least:.0%} (mission.task.mobility_fraction) it sticks and slips: press without "
        "sliding (mission.task.slide_m=0), or reduce world.structure.friction"
    )


def compute_sliding_press(
    robot: Robot, stance: ContactStance, R_WB: Array, gravity: float, structure: Structure,
    *, wind: Array, air_density: float,
) -> float:  # fmt: skip
    """Return the largest press (N) at which the tip slides in both directions; NaN: none."""
    surface = build_surface(structure)
    along = R_WB.T @ surface.R_WS[:, surface.along]
    return float(
        np.min([
            compute_flying_press(
                robot, stance, R_WB, gravity, wind=wind, air_density=air_density,
                pull=sign * structure.friction * along,
            )
            for sign in (1.0, -1.0)
        ])
    )  # fmt: skip
