"""A scan: touch the pipe with the probe, slide along a pattern, and return (Tognon 2018)."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from skywright.core.arrays import Array, Table
from skywright.description.world.surface import Cylinder, build_cylinder
from skywright.errors import InputError
from skywright.inspection.calibration import build_calibration, compute_components
from skywright.missions.scan.plan import ScanWay, SurveyWay, plan_found
from skywright.missions.scan.task import Scan
from skywright.missions.skills.datum import look_at_datum
from skywright.missions.skills.survey import Tip, Touch, survey_surface
from skywright.missions.skills.surveyed import fit_touches, get_tip
from skywright.missions.skills.tables import build_retreat, cut_table, lift_table, reverse_table
from skywright.run.flight import Flight
from skywright.run.orders import ContactEnded, Order
from skywright.run.pilot import GivenBack
from skywright.run.supervisor import Supervisor
from skywright.vehicle.guard import CONTACT_LOST
from skywright.vehicle.instruments.eddy_current import LIFT_OFF_THRESHOLD, EddyProbe

TRIM_ERROR = 0.003  # m, tip error below which the free-flight integral counts as settled
TRIM_TIMES = (2.0, 12.0)  # s, least and largest time for it
SETTLE = 4.0  # s in contact before sliding: the attitude integral adapts to the push
AGAIN = "missed_move"
"""Phase: the path to the parts that are scanned once more."""
LOST_PATIENCE = 0.5  # s without contact before the scan backs off


class More(Protocol):
    """Additions of a kind to a scan."""

    def look(self) -> None:
        """Process the present reading; called after each tick of a slide."""

    def plan_again(self, known: Cylinder, row: Any) -> Mapping[str, Table] | None:
        """Plan another scan from the present row of REFERENCE; returns None if none is needed.

        `known` is the surveyed pipe, or that of the map.
        """


def fly(s: Supervisor[Scan], way: ScanWay) -> Flight:
    """Fly the phases between take-off and landing."""
    return fly_scan(s, way)


def fly_scan(s: Supervisor[Scan], way: ScanWay, more: More | None = None) -> Flight:
    """Fly the phases between take-off and landing; `more` may add a second scan."""
    segments, known = s.segments, None
    way_back: list[tuple[str, Table]] = []  # segments flown so far
    for name in ("approach", "unfold", "close_in"):
        s.follow(name, segments[name])
        way_back.append((name, segments[name]))
    if way.survey is not None:
        found, reason = _survey(s, way.survey, way_back)
        if found is None:
            _fly_back(s, way_back)
            return Flight(False, reason)
        segments, known = found
    ended = _scan(s, segments, more)
    if ended is not None:
        _go_home(s, segments, ended.along, way_back)
        return Flight(False, ended.reason)
    s.follow("leave", segments["leave"])
    if more is not None:
        segments = _scan_again(s, segments, more, known)
    for name in ("fold", "return"):
        s.follow(name, segments[name])
    return Flight(True, "")


def _scan_again(
    s: Supervisor[Scan], segments: Mapping[str, Table], more: More, known: Cylinder | None
) -> Mapping[str, Table]:
    """Scan once more if needed; returns the segments that lead home."""
    if known is None:
        pipe = s.vehicle.world.pipe
        assert pipe is not None
        known = build_cylinder(pipe)
    again = more.plan_again(known, segments["leave"][-1])
    if again is None:
        return segments
    there = [(AGAIN, again["face"]), ("close_in", again["close_in"])]
    for name, table in there:
        s.follow(name, table)
    ended = _scan(s, again, more)
    if ended is None:
        s.follow("leave", again["leave"])
        return again
    _go_home(s, again, ended.along, there)
    return segments


class Ended(NamedTuple):
    """A scan that ended early; the robot is at the stand-off."""

    along: float  # s, scanned part of the plan
    reason: str


def _scan(s: Supervisor[Scan], segments: Mapping[str, Table], more: More | None) -> Ended | None:
    """Touch and slide, and repeat up to `retries` times after a loss of contact.

    Returns None at the end of the scan in contact.
    """
    table, done = segments["scan"], 0.0
    touch: Table = segments["touch"]
    away: Table | None = None  # from the present point of contact back to the stand-off
    attempt = -1
    while attempt < s.task.retries:
        attempt += 1
        distance = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
        try:
            with s.orders.contact("the scan"):
                _trim(s)
                if not _touch(s, touch):
                    away = reverse_table(touch)
                    s.follow("back_off", away)
                    continue
                lost_at = _slide(s, cut_table(table, done) if done else table, more)
        except (GivenBack, ContactEnded) as back:  # in contact: touch again at the same place
            if not back.repeats:
                raise
            attempt -= 1
            if back.taken.phase == "scan":
                done += back.taken.along
                touch = build_retreat(back.taken.row, distance, 8.0, back=True)
            if s.orders.go_on(back, touch[0]) == Order.NEXT:
                return Ended(done, f"the operator ended the scan after {done:.1f} s")
            continue
        if lost_at is None:
            return None
        done += lost_at
        row = np.array(s.vehicle.reference)
        s.follow("back_off", build_retreat(row, distance, 4.0))
        touch = build_retreat(row, distance, 8.0, back=True)
    where = f"after {done:.1f} s of the scan" if done else "at the first touch"
    return Ended(done, f"no lasting contact {where}, {s.task.retries} retries used")


def _touch(s: Supervisor, table: Table) -> bool:
    """Touch, and calibrate the instrument from air to contact, as the evaluation does."""
    reading, seen = s.vehicle.look(EddyProbe.Reading), list[Array]()
    s.watch = lambda: seen.append(np.array(reading.ec))
    s.follow("touch", table)
    s.begin("settle")
    s.body.hold()
    s.wait(SETTLE)
    s.watch = None
    made = _calibrate(s, np.array(seen))
    s.end("done" if made else "retry")
    return made


def _calibrate(s: Supervisor, ec: Array) -> bool:
    """Calibrate the probe on its signal (n, 2) of a touch; returns whether that made contact."""
    try:
        found = build_calibration(ec, lift_off_threshold=LIFT_OFF_THRESHOLD)
    except InputError:  # the signal has no transition from air to contact
        return False
    s.probe.calibrate(found.contact, found.lift_off_axis)
    return bool(abs(compute_components(ec[-1:], found)[0][0]) < LIFT_OFF_THRESHOLD)


def _slide(s: Supervisor, table: Table, more: More | None = None) -> float | None:
    """Follow the scan; returns the time along `table` of a lasting loss of contact, or None."""
    s.begin("scan")
    s.body.track(table)
    start, out_since = s.vehicle.t, None
    while True:
        ticked = s.tick(CONTACT_LOST)
        if more is not None:
            more.look()
        if s.probe.in_contact():
            out_since = None
        elif out_since is None:
            out_since = ticked.t
        elif ticked.t - out_since > LOST_PATIENCE:
            s.end("retry")
            return out_since - start
        if ticked.arrived:
            s.end("done")
            return None


def _trim(s: Supervisor) -> None:
    """Hold the stand-off until the integral settles in all directions, before a touch."""
    s.begin("trim")
    s.body.hold()
    start = good_since = s.clock
    while True:
        s.tick()
        t = s.clock
        error = s.vehicle.reference["p_WT"] - s.vehicle.estimate["p_WT"]
        if float(np.linalg.norm(error)) > TRIM_ERROR:
            good_since = t
        if (t - start > TRIM_TIMES[0] and t - good_since > 1.0) or t - start > TRIM_TIMES[1]:
            s.end("done")
            return


def _survey(
    s: Supervisor[Scan], survey: SurveyWay, way_back: list[tuple[str, Table]]
) -> tuple[tuple[Mapping[str, Table], Cylinder] | None, str]:
    """Touch the pipe and plan again; returns the segments and the pipe, or None and the reason."""

    first = 0 if survey.mark is None else 1  # index of the first touch among the stops

    def come(i: int, _: list[Touch]) -> None:
        move = s.segments.get(f"survey {first + i + 1}")
        if move is not None:
            s.follow("survey_move", move)
            way_back.append(("survey_move", move))

    mark = None
    if survey.mark is not None:
        come(-1, [])
        _trim(s)
        seen = look_at_datum(s, survey.setup)
        if isinstance(seen, str):
            return None, seen
        mark = seen
    tip = Tip(s, survey.sensed)
    touches = survey_surface(s, tip, survey.frames, survey.travels.tolist(), come, lambda: _trim(s))
    leave = s.segments["survey leave"]
    s.follow("survey_leave", leave)
    way_back.append(("survey_leave", leave))
    surveyed = fit_touches(survey.setup, touches, get_tip(survey.setup), mark)
    if surveyed.reason:
        return None, surveyed.reason
    again = plan_found(survey.setup, surveyed.found.cylinder, leave[-1])
    if not again.feasible:
        return None, f"no plan on the surveyed pipe: {again.blocked_by}"
    for name in ("face", "close_in"):
        s.follow(name, again.segments[name])
        way_back.append((name, again.segments[name]))
    return (again.segments, surveyed.found.cylinder), ""


def _go_home(
    s: Supervisor, segments: Mapping[str, Table], done: float, way_back: list[tuple[str, Table]]
) -> None:
    """Fly back: over the scanned path at the stand-off, then the approach in reverse."""
    flown = segments["scan"][segments["scan"]["t"] <= done]
    touch = segments["touch"]
    lift = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
    if done > 0.0 and len(flown) > 1:
        s.follow("retrace", reverse_table(lift_table(flown, lift), speed_up=4.0))
    _fly_back(s, way_back)


def _fly_back(s: Supervisor, way_back: list[tuple[str, Table]]) -> None:
    """Fly the recorded segments in reverse."""
    for name, table in reversed(way_back):
        s.follow(f"reverse {name}", reverse_table(table))
