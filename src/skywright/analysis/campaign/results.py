"""The results of a campaign as a table with one row per run: CSV, and Parquet on request."""

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.errors import InputError
from skywright.run.rows import Row

CSV = "results.csv"
PARQUET = "results.parquet"


def check_parquet() -> None:
    """Raise InputError if pyarrow is not installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError(
            "--parquet needs pyarrow, which is not installed: pip install 'skywright[parquet]'; "
            f"{CSV} holds the same table"
        ) from None


def tabulate(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Return the columns: seed, outcome, varied keys and metrics by name, timing, command.

    Keys of the description and metrics keep their dotted names. Non-finite values become None.
    """

    def gather(name: str) -> list[str]:
        return list(dict.fromkeys(key for row in rows for key in getattr(row, name)))

    table: dict[str, list[Any]] = {
        "run": [r.run for r in rows],
        "seed": [r.seed for r in rows],
        "outcome": [r.outcome for r in rows],
        "requirement": [r.requirement or None for r in rows],
        "failed": [list(r.failed) for r in rows],
        "reason": [r.reason for r in rows],
    }
    for key in gather("varied"):
        table[key] = [r.varied.get(key) for r in rows]
    for key in sorted(gather("metrics")):
        table[key] = [r.metrics.get(key) for r in rows]
    table["attempts"] = [r.attempts for r in rows]
    for key in gather("timing"):
        table[f"timing.{key}"] = [r.timing.get(key) for r in rows]
    table["command"] = [r.command for r in rows]
    return {
        name: [None if isinstance(v, float) and not math.isfinite(v) else v for v in cells]
        for name, cells in table.items()
    }


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write the table as CSV: missing values are empty cells, `failed` is separated by spaces."""
    table = tabulate(rows)
    table["failed"] = [" ".join(names) for names in table["failed"]]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def write_parquet(rows: Sequence[Row], path: Path, identity: dict[str, Any]) -> None:
    """Write the table as Parquet, with the campaign's identity in its metadata.

    The metadata key is `skywright.campaign`. Needs pyarrow (see `check_parquet`).
    """
    import pyarrow
    import pyarrow.parquet

    types = {"requirement": pyarrow.string(), "failed": pyarrow.list_(pyarrow.string())}
    columns = {
        name: _build_column(cells, types.get(name)) for name, cells in tabulate(rows).items()
    }
    table = pyarrow.table(columns).replace_schema_metadata(
        {"skywright.campaign": json.dumps(identity)}
    )
    pyarrow.parquet.write_table(table, path)


def _build_column(cells: list[Any], kind: Any = None) -> Any:
    import pyarrow

    kinds = {type(v) for v in cells if v is not None}
    if kind is not None or kinds in ({bool}, {int}, {str}):
        return pyarrow.array(cells, kind)
    if kinds <= {int, float}:
        return pyarrow.array([None if v is None else float(v) for v in cells], pyarrow.float64())
    return pyarrow.array([None if v is None else str(v) for v in cells], pyarrow.string())
