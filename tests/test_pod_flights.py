"""POD of a mission: rows of a campaign become a table, and the table says what it says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.special import expit

from skywright.analysis.campaign.store import decode_row, encode_row
from skywright.analysis.pod.flights import collect_inspections, write_table
from skywright.analysis.pod.groups import compare_groups, divide
from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import compute_pod
from skywright.analysis.pod.table import load_inspections
from skywright.cli import main
from skywright.errors import InputError
from skywright.run.inspected import Inspected, InspectedFlaw
from skywright.run.rows import Row


def build_row(
    run: int, inspected: Inspected | None, outcome: str = "failed", **varied: float
) -> Row:
    told = None if inspected is None else inspected.to_json()
    return Row(run, run, outcome, "", (), "", dict(varied), {}, {}, 1, "", told)


def build_rows(n: int, seed: int = 1) -> list[Row]:
    """Cracks of 0.1 to 1 mm; wind 5 shifts the curve; every tenth flight loses its contact."""
    r, rows = np.random.default_rng(seed), []
    for k in range(n):
        wind = (1.0, 5.0)[k % 2]
        depth = float(r.uniform(0.1, 1.0))
        held = k % 10 != 9
        hit = held and bool(r.random() < expit(14.0 * (depth - 0.3 - 0.05 * wind)))
        flaw = InspectedFlaw(
            "c1", {"depth_mm": depth, "length_mm": 6.0}, hit, held, None, {"gap_mm": 0.1 * wind}
        )
        rows.append(build_row(k, Inspected((flaw,), 5, int(k == 0), "30 mm of path"), wind=wind))
    return rows


def test_rows_of_a_campaign_are_a_table_that_reads_back(tmp_path: Path) -> None:
    rows = [decode_row(json.loads(json.dumps(encode_row(row)))) for row in build_rows(120)]
    rows += [build_row(200, None, "infeasible"), build_row(201, None, "infeasible")]
    flights = collect_inspections(rows)
    assert flights.left_out == {"infeasible": 2} and flights.flown == 120
    assert flights.size == "depth_mm" and flights.sizes == ("depth_mm", "length_mm")
    path = tmp_path / "pod.csv"
    path.write_text(write_table(flights))
    again = load_inspections(path)
    one, other = compute_pod(flights.table), compute_pod(again)
    assert one.to_json() == other.to_json() and again.unit == "mm"
    assert one.counted.clean_sites == 600 and one.counted.flaws == 120
    assert one.false_calls is not None and one.false_calls.calls == 1
    assert one.curve.ceiling is not None
    assert one.curve.ceiling.value == pytest.approx(0.9) and one.curve.a90 is None
    assert one.curve.conditional is not None and one.curve.conditional["a90"] is not None
    found = compare_groups(again, "wind", Method())
    assert found.p_same < 0.05 and list(found.groups) == ["1.0", "5.0"]
    code = CliRunner().invoke(main, ["pod", str(tmp_path), "--group", "wind", "--json"])
    assert code.exit_code == 0 and json.loads(code.output)["groups"]["column"] == "wind"


def test_passes_of_one_flight_are_one_datum_and_flights_are_not() -> None:
    """A flaw of a name in two flights is two flaws; the kind reports a flaw once a flight."""
    flights = collect_inspections(build_rows(40))
    assert len(set(flights.table.flaw or ())) == 41  # 40, and no name for the clear places
    assert compute_pod(flights.table).counted.passes_merged == 0


def test_many_numbers_are_divided_into_ranges() -> None:
    cells = tuple(f"{x:.3f}" for x in np.linspace(0.0, 0.9, 30)) + ("",)
    groups = divide(cells)
    assert sorted(set(groups)) == ["", "0 to 0.3", "0.3 to 0.6", "0.6 to 0.9"]
    assert groups[0] == "0 to 0.3" and groups[29] == "0.6 to 0.9" and groups[30] == ""
    assert list(divide(("a", "b", "a"))) == ["a", "b", "a"]


@pytest.mark.parametrize(
    ("rows", "size", "says"),
    [
        ([], None, "no run inspected a flaw"),
        ([build_row(0, None, "refused")], None, "1 refused"),
        (build_rows(3), "width_mm", "valid: depth_mm, length_mm"),
        ([build_row(0, Inspected((InspectedFlaw("x", {"d": 0.0}, True, True),)))], None, "above 0"),
        ([build_row(0, Inspected((), 9, 0, ""))], None, "the world needs flaws"),
    ],
)
def test_campaigns_without_data_are_told(rows: list[Row], size: str | None, says: str) -> None:
    with pytest.raises(InputError, match=says):
        collect_inspections(rows, size)


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("waypoints",), "requires --runs"),
        (("nowhere",), "requires --runs"),
        (("nowhere", "--runs", "2"), "nowhere"),
        (("waypoints", "--runs", "0"), "--runs 0"),
        (("waypoints", "--runs", "2", "--columns", "size=a"), "valid for a table"),
        (("x.csv", "--runs", "2"), "--runs: valid for a mission"),
        (("x.csv", "--vary", "a=b"), "--vary: valid for a mission"),
        (("x.csv",), "x.csv"),
    ],
)
def test_wrong_requests_are_told_in_one_line(args: tuple[str, ...], says: str) -> None:
    done = CliRunner().invoke(main, ["pod", *args])
    assert done.exit_code == 2 and says in done.output
    assert len(done.output.strip().splitlines()) == 1
