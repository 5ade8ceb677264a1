"""Structures to inspect: frames, distances against MuJoCo, thrust near surfaces."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from plant_parts import view
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.description.world.structure import Structure, build_surface, find_place, locate_point
from skywright.models.arm_body import Deviation
from skywright.models.scene import build_scene
from skywright.models.structure_distance import StructureShape, fill_structure, measure_surface
from skywright.vehicle.bus import Truth
from skywright.vehicle.effects.surface_thrust import (
    SurfaceThrust,
    compute_ceiling_gain,
    compute_ground_gain,
)
from skywright.vehicle.plant import RotorGain

SHAPES = st.sampled_from(["plane", "cylinder", "arch"])


def build_structure(shape: str, facing: str, yaw: float, slope: float, toward: float) -> Structure:
    return Structure(
        shape=shape, facing=facing, x_m=1.0, y_m=-2.0, z_m=3.0, yaw_deg=yaw, slope_deg=slope,
        slope_toward_deg=toward, radius_m=None if shape == "plane" else 2.0,
    )  # fmt: skip


@given(
    SHAPES, st.sampled_from(["down", "side"]), st.floats(-180, 180), st.floats(0, 20),
    st.floats(-180, 180), st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 0.5),
)  # fmt: skip
def test_places_are_found_again(
    shape: str, facing: str, yaw: float, slope: float, toward: float, x: float, y: float, off: float
) -> None:
    surface = build_surface(build_structure(shape, facing, yaw, slope, toward))
    p, R = locate_point(surface, np.array([x, y]))
    assert pytest.approx(np.eye(3), abs=1e-12) == R.T @ R and np.linalg.det(R) == pytest.approx(1)
    assert find_place(surface, p + off * R[:, 2]) == pytest.approx([x, y, off], abs=1e-9)
    record = view(StructureShape)
    fill_structure(record, build_structure(shape, facing, yaw, slope, toward), surface)
    normal = np.empty(3)
    assert measure_surface(record, p + off * R[:, 2], normal) == pytest.approx(off, abs=1e-9)
    assert normal == pytest.approx(R[:, 2], abs=1e-9)


@given(st.floats(0, 45), st.floats(-180, 180))
def test_a_deck_rises_where_it_is_told(slope: float, toward: float) -> None:
    surface = build_surface(build_structure("plane", "down", 30.0, slope, toward))
    n, a = surface.R_WS[:, 2], math.radians(toward)
    assert n[2] < 0
    up_slope = np.array([math.cos(a), math.sin(a), math.tan(math.radians(slope))])
    assert n @ up_slope == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", ["bridge", "tunnel", "pillar", "test-bench"])
def test_the_scene_is_the_surface(name: str) -> None:
    """A small sphere of MuJoCo is as far from the geometry as the closed form says."""
    world, _ = load_world(name)
    assert world.structure is not None
    robot, _ = load_robot("f550-bridge")
    model = build_scene(robot, world, Deviation()).model
    data = mujoco.MjData(model)
    surface = build_surface(world.structure)
    geoms = [i for i in range(model.ngeom) if model.geom(i).name.startswith("structure")]
    tip = model.geom("tip").id
    mujoco.mj_forward(model, data)
    for place in ([0.0, 0.0], [0.1, 0.0], [0.0, 0.08]):
        p, R = locate_point(surface, np.array(place))
        data.geom_xpos[tip] = p + 0.05 * R[:, 2]
        near = min(mujoco.mj_geomDistance(model, data, tip, g, 1.0, np.zeros(6)) for g in geoms)
        # an arch is built of staves of 5 deg, which stand back between their middles
        slack = (surface.radius * (1 / math.cos(math.radians(2.5)) - 1)) if name == "tunnel" else 0
        assert -1e-6 <= near - (0.05 - robot.probe.tip_radius_m) <= slack + 1e-6


def test_thrust_grows_near_surfaces_and_nowhere_else() -> None:
    assert compute_ground_gain(10.0, 0.12) == pytest.approx(1.0, abs=1e-5)
    assert compute_ground_gain(0.12, 0.12) == pytest.approx(16 / 15)  # Cheeseman-Bennett at z = R
    assert compute_ground_gain(0.0, 0.12) == compute_ground_gain(0.06, 0.12) == pytest.approx(4 / 3)
    z = np.linspace(0.01, 1.0, 50)
    gains = np.array([compute_ceiling_gain(x, 0.12) for x in z])
    assert np.all(np.diff(gains) <= 0) and gains[-1] < 1.003 and gains[0] < 1.7
    # the paper: with the docking gear's distance the ceiling effect can be ignored
    assert compute_ceiling_gain(0.45, 0.12) < 1.02


def test_rotors_feel_the_deck_above_them_only() -> None:
    world, _ = load_world("bridge")
    assert world.structure is not None
    me, out, truth = view(SurfaceThrust.Me, n=2, disc=0.12), view(RotorGain), view(Truth)
    fill_structure(me.structure, world.structure, build_surface(world.structure))
    me.has_structure = 1
    me.rotor_p[:2], me.rotor_axis[:2] = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]], [0.0, 0.0, 1.0]
    truth.R_WB[:] = np.eye(3)
    for p, low, high in (
        ([2.0, 0.0, 2.8], 1.03, 1.2), ([2.0, 0.0, 1.5], 1.0, 1.0), ([20.0, 0.0, 2.8], 1.0, 1.0),
    ):  # fmt: skip
        truth.p_WB[:] = p
        SurfaceThrust.step(me, truth, out)
        gain = out.gain[:2]
        assert np.all((gain >= low) & (gain <= high)), (p, gain)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"shape": "arch"}, "needs radius_m"),
        ({"radius_m": 1.0}, "takes no radius_m"),
        ({"slope_deg": 60.0}, "less than or equal to 45"),
        ({"facing": "up"}, "'down' or 'side'"),
        ({"z_m": 0.0}, "greater than 0"),
    ],
)
def test_a_bad_structure_is_told(change: dict[str, object], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        Structure(**{"x_m": 0.0, "z_m": 3.0, **change})
