"""What a scan adds to the database: the crossings of welds as indications, where they were read."""

from skywright.errors import InputError
from skywright.inspection.history.entries import COVERAGE, Entries, Indication
from skywright.missions.scan.metrics import process_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown


def build_entries(run: Flown[Scan, ScanWay]) -> Entries:
    """Return each crossing of a weld, in the frame W, with the deviation along the motion."""
    try:
        weld = run.once(process_weld)
    except InputError:  # a flight that was cut short: its approach tells too little
        weld = None
    if weld is None:
        return Entries()
    shared = run.setup.world.mocap.calibration_m
    found = [
        (x.t, Indication(
            "weld", *x.p_W, COVERAGE * (x.std**2 + shared**2) ** 0.5, amplitude=x.peak,
            amplitude_unit="instrument units",
        ))
        for x in weld.crossings
    ]  # fmt: skip
    return Entries("pipe", indications=tuple(found))
