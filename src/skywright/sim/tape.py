"""Double-sided tape on a hand: what pressing leaves and pulling breaks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.models.things.tape import Tape

Record = Any

TOUCH = 0.02  # N, force above which the tape is being pressed

f8, i8 = np.float64, np.int64

TAPE = np.dtype(
    [
        ("on", i8),
        ("hand", i8),
        ("body", i8),
        ("strength", f8),
        ("press", f8),  # N s
        ("release", f8),  # N
        ("stiffness", f8),  # N/m
        ("impulse", f8),  # N s, pressed so far
        ("bond", f8),  # N
        ("anchor_W", f8, 3),  # m, where the hand was while it pressed
        ("normal_W", f8, 3),  # direction of pressing
        ("pull", f8),  # N, tension now
        ("parted", i8),  # 1: the holder let go, the sensor stays; 2: the bond gave way
    ]
)
"""Parameters and state of the tape."""


@njit(cache=True, error_model="numpy")
def step_tape(tape: Record, p_WH: Any, f_WH: Any, dt: float, xfrc: Any) -> None:
    """Advance the bond and write the tension on the hand's body into `xfrc`.

    p_WH (3,) m is the hand, f_WH (3,) N the force that it exerts, tension included. The tension
    acts along the direction of pressing only.
    """
    if tape.bond == 0.0:
        force = math.sqrt(f_WH[0] ** 2 + f_WH[1] ** 2 + f_WH[2] ** 2)
    else:  # tension is no pressing
        force = 0.0
        for a in range(3):
            force += f_WH[a] * tape.normal_W[a]
    tape.pull = 0.0
    if tape.parted == 0 and force > TOUCH:
        tape.impulse += force * dt
        tape.bond = tape.strength * (1.0 - math.exp(-tape.impulse / tape.press))
        for a in range(3):
            tape.anchor_W[a] = p_WH[a]
        size = math.sqrt(f_WH[0] ** 2 + f_WH[1] ** 2 + f_WH[2] ** 2)
        for a in range(3):
            tape.normal_W[a] = f_WH[a] / size
    elif tape.parted == 0 and tape.bond > 0.0:
        back = 0.0
        for a in range(3):
            back += (tape.anchor_W[a] - p_WH[a]) * tape.normal_W[a]
        tape.pull = tape.stiffness * max(back, 0.0)
        if tape.pull > min(tape.bond, tape.release):
            tape.parted = 1 if tape.bond >= tape.release else 2
            tape.pull = 0.0
    for a in range(3):
        xfrc[tape.body, a] = tape.pull * tape.normal_W[a]


def fill_tape(record: Record, tape: Tape | None, bodies: Any) -> None:
    """Write a TAPE record; `bodies` are the hands' bodies, -1 where a hand has none."""
    if tape is None:
        return
    record["hand"] = int(tape.hand == "right")
    if record["hand"] >= len(bodies) or bodies[record["hand"]] < 0:
        return
    record["on"], record["body"] = 1, bodies[record["hand"]]
    record["strength"], record["press"] = tape.strength_n, tape.press_n_s
    record["release"], record["stiffness"] = tape.release_n, tape.stiffness_n_per_m
