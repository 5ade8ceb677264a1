"""Write the table of docs/howto/compile-for-cuda.md: `python docs/generate_cuda.py`.

It comes from benchmarks/cuda.json, which `python -m skywright.evidence.cuda_steps` wrote.
"""

from __future__ import annotations

import json
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "compile-for-cuda.md"
KEPT = DOCS.parent / "benchmarks" / "cuda.json"
BEGIN = "<!-- cuda: begin, made by docs/generate_cuda.py, do not edit -->"
END = "<!-- cuda: end -->"


def build_table() -> str:
    """Return a line a step."""
    found = json.loads(KEPT.read_text(encoding="utf-8"))
    steps, major = found["steps"], found["architecture"]
    good = [s for s in steps if not s["why"]]
    lines = [
        f"Of {len(steps)} steps of all built-in missions, laws and estimators, {len(good)} compile "
        f"for compute capability {major[0]}.{major[1]} (numba-cuda {found['numba_cuda']}). A step "
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


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
