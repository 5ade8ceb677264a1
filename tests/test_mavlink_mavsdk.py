"""MAVSDK 4 flies the simulated robot that speaks MAVLink, over UDP on this computer."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.offboard import Attitude, OffboardAsync, PositionNedYaw, VelocityNedYaw
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import LandedState, TelemetryAsync
from mavsdk.plugins.mavlink_direct import MavlinkMessage
from pymavlink.dialects.v20 import common

import skywright
from skywright.links.mavlink.attitude_target import AttitudeTarget
from skywright.links.mavlink.endpoint import Endpoint, Url
from skywright.links.mavlink.serve import Service

SPEED = 3.0


def find_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@pytest.fixture
def port() -> Iterator[int]:
    """The port to which a robot speaks while it is simulated in a thread."""
    port = find_port()
    endpoint = Endpoint(Url("udpout", "127.0.0.1", port), 1, 1)
    service = Service(skywright.load("waypoints"), [endpoint], speed=SPEED)
    ended = threading.Event()

    def run() -> None:
        while not ended.is_set():
            service.tick()

    thread = threading.Thread(target=run)
    thread.start()
    yield port
    ended.set()
    thread.join()
    endpoint.close()


async def until(what: Any, seconds: float = 60.0) -> None:
    async with asyncio.timeout(seconds):
        while not await what():
            await asyncio.sleep(0.05)


async def fly(port: int) -> None:
    station = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(station) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await mavsdk.first_autopilot(timeout_s=60.0)
        assert system is not None
        action, tell = ActionAsync(system), TelemetryAsync(system)
        offboard, parameters = OffboardAsync(system), ParamAsync(system)
        await until(tell.health_all_ok)
        # half a second of the robot's time passes in a sixth of a second: on a busy computer
        # set-points come later than that, and the robot would hold
        await parameters.set_param_float("COM_OF_LOSS_T", 20.0)
        await action.set_takeoff_altitude(1.0)
        assert await action.get_takeoff_altitude() == 1.0
        await action.arm()
        await until(tell.armed)
        await action.takeoff()

        async def flies() -> bool:
            return bool(await tell.landed_state() == LandedState.IN_AIR)

        async def place() -> np.ndarray:
            p = (await tell.position_velocity_ned()).position
            return np.array([p.north_m, p.east_m, p.down_m])

        async def speed() -> np.ndarray:
            v = (await tell.position_velocity_ned()).velocity
            return np.array([v.north_m_s, v.east_m_s, v.down_m_s])

        await until(flies)
        goal = np.array([0.5, -0.5, -1.6])

        async def is_there() -> bool:
            return bool(np.linalg.norm(await place() - goal) < 0.15)

        await offboard.set_position_ned(PositionNedYaw(*goal, 90.0))
        await offboard.start()
        await until(is_there)
        assert await offboard.is_active()

        async def goes_east() -> bool:
            v = await speed()
            return bool(abs(v[1] - 0.5) < 0.1 and abs(v[0]) < 0.1)

        await offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.5, 0.0, 90.0))
        await until(goes_east)
        hover = await parameters.get_param_float("MPC_THR_HOVER")

        async def is_tilted() -> bool:
            angle = await tell.attitude_euler()
            return bool(abs(angle.pitch_deg - 4.0) < 1.0 and abs(angle.roll_deg) < 1.0)

        await offboard.set_attitude(Attitude(0.0, 4.0, 90.0, hover))  # nose up: it brakes
        await until(is_tilted)
        await offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 90.0))

        async def stands() -> bool:
            return bool(np.linalg.norm(await speed()) < 0.1)

        await until(stands)
        await offboard.stop()
        await action.land()

        async def is_down() -> bool:
            landed = await tell.landed_state() == LandedState.ON_GROUND
            return landed and not await tell.armed()  # two messages: either may come first

        await until(is_down)


def test_mavsdk_arms_flies_offboard_and_lands(port: int) -> None:
    asyncio.run(fly(port))


async def record_target() -> bytes:
    """Return message 82 as MAVSDK's MavlinkDirect sends it, with thrust_body."""
    port = find_port()
    sender, parser = common.MAVLink(None, 1, 1), common.MAVLink(None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        s.setblocking(False)
        station = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(station) as mavsdk:
            await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
            beat = common.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
            found: asyncio.Task[Any] = asyncio.create_task(mavsdk.first_autopilot(timeout_s=20.0))
            while not found.done():
                s.sendto(beat.pack(sender), ("127.0.0.1", port))
                await asyncio.sleep(0.1)
            direct = MavlinkDirectAsync(found.result())
            fields = {
                "time_boot_ms": 1234, "target_system": 1, "target_component": 1, "type_mask": 39,
                "q": [0.9, 0.1, -0.2, 0.3], "body_roll_rate": 0.0, "body_pitch_rate": 0.0,
                "body_yaw_rate": 0.0, "thrust": 0.25, "thrust_body": [0.1, -0.05, -0.5],
            }  # fmt: skip
            message = MavlinkMessage("SET_ATTITUDE_TARGET", 245, 190, 1, 1, json.dumps(fields))
            for _ in range(100):
                await direct.send_message(message)
                await asyncio.sleep(0.05)
                while True:
                    try:
                        data = s.recv(2048)
                    except BlockingIOError:
                        break
                    for m in parser.parse_buffer(data) or []:
                        if m.get_msgId() == 82:
                            return bytes(m.get_msgbuf())
    raise AssertionError("MAVSDK sent no message 82")


def test_our_attitude_target_has_the_bytes_of_mavsdks() -> None:
    theirs = asyncio.run(record_target())
    sender = common.MAVLink(None, theirs[5], theirs[6])
    sender.seq = theirs[4]
    f = np.float32
    ours = AttitudeTarget(
        1234, 39, (f(0.9), f(0.1), f(-0.2), f(0.3)), thrust=f(0.25),
        thrust_body=(f(0.1), f(-0.05), f(-0.5)),
    ).pack(sender)  # fmt: skip
    assert ours == theirs
    (message,) = common.MAVLink(None).parse_buffer(ours)
    read = AttitudeTarget.read(message)
    assert read is not None and np.allclose(read.thrust_body, (0.1, -0.05, -0.5))
    assert read.type_mask == 39 and read.thrust == pytest.approx(0.25)
