"""Ratios measured side by side in one process: `python -m skywright.studies.bench`.

Closed loop over bare `mj_step`: the same stretch of a scan in contact is flown with sensors,
control and recording in both ways of running, and stepped by MuJoCo alone with the controls that
were flown (without them the robot would fall off the pipe, which is cheaper to simulate). The
rounds alternate, so that a busy machine slows all of them alike; the ratio is of medians.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from skywright.core.recording import RecordingWriter
from skywright.evaluation.run import build_vehicle, collect_versions
from skywright.missions.loader import load_description
from skywright.missions.planning import plan_mission
from skywright.models.rigid_body import joint_names
from skywright.sim.simulation import Snapshot
from skywright.vehicle.interface import Uav, WholeBody

ROUNDS = 9
SECONDS = 5.0  # simulated, a round


def measure_loop(folder: Path) -> dict[str, float]:
    """Time of bare stepping, of the fast and of the interactive closed loop, us a physics step."""
    description = load_description("pipe-weld-scan")
    plan = plan_mission(description)
    vehicle = build_vehicle(description)
    writer = RecordingWriter(
        folder / "bench.mcap",
        joint_names(description.robot),
        len(description.robot.rotors.azimuth_deg),
    )
    _fly_into_contact(vehicle, plan)
    vehicle.flush()
    vehicle.on_samples = writer.append
    sim = vehicle.sim
    ticks = round(SECONDS / 0.02)
    steps = ticks * vehicle.n_ticks * vehicle.n_steps

    def closed_loop(interactive: bool) -> float:
        vehicle.interactive = interactive
        start = time.perf_counter()
        for _ in range(ticks):
            vehicle.tick()
        vehicle.flush()
        return time.perf_counter() - start

    times: dict[str, list[float]] = {"bare": [], "fast": [], "interactive": []}
    for _ in range(ROUNDS + 1):  # the first round warms up
        before = Snapshot(sim)
        controls, forces = _record_controls(vehicle, ticks)
        after = Snapshot(sim)
        before.restore(sim)
        times["bare"].append(_replay(vehicle, controls, forces))
        after.restore(sim)
        times["fast"].append(closed_loop(False))
        times["interactive"].append(closed_loop(True))
    writer.close()
    out = {f"{k}_us_per_step": 1e6 * statistics.median(v[1:]) / steps for k, v in times.items()}
    for name in ("fast", "interactive"):
        ratios = [a / b for a, b in zip(times[name][1:], times["bare"][1:], strict=True)]
        out[f"{name}_over_bare"] = statistics.median(ratios)
    return out


def _fly_into_contact(vehicle: Any, plan: Any) -> None:
    uav, body = Uav(vehicle), WholeBody(vehicle)
    tables = [plan.segments[n] for n in ("approach", "unfold", "close_in", "touch", "scan")]
    for _ in range(50):
        vehicle.tick()
    uav.motors(True)
    uav.take_off(1.2)
    while not vehicle.tick().arrived:
        pass
    for table in tables[:-1]:
        body.track(table)
        while not vehicle.tick().arrived:
            pass
    body.track(tables[-1])
    for _ in range(100):
        vehicle.tick()


def _record_controls(vehicle: Any, ticks: int) -> tuple[Any, Any]:
    """Fly `ticks` interactively one control tick at a time and keep what was applied."""
    controls, forces = [], []
    sim, keep = vehicle.sim, (vehicle.interactive, vehicle.n_ticks)
    vehicle.interactive, vehicle.n_ticks = True, 1
    for _ in range(ticks * keep[1]):
        vehicle.tick()
        controls.append(sim.ctrl.copy())
        forces.append(sim.xfrc.copy())
    vehicle.interactive, vehicle.n_ticks = keep
    return np.array(controls), np.array(forces)


def _replay(vehicle: Any, controls: Any, forces: Any) -> float:
    """Bare `mj_step` with recorded controls, called as MuJoCo's users do."""
    sim, n = vehicle.sim, vehicle.n_steps
    start = time.perf_counter()
    for control, force in zip(controls, forces, strict=True):
        sim.ctrl[:] = control
        sim.xfrc[:] = force
        sim.step(n)
    return time.perf_counter() - start


def measure_run(folder: Path) -> dict[str, float]:
    """A whole warm run in a process of its own, and the start of the command line."""
    command = [sys.executable, "-m", "skywright"]
    help_times = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([*command, "--help"], check=True, capture_output=True)
        help_times.append(time.perf_counter() - start)
    out = folder / "run"
    start = time.perf_counter()
    done = subprocess.run(
        [*command, "run", "pipe-weld-scan", "--out", str(out), "--json"], capture_output=True
    )
    wall = time.perf_counter() - start
    timing = json.loads(done.stdout)["timing"]
    return {
        "help_s": statistics.median(help_times),
        "run_wall_s": wall,
        "real_time_factor": timing["real_time_factor"],
        "plan_s": timing["plan_s"],
    }


def main() -> int:
    """Measure, print a table, and write the result beside the others."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results"))
    folder = parser.parse_args().out
    with tempfile.TemporaryDirectory() as scratch:
        values = {**measure_loop(Path(scratch)), **measure_run(Path(scratch))}
    limits = {
        "fast_over_bare": 1.2,
        "interactive_over_bare": 1.8,
        "real_time_factor": 40.0,
        "run_wall_s": 10.0,
        "help_s": 0.4,
        "plan_s": 1.0,
    }
    for name, value in values.items():
        limit = f"  (limit {limits[name]:g})" if name in limits else ""
        print(f"{name:28s} {value:8.3f}{limit}")
    folder.mkdir(parents=True, exist_ok=True)
    record = {
        "when": time.strftime("%Y-%m-%d"),
        "machine": {"processor": _processor(), "cores": os.cpu_count()},
        "versions": collect_versions(),
        "values": {k: round(v, 4) for k, v in values.items()},
    }
    (folder / "loop.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return 0


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main())
