"""Write tests/slow.txt, the tests that `make check` leaves out: `make durations` calls it.

    python scripts/list_slow_tests.py FILE [--budget SECONDS]

FILE holds the processor time of every test (`pytest --measure FILE`). The tests stay in that are
shortest, a test function with all its cases, until together they take the budget of processor time.
A test that is new since is not in the list, and runs.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

SLOW = Path(__file__).resolve().parent.parent / "tests" / "slow.txt"
BUDGET = 90.0  # s on both cores together; lint, types and the start of pytest take the rest


def main() -> None:
    """Write the list."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--budget", type=float, default=BUDGET)
    args = parser.parse_args()
    took: Counter[str] = Counter()
    for line in args.file.read_text(encoding="utf-8").splitlines():
        seconds, _, test = line.partition("\t")
        took[test.partition("[")[0]] += float(seconds)
    left, slow = args.budget, []
    for test, seconds in sorted(took.items(), key=lambda item: item[1]):
        left -= seconds
        if left < 0.0:
            slow.append(test)
    SLOW.write_text("".join(f"{test}\n" for test in sorted(slow)), encoding="utf-8")
    print(f"{len(took)} test functions, {sum(took.values()):.0f} s; {len(slow)} are left out")


if __name__ == "__main__":
    main()
