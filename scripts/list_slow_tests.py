"""Write tests/slow.txt, the tests that `make check` omits; called by `make durations`.

    python scripts/list_slow_tests.py FILE [--budget SECONDS]

FILE contains the processor time of every test and of the fixtures that tests share (`pytest
--measure FILE`). `make check` keeps the shortest tests, each a test function with all its cases and
the fixtures that it needs, up to the budget of processor time; a shared fixture counts once. A new
test is not in the list and therefore runs. Files with the longest tests come first: `make test`
begins with them, so that no worker ends with a long file.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from pathlib import Path

SLOW = Path(__file__).resolve().parent.parent / "tests" / "slow.txt"
BUDGET = 70.0  # s on both cores together; lint, types and the start of pytest take the rest


def main() -> None:
    """Write the list."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--budget", type=float, default=BUDGET)
    args = parser.parse_args()
    took: Counter[str] = Counter()
    needs: defaultdict[str, set[str]] = defaultdict(set)
    for line in args.file.read_text(encoding="utf-8").splitlines():
        seconds, test, *fixtures = line.split("\t")
        took[test.partition("[")[0]] += float(seconds)
        needs[test.partition("[")[0]].update(f"fixture {name}" for name in fixtures)
    tests = [name for name in took if not name.startswith("fixture ")]
    whole = {test: took[test] + sum(took[name] for name in needs[test]) for test in tests}
    left, slow, ready = args.budget, [], set[str]()
    for test in sorted(tests, key=whole.__getitem__):
        left -= took[test] + sum(took[name] for name in needs[test] - ready)
        ready |= needs[test]
        if left < 0.0:
            slow.append(test)
    parts = defaultdict[str, set[str]](set)  # per file: its tests, and each shared fixture once
    for test in tests:
        parts[test.partition("::")[0]] |= {test, *needs[test]}
    files = {file: sum(took[name] for name in names) for file, names in parts.items()}
    slow.sort(key=lambda test: (-files[test.partition("::")[0]], test))
    SLOW.write_text("".join(f"{test}\n" for test in slow), encoding="utf-8")
    print(f"{len(tests)} test functions, {sum(took.values()):.0f} s; {len(slow)} are left out")


if __name__ == "__main__":
    main()
