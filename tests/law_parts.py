"""The records that a law's step gets, to call it without a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import View
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.laws.impedance import Impedance
from skywright.vehicle.laws.push_and_slide import PushAndSlide
from skywright.vehicle.laws.thrust_vectoring import ThrustVectoring
from skywright.vehicle.laws.tip_pd import TipPd


class Me(ThrustVectoring.Me, TipPd.Me, PushAndSlide.Me, Impedance.Me):
    """Parameters and memory of every law with three loops."""


RECORDS = {
    "me": Me, "ref": Reference, "est": Estimate, "body": Body, "allocated": Allocated,
    "cmd": WrenchCommand,
}  # fmt: skip


def build_case() -> dict[str, Any]:
    """Return the records of a law with three loops, by name: at rest and level, motors on."""
    b = {name: np.zeros(1, record.dtype)[0] for name, record in RECORDS.items()}
    me, body = b["me"], b["body"]
    me["dt"], me["wn_p"], me["zeta_p"], me["wi_p"] = 0.002, 6.0, 1.2, 0.5
    me["wn_R"], me["zeta_R"], me["wi_R"], me["k_arm"] = 11.0, 1.0, 0.5, 3.0
    me["tilt_max"], me["thrust_max"] = 0.4, 60.0
    me["f_integral_max"], me["t_integral_max"] = 8.0, 2.0
    me["belt"][:2, :2] = [[1, 0], [-1, 1]]
    me["belt_inv"][:2, :2] = [[1, 0], [1, 1]]
    me["motor_speed_max"] = 5.0
    body["mass"], body["gravity"] = 2.25, 9.81
    body["I_B"], body["n_joints"] = np.diag([0.07, 0.14, 0.2]), 2
    for part in ("ref", "est"):
        for name in ("R_WB", "R_WT"):
            b[part][name] = np.eye(3)
    b["ref"]["R_WS"], b["ref"]["active"] = np.eye(3), 1.0
    return b


def call(law: Any, b: dict[str, Any]) -> None:
    """Run a law's step as plain Python."""
    law.step(*(View(b[name]) for name in RECORDS))
