"""Wall loss: change of thickness, rates and remaining life, each with its standard deviation.

    LT = (t_initial - t_actual) / dt      long-term rate, from the first inspection
    ST = (t_previous - t_actual) / dt     short-term rate, from the previous inspection
    life = (t_actual - t_required) / rate

API 570, section 7.1 (and API 510, 7.1): the rate that gives the shorter life governs, and the
interval to the next inspection is at most half of the remaining life. The standard deviations
follow from propagation of errors. The two readings of a difference are independent. The actual
thickness also appears in the numerator of the life.

An inspection is all readings of a location within MERGE_DAYS. The deviation of a rate is inversely
proportional to the time between its inspections: two readings of the same day with a deviation of
0.1 mm would give a rate of some 50 mm per year.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.inspection.history.database import parse_stamp, stamp
from skywright.inspection.history.entries import COVERAGE, StoredCalibration, StoredReading

MERGE_DAYS = 30.0
"""Days; later readings belong to the next inspection of a location."""
YEAR_S = 365.25 * 86400.0
ONE_SIDED = 1.645


class Inspected(NamedTuple):
    """One inspection of a location: the mean of its accepted readings within MERGE_DAYS."""

    flights: tuple[str, ...]  # in chronological order
    time: datetime  # of the first reading
    thickness_mm: float
    std_mm: float
    readings: int
    x_m: float
    y_m: float
    z_m: float
    simulated: bool


class Rate(NamedTuple):
    """Loss between two inspections, in total and per year; negative if the wall reads thicker."""

    loss_mm: float
    loss_std_mm: float
    years: float
    mm_per_year: float
    std_mm_per_year: float
    life_years: float | None  # None: no loss, or no required thickness
    life_std_years: float | None
    life_low_years: float | None
    """Life at the one-sided upper 95 % bound of the rate, from the measured thickness. None: the
    bound is 0 or less, or no thickness is required."""

    @property
    def significant(self) -> bool:
        """Whether the loss exceeds its uncertainty (one-sided, 95 %)."""
        return self.loss_mm > ONE_SIDED * self.loss_std_mm


class Location(NamedTuple):
    """One location of a component with all its inspections."""

    name: str
    asset: str
    component: str
    x_m: float  # mean position in the frame of the asset
    y_m: float
    z_m: float
    place_std_m: float | None
    """Largest standard deviation of a position: registration and position within the flight."""
    inspections: list[Inspected]  # in chronological order; empty: no reading is valid
    long_term: Rate | None  # None: one inspection
    short_term: Rate | None
    required_mm: float | None
    life_years: float | None  # the shorter of the two
    interval_years: float | None
    """Half of `life_years`, from the rates as measured; None if `life_years` is None."""
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON."""
        rates = {
            name: None if rate is None else rate._asdict() | {"significant": rate.significant}
            for name, rate in (("long_term", self.long_term), ("short_term", self.short_term))
        }
        each = [one._asdict() | {"time": stamp(one.time)} for one in self.inspections]
        return self._asdict() | {"inspections": each, "actual_mm": self.actual_mm, **rates}

    @property
    def actual_mm(self) -> float | None:
        """Thickness at the last inspection; None: there is none."""
        return self.inspections[-1].thickness_mm if self.inspections else None


def compute_rate(first: Inspected, last: Inspected, required_mm: float | None) -> Rate:
    """Return loss, rate and life between two inspections, with their standard deviations.

    Raises InputError if `last` is not later than `first`.
    """
    years = (last.time - first.time).total_seconds() / YEAR_S
    if years <= 0:
        before, after = (", ".join(one.flights) for one in (first, last))
        raise InputError(
            f"the inspections by flights {before} and {after} have the same time; correct the time "
            "of one"
        )
    loss = first.thickness_mm - last.thickness_mm
    loss_std = math.hypot(first.std_mm, last.std_mm)
    rate, rate_std = loss / years, loss_std / years
    life = life_std = low = None
    if required_mm is not None:
        margin = last.thickness_mm - required_mm
        if rate > 0:
            life = max(margin, 0.0) / rate
            # life = m / r; a unit change of the actual thickness changes m by 1 and r by -1 / years
            by_actual = 1.0 / rate + margin / (rate**2 * years)
            by_first = -margin / (rate**2 * years)
            life_std = math.hypot(by_actual * last.std_mm, by_first * first.std_mm)
        upper = rate + ONE_SIDED * rate_std
        low = max(margin, 0.0) / upper if upper > 0 else None
    return Rate(loss, loss_std, years, rate, rate_std, life, life_std, low)


def group_places(
    readings: Sequence[StoredReading], radius: float
) -> list[tuple[str, list[StoredReading]]]:
    """Return (name, readings) of each location.

    Readings of the same name form one location of their component. A reading without a name joins
    the nearest unnamed location of its component within `radius` (m), or starts a new location if
    there is none. The readings of a location keep their order.
    """
    groups: list[tuple[str, list[StoredReading]]] = []
    centres: list[Array] = []
    for r in readings:
        p = np.array([r.reading.x_m, r.reading.y_m, r.reading.z_m])
        fits = [
            k for k, (name, members) in enumerate(groups)
            if members[0].component == r.component and members[0].asset == r.asset
            and (
                name == r.reading.spot if r.reading.spot and name
                else not (r.reading.spot or name) and np.linalg.norm(centres[k] - p) <= radius
            )
        ]  # fmt: skip
        if not fits:
            groups.append((r.reading.spot, [r]))
            centres.append(p)
            continue
        k = min(fits, key=lambda k: float(np.linalg.norm(centres[k] - p)))
        groups[k][1].append(r)
        centres[k] += (p - centres[k]) / len(groups[k][1])
    return groups


def divide_inspections(members: Sequence[StoredReading]) -> list[Inspected]:
    """Return the inspections of a location in chronological order.

    The first reading starts an inspection, which contains the readings of MERGE_DAYS from then on.
    The first reading after them starts the next one.
    """
    timed = [(parse_stamp(m.time_utc, m.flight), m) for m in members]
    groups: list[tuple[datetime, list[StoredReading]]] = []
    for t, m in sorted(timed, key=lambda one: one[0]):
        if not groups or t - groups[-1][0] >= timedelta(days=MERGE_DAYS):
            groups.append((t, []))
        groups[-1][1].append(m)
    return [_merge(t, some) for t, some in groups]


def _merge(start: datetime, members: Sequence[StoredReading]) -> Inspected:
    """Return the mean of the readings of one inspection.

    Its standard deviation is the largest stated one, or the scatter of the readings if that is
    larger. It does not decrease with the number of readings, because readings of one flight share
    calibration and velocity.
    """
    values = [m.reading.value for m in members if m.reading.value is not None]
    n = len(values)
    mean = sum(values) / n
    scatter = math.sqrt(sum((v - mean) ** 2 for v in values) / (n - 1)) if n > 1 else 0.0
    stated = max((m.reading.u95 or 0.0) / COVERAGE for m in members)
    x, y, z = _compute_centre([(m.reading.x_m, m.reading.y_m, m.reading.z_m) for m in members])
    flights = tuple(dict.fromkeys(m.flight for m in members))
    return Inspected(
        flights, start, mean, max(stated, scatter), n, x, y, z, any(m.simulated for m in members)
    )


def _compute_centre(places: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    x, y, z = (sum(p[i] for p in places) / len(places) for i in range(3))
    return x, y, z


def build_history(
    readings: Sequence[StoredReading],
    required: Mapping[tuple[str, str], float | None],
    radius: float = 0.05,
    calibrations: Sequence[StoredCalibration] = (),
) -> list[Location]:
    """Return the history of every location with accepted thickness readings.

    `required` maps (asset, component) to the required thickness (mm). `radius` (m) groups readings
    without a name. A failed check among `calibrations` makes the readings of its instrument in its
    flight invalid, and so does another unit than mm, or no u95, because the standard deviation of
    the rate is then unknown. The inspections omit such readings, and the notes of the location
    state it.
    """
    usable = [r for r in readings if r.reading.accepted and r.reading.quantity == "thickness"]
    out = []
    for number, (name, members) in enumerate(group_places(usable, radius), 1):
        owner = members[0].asset, members[0].component or ""
        valid, notes = _omit_invalid(members, calibrations)
        out.append(
            _judge(name or f"place {number}", owner, members, valid, required.get(owner), notes)
        )
    return out


def _omit_invalid(
    members: Sequence[StoredReading], calibrations: Sequence[StoredCalibration]
) -> tuple[list[StoredReading], list[str]]:
    """Return the valid readings, and a note for each flight with omitted ones.

    A reading without a calibration counts as one of every instrument of its flight.
    """
    instruments = {c.id: c.calibrated[:3] for c in calibrations}  # method, model, serial number
    checks = [c for c in calibrations if not c.calibrated.passed]
    valid, omitted = [], Counter[str]()
    for m in members:
        mine = instruments.get(m.calibration or 0)
        failed = [
            c.calibrated for c in checks
            if c.id == m.calibration
            or (c.flight == m.flight and mine in (None, instruments[c.id]))
        ]  # fmt: skip
        if m.reading.unit != "mm" or m.reading.u95 is None:
            lacks = "u95" if m.reading.unit == "mm" else "unit mm"
            omitted[f"of flight {m.flight} without {lacks}"] += 1
            continue
        if not failed:
            valid.append(m)
            continue
        why = f": {failed[0].note}" if failed[0].note else ""
        omitted[
            f"of flight {m.flight}, whose calibration check {failed[0].stage} the flight failed"
            + why
        ] += 1
    return valid, [f"omits {n} reading{'s' * (n > 1)} {which}" for which, n in omitted.items()]


def _judge(
    name: str,
    owner: tuple[str, str],
    members: Sequence[StoredReading],
    valid: Sequence[StoredReading],
    required_mm: float | None,
    notes: list[str],
) -> Location:
    each = divide_inspections(valid)
    long_term = short_term = None
    if len(each) > 1:
        long_term = compute_rate(each[0], each[-1], required_mm)
        short_term = compute_rate(each[-2], each[-1], required_mm)
        notes += _note_rates(long_term, short_term)
    if required_mm is not None and each and each[-1].thickness_mm < required_mm:
        notes.append("below the required thickness")
    elif (
        required_mm is not None
        and each
        and (each[-1].thickness_mm - ONE_SIDED * each[-1].std_mm < required_mm)
    ):
        notes.append("within the deviation of the required thickness")
    known = [
        math.hypot(m.registration_std_m or 0.0, (m.reading.place_u95_m or 0.0) / COVERAGE)
        for m in members
        if m.registration_std_m is not None or m.reading.place_u95_m is not None
    ]
    lives = [r.life_years for r in (long_term, short_term) if r and r.life_years is not None]
    life = min(lives, default=None)
    if any(m.registration_std_m is None for m in members) and len(each) > 1:
        notes.append("a flight states no registration error: places may differ by more than shown")
    places = [(one.x_m, one.y_m, one.z_m) for one in each]
    places = places or [(m.reading.x_m, m.reading.y_m, m.reading.z_m) for m in members]
    return Location(
        name, *owner, *_compute_centre(places), max(known, default=None), each, long_term,
        short_term, required_mm, life, None if life is None else 0.5 * life, tuple(notes),
    )  # fmt: skip


def _note_rates(long_term: Rate, short_term: Rate) -> list[str]:
    notes = []
    if not (long_term.significant or short_term.significant):
        notes.append("no loss beyond the deviations: the bound of the life counts")
    elif long_term.life_years is not None and short_term.life_years is not None:
        short = short_term.life_years < long_term.life_years
        governs, other = (short_term, long_term) if short else (long_term, short_term)
        if not governs.significant:
            term, rest = ("short", "long") if short else ("long", "short")
            notes.append(
                f"the {term}-term rate governs, but its loss of {governs.loss_mm:.2f} mm is within "
                f"the deviations; the {rest}-term rate gives a life of {other.life_years:.3g} a"
            )
    grown = -short_term.loss_mm
    if grown > COVERAGE * short_term.loss_std_mm:
        notes.append(
            f"the wall reads {grown:.2f} mm thicker than before, beyond the deviations: check "
            "calibration, couplant and place"
        )
    return notes
