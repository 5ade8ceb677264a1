"""Measures of Caballero 2018 on made-up flights, and the free joint against the spatial model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.measures_transport import (
    measure_follow,
    measure_free_joint,
    measure_similar,
)
from skywright.models.scene import build_scene


def make_flight(*, start: float = 5.0, off: float = 0.0, **metrics: float) -> Record:
    """A flight along x at 0.5 m/s whose transport begins at `start`; `off` (m) to the side."""
    t = np.arange(0.0, start + 10.0, 0.01)
    p = np.column_stack([0.5 * np.maximum(t - start, 0.0), np.full_like(t, off), 2.0 + 0 * t])
    arrays = {
        "t": t, "phase": (t >= start).astype(int), "q": np.zeros((len(t), 9)),
        "p_WB": p, "ref_p_WB": p - [0.0, off, 0.0],
    }  # fmt: skip
    for side in ("left", "right"):
        arrays[f"{side}_p_WH"] = arrays[f"{side}_ref_p_WH"] = p - [0.0, 0.0, 1.0]
    known = {
        "tip.tracking_max_m": 0.02, "tip.tracking_rms_m": 0.01, "platform.tracking_max_m": 0.03,
        "swing.max_deg": 2.0, "transport.contacts": 0.0, "transport.clearance_min_m": 0.19,
    }  # fmt: skip
    phases = [
        {"name": "start pose", "start_s": 0.0, "end_s": start},
        {"name": "transport", "start_s": start, "end_s": start + 10.0},
    ]
    info = {"metrics": known | metrics, "phases": phases, "outcome": "succeeded", "reason": ""}
    return Record(info, arrays)


def test_flights_are_compared_from_the_start_of_the_carrying():
    same = measure_similar({"simulated": [make_flight()], "outdoors": [make_flight(start=7.3)]})
    assert same.values["apart_m"] < 1e-9
    aside = measure_similar({"simulated": [make_flight()], "outdoors": [make_flight(off=0.15)]})
    assert aside.values["apart_m"] == pytest.approx(0.15)
    assert aside.values["bar_m"] == pytest.approx(0.15)


def test_the_worst_flight_counts():
    near = make_flight(**{"transport.clearance_min_m": 0.12})
    far = make_flight(**{"tip.tracking_max_m": 0.05})
    values = measure_follow({"flight": [near, far]}).values
    assert values["clearance_m"] == 0.12 and values["tip_max_m"] == 0.05
    lost = make_flight()
    del lost.info["metrics"]["tip.tracking_max_m"]
    with pytest.raises(InputError, match=r"tip\.tracking_max_m"):
        measure_follow({"flight": [near, lost]})


def test_the_free_joint_spares_the_platform_as_in_the_spatial_model():
    """The same push on MuJoCo's model, arms held by their inertia's rows being left out."""
    d = load_description("bar-transport", sets={"mission.task.bar_length_m": 0.0})
    scene = build_scene(d.robot, d.world)
    model = scene.model
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 2, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    joint = int(model.jnt_dofadr[model.joint("pendulum").id])
    end = 0.5 * sum(data.xanchor[model.joint(f"{s}_shoulder_pitch").id] for s in ("left", "right"))
    J = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, J, None, end, model.body("pendulum").id)
    found = []
    for rows in ([0, 2, 4, joint], [0, 2, 4]):
        found.append(abs(np.linalg.solve(M[np.ix_(rows, rows)], J[0, rows])[2]))
    values = measure_free_joint({}).values
    assert values["free_rad_s2"] == pytest.approx(found[0], rel=1e-6)
    assert values["fixed_rad_s2"] == pytest.approx(found[1], rel=1e-6)
