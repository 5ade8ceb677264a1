"""Fly logs in Skywright's simulator: identify the robot, and lead its rotors by the logs' commands.

Identifies the robot from all logs, writes the robot file, and then simulates the parts of the logs
that the identification did not see, in windows. A window starts from the logged attitude and body
rates; from there on the logged motor commands are the only input of the plant (MuJoCo, with the
rotors' lag, drag and momentum). No controller holds the simulated robot. Prints the errors at the
windows' ends beside those of a robot that keeps its state, and draws `fly_log.png`.

    python examples/identify/fly_log.py log10.csv log15.csv log16.csv

`crazyflie_log.py` makes these tables. `--robot` is the robot file that the identification extends.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from scipy.signal import butter, sosfilt

import skywright
from skywright.analysis.identify.fit import choose_held_out, predict
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import Identification, identify
from skywright.analysis.identify.load import load_log
from skywright.analysis.identify.overrides import build_overrides
from skywright.analysis.identify.signals import build_columns
from skywright.core.rotations import rot_to_quat
from skywright.description.robot.loader import load_robot
from skywright.links.sitl.plant import SitlPlant
from skywright.models.part_masses import platform_inertia
from skywright.models.rotors import build_rotors

matplotlib.use("Agg")
import matplotlib.pyplot as plt

WINDOWS = (0.1, 0.25, 0.5, 1.0)  # s
SLOW = 5.0  # Hz, of the specific force that tells the velocity at the start
SHOWN = 4.0  # s of a log in the picture
INSIDE = 2.0  # s, after lift-off and before landing, that are left out
SPIN_UP = 0.5  # s, before a part, in which the rotors come to their speeds
EXACT = {
    f"plant.{key}": 0.0
    for key in (
        "mass_error", "rotor_gain_error", "rotor_gain_spread", "com_x_error_m", "com_y_error_m",
        "com_z_error_m", "inertia_error", "drag_error",
    )
}  # fmt: skip
"""The plant is the identified robot."""
CHANNELS = (
    "rate of roll, rad/s", "rate of pitch, rad/s", "rate of yaw, rad/s", "tilt, deg",
    "velocity along z, m/s",
)  # fmt: skip


class Flown:
    """A log beside its simulation, window by window."""

    def __init__(self, log: FlightLog, found: Identification, robot: Path) -> None:
        self.log, self.dt = log, float(log.t[1] - log.t[0])
        self.plant = SitlPlant(skywright.load("waypoints", robot=str(robot), sets=EXACT))
        if abs(self.plant.period - self.dt) > 1e-6:
            raise SystemExit(f"{log.name}: {1 / self.dt:.0f} Hz; needed: {1 / self.plant.period:g}")
        values = {e.parameter.name: e.value for e in found.fit.estimates}
        gain = np.array([values[f"rotor_gain_{i + 1}"] for i in range(self.plant.n_rotors)])
        full = np.sqrt(found.robot.rotors.thrust_max_n
                       / found.robot.rotors.thrust_coefficient_n_per_rad2s2)  # fmt: skip
        # the robot file has the mean of the gains
        self.command = log.rotor_command / full * np.sqrt(gain / gain.mean())
        self.command = self._trim(found)
        self.late = round(values["rotor_delay_s"] / self.dt)
        rotors = self.plant.setup.robot.rotors
        self.drag = rotors.drag_coefficient_n_per_rads_mps / found.fit.mass
        sos = butter(2, SLOW, fs=1.0 / self.dt, output="sos")
        self.slow = sosfilt(sos, log.specific_force_B, axis=0)

    def _trim(self, found: Identification) -> np.ndarray:
        """Return commands with the torque that the model misses in the mean of the fitted parts.

        Trim differs from flight to flight (battery's place, a propeller): 2 mm of the centre of
        mass are 30 rad/s^2.
        """
        x = np.array([e.value for e in found.fit.estimates])
        columns = build_columns(self.log, found.command_lag)
        rotors = build_rotors(found.robot.rotors)
        missed = columns.wd - predict(columns, rotors, found.fit.mass, x)[:, 3:]
        bias = missed[~choose_held_out(columns.t)].mean(axis=0)
        print(f"{self.log.name}: trim of {np.round(bias, 1)} rad/s^2")
        robot = self.plant.setup.robot
        inertia = np.diag(platform_inertia(robot.platform))
        wanted = np.array([0.0, 0.0, 0.0, *(inertia * bias)])
        thrust = np.linalg.pinv(build_rotors(robot.rotors).B) @ wanted
        squared = self.command**2 + thrust / robot.rotors.thrust_max_n
        return np.where(self.command > 0.0, np.sqrt(np.maximum(squared, 0.0)), 0.0)

    def fly(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the samples flown (k,), their simulated rates (k, 3), and errors.

        Errors are (windows, WINDOWS, 2, channels): of the simulation, and of a robot that keeps
        the state of the start. Between windows the robot is led along the log.
        """
        log, ends = self.log, [round(window / self.dt) for window in WINDOWS]
        inside = round(INSIDE / self.dt)
        flies = np.convolve(log.free, np.ones(2 * inside + 1), "same") > 2 * inside + 0.5
        held_out = choose_held_out(log.t) & flies
        up = log.gravity * np.array([0.0, 0.0, 1.0])
        a_W = np.einsum("kij,kj->ki", log.R_WB, log.specific_force_B) - up
        v_z = np.cumsum(a_W[:, 2]) * self.dt
        at, rates, errors, start = [], [], [], -1
        spin_up = round(SPIN_UP / self.dt)
        for k in range(self.late, len(log.t) - ends[-1]):
            if not held_out[k : k + spin_up].any() and start < 0:
                continue
            if start >= 0 and k - start in ends:
                errors[-1].append(self._compare(start, k, v_z))
            if start < 0 or k == start + ends[-1]:
                start = k if held_out[k : k + ends[-1] + 1].all() else -1
                self._place(k)
                if start >= 0:
                    errors.append([])
            if start >= 0:
                at.append(k)
                rates.append(self.plant.vehicle.sim.qvel[3:6].copy())
            self.plant.step(np.clip(self.command[k - self.late], 0.0, 1.0))
        whole = [e for e in errors if len(e) == len(ends)]
        return np.array(at), np.array(rates), np.array(whole)

    def _place(self, k: int) -> None:
        """Put the simulated robot into the state that is logged at sample k."""
        sim, log = self.plant.vehicle.sim, self.log
        speeds = np.sum(self.command[k - self.late] * self.plant.speed_max)
        v_B = np.zeros(3)
        if log.v_WB is None:  # the drag of the rotors tells it
            v_B[:2] = -self.slow[k, :2] / (self.drag * max(speeds, 1.0))
        sim.qpos[:3] = 0.0, 0.0, 50.0
        rot_to_quat(np.ascontiguousarray(log.R_WB[k]), sim.qpos[3:7])
        sim.qvel[:3] = log.R_WB[k] @ v_B if log.v_WB is None else log.v_WB[k]
        sim.qvel[3:6] = log.w_WB_B[k]
        self.started = sim.qvel[:3].copy()

    def _compare(self, start: int, end: int, v_z: np.ndarray) -> np.ndarray:
        """Return the errors (2, channels) at sample `end`."""
        sim, log = self.plant.vehicle.sim, self.log
        q = sim.qpos[3:7]
        up = np.array([2 * (q[1] * q[3] - q[0] * q[2]), 2 * (q[2] * q[3] + q[0] * q[1]),
                       1 - 2 * (q[1] ** 2 + q[2] ** 2)])  # fmt: skip

        def tilt(z: np.ndarray) -> float:
            return float(np.degrees(np.arccos(np.clip(z @ log.R_WB[end, 2], -1.0, 1.0))))

        moved = v_z[end - 1] - v_z[start - 1]
        rises = sim.qvel[2] - self.started[2]
        return np.array([
            [*(sim.qvel[3:6] - log.w_WB_B[end]), tilt(up), rises - moved],
            [*(log.w_WB_B[start] - log.w_WB_B[end]), tilt(log.R_WB[start, 2]), -moved],
        ])  # fmt: skip


def draw(flown: list[tuple[Flown, np.ndarray, np.ndarray]], path: Path) -> None:
    """Draw logged and simulated rates of each log, the windows one after the other."""
    figure, axes = plt.subplots(3, len(flown), figsize=(4.2 * len(flown), 6.0), squeeze=False)
    for column, (one, at, simulated) in zip(axes.T, flown, strict=True):
        t, logged = one.log.t[at], one.log.w_WB_B[at]
        parts = np.split(np.arange(len(at)), 1 + np.flatnonzero(np.diff(at) != 1))
        longest = max(parts, key=lambda p: float(np.sum(np.var(logged[p], axis=0))) * len(p))
        show = longest[t[longest] <= t[longest[0]] + SHOWN]
        for i, (axis, name) in enumerate(zip(column, ("roll", "pitch", "yaw"), strict=True)):
            y = simulated[show, i].copy()
            y[:: round(WINDOWS[-1] / one.dt)] = np.nan  # a new window
            axis.plot(t[show], logged[show, i], "k", lw=1.2, label="log")
            axis.plot(t[show], y, color="#d55e00", lw=1.2, label="simulated")
            room = 0.5 * float(np.ptp(logged[show, i]))
            axis.set_ylim(logged[show, i].min() - room, logged[show, i].max() + room)
            axis.set_ylabel(f"{name} (rad/s)")
        column[0].set_title(one.log.name)
        column[0].legend(loc="upper right")
        column[-1].set_xlabel("time (s)")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Identify, fly, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("logs", nargs="+", type=Path)
    here = Path(__file__).parent / "crazyflie" / "robot.toml"
    parser.add_argument("--robot", type=Path, default=here)
    parser.add_argument("--out", type=Path, default=Path("fly_log.png"))
    a = parser.parse_args()
    robot = load_robot(str(a.robot))[0]
    found = identify(a.logs, robot)
    file = a.out.with_suffix(".toml")
    file.write_text(build_overrides(found, str(a.robot.resolve())), encoding="utf-8")
    flown = [Flown(load_log(path, robot), found, file) for path in a.logs]
    print("error at a window's end, rms, of rms change (share that is explained)")
    drawn = []
    for one in flown:
        at, rates, errors = one.fly()
        drawn.append((one, at, rates))
        print(f"{one.log.name}, {len(errors)} windows")
        model, still = np.sqrt(np.mean(errors**2, axis=0)).transpose(1, 0, 2)
        for i, name in enumerate(CHANNELS):
            told = [
                f"{window:g} s {e:.2f} of {s:.2f} ({1 - (e / s) ** 2:.2f})"
                for window, e, s in zip(WINDOWS, model[:, i], still[:, i], strict=True)
            ]
            print(f"  {name}: " + ", ".join(told))
    draw(drawn, a.out)
    print(f"{file}, {a.out}")


if __name__ == "__main__":
    main()
