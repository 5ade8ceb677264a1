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
    """Return a line a mission."""
    found = json.loads(KEPT.read_text(encoding="utf-8"))
    n = found["planned"]
    lines = [
        "| mission | flight | start of a worker | per run, 1 worker | per run, 2 workers | "
        f"handing out a run | the same with Ray | per run, {n} workers (computed) | the same with "
        "Ray | most useful workers | the same with Ray |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for m in found["missions"]:
        each = m["flight_cpu_s"] / n
        costs = [max(each, cost) for cost in (m["parent_cpu_s"], m["ray_hand_out_s"])]
        local, ray = (
            f"{1e3 * cost:.0f} ms, {'the flights' if cost == each else 'handing out'}"
            for cost in costs
        )
        lines.append(
            f"| `{m['mission']}` | {m['flight_cpu_s']:.2f} s | {m['worker_start_cpu_s']:.1f} s | "
            f"{m['run_cpu_s']['1']:.2f} s | {m['run_cpu_s']['2']:.2f} s | "
            f"{1e3 * m['parent_cpu_s']:.0f} ms | {1e3 * m['ray_hand_out_s']:.0f} ms | "
            f"{local} | {ray} | {m['most_workers']} | {m['most_workers_ray']} |"
        )
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


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
