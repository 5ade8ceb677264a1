"""Computing time for a recorded flight of total station and tracking camera."""

from functools import partial

from skywright.analysis.locate.fusion import fuse
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import interleave, read_clock
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.vehicle.sensor_flight import Flight, build_inspection_path, simulate_flight

DURATION, CALIBRATION = 100.0, 40.0  # s


def measure(session: Session) -> list[Row]:
    """Time clock alignment, calibration and filter on a flight of 100 s, calibrated on 40 s."""
    flight = simulate_flight(build_inspection_path(1, DURATION), 1)
    found = _calibrate(flight)
    times = interleave(
        {
            "calibrate": partial(_time_calibration, flight),
            "filter": partial(_time_filter, flight, found),
        },
        session.pick(1, 5, 20),
    )
    samples = len(flight.camera.t) + len(flight.station.t)
    each = [1e6 * t / samples for t in times["filter"]]
    note = f"{DURATION:g} s at {flight.camera.rate:.0f} and {flight.station.rate:.0f} Hz"
    return [
        build_row("calibrate_s", times["calibrate"], "s", note=f"clocks and frame, {note}"),
        build_row("filter_sample_us", each, "us", note=f"drift-aware filter, {note}"),
    ]


def _calibrate(flight: Flight) -> Calibration:
    """Estimate the clock offset from the speeds, then clocks, frame and scale together."""
    first = float(flight.station.t[0])
    span = (first, first + CALIBRATION)
    offset = estimate_offset(flight.station.cut(*span), flight.camera).offset
    return calibrate(flight.station, flight.camera, offset, span=span)


def _time_calibration(flight: Flight) -> float:
    start = read_clock()
    _calibrate(flight)
    return read_clock() - start


def _time_filter(flight: Flight, found: Calibration) -> float:
    start = read_clock()
    fuse(flight.station, flight.camera, found)
    return read_clock() - start
