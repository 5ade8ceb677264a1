"""Set-points of an offboard stream (messages 84, 86, 82), and the resulting vehicle commands."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.description.world.origin import Origin
from skywright.errors import InputError
from skywright.links.mavlink.attitude_target import (
    IGNORE_ATTITUDE,
    IGNORE_THRUST,
    THRUST_BODY,
    AttitudeTarget,
)
from skywright.links.mavlink.frames import (
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    find_heading,
    find_height,
    from_ned_quaternion,
    swap_body,
    swap_heading,
    swap_world,
)
from skywright.vehicle.geodesy import Geodetic, to_local
from skywright.vehicle.interface import Backend
from skywright.vehicle.uav import Uav

Array = NDArray[np.float64]

LOCAL, OFFSET, BODY, BODY_OFFSET = 1, 7, 8, 9  # MAV_FRAME
ACCELERATION, FORCE = 0x1C0, 0x200  # bits of type_mask
YAW, YAW_RATE = 0x400, 0x800
FAR = 1e4
"""m: positions beyond are rejected."""
GAIN = 1.0  # 1/s, position gain along an axis if other axes have a commanded velocity


class SetPoint(NamedTuple):
    """A set-point of the stream, in W; NaN: not given."""

    p: Array  # (3,) m
    v: Array  # (3,) m/s
    yaw: float  # rad
    yaw_rate: float  # rad/s
    R_WB: Array | None = None  # (3, 3), with f_B instead of all else
    f_B: Array | None = None  # (3,) N
    v_body: bool = False  # `v` is forward, left, up along the heading

    def lifts(self, height: float) -> bool:
        """Whether it commands a position above a height (m), or an upward velocity."""
        if self.f_B is not None:
            return bool(self.f_B[2] > 0.0)
        return bool(self.p[2] > height or (math.isnan(self.p[2]) and self.v[2] > 0.05))


class Scale(NamedTuple):
    """Scale of normalised thrust."""

    unit: float  # N, of a thrust of 1: all rotors at their maximum
    lateral: bool  # whether the rotors produce lateral force


def read_local(message: Any, b: Backend) -> SetPoint | str:
    """Return the set-point of SET_POSITION_TARGET_LOCAL_NED, or the reason of a refusal."""
    mask, frame = message.type_mask, message.coordinate_frame
    if frame not in (LOCAL, OFFSET, BODY, BODY_OFFSET):
        return f"set-points in the frame {frame} are refused; valid: 1, 7, 8, 9"
    p = _read(mask, 0, message.x, message.y, message.z)
    v = _read(mask, 3, message.vx, message.vy, message.vz)
    lack = _check(mask, message, p, v)
    if lack:
        return lack
    given = ~np.isnan(p)
    heading = find_heading(np.asarray(b.estimate["R_WB"]))
    body = frame in (BODY, BODY_OFFSET)
    if body:  # x ahead, y right, z down
        p, v = swap_body(p), swap_body(v)
        if given.any():
            if not given.all():
                return "a position in a body frame is given whole or not at all"
            p = np.asarray(b.estimate["p_WB"]) + rot_z(heading) @ p
    else:
        p, v = swap_world(p), swap_world(v)
        if frame == OFFSET:
            p = p + np.asarray(b.estimate["p_WB"])
    yaw = math.nan
    if not mask & YAW:
        yaw = heading - message.yaw if body else swap_heading(message.yaw)
    rate = math.nan if mask & YAW_RATE else -message.yaw_rate
    return SetPoint(p, v, yaw, rate, v_body=body)


def read_global(message: Any, origin: Origin, home: float) -> SetPoint | str:
    """Return the set-point of SET_POSITION_TARGET_GLOBAL_INT, or the reason of a refusal.

    `home` (m) is the height z of home in W, to which altitudes in the frames 3 and 6 refer.
    """
    mask, frame = message.type_mask, message.coordinate_frame
    if frame not in (*GLOBAL_FRAMES, *RELATIVE_FRAMES):
        return f"global set-points in the frame {frame} are refused; valid: 0, 3, 5, 6"
    if mask & 0x3 in (1, 2):
        return "a global set-point with one of latitude and longitude is refused: give both"
    v = swap_world(_read(mask, 3, message.vx, message.vy, message.vz))
    p = np.full(3, np.nan)
    if not mask & 0x4:
        p[2] = find_height(message.alt, frame, origin.altitude_m, home)
    if not mask & 0x3:
        height = 0.0 if mask & 0x4 else p[2]
        lat, lon = 1e-7 * message.lat_int, 1e-7 * message.lon_int
        try:
            place = Geodetic.check(lat, lon, origin.altitude_m + height)
        except InputError as error:
            return str(error)
        p[:2] = to_local(origin, place)[:2]
    lack = _check(mask, message, p, v)
    if lack:
        return lack
    yaw = math.nan if mask & YAW else swap_heading(message.yaw)
    return SetPoint(p, v, yaw, math.nan if mask & YAW_RATE else -message.yaw_rate)


def read_attitude(message: Any, b: Backend, scale: Scale) -> SetPoint | str:
    """Return the set-point of SET_ATTITUDE_TARGET, or the reason of a refusal."""
    target = AttitudeTarget.read(message)
    if target is None:
        return "an attitude set-point holds numbers that are not finite"
    mask = target.type_mask
    if mask & IGNORE_ATTITUDE:
        return "set-points of body rates are refused: give an attitude"
    R = from_ned_quaternion(np.array(target.q))
    if R is None:
        return "an attitude set-point whose quaternion has not the length 1"
    if mask & THRUST_BODY:
        shares = swap_body(np.array(target.thrust_body))
        if np.linalg.norm(shares) > 2.0:
            return "thrust_body is larger than 1"
        if not scale.lateral and np.abs(shares[:2]).max() > 1e-3:
            return "thrust_body along x and y is refused: the rotors do not push sideways"
    elif mask & IGNORE_THRUST:
        return "an attitude set-point without thrust is refused"
    else:
        shares = np.array([0.0, 0.0, min(max(target.thrust, 0.0), 1.0)])
    nan = np.full(3, np.nan)
    return SetPoint(nan, nan, math.nan, math.nan, R, shares * scale.unit)


def follow(uav: Uav, point: SetPoint) -> str:
    """Command a set-point to a vehicle; return the reason of a refusal, or ""."""
    if point.R_WB is not None and point.f_B is not None:
        return _explain(uav.set_attitude(point.R_WB, point.f_B))
    heading = find_heading(uav.backend.reference_now["R_WB"])
    v = rot_z(heading) @ np.nan_to_num(point.v) if point.v_body else np.nan_to_num(point.v)
    rate = 0.0 if math.isnan(point.yaw_rate) else point.yaw_rate
    place = ~np.isnan(point.p)
    if place.all():
        yaw = None if math.isnan(point.yaw) else point.yaw
        return _explain(uav.set_pose(point.p, yaw, v, rate))
    if place.any():
        v = np.where(place, v + GAIN * (point.p - uav.backend.estimate["p_WB"]), v)
    if math.isnan(point.yaw_rate) and not math.isnan(point.yaw):
        rate = math.remainder(point.yaw - heading, 2.0 * math.pi)  # 1 rad/s per rad
    return _explain(uav.set_velocity(v, rate))


def _explain(handle: Any) -> str:
    return "" if handle else handle.result.reason


def _read(mask: int, first: int, *values: float) -> Array:
    """Return three numbers; NaN for those that the mask excludes."""
    return np.array([math.nan if mask & 1 << first + i else v for i, v in enumerate(values)])


def _check(mask: int, message: Any, p: Array, v: Array) -> str:
    """Return the reason of a refusal, or "": given numbers must be finite."""
    given = [
        *([] if mask & YAW else [message.yaw]),
        *([] if mask & YAW_RATE else [message.yaw_rate]),
    ]
    if not all(math.isfinite(x) for x in given) or np.isinf(p).any() or np.isinf(v).any():
        return "a set-point holds numbers that are not finite"
    if np.nanmax(np.abs([*p, 0.0])) > FAR:
        return f"a set-point is further away than {FAR:g} m"
    if np.isnan(p).all() and np.isnan(v).all():
        return "a set-point without position and velocity is refused"
    return ""
