"""Entries of a scan in the database: the crossings of welds as indications, at their places."""

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.surface import roll_points, unroll_points
from skywright.errors import InputError
from skywright.inspection.history.entries import COVERAGE, Entries, Indication
from skywright.missions.scan.metrics import find_place_std, find_survey, process_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown


def build_entries(run: Flown[Scan, ScanWay]) -> Entries:
    """Return each crossing of a weld, with its deviation along the motion; places are in W."""
    try:
        weld = run.once(process_weld)
    except InputError:  # the flight was cut short: its approach is insufficient
        weld = None
    if weld is None:
        return Entries()
    shared = run.setup.world.mocap.calibration_m
    places = _count_from_datum(run, np.array([x.p_W for x in weld.crossings]).reshape(-1, 3))
    found = [
        (x.t, Indication(
            "weld", float(p[0]), float(p[1]), float(p[2]), COVERAGE * (x.std**2 + shared**2) ** 0.5,
            amplitude=x.peak, amplitude_unit="instrument units",
        ))
        for x, p in zip(weld.crossings, places, strict=True)
    ]  # fmt: skip
    return Entries("pipe", indications=tuple(found), registration_std_m=run.once(find_place_std))


def _count_from_datum(run: Flown[Scan, ScanWay], p_W: Array) -> Array:
    """Return places (n, 3) m on the pipe of the map if a datum determines them."""
    surveyed, mapped = run.once(find_survey), run.setup.cylinder
    if surveyed is None or surveyed.mark is None or mapped is None:
        return p_W
    known = surveyed.found.cylinder
    s, c, _ = unroll_points(known, p_W)
    return roll_points(mapped, s, c * mapped.radius / known.radius)[0]
