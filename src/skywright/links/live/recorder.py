"""Writes streams to files that `skywright locate` and `skywright weld` read.

Each stream becomes NAME.csv with the sender's times, so that `locate` aligns clocks by the motion
as for other files. An eddy-current stream and the poses of the tip become scan.csv on one clock:
exactly if both share a clock, else by the smallest delays of both.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.links.live.packets import LINES
from skywright.links.live.receiver import Arrived, LiveReceiver

Array = NDArray[np.float64]

PLACE = ("x_m", "y_m", "z_m")
TURN = ("qw", "qx", "qy", "qz")
UNITS = {"SKYEC": ("re", "im"), "SKYFT": ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")}
GAP = 5.0
"""Gaps longer than this number of usual intervals of the tip's poses are not interpolated."""
NEAR = 0.01  # of the usual interval: distance to a pose that is still used beside a gap
ROWS_MIN = 30
TIME, VALUE = "%.6f", "%.12g"
"""Formats of scan.csv: times to 1 us, Unix time too; positions up to POSITION_MAX to 0.1 mm."""


def _is_signal(key: tuple[str, str]) -> bool:
    """Whether a stream (kind, name) is the instrument's signal."""
    return key[0] == "SKYEC"


def _is_tip(key: tuple[str, str]) -> bool:
    """Whether a stream (kind, name) has the positions of the tip."""
    return key[1] == "tip" and key[0] not in LINES


class LiveRecorder:
    """Writes received samples to a folder."""

    def __init__(self, folder: Path) -> None:
        """Raises InputError if the folder cannot be created or already contains stream files."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            taken = sorted(folder.glob("*.csv"))
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
        if taken:
            raise InputError(f"{folder}: holds {taken[0].name}; give an empty folder")
        self.folder = folder
        self._files: dict[tuple[str, str], IO[str]] = {}
        self._rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}
        self._held: dict[tuple[str, str], list[Arrived]] = {}
        """Samples of each stream that are ahead of their clock, which none has disproved yet."""
        self._offsets: dict[int, float] = {}
        """Clock number -> local clock minus the sender's (s), as of its newest sample not ahead."""

    def write(self, arrived: Arrived) -> int:
        """Append a sample; return the number of dropped samples of its stream.

        A sample whose time is ahead of its clock is held back until a later time confirms it; an
        earlier one proves it wrong, and it is dropped. Raises InputError if the disk is full.
        """
        sample = arrived.sample
        held = self._held.setdefault((sample.kind, sample.name), [])
        kept = [h for h in held if h.sample.clock != sample.clock or h.sample.t <= sample.t]
        dropped = len(held) - len(kept)
        held[:] = [*kept, arrived]
        if arrived.age >= 0.0:
            self._offsets[sample.clock] = arrived.arrival - sample.t - arrived.age
            self._flush(held)
        return dropped

    def _flush(self, held: list[Arrived]) -> None:
        while held:  # one by one: an interrupt, after which `finish` flushes, repeats no row
            self._append(held.pop(0))

    def _append(self, arrived: Arrived) -> None:
        sample = arrived.sample
        key = sample.kind, sample.name
        file = self._files.get(key)
        try:
            if file is None:
                file = self._open(key)
            cells = [f"{sample.t:.6f}", *(repr(v) for v in sample.values)]
            file.write(",".join([*cells, str(sample.clock), f"{arrived.arrival:.6f}"]) + "\n")
        except OSError as error:
            raise InputError(f"{self.folder}: {error.strerror or error}") from None
        if _is_signal(key) or _is_tip(key):  # `_merge` reads no others
            self._rows[key].append((sample.t, float(sample.clock), *sample.values))

    def finish(self) -> list[Path]:
        """Close the files, and write scan.csv if possible; return all files."""
        for held in self._held.values():
            self._flush(held)
        for file in self._files.values():
            file.close()
        paths = [Path(file.name) for file in self._files.values()]
        scan = self._merge()
        if scan is not None:
            paths.append(scan)
        return paths

    def _open(self, key: tuple[str, str]) -> IO[str]:
        kind, name = key
        used = {Path(f.name).stem for f in self._files.values()} | {"scan"}
        stem = name if name not in used else f"{name}-{kind.lower()}"
        file = (self.folder / f"{stem}.csv").open("w", encoding="utf-8", buffering=1)
        columns = UNITS[kind] if kind in LINES else PLACE + (TURN if kind == "pose" else ())
        file.write(",".join(["t_s", *columns, "clock", "arrival"]) + "\n")
        self._files[key], self._rows[key] = file, []
        return file

    def _merge(self) -> Path | None:
        """Write the instrument's signal with the tip's positions; None if one is missing."""
        signals = [key for key in self._rows if _is_signal(key)]
        tips = [key for key in self._rows if _is_tip(key)]
        if len(signals) != 1 or len(tips) != 1:
            return None
        signal, tip = np.array(self._rows[signals[0]]), np.array(self._rows[tips[0]])
        if len(signal) < ROWS_MIN or len(tip) < ROWS_MIN:
            return None
        shared = set(signal[:, 1]) == set(tip[:, 1]) and len(set(tip[:, 1])) == 1
        times = []
        for rows in (signal, tip):
            offsets = [0.0 if shared else self._offsets[int(c)] for c in rows[:, 1]]
            times.append(rows[:, 0] + np.array(offsets))
        at, place = times
        order = np.argsort(place, kind="stable")
        place, tip = place[order], tip[order]
        after = np.clip(np.searchsorted(place, at), 1, len(place) - 1)
        gap = place[after] - place[after - 1]
        sound = (at >= place[0]) & (at <= place[-1])
        usual = float(np.median(np.diff(place)))
        near = np.minimum(at - place[after - 1], place[after] - at) <= NEAR * usual
        sound &= (gap <= GAP * usual) | near
        p = np.stack([np.interp(at, place, tip[:, 2 + i]) for i in range(3)], axis=1)
        columns = [at[:, None], signal[:, 2:4], p]
        names = ["t_s", *UNITS["SKYEC"], *PLACE]
        if tips[0][0] == "pose":
            nearest = np.where(at - place[after - 1] < place[after] - at, after - 1, after)
            columns.append(tip[nearest, 5:9])
            names += TURN
        table = np.hstack(columns)[sound]
        path = self.folder / "scan.csv"
        np.savetxt(
            path, table, fmt=[TIME, *[VALUE] * (len(names) - 1)], delimiter=",",
            header=",".join(names), comments="",
        )  # fmt: skip
        return path


def record(receiver: LiveReceiver, recorder: LiveRecorder, seconds: float, idle_s: float) -> None:
    """Record for `seconds`, until no data arrive for `idle_s` (s), a failure or an interrupt.

    Samples that the recorder drops count as refused: a stream counts the samples in its file.
    """
    begin, last = time.monotonic(), math.inf
    try:
        while time.monotonic() - begin < seconds and time.monotonic() - last < idle_s:
            found = receiver.poll()
            for arrived in found:
                dropped = recorder.write(arrived)
                if dropped:
                    receiver.counts["clock"] += dropped
                    receiver.streams[arrived.sample.kind, arrived.sample.name].count -= dropped
                last = time.monotonic()
            if receiver.failure:
                return
            if not found:
                time.sleep(0.002)
    except KeyboardInterrupt:
        return
