"""A log of a real quadrotor against the rotor model that Skywright simulates.

Reads logs of the Crazyflie's micro-SD deck (accelerometer, gyroscope and motor commands at 1 kHz),
writes them as tables that `skywright identify` takes, and compares three parts of the model with
what was measured: thrust, roll and pitch, and yaw. Parameters are fitted on the first half of the
flight and judged on the second. Then the fitted model is simulated over the second half, in windows
that start from the logged rates, with the logged motor commands as the only input. Needs NumPy and
SciPy only.

    python examples/identify/crazyflie_log.py log10 log15 log16

The public logs of arplaboratory/data-driven-system-identification (folder logs_crazyflie) excite
one axis each: log10 climbs and sinks, log15 rolls and pitches, log16 yaws.
"""

import struct
import sys
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

MASS = 0.027  # kg, and
LEVER = 0.028  # m of each rotor along x and y, as the authors of the logs state
ORDER = (4, 3, 2, 1)  # the log's motors, counter-clockwise from front left
X, Y = np.array([1.0, -1.0, -1.0, 1.0]), np.array([1.0, 1.0, -1.0, -1.0])
IDLE = 380.8 / 0.04077
"""Of the motors' signal: speed = 0.04077 signal + 380.8 rad/s, measured on a Crazyflie by Foerster
(System Identification of the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich 2015, section 3.2)."""
SPIN = np.array([1.0, -1.0, 1.0, -1.0])  # direction of the torque about z on the body
LAGS = np.arange(0.0, 0.16, 0.01)  # s, of the rotors, and
DELAYS = np.arange(0, 8)  # samples of 4 ms, of everything from the command to the gyroscope
BAND = (0.5, 15.0)  # Hz
FLIES = 0.35  # of the mean command
WINDOWS = (0.1, 0.25, 0.5, 1.0)  # s, of a simulation from a logged state
BEFORE = 2.0  # s, before a window, from which its constant torque or force is taken
KINDS = {"f": "f4", "I": "u4", "H": "u2", "h": "i2", "B": "u1", "i": "i4", "Q": "u8"}


def decode(path: Path) -> np.ndarray:
    """Return the rows of a log, format 2 with one kind of event."""
    data = path.read_bytes()
    if data[:3] != b"\xbc\x02\x00" or data[3:5] != b"\x01\x00":
        raise SystemExit(f"{path}: is not a log of the micro-SD deck, version 2, with one event")
    at = data.index(b"\0", 7) + 1
    (count,) = struct.unpack_from("<H", data, at)
    at, fields = at + 2, [("event", "<u2"), ("us", "<u8")]
    for _ in range(count):
        end = data.index(b"\0", at)
        name = data[at:end].decode()  # such as "acc.x(f)"
        fields.append((name[:-3], "<" + KINDS[name[-2]]))
        at = end + 1
    kind = np.dtype(fields)
    return np.frombuffer(data, kind, (len(data) - at) // kind.itemsize, at)


def build_table(rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of a table for `skywright identify`, means over 4 samples."""
    table = {"t_s": (rows["us"] - rows["us"][0]) * 1e-6}
    table |= {f"w{a}_rad_s": np.radians(rows[f"gyro.{a}"]) for a in "xyz"}
    table |= {f"a{a}_m_s2": 9.80665 * rows[f"acc.{a}"] for a in "xyz"}
    for i, k in enumerate(ORDER):
        u = rows[f"motor.m{k}"].astype(float)
        table[f"command_{i + 1}"] = np.where(u > 0, u + IDLE, 0.0) / (65535 + IDLE)
    n = len(rows) // 4 * 4
    return {k: np.asarray(v, float)[:n].reshape(-1, 4).mean(axis=1) for k, v in table.items()}


def follow(command: np.ndarray, lag: float, delay: int, dt: float) -> np.ndarray:
    """Return commands (n, 4) as the rotors follow them, by a first-order lag (s) and a delay."""
    share = 1.0 if lag == 0.0 else 1.0 - np.exp(-dt / lag)
    late = np.concatenate([command[:1].repeat(delay, axis=0), command[: len(command) - delay]])
    return lfilter([share], [1.0, share - 1.0], late, axis=0)


def simulate(state: np.ndarray, rate: np.ndarray, at: np.ndarray, dt: float) -> list[str]:
    """Compare a state (n,) with its simulation by the model's rate (n,) over windows of `at`.

    A window starts from the logged state. The constant part of the rate (trim, the battery's sag)
    is that of the seconds before it, so nothing of the window itself is used but the commands.
    Without a model the state stays as it is at the start.
    """
    whole = np.concatenate([[0.0], np.cumsum(rate[1:] * dt)])
    back, out = round(BEFORE / dt), []
    for window in WINDOWS:
        n = round(window / dt)
        starts = np.arange(at[0] + back, at[-1] - n, n)
        i = starts[:, None] + np.arange(1, n + 1)
        moved = state[i] - state[starts, None]
        past = state[starts] - state[starts - back] - whole[starts] + whole[starts - back]
        model = whole[i] - whole[starts, None] + past[:, None] / BEFORE * dt * (i - starts[:, None])
        error, still = np.sqrt(np.mean((moved - model) ** 2)), np.sqrt(np.mean(moved**2))
        out.append(f"{window:g} s {error:.2f} of {still:.2f} ({1.0 - (error / still) ** 2:.2f})")
    return out


def compare(table: dict[str, np.ndarray]) -> list[str]:
    """Compare the flight with the model: command, first-order lag, thrust by its square."""
    t = table["t_s"]
    dt = float(np.median(np.diff(t)))
    command = np.column_stack([table[f"command_{i}"] for i in range(1, 5)])
    flown = np.flatnonzero(command.mean(axis=1) > FLIES)
    begin, end = flown[0] + round(2.0 / dt), flown[-1] - round(2.0 / dt)
    first = np.arange(begin, (begin + end) // 2)
    second = np.arange((begin + end) // 2, end)
    sos = butter(2, np.array(BAND) * 2.0 * dt, "bandpass", output="sos")
    up = table["az_m_s2"]
    spun = np.column_stack([np.gradient(table[f"w{a}_rad_s"], dt) for a in "xyz"])
    force, spun = sosfiltfilt(sos, up), sosfiltfilt(sos, spun, axis=0)

    def fit(wanted: np.ndarray, build) -> tuple[float, np.ndarray, str, np.ndarray]:
        """Return what fits the first half best: R² of the second, factors, lag and delay, rate."""
        best = (np.inf, 0.0, np.zeros(1), "", wanted)
        for lag in LAGS:
            for delay in DELAYS:
                built = build(follow(command, lag, int(delay), dt))
                columns = sosfiltfilt(sos, built, axis=0)
                factors = np.linalg.lstsq(columns[first], wanted[first], rcond=None)[0]
                left = np.mean((wanted[first] - columns[first] @ factors) ** 2)
                if left < best[0]:
                    error = wanted[second] - columns[second] @ factors
                    r2 = 1.0 - np.mean(error**2) / np.var(wanted[second])
                    says = f"lag {1e3 * lag:.0f} ms, delay {1e3 * delay * dt:.0f} ms"
                    best = (left, r2, factors, says, built @ factors)
        return best[1:]

    r2, (k,), says, rate = fit(force, lambda u: np.sum(u**2, axis=1)[:, None])
    # of a frame that falls: gravity taken out, as if level
    told = {"velocity along z, m/s": (np.cumsum(up - 9.80665) * dt, rate)}
    full = MASS * k  # N of a rotor
    hover = np.sqrt(np.mean(np.mean(command[second] ** 2, axis=1)) / np.mean(up[second]) * 9.80665)
    out = [
        f"thrust: R² {r2:.2f}, {says}, {full:.3f} N a rotor at full command; "
        f"hovers at a command of {np.sqrt(MASS * 9.80665 / (4 * full)):.2f}, flown {hover:.2f}"
    ]
    for axis, name, side in ((0, "roll", Y), (1, "pitch", -X)):
        r2, (a,), says, rate = fit(spun[:, axis], lambda u, side=side: (u**2 @ side)[:, None])
        told[f"rate of {name}, rad/s"] = table[f"w{'xy'[axis]}_rad_s"], rate
        out.append(
            f"{name}: R² {r2:.2f}, {says}, "
            f"{a / k:.0f} rad/s² a m/s² of thrust: inertia {MASS * LEVER * k / a:.3g} kg m²"
        )
    r2, _, says, _ = fit(spun[:, 2], lambda u: (u**2 @ SPIN)[:, None])
    out.append(f"yaw, drag torque of the propellers alone: R² {r2:.2f}, {says}")

    def both(u: np.ndarray) -> np.ndarray:
        return np.column_stack([u**2 @ SPIN, np.gradient(u, dt, axis=0) @ SPIN])

    r2, _, says, rate = fit(spun[:, 2], both)
    told["rate of yaw, rad/s"] = table["wz_rad_s"], rate
    out.append(f"yaw, with the torque of the spin-up: R² {r2:.2f}, {says}")
    out.append("simulated: rms error of rms change in a window (share that is explained)")
    for name, (state, rate) in told.items():
        out.append(f"  {name}: " + ", ".join(simulate(state, rate, second, dt)))
    return out


def main() -> None:
    """Write a table of each log beside it, and print the comparison."""
    for path in map(Path, sys.argv[1:]):
        table = build_table(decode(path))
        out = Path(f"{path.name}.csv")
        np.savetxt(
            out, np.column_stack(list(table.values())), "%.6g", ",", header=",".join(table),
            comments="",
        )  # fmt: skip
        print(f"{path.name}: {out}", *compare(table), sep="\n  ")


if __name__ == "__main__":
    main()
