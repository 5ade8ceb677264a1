"""Write the tables of docs/howto/compile-for-cuda.md: `python docs/generate_cuda.py`.

They come from benchmarks/cuda.json, which `python -m skywright.evidence.cuda_steps` wrote, and from
benchmarks/cuda, which `benchmarks/fly_bundle.py` wrote on a machine with a GPU.
"""

from __future__ import annotations

import json
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "compile-for-cuda.md"
KEPT = DOCS.parent / "benchmarks" / "cuda.json"
BEGIN = "<!-- cuda: begin, made by docs/generate_cuda.py, do not edit -->"
END = "<!-- cuda: end -->"
FLOWN = DOCS.parent / "benchmarks" / "cuda"
FLOWN_BEGIN = "<!-- flight: begin, made by docs/generate_cuda.py, do not edit -->"
FLOWN_END = "<!-- flight: end -->"


def build_table() -> str:
    """Return a line a step."""
    found = json.loads(KEPT.read_text(encoding="utf-8"))
    steps, major = found["steps"], found["architecture"]
    good = [s for s in steps if not s["why"]]
    lines = [
        f"Of {len(steps)} steps of all built-in missions, laws and estimators, {len(good)} compile "
        f"for compute capability {major[0]}.{major[1]} (numba-cuda {found['numba_cuda']}; "
        f"commit `{found['commit']}`, {found['when']}). A step "
        "that several missions have is listed once:",
        "",
        "| mission | step | slot | PTX (kB) | registers | stack (bytes) | spilled (bytes) |",
        "|---|---|---|---|---|---|---|",
    ]
    for s in steps:
        numbers = (
            " | ".join(str(s[k]) for k in ("registers", "stack_bytes", "spilled_bytes"))
            if not s["why"]
            else "does not compile | – | –"
        )
        size = f"{s['ptx_bytes'] / 1000:.1f}" if not s["why"] else "–"
        lines.append(f"| {s['mission']} | `{s['step']}` | {s['slot']} | {size} | {numbers} |")
    return "\n".join(lines)


def build_flights() -> str:
    """Return what the recorded flights gave on the GPU."""
    flights = [json.loads(f.read_text(encoding="utf-8")) for f in sorted(FLOWN.glob("*.json"))]
    first = flights[0]
    recorded, gb = first["recorded"], max(f["block_bytes"] for f in flights) * 1e-9
    most = max(x["worlds"] for x in first["speed"])
    lines = [
        f"Measured on one {first['device']} with MuJoCo Warp {first['versions']['mujoco-warp']}, "
        f"as the mean of the first {first['speed'][0]['seconds']:g} s of the flight. A control "
        f"tick of {1000 * recorded['dt']:g} ms is all rows, {recorded['n_steps']} steps of the "
        "physics and the copies between them. The last column compares with the same ticks on "
        "one core of "
        f"{recorded['processor']['name']}, if cores scale linearly: "
        + ", ".join(
            f"{f['recorded']['processor']['tick_us']:.0f} us a tick of `{f['mission']}`"
            for f in flights
        )
        + f". The blocks of {most} worlds take {most * gb:.0f} GB.",
        "",
        "| mission | worlds | control tick of all worlds (ms) | rows alone (ms) | "
        "MuJoCo Warp alone (ms) | control ticks per second, all worlds together | "
        "processor cores of the same speed |",
        "|---|---|---|---|---|---|---|",
    ]
    for f in flights:
        for s in f["speed"]:
            times = (f"{1000 * s[k]:.2f}" for k in ("tick_s", "rows_s", "physics_s"))
            rate = s["worlds"] / s["tick_s"]
            cores = rate * 1e-6 * f["recorded"]["processor"]["tick_us"]
            lines.append(
                f"| `{f['mission']}` | {s['worlds']} | {' | '.join(times)} | "
                f"{rate / 1e6:.4f} million | {cores:.{2 if cores < 1 else 0}f} |"
            )
    least, more = (
        f(x["speed"][1]["tick_s"] / x["speed"][0]["tick_s"] for x in flights) for f in (min, max)
    )
    lines += [
        "",
        f"{first['speed'][1]['worlds']} worlds take {least:.1f} to {more:.1f} times as long as "
        "one.",
        "",
        "The control rows of single ticks, from the same state as on the processor:",
        "",
        "| mission | words written | equal in all bits | largest difference | "
        "median of the others |",
        "|---|---|---|---|---|",
    ]
    for f in flights:
        a = f["agreement"]
        lines.append(
            f"| `{f['mission']}` | {a['words']} | {100 * a['same'] / a['words']:.0f} % | "
            f"{a['largest']:.0e} | {a['median']:.0e} |"
        )
    lines += [
        "",
        "Differences are relative to the largest value of the word in all compared ticks.",
    ]
    if any("wrong_integers" not in f["agreement"] for f in flights):
        lines[-1] += (
            " Integers were compared as the other words: an unequal one lowers the share of equal "
            "words, but not the differences."
        )
    lines += [
        "",
        "The flight in closed loop, and the distances of the platforms from the recorded flight "
        "every 0.2 s:",
        "",
        "| mission | worlds | flight (s) | wall time (s) | world 0, largest (mm) | "
        "all worlds, largest (mm) | rms (mm) |",
        "|---|---|---|---|---|---|---|",
    ]
    for f in flights:
        g = f["flight"]
        lines.append(
            f"| `{f['mission']}` | {g['worlds']} | {g['seconds']:.0f} | {g['wall_s']:.0f} | "
            f"{1000 * g['world_0_largest_m']:.3f} | {1000 * g['all_largest_m']:.1f} | "
            f"{1000 * g['all_rms_m']:.1f} |"
        )
    lines += [
        "",
        "At the end of each flight all positions were finite, and no guard had fired in any world.",
    ]
    for f in flights:
        assert not f["agreement"].get("wrong_integers", 0)
        assert not f["agreement"]["not_finite"]
        assert not any(x["not_finite"] or x["guards_fired"] for x in (*f["speed"], f["flight"]))
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    text = f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"
    head, rest = text.split(FLOWN_BEGIN)
    return f"{head}{FLOWN_BEGIN}\n\n{build_flights()}\n\n{FLOWN_END}{rest.split(FLOWN_END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
