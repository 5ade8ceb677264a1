"""Where the time of a physics step goes, phase by phase of a mission.

    python benchmarks/profile_steps.py MISSION [--set KEY=VALUE]...

MuJoCo's own timers run on the processor time of this thread, so that other programs disturb them
little. `run` is everything between two steps of MuJoCo: control, sensors, and the mission's Python.
Shares are of mj_step; broad and narrow phase are parts of the collision.
"""

from __future__ import annotations

import argparse
import ctypes
import time
from collections import defaultdict
from typing import Any

import mujoco
import numba
import numpy as np

from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor

CPU_OF_THREAD = 3
"""CLOCK_THREAD_CPUTIME_ID of Linux."""
SHOWN = {
    "kinematics": "POS_KINEMATICS", "inertia": "POS_INERTIA", "broad": "COL_BROAD",
    "narrow": "COL_NARROW", "collision": "POS_COLLISION", "rows": "POS_MAKE",
    "projection": "POS_PROJECT", "velocity": "VELOCITY", "constraint": "CONSTRAINT",
    "advance": "ADVANCE",
}  # fmt: skip
"""What is printed -> MuJoCo's timer."""
_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_int


@numba.cfunc("float64()")
def read_cpu() -> float:
    """Return the processor time (s) of this thread: MuJoCo's clock, with no interpreter in it."""
    a = np.empty(2, np.int64)
    _clock(CPU_OF_THREAD, a.ctypes.data)
    return a[0] + 1e-9 * a[1]  # type: ignore[no-any-return]


def find_timer(sums: Any, name: str) -> float:
    """Return the time (s) of one of MuJoCo's timers."""
    return float(sums[2 + int(getattr(mujoco.mjtTimer, f"mjTIMER_{name}"))])


class Profile:
    """Sums of the timers by phase; `begin` is called where a phase begins."""

    def __init__(self, vehicle: Any) -> None:
        self.data, self.phase = vehicle.sim.data, "start"
        self.sums: dict[str, Any] = defaultdict(lambda: np.zeros(2 + int(mujoco.mjtTimer.mjNTIMER)))
        self.seen: dict[str, list[Any]] = defaultdict(list)
        self.last = self._read()

    def _read(self) -> Any:
        timers = [float(t.duration) for t in self.data.timer]
        return np.array([time.thread_time(), float(self.data.timer[0].number), *timers])

    def begin(self, index: int, name: str) -> None:
        """Add what the phase before took."""
        now = self._read()
        self.sums[self.phase] += now - self.last
        self.last, self.phase = now, name

    def look(self, *_: Any) -> None:
        """Note contacts, rows and iterations, once a mission tick."""
        d = self.data
        self.seen[self.phase].append((d.ncon, d.nefc, d.solver_niter[0]))

    def print(self) -> None:
        """Print a line a phase, and the whole flight."""
        total = np.sum(list(self.sums.values()), axis=0)
        for name, sums in [*self.sums.items(), ("whole flight", total)]:
            steps = sums[1]
            if steps < 1.0:
                continue
            looks = self.seen.get(name) or [x for y in self.seen.values() for x in y] or [(0, 0, 0)]
            contacts, rows, rounds = np.mean(looks, axis=0)
            whole = find_timer(sums, "STEP")
            shares = " ".join(
                f"{what} {100.0 * find_timer(sums, timer) / whole:.0f} %"
                for what, timer in SHOWN.items()
            )
            print(
                f"{name}: {steps:.0f} steps, run {1e6 * (sums[0] - whole) / steps:.1f} us, mj_step "
                f"{1e6 * whole / steps:.1f} us; contacts {contacts:.1f}, rows {rows:.1f}, "
                f"iterations {rounds:.1f}; {shares}"
            )


def main() -> None:
    """Fly one mission and print its profile."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    args = parser.parse_args()
    d = load_description(args.mission, sets=args.sets)
    plan, vehicle = plan_mission(d), build_vehicle(d)
    if not plan.feasible:
        raise SystemExit(f"no plan: {plan.blocked_by}")
    model = vehicle.scene.model
    print(f"{model.nv} degrees of freedom, {model.ngeom} geometries")
    callback = ctypes.CFUNCTYPE(ctypes.c_double)(read_cpu.address)
    mujoco.set_mjcb_time(callback)
    try:
        profile = Profile(vehicle)
        height = vehicle.robot.platform.gear_height_m
        Supervisor(
            vehicle, d.mission, plan, height, profile.begin, on_tick=profile.look
        ).fly()  # fmt: skip
        profile.begin(-1, "end")
    finally:
        mujoco.set_mjcb_time(None)
    profile.print()


if __name__ == "__main__":
    main()
