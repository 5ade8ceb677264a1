"""Profile of a physics step, by phase of a mission.

    python benchmarks/profile_steps.py MISSION [--set KEY=VALUE]... [--plain | --options]

`--plain` disables MuJoCo's timers, which take as long as a small step, and prints the processor
time of a step including control and mission.

`--options` flies nothing: the scene on the ground is stepped with other options of MuJoCo, in
turns, and the differences after 300 steps are printed.

MuJoCo's timers use the processor time of this thread, so that other programs have little effect.
`run` is everything between two steps of MuJoCo: control, sensors, and the mission's Python code.
Shares are relative to mj_step; broad and narrow phase are parts of the collision.
"""

from __future__ import annotations

import argparse
import ctypes
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import mujoco
import numba
import numpy as np

from skywright.description.loader import load_description
from skywright.evidence.bench.insertion import time_step
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor

STEPS = 300
CPU_OF_THREAD = 3
"""CLOCK_THREAD_CPUTIME_ID of Linux."""
SHOWN = {
    "kinematics": "POS_KINEMATICS", "inertia": "POS_INERTIA", "broad": "COL_BROAD",
    "narrow": "COL_NARROW", "collision": "POS_COLLISION", "rows": "POS_MAKE",
    "projection": "POS_PROJECT", "velocity": "VELOCITY", "constraint": "CONSTRAINT",
    "advance": "ADVANCE",
}  # fmt: skip
"""Printed name -> MuJoCo's timer."""
_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_int


@numba.cfunc("float64()")
def read_cpu() -> float:
    """Return the processor time (s) of this thread: MuJoCo's clock, without the interpreter."""
    a = np.empty(2, np.int64)
    _clock(CPU_OF_THREAD, a.ctypes.data)
    return a[0] + 1e-9 * a[1]  # type: ignore[no-any-return]


def find_timer(sums: Any, name: str) -> float:
    """Return the time (s) of one of MuJoCo's timers."""
    return float(sums[2 + int(getattr(mujoco.mjtTimer, f"mjTIMER_{name}"))])


class Profile:
    """Sums of the timers by phase; `begin` is called at the start of a phase."""

    def __init__(self, vehicle: Any) -> None:
        self.data, self.phase = vehicle.sim.data, "start"
        self.sums: dict[str, Any] = defaultdict(lambda: np.zeros(2 + int(mujoco.mjtTimer.mjNTIMER)))
        self.seen: dict[str, list[Any]] = defaultdict(list)
        self.last = self._read()

    def _read(self) -> Any:
        timers = [float(t.duration) for t in self.data.timer]
        return np.array([time.thread_time(), float(self.data.timer[0].number), *timers])

    def begin(self, before: Sequence[Any], name: str) -> None:
        """Add the times of the previous phase."""
        now = self._read()
        self.sums[self.phase] += now - self.last
        self.last, self.phase = now, name

    def look(self, *_: Any) -> None:
        """Record contacts, rows and iterations, once per mission tick."""
        d = self.data
        self.seen[self.phase].append((d.ncon, d.nefc, d.solver_niter[0]))

    def print(self) -> None:
        """Print one line per phase, and the whole flight."""
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


def compare_options(vehicle: Any) -> None:
    """Print the time of a step with other options, relative to the default ones."""
    model, data, spec = vehicle.scene.model, vehicle.sim.data, mujoco.mjtState.mjSTATE_INTEGRATION
    mujoco.mj_step(model, data, nstep=200)
    begin = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, begin, spec)
    flags, rounds = int(model.opt.disableflags), int(model.opt.noslip_iterations)
    island, contact = mujoco.mjtDisableBit.mjDSBL_ISLAND, mujoco.mjtDisableBit.mjDSBL_CONTACT
    cases = {
        "as it is": (flags, rounds), "the same": (flags, rounds),
        "islands": (flags & ~int(island), rounds), "no no-slip solver": (flags, 0),
        "no contacts": (flags | int(contact), rounds),
    }  # fmt: skip
    times: dict[str, list[float]] = defaultdict(list)
    places = {}
    for _ in range(9):
        for name, (model.opt.disableflags, model.opt.noslip_iterations) in cases.items():
            mujoco.mj_setState(model, data, begin, spec)
            mujoco.mj_forward(model, data)
            since = time.thread_time()
            mujoco.mj_step(model, data, nstep=STEPS)
            times[name].append((time.thread_time() - since) / STEPS)
            places[name] = data.qpos.copy()
    first = np.median(times["as it is"])
    print(f"{1e6 * first:.1f} us a step")
    for name, spent in times.items():
        away = np.max(np.abs(places[name] - places["as it is"]))
        print(f"{name}: {np.median(spent) / first:.2f}, {away:.1e} m or rad away")


def main() -> None:
    """Fly one mission and print its profile."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--options", action="store_true")
    args = parser.parse_args()
    d = load_description(args.mission, sets=args.sets)
    if args.options:
        compare_options(build_vehicle(d))
        return
    if args.plain:
        print(f"{1e6 * time_step(d):.1f} us a step")
        return
    plan, vehicle = plan_mission(d), build_vehicle(d)
    if not plan.feasible:
        raise SystemExit(f"no plan: {plan.blocked_by}")
    model = vehicle.scene.model
    print(f"{model.nv} degrees of freedom, {model.ngeom} geometries")
    height = vehicle.robot.platform.gear_height_m
    callback = ctypes.CFUNCTYPE(ctypes.c_double)(read_cpu.address)
    mujoco.set_mjcb_time(callback)
    try:
        profile = Profile(vehicle)
        Supervisor(
            vehicle, d.mission, plan, height, profile.begin, on_tick=profile.look
        ).fly()  # fmt: skip
        profile.begin((), "end")
    finally:
        mujoco.set_mjcb_time(None)
    profile.print()


if __name__ == "__main__":
    main()
