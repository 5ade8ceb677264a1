"""The run directory of a flight under an autopilot: truth, its estimate and its set-points."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_from_quat
from skywright.links.sitl.plant import SitlPlant
from skywright.run.directory import open_directory, write_json, write_unfinished
from skywright.run.flight_recording import FlightRecording
from skywright.run.operated import write_mission
from skywright.run.planning import MissionPlan
from skywright.run.versions import collect_versions

FLUSH_S = 1.0
"""s between writes: the data lost when a process is killed."""
PHASE = "autopilot"


class SitlDirectory:
    """Writes NAME.partial during the flight, and NAME at its end."""

    def __init__(self, out: Path | None, plant: SitlPlant, backend: str, command: str) -> None:
        """`backend` names the autopilot; `command` is recorded. Raises InputError as for runs."""
        d = plant.description
        self.final, self.partial = open_directory(out, f"{d.robot.name}-{backend}")
        plan: MissionPlan[Any] = MissionPlan(True, None, 0.0, 0.0, 0.0, 0.0, {})
        write_mission(self.partial, d, plan)
        write_unfinished(self.partial)
        self._plant, self._backend, self._command = plant, backend, command
        self._writer = FlightRecording(self.partial, d.robot, plant.vehicle.recorded)
        plant.vehicle.on_stream = self._writer.append_stream
        plant.vehicle.on_samples = self._append
        self._judged = Judged()
        self._next, self._start = FLUSH_S, time.time()
        self.events: list[tuple[float, str]] = []
        self._writer.phase(0.0, PHASE)

    def _append(self, samples: NDArray[Any]) -> None:
        self._writer.append(samples)
        self._judged.add(samples)

    def note(self, says: str) -> None:
        """Record an event with the current time."""
        if len(self.events) < 1000:
            self.events.append((self._plant.t, says))
            self._writer.event(self._plant.t, says)

    def tick(self) -> None:
        """Write recorded data, once a second."""
        if self._plant.t >= self._next:
            self._next = self._plant.t + FLUSH_S
            self._plant.vehicle.flush()

    def finish(self, outcome: str, reason: str) -> Path:
        """Close the recording and write metrics.json; return the directory.

        A flight with the outcome "finished" is complete; any other stays NAME.partial.
        """
        self._plant.vehicle.flush()
        if outcome != "finished":
            self._writer.event(self._plant.t, f"{outcome}: {reason}")
        self._writer.close()
        wall = time.time() - self._start
        self.factor = self._plant.t / max(wall, 1e-9)
        value = self._build_json(outcome, reason, wall)
        write_json(self.partial / "metrics.json", value)
        if outcome != "finished":
            return self.partial
        self.partial.rename(self.final)
        return self.final

    def _build_json(self, outcome: str, reason: str, wall: float) -> dict[str, Any]:
        d, t = self._plant.description, self._plant.t
        phase = {"name": PHASE, "start_s": 0.0, "end_s": t, "outcome": "done"}
        self.metrics = self._judged.compute()
        return {
            "mission": d.mission.name, "robot": d.robot.name, "world": d.world.name,
            "seed": d.mission.seed, "backend": self._backend, "command": self._command,
            "outcome": outcome, "reason": reason, "requirements": [], "waived": {},
            "result": {"events": self.events}, "inspected": None, "metrics": self.metrics,
            "phases": [phase], "faults": [], "checklist": [],
            "timing": {
                "simulated_s": t, "wall_s": wall, "real_time_factor": self.factor,
                "plan_s": 0.0, "started_unix_s": round(self._start, 3),
            },
            "versions": collect_versions(),
        }  # fmt: skip


class Judged:
    """Sums over a flight of any length."""

    def __init__(self) -> None:
        self.n = self.n_armed = self.n_heard = 0
        self.squares = np.zeros(2)  # of position errors (m) and attitude errors (rad) while armed
        self.largest = np.zeros(2)
        self.height = -np.inf
        self.period = 0.0

    def add(self, samples: NDArray[Any]) -> None:
        """Add samples of the recording."""
        self.n += len(samples)
        if len(samples) > 1:
            self.period = float(samples["t"][1] - samples["t"][0])
        if len(samples):
            self.height = max(self.height, float(samples["p_WB"][:, 2].max()))
        armed = samples[samples["autopilot_armed"] > 0.5]
        self.n_armed += len(armed)
        heard = armed[armed["autopilot_heard"] > 0.5]
        self.n_heard += len(heard)
        if len(heard) == 0:
            return
        place = np.linalg.norm(heard["autopilot_p_WB"] - heard["p_WB"], axis=1)
        turn = [
            _measure_angle(rot_from_quat(a), rot_from_quat(b))
            for a, b in zip(heard["autopilot_q_WB"][::10], heard["q_WB"][::10], strict=True)
        ]
        self.squares += [float(place @ place), 10.0 * float(np.sum(np.square(turn)))]
        self.largest = np.maximum(self.largest, [place.max(), max(turn)])

    def compute(self) -> dict[str, float]:
        """Compute the metrics; quantities without data are omitted."""
        out = {
            "autopilot.armed_s": self.n_armed * self.period,
            "flight.height_max_m": self.height if self.n else 0.0,
        }
        if self.n_heard:
            rms = np.sqrt(self.squares / self.n_heard)
            out |= {
                "autopilot.position_error_rms_m": float(rms[0]),
                "autopilot.position_error_max_m": float(self.largest[0]),
                "autopilot.attitude_error_rms_deg": float(np.degrees(rms[1])),
                "autopilot.attitude_error_max_deg": float(np.degrees(self.largest[1])),
            }
        return out


def _measure_angle(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    cosine = 0.5 * (float(np.sum(a * b)) - 1.0)
    return float(np.arccos(min(max(cosine, -1.0), 1.0)))
