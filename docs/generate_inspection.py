"""Write docs/reference/inspection.md: `python docs/generate_inspection.py`.

From what benchmarks/fly_inspections.py and benchmarks/crack_detection.py keep.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

DOCS = Path(__file__).parent
PAGE = DOCS / "reference" / "inspection.md"
KEPT = DOCS.parent / "benchmarks" / "inspection"
BEGIN = "<!-- inspection: begin, made by docs/generate_inspection.py, do not edit -->"
END = "<!-- inspection: end -->"
SKIP_MM = 0.25
"""Error from which a reading is a skipped cycle or a doubling."""
SMOOTH = 15e-6
"""m, roughness of the far side up to which a wall is called smooth."""

Flights = list[dict[str, Any]]


def load_flights(name: str) -> Flights:
    """Return the kept flights of a mission; none where nothing was flown."""
    path = KEPT / f"{name}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]


def bound(count: int, total: int) -> float:
    """Upper 95 % bound of a rate, Clopper and Pearson."""
    return float(beta.ppf(0.95, count + 1, total - count)) if count < total else 1.0


def list_thickness(flights: Flights) -> list[tuple[str, str, str]]:
    """Requirement, limit, value of the thickness surveys."""
    flown = [f for f in flights if "touches" in f]
    touches = [t for f in flown for t in f["touches"]]
    good = [t["scans"][-1] for t in touches if t["accepted"]]
    if not good:
        return []
    error, u95 = (np.array([r[k] for r in good], float) for k in (1, 2))
    read = [r for t in touches for r in t["scans"] if r[1] is not None]
    skips = sum(abs(r[1]) > SKIP_MM for r in read)
    kept = int(np.sum(np.abs(error) > SKIP_MM))
    rough = "world.things.steel.roughness_back_m"
    smooth = [f for f in flown if float(f["site"][rough]) <= SMOOTH]
    spots = sum(f["spots"] for f in smooth)
    accepted = sum(t["accepted"] for f in smooth for t in f["touches"])
    bad = [t for t in touches if t["air"] or t["beyond_null"]]
    wrong = sum(t["accepted"] for t in bad)
    return [
        ("error of accepted readings, 95 %", "0.1 mm",
         f"{np.quantile(np.abs(error), 0.95):.3f} mm ({len(good)} readings)"),
        ("bias", "0.05 mm", f"{np.mean(error):+.3f} mm"),
        (f"spots accepted on smooth steel (up to {1e6 * SMOOTH:.0f} um)", "90 %",
         f"{accepted} of {spots}"),
        ("touches with air or beyond the tilt's null that were accepted", "0",
         f"{wrong} of {len(bad)}"),
        ("skipped cycles or doublings, of accepted readings", "0 in 1,000",
         f"{kept} of {len(good)} (rate below {bound(kept, len(good)):.2%})"),
        ("the same of all A-scans that gave a thickness, most of which were refused", "–",
         f"{skips} of {len(read)}"),
        ("stated u95 covers the true error", "93 to 97 %",
         f"{int(np.sum(np.abs(error) <= u95))} of {len(good)}"),
    ]  # fmt: skip


def list_cracks(flights: Flights) -> list[tuple[str, str, str]]:
    """Requirement, limit, value of the searches for cracks."""
    flown = [f for f in flights if f.get("inspected") and "gap_rms_mm" in f]
    if not flown:
        return []
    area = [f["metrics"]["coverage.area_fraction"] for f in flown]
    hole = [f["metrics"]["coverage.gap_max_mm"] for f in flown]
    flaws = [x for f in flown for x in f["inspected"]["flaws"]]
    sites, calls = (sum(f["inspected"][k] for f in flown) for k in ("sites", "calls"))
    errors = [e for f in flown for e in f["place_errors_mm"] if e is not None]
    stated = [u for f in flown for u in f["u95_mm"]]
    spread = [f["metrics"]["datum.place_std_mm"] for f in flown]
    within = sum(e <= 5.0 for e in errors)
    return [
        ("area covered, least", "95 %", f"{min(area):.1%} ({len(flown)} flights)"),
        ("largest gap", "5 mm", f"{max(hole):.1f} mm"),
        ("cracks of 6 by 1 mm found, any direction", "–",
         f"{sum(x['hit'] for x in flaws)} of {len(flaws)}"),
        ("false calls, at places of 20 by 20 mm without a crack", "1 %",
         f"{calls} of {sites} (rate below {bound(calls, sites):.1%})"),
        ("error of an indication's place from the datum", "–",
         f"{within} of {len(errors)} within 5 mm, at most {max(errors):.1f} mm"),
        ("the same, 95 %", "5 mm", f"{float(np.quantile(errors, 0.95)):.1f} mm"),
        ("its stated u95 within the flight", "5 mm", f"{max(stated):.1f} mm"),
        ("stated deviation of the farthest corner from the datum, each way", "–",
         f"{float(np.mean(spread)):.1f} mm, at most {max(spread):.1f} mm"),
    ]  # fmt: skip


def tell_flown(name: str, flights: Flights) -> str:
    """Say how many flights met all of their requirements, and why the others did not."""
    if not flights:
        return f"`{name}`: not flown yet."
    good = sum(f["outcome"] == "succeeded" for f in flights)
    commits = ", ".join(f"`{c}`" for c in dict.fromkeys(f["commit"] for f in flights))
    text = f"`{name}`: {good} of {len(flights)} flights met all requirements of the mission"
    return f"{text} (commit {commits})."


def build_detection() -> list[str]:
    """The table of the reduced model."""
    path = KEPT / "detection.json"
    if not path.is_file():
        return []
    data = json.loads(path.read_text(encoding="utf-8"))
    out = [
        "| case | cracks | a50 (mm) | a90 (mm) | a90/95 (mm) | false calls |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in data["cases"].items():
        if "pod" not in one:
            out.append(f"| {name} | – | – | – | – | {one['error']} |")
            continue
        pod = one["pod"]
        sizes = (f"{pod[k]:.2f}" if pod[k] else "–" for k in ("a50", "a90", "a90_95"))
        rate = bound(one["calls"], one["sites"])
        out.append(
            f"| {name} | {one['cracks']} | {' | '.join(sizes)} | {one['calls']} of {one['sites']} "
            f"(below {rate:.2%}) |"
        )
    return [*out, "", f"Commit `{data['commit']}`."]


def build_gusts() -> list[str]:
    """The curves of benchmarks/crack_gusts.py."""
    data = json.loads((KEPT / "gusts.json").read_text(encoding="utf-8"))
    out = [
        "| robot | gusts around a mean of | flights | cracks found | largest missed (mm) | "
        "smallest found (mm) | a50 (mm) | a90 (mm) | a90/95 (mm) | false calls |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for c in data["cells"]:
        mean = f"{c['mean_mps']:g} m/s" if c["mean_mps"] else "calm air"
        sizes = " | ".join(f"{c[k]:.2f}" if c.get(k) else "–" for k in ("a50", "a90", "a90_95"))
        out.append(
            f"| `{c['robot']}` | {mean} | {c['flights']} | {c['found']} of {c['flaws']} "
            f"| {c['largest_missed_mm']:.2f} | {c['smallest_found_mm']:.2f} | {sizes} "
            f"| {c['calls']} of {c['sites']} |"
        )
    flaws = sum(c["flaws"] for c in data["cells"])
    out += [
        "",
        "In gusts the law of Tognon 2018 and `direct_force` find the same cracks: the test for one "
        f"curve of both laws gives p = {data['one_curve_p']:.2f}, and each of the {flaws} cracks "
        "was passed with the probe in contact (gap below 0.5 mm). The gain of `direct_force` is "
        "the wind in which it may fly: the plan for `othex` refuses gusts around a mean of 3 m/s, "
        "that for `othex-force` accepts 3.5 m/s.",
    ]
    return [*out, "", f"Commit `{data['commit']}`."]


def build_tables() -> str:
    """All that is generated."""
    out = []
    for name, list_rows in (
        ("thickness-survey", list_thickness), ("crack-scan", list_cracks), ("one-coil", list_cracks)
    ):  # fmt: skip
        flights = load_flights(name)
        rows = list_rows(flights)
        out += [tell_flown(name, flights), ""]
        if rows:
            out += ["| requirement | limit | measured |", "|---|---|---|"]
            out += [f"| {' | '.join(row)} |" for row in rows] + [""]
    out += ["## Detection in flights, by law and gusts", "", *build_gusts(), ""]
    return "\n".join([*out, "## Detection without a flight", "", *build_detection()])


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_tables()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
