"""Size of the code base: statements by package, without docstrings.

    python scripts/count_statements.py [FOLDER]

A statement is a node of the syntax tree. A line with two statements counts twice, and a call over
ten lines counts once: the number changes with the code, not with its layout.
"""

import ast
import sys
from collections import Counter
from pathlib import Path

SOURCES = Path(__file__).parents[1] / "src" / "skywright"


def count_statements(text: str) -> int:
    """Return the number of statements in a module's `text`, without bare strings."""
    return sum(
        isinstance(node, ast.stmt)
        and not (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        )
        for node in ast.walk(ast.parse(text))
    )


def count_packages(folder: Path = SOURCES) -> Counter[str]:
    """Return the number of statements below `folder`, by the folder or module directly below it."""
    counts: Counter[str] = Counter()
    for file in sorted(folder.rglob("*.py")):
        counts[file.relative_to(folder).parts[0]] += count_statements(file.read_text("utf-8"))
    return counts


if __name__ == "__main__":
    packages = count_packages(Path(sys.argv[1]) if len(sys.argv) > 1 else SOURCES)
    for name, count in sorted(packages.items()):
        print(f"{count:7d}  {name}")
    print(f"{packages.total():7d}")
