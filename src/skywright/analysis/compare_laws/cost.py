"""Computing time of a law: its step alone, on the records of a hover."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from skywright.description.loader import Description
from skywright.run.backends import build_vehicle
from skywright.vehicle.bus import Clock
from skywright.vehicle.schedule import repeat_row
from skywright.vehicle.stepped import LawStep

CALLS, ROUNDS = 500, 15


def measure_cost(description: Description[Any]) -> float:
    """Return the median processor time (s) of a step of the mission's law.

    A law in Python is called through the interpreter, as in flight.
    """
    law = LawStep(build_vehicle(description))
    a = law.assembly
    mine = [i for i, step in enumerate(a.steps) if step.component is law.vehicle.law]
    at, clock = int(a.rows.ctypes.data), a.address(Clock)
    law.step()  # compiles the step and fills its inputs
    every = int(a.rows["every"][mine[0]])
    tick = a.get(Clock)
    tick["tick"] += (int(a.rows["phase"][mine[0]]) - int(tick["tick"])) % every  # make the step due
    spent = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        for i in mine:
            if a.rows["function"][i] == 0:
                for _ in range(CALLS):
                    a.run_python(i)
            else:
                repeat_row(at, i, clock, CALLS)
        spent.append((time.process_time() - begin) / CALLS)
    return float(np.median(spent[1:]))
