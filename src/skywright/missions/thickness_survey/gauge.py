"""Probe and gauge of a survey: set up on the block before the flight, checked on it after."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.inspection.echoes import Pulse
from skywright.inspection.thickness import (
    GaugeCheck,
    GaugeSetup,
    Rules,
    ThicknessGauge,
    check_gauge,
    set_up_gauge,
)
from skywright.missions.skills.instrument import Carried, find_instrument
from skywright.missions.skills.procedure import ThicknessProcedure
from skywright.models.ultrasonic import (
    CLIP,
    SAMPLE_RATE,
    Coupling,
    Transducer,
    compute_ascan,
    compute_echoes,
)
from skywright.run.setup import Setup
from skywright.vehicle.sensors.ultrasonic import Ultrasonic, find_wall

Probe = Carried[Ultrasonic.Table]
SAME_MATERIAL = 0.02
"""Largest relative difference of the velocities of block and wall: that between steels."""


def find_probe(setup: Setup[Any]) -> Probe:
    """Return the robot's ultrasonic probe; raises InputError if it has none."""
    return find_instrument(setup, Ultrasonic, "ultrasonic probe")


def set_up(setup: Setup[Any], probe: Probe, procedure: ThicknessProcedure) -> GaugeSetup:
    """Set up the gauge on the procedure's block, before the flight.

    Raises InputError for a block whose steps are not resolved, or of another material.
    """
    wall, velocity = find_wall(setup.world, probe.name)[0], procedure.velocity_m_per_s
    if not abs(wall.velocity_m_per_s / velocity - 1.0) <= SAME_MATERIAL:
        raise InputError(
            f"mission.task.procedure.velocity_m_per_s: a block of {velocity:g} m/s for a wall of "
            f"{wall.velocity_m_per_s:g} m/s; valid: within {SAME_MATERIAL:.0%}; use a block of the "
            "part's material"
        )
    transducer = probe.table.build_transducer()
    pulse = Pulse(
        transducer.frequency, transducer.bandwidth, SAMPLE_RATE, transducer.ready, CLIP
    )  # fmt: skip
    steps = (procedure.block_thin_m, procedure.block_thick_m)
    return set_up_gauge(
        _visit(setup, probe, procedure, "block before"), steps, pulse,
        expected=procedure.velocity_m_per_s, separation=transducer.separation,
    )  # fmt: skip


def check(
    setup: Setup[Any], probe: Probe, procedure: ThicknessProcedure, done: GaugeSetup
) -> GaugeCheck:
    """Measure the block once more, after the flight."""
    return check_gauge(done, _visit(setup, probe, procedure, "block after"))


def build_gauge(procedure: ThicknessProcedure, done: GaugeSetup) -> ThicknessGauge:
    """Return a gauge with the procedure's rules; raises InputError if it cannot measure this."""
    rules = Rules(
        snr_db=procedure.snr_db, least_fsh=procedure.least_height_fraction,
        steady_m=procedure.steady_m, steady_count=procedure.steady_count,
        steady_s=procedure.steady_s,
    )  # fmt: skip
    return ThicknessGauge(
        done, procedure.nominal_m, mode="single" if done.separation else "echo-to-echo",
        velocity_fraction=procedure.velocity_fraction, rules=rules,
    )  # fmt: skip


def _visit(
    setup: Setup[Any], probe: Probe, procedure: ThicknessProcedure, when: str
) -> tuple[Array, Array]:
    """Return A-scans on both steps, taken by hand on the ground: well coupled, normal, uncoated."""
    rng = build_stream(setup.description.mission.seed, "block", when)
    transducer: Transducer = probe.true.build_transducer()
    coupling = Coupling(velocity=procedure.velocity_m_per_s)
    thin, thick = (
        compute_ascan(
            transducer, compute_echoes(transducer, coupling, np.array([step])), rng,
            place_seed=int(rng.integers(2**31)),
        )
        for step in (procedure.block_thin_m, procedure.block_thick_m)
    )  # fmt: skip
    return thin, thick
