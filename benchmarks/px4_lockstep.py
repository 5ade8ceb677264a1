"""Cost and memory of the lockstep of `skywright sitl hexarotor`, with a peer that replaces PX4.

    python benchmarks/px4_lockstep.py [--minutes 30]

Simulator and peer (tests/px4_peer.py) share one core; the rotors turn while the robot stands. For
each simulated minute a row of benchmarks/px4-lockstep.csv contains the simulated time, the
processor time of both processes since the first sample, and the simulator's resident memory. The
script fails if the simulated time is below 5 times the processor time, or if the memory grew: the
mean of the last third above that of the second third by more than 1 % and 2 MB.
"""

from __future__ import annotations

import argparse
import csv
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from px4_peer import Px4Peer

KEPT = Path(__file__).resolve().parent / "px4-lockstep.csv"
COLUMNS = ("t_s", "processor_s", "simulator_mb")
FACTOR, SHARE, MEGABYTES = 5.0, 0.01, 2.0
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def read_usage(pid: int) -> tuple[float, float]:
    """Return processor time (s) and resident memory (MB) of a process."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return TICK_S * (int(words[11]) + int(words[12])), 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")


def measure(minutes: float) -> list[tuple[float, float, float]]:
    """Fly against the peer; return the rows."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = int(s.getsockname()[1])
    rows: list[tuple[float, float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-m", "skywright", "sitl", "hexarotor", "--speed", "max"),
            *("--port", str(port), "--telemetry", "0", "--duration", str(60.0 * minutes + 10.0)),
            *("--out", str(Path(folder) / "run")),
        ]
        simulator = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        peer = Px4Peer(port, command=[0.1] * 6)
        peer.start()
        try:
            began: tuple[float, float] | None = None
            while simulator.poll() is None and len(rows) < minutes:
                time.sleep(0.05)
                if not peer.times:
                    continue
                t = 1e-6 * peer.times[-1]
                del peer.times[:-10]
                peer.armed = peer.armed or peer.arm()
                spent, memory = read_usage(simulator.pid)
                spent += time.process_time()
                began = began or (t, spent)
                if t - began[0] >= 60.0 * (len(rows) + 1):
                    rows.append((t - began[0], spent - began[1], memory))
                    print(" ".join(f"{x:.4g}" for x in rows[-1]), flush=True)
        finally:
            peer.stop()
            simulator.terminate()
            simulator.wait(60.0)
    return rows


def judge(rows: list[tuple[float, float, float]]) -> str:
    """Return a failure of speed or memory, "" without one."""
    t, spent, _ = rows[-1]
    if t < FACTOR * spent:
        return f"{t / spent:.1f} times real time, required {FACTOR:g}"
    third = len(rows) // 3
    before = statistics.mean(r[2] for r in rows[third : 2 * third])
    after = statistics.mean(r[2] for r in rows[2 * third :])
    if after - before > max(SHARE * before, MEGABYTES):
        return f"the simulator's memory grew from {before:.1f} to {after:.1f} MB"
    return ""


def main() -> int:
    """Run the measurement and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    rows = measure(parser.parse_args().minutes)
    if len(rows) < 3:
        print("too few rows to judge: at least 3 minutes", file=sys.stderr)
        return 1
    with KEPT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([f"{x:.4g}" for x in row] for row in rows)
    says = judge(rows)
    print(says or f"{rows[-1][0] / rows[-1][1]:.1f} times real time on one core")
    return int(bool(says))


if __name__ == "__main__":
    sys.exit(main())
