"""Change one thing in the code at a time and check whether a test detects it.

    python scripts/mutants.py [--workers 2] [--group NAME] [--new | --retry-survivors]

`benchmarks/mutants.toml` defines the files to change, the number of mutants per group, and the
tests that cover it. The mutants are drawn with a seed: a sign, a factor, an axis, a dropped term, a
limit, a comparison. Recorded mutants stay while the code that they change exists; changes elsewhere
in a file do not draw others. Named ones are listed by their text. Every mutant is tested in a copy
of the checkout until a test fails: first with the tests `plain`, which run without compiling (a
second or two), then with the tests `compiled`. Tests of `plain` that fail without compiled code are
omitted.

The results are written to `benchmarks/mutants.csv`, one line per mutant. A survivor keeps its
line's reason, which a person writes, while the mutant stays the same.
"""

from __future__ import annotations

import argparse
import ast
import csv
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from queue import Queue
from threading import Lock
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PLAN, RESULTS = ROOT / "benchmarks" / "mutants.toml", ROOT / "benchmarks" / "mutants.csv"
COLUMNS = ("group", "file", "line", "kind", "before", "after", "result", "test", "reason")
SWAPS = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "minimum": "maximum",
         "maximum": "minimum"}  # fmt: skip
SLACK_S = 60.0  # added to three times the duration of the tests without a mutant


class Mutant(NamedTuple):
    """One change: characters `start` to `end` of a file become `after`."""

    group: str
    file: str
    start: int
    end: int
    line: int
    kind: str
    before: str
    after: str

    @property
    def key(self) -> tuple[str, ...]:
        return (self.file, self.kind, self.before, self.after)


# Places where the code can be changed


def find_mutants(group: str, file: str, text: str) -> list[Mutant]:
    """Return every change of the kinds above, in the numeric code of functions."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    data = text.encode()

    def place(node: ast.AST) -> tuple[int, int]:
        return (
            starts[node.lineno - 1] + node.col_offset,  # type: ignore[attr-defined]
            starts[node.end_lineno - 1] + node.end_col_offset,  # type: ignore[attr-defined]
        )

    found = []
    for statement in _list_statements(ast.parse(text)):
        for node in _walk(statement):
            for kind, after in _change(node):
                start, end = place(node)
                before = data[start:end].decode()
                if after != before and "\n" not in before:
                    number = data.count(b"\n", 0, start) + 1
                    found.append(Mutant(group, file, start, end, number, kind, before, after))
    return found


def _list_statements(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield assignments, returns and conditions in functions, without those that only raise."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for s in ast.walk(function):
                if isinstance(s, ast.Assign | ast.AugAssign | ast.Return | ast.AnnAssign):
                    yield s
                elif isinstance(s, ast.If | ast.While) and not _only_raises(s):
                    yield ast.Expr(s.test)


def _only_raises(s: ast.If | ast.While) -> bool:
    return all(isinstance(inner, ast.Raise) for inner in s.body)


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "op", "ctx"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(
                child, ast.JoinedStr | ast.Lambda | ast.FunctionDef
            ):
                yield from _walk(child)


def _change(node: ast.AST) -> Iterator[tuple[str, str]]:
    match node:
        case ast.BinOp(left=a, op=ast.Add() | ast.Sub() as op, right=b) if not _is_text(a, b):
            other = "-" if isinstance(op, ast.Add) else "+"
            yield "sign", f"({_code(a)}) {other} ({_code(b)})"
            yield "dropped term", f"({_code(a)})"
        case ast.BinOp(left=a, op=ast.Mult(), right=b) if not _is_text(a, b):
            yield "factor", f"2.0 * ({_code(node)})"
            yield "dropped factor", f"({_code(b)})"
        case ast.BinOp(left=a, op=ast.Div()):
            yield "dropped factor", f"({_code(a)})"
        case ast.UnaryOp(op=ast.USub(), operand=ast.Name() | ast.Attribute() | ast.Subscript()):
            yield "sign", f"({_code(node.operand)})"  # type: ignore[attr-defined]
        case ast.Subscript(value=v, slice=ast.Constant(value=int(i))) if i in (0, 1, 2):
            if isinstance(node.ctx, ast.Load):  # type: ignore[attr-defined]
                yield "axis", f"{_code(v)}[{(1, 0, 1)[i]}]"
        case ast.AugAssign(target=t, op=ast.Add() | ast.Sub() as op, value=v) if not _is_text(v):
            other = "-" if isinstance(op, ast.Add) else "+"
            yield "sign", f"{_code(t)} {other}= {_code(v)}"
            yield "dropped term", f"{_code(t)} += 0 * ({_code(v)})"
        case ast.Call(func=f, args=[_, *_]) if (name := _name(f)) in SWAPS:
            swapped = _code(f)[: -len(name)] + SWAPS[name]
            inside = ", ".join(
                [*map(_code, node.args), *(f"{k.arg}={_code(k.value)}" for k in node.keywords)]  # type: ignore[attr-defined]
            )
            yield ("limit" if name[0] == "m" else "axis"), f"{swapped}({inside})"
        case ast.Compare(left=a, ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() as op],
                         comparators=[b]):  # fmt: skip
            sense = ">" if isinstance(op, ast.Lt | ast.LtE) else "<"
            yield "comparison", f"({_code(a)}) {sense} ({_code(b)})"


def _is_text(*nodes: ast.AST) -> bool:
    kinds = (ast.JoinedStr, ast.List, ast.Tuple)
    return any(
        isinstance(n, kinds) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for one in nodes
        for n in ast.walk(one)
    )


def _name(f: ast.expr) -> str:
    return f.id if isinstance(f, ast.Name) else f.attr if isinstance(f, ast.Attribute) else ""


def _code(node: ast.AST) -> str:
    return ast.unparse(node)


# Selection and tests of the mutants


def draw_mutants(plan: dict, known: Container[tuple[str, ...]]) -> list[Mutant]:
    """Return each group's mutants: named ones, then `known` ones, then others in the seed's order.

    Two changes with the same text in one file count once, because the record cannot distinguish
    them.
    """
    drawn = []
    for name, group in plan["groups"].items():
        for one in group.get("named", []):
            text = (ROOT / one["file"]).read_text()
            count = text.count(one["before"])
            if count != 1:
                raise SystemExit(f"{one['file']}: {one['before']!r} occurs {count} times; valid: 1")
            at = len(text[: text.index(one["before"])].encode())
            line = text[: text.index(one["before"])].count("\n") + 1
            end = at + len(one["before"].encode())
            drawn.append(
                Mutant(name, one["file"], at, end, line, one["kind"], one["before"], one["after"])
            )
        every = {
            m.key: m
            for pattern in group["files"]
            for file in sorted(ROOT.glob(pattern))
            for m in find_mutants(name, str(file.relative_to(ROOT)), file.read_text())
        }
        if not every:
            raise SystemExit(f"{PLAN.name}: group {name!r} has no code to change")
        order = sorted(every, key=lambda key: (key not in known, _hash(plan["seed"], *key)))
        drawn += [every[key] for key in order[: group["mutants"]]]
    return drawn


def _hash(*values: object) -> str:
    return sha256(repr(values).encode()).hexdigest()


def copy_checkout(folder: Path) -> None:
    """Copy the files that tests need, with compiled code, so that it is compiled once."""
    for name in ("src", "tests", "examples", "benchmarks", "docs", "scripts"):
        shutil.copytree(ROOT / name, folder / name, copy_function=shutil.copy2)
    for name in ("pyproject.toml", "README.md", "CHANGELOG.md"):
        shutil.copy2(ROOT / name, folder / name)
    stamps = [_find_stamps(top / "src" / "skywright") for top in (ROOT, folder)]
    if stamps[0].exists():  # otherwise the copy drops its compiled code: core/compiled_code.py
        shutil.copy2(*stamps)


def _find_stamps(root: Path) -> Path:
    """Return the file in which the package at `root` records the sources of its compiled code."""
    return root / "__pycache__" / f"skywright-{sha256(os.fsencode(root)).hexdigest()[:8]}.json"


def run_tests(
    folder: Path, tests: list[str], limit_s: float, *, plain: bool, whole: bool = False
) -> tuple[list[str], float]:
    """Return the failed tests (one, unless `whole`), and the duration.

    The limit is in processor time, so that a loaded machine kills no mutant; the limit of wall time
    is ten times that.
    """
    env = {
        **os.environ, "PYTHONPATH": f"{folder / 'src'}{os.pathsep}{folder / 'scripts'}",
        "OPENBLAS_NUM_THREADS": "1", "NUMBA_DISABLE_JIT": str(int(plain)),
        "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "400",
    }  # fmt: skip
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider",
               "--no-header", "--tb=no", *([] if whole else ["-x"]),
               *(["-p", "plain_python"] if plain else []), *tests]  # fmt: skip
    began = time.perf_counter()
    process = subprocess.Popen(
        ["sh", "-c", f'ulimit -t {limit_s:.0f}; exec "$@"', "sh", *command],
        cwd=folder, env=env, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        out, _ = process.communicate(timeout=10.0 * limit_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return [f"no end after {10.0 * limit_s:.0f} s"], time.perf_counter() - began
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return [f"no end after {limit_s:.0f} s of processor time"], time.perf_counter() - began
    lines = [w.split(" ", 1)[1] for w in out.splitlines() if w.startswith(("FAILED ", "ERROR "))]
    failed = [line.split(" - ")[0] for line in lines]
    if process.returncode and not failed:
        failed = [out.strip().splitlines()[-1][:80]]
    return failed, time.perf_counter() - began


class Stage(NamedTuple):
    """Tests that a mutant has to pass, with their time limit."""

    tests: list[str]
    plain: bool
    limit_s: float


def list_stages(folder: Path, name: str, group: dict) -> list[Stage]:
    """Run a group's tests without a mutant: all must pass, except `plain` ones that need
    compiling."""
    stages = []
    for key in ("plain", "compiled"):
        if key not in group:
            continue
        plain, tests = key == "plain", list(group[key])
        failed, took = run_tests(folder, tests, 1800.0, plain=plain, whole=True)
        if failed and not plain:
            raise SystemExit(f"group {name}: {failed[0]} fails without a mutant")
        for test in failed:
            tests += ["--deselect", test]
        note = f", {len(failed)} need compiled code" if failed else ""
        print(f"{name}: {key} tests take {took:.0f} s{note}", flush=True)
        stages.append(Stage(tests, plain, 3.0 * took + SLACK_S))
    return stages


def try_mutant(folder: Path, stages: list[Stage], mutant: Mutant) -> str:
    """Apply the change, run the tests, revert it; return the test that failed, or ""."""
    file = folder / mutant.file
    data, before = file.read_bytes(), file.stat()
    file.write_bytes(data[: mutant.start] + mutant.after.encode() + data[mutant.end :])
    try:
        for stage in stages:
            failed, _ = run_tests(folder, stage.tests, stage.limit_s, plain=stage.plain)
            if failed:
                return failed[0]
    finally:
        file.write_bytes(data)
        os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    return ""


def write_results(rows: list[dict]) -> None:
    """Write the results so far, so that an interrupted run keeps them."""
    with RESULTS.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--group", help="only this one; the lines of the others are kept")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--new", action="store_true", help="only what has no result")
    some.add_argument("--retry-survivors", action="store_true", help="only what survived")
    a = parser.parse_args()
    plan = tomllib.loads(PLAN.read_text())
    old = list(csv.DictReader(RESULTS.open())) if RESULTS.exists() else []
    known = {tuple(r[k] for k in ("file", "kind", "before", "after")): r for r in old}
    mutants = draw_mutants(plan, known)
    wanted = [
        m for m in mutants
        if a.group in (None, m.group)
        and not (a.new and m.key in known)
        and not (a.retry_survivors and known.get(m.key, {}).get("result") != "survived")
    ]  # fmt: skip
    rows = {  # kept until they are tried again
        m: known[m.key] | {"line": str(m.line)} for m in mutants if m.key in known
    }
    writing = Lock()
    with tempfile.TemporaryDirectory(prefix="mutants-") as top:
        copies: Queue[Path] = Queue()
        for i in range(a.workers):
            folder = Path(top, str(i))
            copy_checkout(folder)
            copies.put(folder)
        folder = copies.get()
        stages = {
            name: list_stages(folder, name, plan["groups"][name])
            for name in dict.fromkeys(m.group for m in wanted)
        }
        copies.put(folder)

        def work(mutant: Mutant) -> None:
            folder = copies.get()
            try:
                test = try_mutant(folder, stages[mutant.group], mutant)
            finally:
                copies.put(folder)
            reason = "" if test else known.get(mutant.key, {}).get("reason", "")
            values = (mutant.group, mutant.file, str(mutant.line), mutant.kind, mutant.before,
                      mutant.after, "killed" if test else "survived", test, reason)  # fmt: skip
            rows[mutant] = dict(zip(COLUMNS, values, strict=True))
            if not test:
                change = f"{mutant.before} -> {mutant.after}"
                print(f"survived: {mutant.file}:{mutant.line} {change}", flush=True)
            with writing:
                write_results([rows[m] for m in mutants if m in rows])

        with ThreadPoolExecutor(a.workers) as pool:
            list(pool.map(work, wanted))
    write_results([rows[m] for m in mutants if m in rows])
    counts = Counter(r["result"] for r in rows.values())
    total = sum(counts.values())
    print(f"{counts['killed']} of {total} killed ({100 * counts['killed'] / total:.0f} %)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
