"""Reaction of arm joint accelerations on the platform: columns of the coupled mass matrix."""

from __future__ import annotations

from typing import Any

from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.models.body_records import MAX_LINKS
from skywright.vehicle.component import helper


@helper
def fill_reaction(model: Any, kin: Any, joint: int, force: Any, torque: Any) -> None:
    """Fill force (3,) N and torque (3,) N m about B's origin for 1 rad/s^2 of a joint.

    In B, for all bodies that the joint carries: the rows of the platform in the joint's column of
    the mass matrix. For a sliding joint the acceleration is 1 m/s^2.
    """
    carried, axis, pivot = local(MAX_LINKS), local(3), local(3)
    c, rate, turn, spin = local(3), local(3), local(3), local(3)
    slides = False
    for a in range(3):
        force[a] = torque[a] = 0.0
    for i in range(model.n_links):
        carried[i] = 0.0
        if model.joint[i] == joint:
            carried[i] = 1.0
            slides = model.slide[i] != 0
            for a in range(3):
                axis[a], pivot[a] = kin.R[i, a, model.axis[i]], kin.p[i, a]
        elif model.parent[i] >= 0:
            carried[i] = carried[model.parent[i]]
        if carried[i] == 0.0:
            continue
        mat_vec(kin.R[i], model.com[i], c)
        for a in range(3):
            c[a] += kin.p[i, a]
            spin[a] = c[a] - pivot[a]
        if slides:
            for a in range(3):
                rate[a], spin[a] = axis[a], 0.0
        else:
            cross(axis, spin, rate)
            mat_t_vec(kin.R[i], axis, turn)  # R I R^T axis
            mat_vec(model.inertia[i], turn, spin)
            mat_vec(kin.R[i], spin, turn)
            for a in range(3):
                torque[a] += turn[a]
        cross(c, rate, turn)
        for a in range(3):
            force[a] += model.mass[i] * rate[a]
            torque[a] += model.mass[i] * turn[a]
