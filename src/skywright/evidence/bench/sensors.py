"""Computing time of sensors, link, wind and friction in the closed loop, relative to the plain
scan."""

from functools import partial

from skywright.evidence.bench.flights import (
    FULL_STRENGTH,
    count_ticks,
    fly_into_contact,
    load_scan,
    run_ticks,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave

FAN = ("world.wind.kind=fan", "world.wind.mean_mps=2")
CASES: dict[str, tuple[str, ...]] = {
    "plain": (),
    "mocap_30hz": ("world.mocap.rate_hz=30",),
    "mocap_500hz": ("world.mocap.rate_hz=500",),
    "artefacts": ("world.mocap.outlier_fraction=0.02",),
    "observer": ("mission.estimator=observer",),
    "link": ("world.link.delay_s=0.004", "world.link.jitter_s=0.001"),
    "steady_wind": ("world.wind.kind=steady", "world.wind.mean_mps=2"),
    "fan": FAN,
    "fan_oscillating": (*FAN, "world.wind.fan.sweep_deg=10"),
    "dryden": ("world.wind.kind=dryden", "world.wind.mean_mps=2"),
    "friction": ("world.pipe.friction_variation=0.3",),
    "full_strength": FULL_STRENGTH,
}
NOTES = {
    "mocap_30hz": "motion capture at 30 Hz instead of 100",
    "mocap_500hz": "motion capture at 500 Hz",
    "artefacts": "2 % of the samples are artefacts",
    "observer": "the plain observer: of the inertial unit only the mean rate is used",
    "link": "control over a link of 4 ms, each way",
    "steady_wind": "steady wind of 2 m/s",
    "fan": "a fan's jet",
    "fan_oscillating": "an oscillating fan's jet",
    "dryden": "Dryden turbulence",
    "friction": "friction that varies along the pipe",
    "full_strength": "gusts, link, artefacts and friction together",
}


def measure(session: Session) -> list[Row]:
    """Fly all cases in contact, one second of each in turns."""
    chosen = session.pick(["plain", "observer", "full_strength"], [*CASES], [*CASES])
    vehicles = {name: fly_into_contact(load_scan(*CASES[name])) for name in chosen}
    ticks = count_ticks(session.pick(0.2, 1.0, 1.0))
    calls = {name: partial(run_ticks, v, ticks) for name, v in vehicles.items()}
    times = interleave(calls, session.pick(2, 12, 80))
    return [
        build_row(
            f"{name}_over_plain", compute_ratios(times[name], times["plain"]),
            note=f"fast closed loop: {NOTES[name]}",
        )
        for name in chosen
        if name != "plain"
    ]  # fmt: skip
