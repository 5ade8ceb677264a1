"""Computing time of each component of a vehicle per control tick.

A vehicle flies to a demanding state. Each row of its schedule is then called many times in compiled
code on unchanged records; the state is restored after each row.
"""

from functools import partial

from skywright.evidence.bench.flights import (
    count_ticks,
    fly_into_contact,
    fly_with_hands,
    load_scan,
    record_applied,
    step_bare,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import interleave, read_clock
from skywright.vehicle.bus import Clock
from skywright.vehicle.schedule import repeat_row
from skywright.vehicle.simulated import SimulatedVehicle

CALLS, STRETCHES = 16, 12
"""Calls of a row at a time, and repetitions: few enough for the buffers of collected samples."""


def measure(session: Session) -> list[Row]:
    """Measure the components of a scan in contact, and of a long-reach robot that moves its
    hands."""
    ticks, rounds = count_ticks(session.pick(1.0, 2.0, 2.0)), session.pick(2, 15, 40)
    rows = measure_vehicle("scan", fly_into_contact(load_scan()), ticks, rounds)
    return rows + measure_vehicle("arms", fly_with_hands("bimanual-longreach"), ticks, rounds)


def measure_vehicle(name: str, vehicle: SimulatedVehicle, ticks: int, rounds: int) -> list[Row]:
    """Measure all rows of a vehicle's schedule, and a control tick of physics alone."""
    assembly, applied = vehicle.assembly, record_applied(vehicle, ticks)
    cases = {"": partial(step_bare, vehicle, applied)}
    for i, step in enumerate(assembly.steps):
        cases[f"{step.component.name}.{step.name}"] = partial(time_row, vehicle, i)
    times = interleave(cases, rounds)
    bare = [1e6 * t / len(applied.controls) for t in times.pop("")]
    note = f"mj_step alone, {vehicle.n_steps} steps of 1 ms"
    out = [build_row(f"{name}.bare_tick_us", bare, "us", note=note)]
    for i, (label, spent) in enumerate(times.items()):
        row = assembly.rows[i]
        calls = vehicle.n_steps if row["fast"] else row["calls"] / row["every"]
        a_tick = [1e6 * calls * t / (CALLS * STRETCHES) for t in spent]
        slot = assembly.steps[i].slot
        key = f"{name}.{label.replace(' ', '_')}"
        out.append(build_row(f"{key}_us", a_tick, "us", note=f"slot {slot}, a control tick"))
    return out


def time_row(vehicle: SimulatedVehicle, row: int) -> float:
    """Return the time (s) of the repeated calls of a row; the state of the vehicle is restored."""
    assembly, saved = vehicle.assembly, vehicle.save()
    clock = assembly.get(Clock)
    clock["tick"] -= int(clock["tick"]) % int(assembly.rows["every"][row])  # make the step due
    at, clock_at, spent = int(assembly.rows.ctypes.data), assembly.address(Clock), 0.0
    repeat_row(at, row, clock_at, 1)
    for _ in range(STRETCHES):
        begin = read_clock()
        repeat_row(at, row, clock_at, CALLS)
        spent += read_clock() - begin
        assembly.restore(saved.assembly)
        clock["tick"] -= int(clock["tick"]) % int(assembly.rows["every"][row])
    vehicle.restore(saved)
    return spent
