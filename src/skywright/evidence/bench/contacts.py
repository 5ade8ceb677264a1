"""Growth of the computing time with contacts: the same robot hovering, on the pipe, standing."""

from functools import partial

from skywright.evidence.bench.flights import (
    count_ticks,
    fly_into_contact,
    fly_to_hover,
    load_scan,
    record_applied,
    run_ticks,
    step_bare,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave
from skywright.run.backends import build_vehicle

NOTES = {"air": "hovering", "tip": "the probe's tip on the pipe", "feet": "standing"}


def measure(session: Session) -> list[Row]:
    """Time physics steps alone and the fast closed loop in each state, in turns."""
    vehicles = {
        "air": fly_to_hover(load_scan()),
        "tip": fly_into_contact(load_scan()),
        "feet": build_vehicle(load_scan()),
    }
    run_ticks(vehicles["feet"], count_ticks(1.0))
    ticks = count_ticks(session.pick(0.2, 1.0, 1.0))
    contacts = {name: int(v.sim.data.ncon) for name, v in vehicles.items()}
    applied = {name: record_applied(v, ticks) for name, v in vehicles.items()}
    calls = {f"bare {n}": partial(step_bare, v, applied[n]) for n, v in vehicles.items()}
    calls |= {f"fast {n}": partial(run_ticks, v, ticks) for n, v in vehicles.items()}
    times = interleave(calls, session.pick(2, 20, 80))
    rows = []
    for name in ("tip", "feet"):
        for way in ("bare", "fast"):
            ratios = compute_ratios(times[f"{way} {name}"], times[f"{way} air"])
            note = f"{NOTES[name]} (contacts: {contacts[name]}) over hovering ({contacts['air']})"
            what = "mj_step alone" if way == "bare" else "fast closed loop"
            rows.append(build_row(f"{name}_{way}_over_air", ratios, note=f"{what}: {note}"))
    return rows
