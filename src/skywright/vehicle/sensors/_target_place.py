"""True pose of a target: a pipe, or a thing that is fixed or carried by another."""

from __future__ import annotations

from typing import Any

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import mat_mat, mat_vec, quat_to_rot
from skywright.core.scratch import local
from skywright.description.world.thing import Frame, build_frame
from skywright.description.world.things import find_carrier, list_movers, locate_thing
from skywright.models.things._build import find_offsets
from skywright.vehicle.component import helper, words


class TargetPlace(Record):
    """A target, and the thing that carries it."""

    object_qpos: int  # of the thing that carries it (or is it), -1: fixed
    p_CO: Vec3  # m, on that thing, or in W
    R_CO: Mat3
    p_WO: Vec3  # m, truth of this tick
    R_WO: Mat3


def fill_place(place: Any, context: Any, name: str) -> None:
    """Fill a TargetPlace from a thing of the world, or from its pipe if no thing has this name.

    `context` is a PlantContext.
    """
    things, movers = context.world.things, context.scene.places.object_qpos
    place.object_qpos = -1
    if name not in things:
        cylinder = context.true.cylinder
        at = Frame(cylinder.p_WP, cylinder.R_WP)
    else:
        carrier = name if things[name].movable else find_carrier(things, name)
        if carrier is None:
            offsets = find_offsets(things, context.deviation.socket_error)
            at = locate_thing(things, name, offsets=offsets)
        else:
            place.object_qpos = movers[list_movers(things).index(carrier)]
            at = build_frame() if carrier == name else locate_thing(things, name, carrier)
    place.p_CO[:], place.R_CO[:] = place.p_WO[:], place.R_WO[:] = at


@helper
def move_place(place: Any, mj: Any) -> None:
    """Fill the true pose of a target that moves."""
    at, qpos = place.object_qpos, words(mj.qpos, mj.nq)
    if at < 0:
        return
    rot, vec = local(3, 3), local(3)
    quat_to_rot(qpos[at + 3 : at + 7], rot)
    mat_vec(rot, place.p_CO, vec)
    for a in range(3):
        place.p_WO[a] = qpos[at + a] + vec[a]
    mat_mat(rot, place.R_CO, place.R_WO)
