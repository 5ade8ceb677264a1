"""Peg bar, socket and rack in the scene : boxes, held by contact alone.

Contacts are those of `models/tool_body.py`: 8 ms, critically damped, Coulomb friction on an
elliptic cone with the no-slip step, the peg bar's friction for every pair. The peg sinks into a
wall by less than a tenth of a millimetre under the forces that occur (tests hold it): it is as if
the clearance were so much wider. The plant's socket stands where `Deviation.socket_error` says.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot, rot_x, rot_y, rot_z
from skywright.description.world.insertion import (
    SHARES,
    Block,
    Peg,
    Socket,
    list_peg_parts,
    list_socket_parts,
)
from skywright.description.world.spec import World
from skywright.models.arm_body import FEET, PEN, ROBOT, WORLD, Deviation
from skywright.models.docking_body import NOSLIP_ITERATIONS

Array = NDArray[np.float64]

PEG = "peg"
TIME_CONSTANT = 0.008  # s, of the contacts
SOCKET = "socket"


def locate_socket(socket: Socket, error: Array | None = None) -> tuple[Array, Array]:
    """Return (p_WS, R_WS) of a block; `error` (6,) is m in S's frame and rad about x, y, z."""
    R = rot_z(math.radians(socket.yaw_deg))
    p = np.array([socket.x_m, socket.y_m, socket.z_m])
    if error is None:
        return p, R
    turn = rot_z(float(error[5])) @ rot_y(float(error[4])) @ rot_x(float(error[3]))
    return p + R @ error[:3], R @ turn


def move_socket(world: World, error: Array) -> World:
    """Return the world with its socket where it stands in truth, to be drawn; its tilt is left out.

    `error` (6,) is `Deviation.socket_error`.
    """
    if world.socket is None:
        return world
    p, R = locate_socket(world.socket, error)
    x, y, z = (float(a) for a in p)
    yaw = math.degrees(math.atan2(R[1, 0], R[0, 0]))
    place = {"x_m": x, "y_m": y, "z_m": z, "yaw_deg": yaw}
    return world.model_copy(update={"socket": world.socket.model_copy(update=place)})


def add_insertion(spec: mujoco.MjSpec, world: World, name: str, dev: Deviation | None) -> None:
    """Add socket, rack and the peg bar as the body `name`, which only the plant (`dev`) lets move.

    In the nominal scene the bar stands in the rack and the socket where the file puts it.
    """
    contacts: dict[str, Any] = {
        "condim": 4, "solref": [TIME_CONSTANT, 1.0], "solimp": [0.9, 0.95, 0.001, 0.5, 2.0],
    }  # fmt: skip
    fixed = {"contype": WORLD, "conaffinity": ROBOT | FEET | PEN} | contacts
    for what, block, error in (
        (SOCKET, world.socket, dev.socket_error if dev else None), ("rack", world.rack, None)
    ):  # fmt: skip
        if block is not None:
            p, R = locate_socket(block, error)
            _add_block(spec.worldbody, what, block, p, R, fixed)
    if world.peg is None:
        return
    assert world.rack is not None
    spec.option.noslip_iterations = NOSLIP_ITERATIONS
    p, R = locate_socket(world.rack)
    body = spec.worldbody.add_body(name=name, pos=p, quat=quat_from_rot(R))
    friction = {"friction": [world.peg.friction, 0.005, 0.0001], "priority": 2}
    moving = {"contype": WORLD, "conaffinity": ROBOT | FEET | PEN | WORLD}
    _add_peg(body, world.peg, contacts | friction | moving)
    if dev is not None:
        body.add_freejoint(name=name)


def _add_peg(body: mujoco.MjsBody, peg: Peg, kwargs: dict[str, Any]) -> None:
    for part in list_peg_parts(peg):
        _add_box(body, part, np.zeros(3), np.eye(3), [0.75, 0.2, 0.2, 1], kwargs)
    end = np.array([0.0, 0.5 * (peg.handle_length_m - peg.handle_diameter_m), 0.0])
    up = np.array([0.0, 0.0, peg.handle_height_m])
    body.add_geom(
        name="peg bar handle", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[0.5 * peg.handle_diameter_m, 0, 0], fromto=[*(up - end), *(up + end)],
        mass=SHARES["handle"] * peg.mass_kg, rgba=[0.75, 0.2, 0.2, 1], **kwargs,
    )  # fmt: skip


def _add_block(
    body: mujoco.MjsBody, name: str, socket: Socket, p: Array, R: Array, kwargs: dict[str, Any]
) -> None:
    color = [0.45, 0.5, 0.58, 1]
    for part in list_socket_parts(socket):
        _add_box(body, part._replace(name=f"{name} {part.name}"), p, R, color, kwargs)
    height = float(p[2]) - socket.depth_m
    if height > 0.01:
        half = 0.5 * socket.post_m
        post = Block(f"{name} post", np.array([p[0], p[1], 0.5 * height]), np.eye(3),
                     np.array([half, half, 0.5 * height]))  # fmt: skip
        _add_box(body, post, np.zeros(3), np.eye(3), color, kwargs)


def _add_box(
    body: mujoco.MjsBody, part: Block, p: Array, R: Array, rgba: list[float], kwargs: dict[str, Any]
) -> None:
    body.add_geom(
        name=part.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=part.half, pos=p + R @ part.p,
        quat=quat_from_rot(R @ part.R), mass=part.mass, rgba=rgba, **kwargs,
    )  # fmt: skip
