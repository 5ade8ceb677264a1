"""Reference of an identification: the parameters of the perturbed plant."""

import numpy as np

from skywright.analysis.identify.signals import INERTIA_AXES
from skywright.core.arrays import Array
from skywright.description.loader import Description
from skywright.description.robot.spec import Robot
from skywright.models.arm_body import Deviation
from skywright.models.deviation import build_deviation
from skywright.models.rigid_body import build_body_model, compute_body


def build_true_robot(robot: Robot, deviation: Deviation) -> Robot:
    """Return the robot with the plant's masses; lengths stay as in the file."""
    d, p = deviation, robot.platform
    factor = d.mass_factor
    platform = p.model_copy(
        update={
            "mass_kg": p.mass_kg * factor,
            "com_x_m": p.com_x_m + float(d.com_error[0]),
            "com_y_m": p.com_y_m + float(d.com_error[1]),
            "com_z_m": p.com_z_m + float(d.com_error[2]),
            **{
                f"inertia_{a}_kgm2": getattr(p, f"inertia_{a}_kgm2") * d.inertia_factor
                for a in ("xx", "yy", "zz")
            },
        }
    )
    update: dict[str, object] = {"platform": platform}
    if robot.arm is not None:
        links = {
            name: link.model_copy(update={"mass_kg": link.mass_kg * factor})
            for name, link in robot.arm.links.items()
        }
        update["arm"] = robot.arm.model_copy(update={"links": links})
    if robot.probe is not None:
        parts = {"mass_kg": robot.probe.mass_kg, "slider_mass_kg": robot.probe.slider_mass_kg}
        scaled = {name: factor * value for name, value in parts.items()}
        update["probe"] = robot.probe.model_copy(update=scaled)
    if robot.docking is not None:
        mass = {"mass_kg": robot.docking.mass_kg * factor}
        update["docking"] = robot.docking.model_copy(update=mass)
    return robot.model_copy(update=update)


def compute_truth(description: Description, poses: Array) -> tuple[dict[str, float], float]:
    """Return the plant's parameters by their names in a fit, and its mass (kg)."""
    robot, plant = description.robot, description.plant
    deviation = build_deviation(plant, robot, description.mission.seed)
    out = {f"rotor_gain_{i + 1}": float(g) for i, g in enumerate(deviation.rotor_gain)}
    out["torque_per_thrust_m"] = robot.rotors.torque_per_thrust_m
    out["drag_coefficient_n_per_rads_mps"] = (
        robot.rotors.drag_coefficient_n_per_rads_mps * deviation.drag_factor
    )
    out["rotor_inertia_kgm2"] = robot.rotors.rotor_inertia_kgm2
    out["drag_height_m"] = float(np.mean(robot.rotors.heights))
    for axis in "xyz":
        area = getattr(robot.platform, f"drag_area_{axis}_m2")
        out[f"drag_area_{axis}_m2"] = area * deviation.drag_factor
    model = build_body_model(build_true_robot(robot, deviation))
    mass = 0.0
    for n, q in enumerate(poses):
        mass, com, I_B = compute_body(model, q)
        for axis, value in zip("xyz", com, strict=True):
            out[f"pose_{n + 1}.com_{axis}_m"] = float(value)
        for i, j in INERTIA_AXES:
            out[f"pose_{n + 1}.inertia_{'xyz'[i]}{'xyz'[j]}_kgm2"] = float(I_B[i, j])
    return out, mass
