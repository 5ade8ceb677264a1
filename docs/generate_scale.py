"""Write the table of cost of docs/howto/campaign.md: `python docs/generate_scale.py`.

It comes from benchmarks/scale.json, which `python benchmarks/campaign_scale.py` wrote.
"""

from __future__ import annotations

import json
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "campaign.md"
KEPT = DOCS.parent / "benchmarks" / "scale.json"
BEGIN = "<!-- scale: begin, made by docs/generate_scale.py, do not edit -->"
END = "<!-- scale: end -->"


def build_table() -> str:
    """Return a column a mission."""
    found = json.loads(KEPT.read_text(encoding="utf-8"))
    n, missions = found["planned"], found["missions"]
    rows: dict[str, list[str]] = {
        "flight": [f"{m['flight_cpu_s']:.2f} s" for m in missions],
        "start of a worker, once": [f"{m['worker_start_cpu_s']:.1f} s" for m in missions],
    }
    for workers in ("1", "2"):
        name = f"per run, {workers} worker{'s' * (workers != '1')}, start included"
        rows[name] = [f"{m['run_cpu_s'][workers]:.2f} s" for m in missions]
    for kind, cost, most in (
        ("forked workers", "parent_cpu_s", "most_workers"),
        ("Ray", "ray_hand_out_s", "most_workers_ray"),
    ):
        rows[f"{kind}: main process, per run"] = [f"{1e3 * m[cost]:.0f} ms" for m in missions]
        rows[f"{kind}: per run with {n} workers (computed)"] = [
            _limit(m["flight_cpu_s"] / n, m[cost]) for m in missions
        ]
        rows[f"{kind}: workers that one main process supplies"] = [str(m[most]) for m in missions]
    lines = [
        "| processor time | " + " | ".join(f"`{m['mission']}`" for m in missions) + " |",
        "|---|" + "---|" * len(missions),
        *(f"| {name} | " + " | ".join(values) + " |" for name, values in rows.items()),
    ]
    runs = found["missions"][0]["runs"]
    lines += [
        "",
        f"All times are processor times of campaigns of {runs} runs. The start of the workers is "
        f"therefore a large part of the time per run; the computed time for {n} workers excludes "
        "it, and names what limits it. Ray was measured on two warm workers of one machine: "
        + ", ".join(
            f"a further run of `{m['mission']}` takes {m['ray_run_wall_s']:.2f} s of wall time"
            for m in found["missions"]
        )
        + ", and its threads in the main process use "
        f"{100.0 * found['missions'][0]['ray_waiting_share']:.1f} % of a core while runs fly. "
        f"Measured at commit {found['commit']} on {found['cores']} cores of "
        f"{found['processor']}.",
    ]
    return "\n".join(lines)


def _limit(flights: float, handing_out: float) -> str:
    """The time per run and what limits it; both in s."""
    longer = max(flights, handing_out)
    return f"{1e3 * longer:.0f} ms, {'the flights' if longer == flights else 'handing out'}"


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
