"""Metrics of the kind "crack-scan": cracks found, false calls, area, check on the block."""

from __future__ import annotations

from skywright.missions.crack_scan.cover import compute_cover
from skywright.missions.crack_scan.judge import list_flaws, match
from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.search import TILT_LIMIT, Search, as_scan, find_search
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.coverage import COVERAGE_MEASURES, SCAN
from skywright.missions.scan.fly import AGAIN
from skywright.missions.scan.metrics import MEASURES as SCAN_MEASURES
from skywright.missions.scan.metrics import compute_metrics as judge_scan
from skywright.missions.skills.datum import DATUM_MEASURES, DATUM_WHERE
from skywright.missions.skills.surveyed import SURVEY_MEASURES, SURVEY_WHERE
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import PLANNING, WHOLE, Where

SHARED = ("contact.", "tip.", "touch.", "platform.", "rotors.")
"""Prefixes of the metrics that this kind shares with the scan that it is flown as."""

MEASURES: Measures = {
    "crack.expected": ("", "number of cracks in the requested sector"),
    "crack.missed": (
        "",
        "number of these without a reported crack within 8 mm of their mouth; reported are "
        "indications of the kind crack, and ambiguous ones that point upwards",
    ),
    "crack.indications": ("", "number of indications, welds and ambiguous ones included"),
    "crack.ambiguous": ("", "number of indications that are neither clearly crack nor weld"),
    "crack.false_calls": (
        "",
        "number of reported cracks more than 8 mm from the mouth of any crack, in the requested "
        "sector or beside it",
    ),
    "crack.position_error_mm": (
        "mm",
        "largest distance of the indication of a crack from its middle, counted from the datum "
        "where one was seen; 0 in a sector without a "
        "crack",
    ),
    "crack.block_notch_percent": (
        "",
        "height of the reference notch after the flight, in % of full screen; 80 at the set-up",
    ),
    "crack.block_drifted": ("", "1 if the check on the block after the flight fails"),
    "coverage.area_fraction": COVERAGE_MEASURES["coverage.area_fraction"],
    "coverage.gap_max_mm": (
        "mm",
        "diameter of the largest circle of the sector that no coil covers",
    ),
    "coverage.passes": ("", "number of axial passes"),
    "coverage.again": ("", "number of scans of missed parts: 0 or 1"),
    "coverage.pitch_full_mm": COVERAGE_MEASURES["coverage.pitch_full_mm"],
    **{k: v for k, v in SCAN_MEASURES.items() if k.startswith(SHARED)},
    **SURVEY_MEASURES,
    **DATUM_MEASURES,
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""
WHERE = {
    **dict.fromkeys((*SHARED, "force.", "crack.", "coverage."), SCAN),
    "coverage.pitch": PLANNING,
    "coverage.again": WHOLE,
    **SURVEY_WHERE,
    **DATUM_WHERE,
    "touch.": Where(("touch", "settle")),
    "contact.retries": WHOLE,
    "crack.block": Where(note="on the reference block, after the flight"),
}


def compute_metrics(run: Flown[CrackScan, CrackWay]) -> dict[str, float]:
    """Return the metrics of contact, then those of the search."""
    scan: dict[str, float] = judge_scan(as_scan(run))
    out = {k: v for k, v in scan.items() if not k.startswith(("weld.", "coverage."))}
    found = run.once(find_search)
    if found is None:
        return out
    out["coverage.passes"] = float(run.way.passes)
    out["coverage.again"] = float(sum(p.name == AGAIN for p in run.phases))
    out["coverage.pitch_full_mm"] = 1e3 * run.way.pitch_m
    return out | judge_search(run, found)


def judge_search(run: Flown[CrackScan, CrackWay], found: Search) -> dict[str, float]:
    """Compare indications with cracks, and the covered area with the sector."""
    flaws, beside = list_flaws(run)
    errors, false = match(found.indications, flaws, beside)
    samples = run.samples[SCAN.select(run.samples, run.phases)]
    good = (samples["gap_max"] < run.task.procedure.gap_max_m) & (samples["tilt"] < TILT_LIMIT)
    cover = compute_cover(found.cover.sector, found.s[good], found.c[good])  # true coverage
    hit = [e for e in errors if e is not None]
    out = {
        "crack.expected": float(len(flaws)),
        "crack.missed": float(len(flaws) - len(hit)),
        "crack.indications": float(len(found.indications)),
        "crack.ambiguous": float(sum(x.nature == "ambiguous" for x in found.indications)),
        "crack.false_calls": float(false),
        "crack.block_notch_percent": found.check.height,
        "crack.block_drifted": float(not found.check.holds),
        "coverage.area_fraction": cover.fraction,
        "coverage.gap_max_mm": 1e3 * cover.hole_m,
    }
    if hit or not flaws:
        out["crack.position_error_mm"] = 1e3 * max(hit, default=0.0)
    return out
