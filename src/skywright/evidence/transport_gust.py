"""Effect of a gust on a carried bar, and of the lags of the estimates.

`python -m skywright.evidence.transport_gust benchmarks/transport-conditions.csv --run 11` flies one
row of a campaign's table with its wind and again in still air; the difference is the effect of the
wind. A linear model of platform, link and loops along x, driven by the recorded drag, is compared
with it. The model then predicts the error that remains if an estimate had no lag.

    m x'' + b phi'' = u + F,    b x'' + J phi'' + b g phi = s = c F

phi is the link's angle, forward positive; u the rotors' horizontal force after the attitude loop's
lag (`attitude_lag`); F the drag. Its lever c about the joint is the only value fitted to the
flight.

The law is `vehicle/laws/cascade.py`: position and velocity loop, damping of the swing, the
estimates of F (`wrench.bandwidth`) and of s (SWING_BANDWIDTH, twice), and the shift of the platform
(SHIFT_BANDWIDTH).
"""

from typing import NamedTuple

import click
import numpy as np
from scipy.linalg import expm

from skywright.analysis.campaign.spec import build_campaign, draw_run, load_run
from skywright.core.arrays import Array
from skywright.description.loader import Description
from skywright.evidence.command import Command
from skywright.missions.bar_transport.metrics import compute_tip_errors
from skywright.models.floating import compute_floating
from skywright.models.rigid_body import (
    build_body_model,
    posture,
)
from skywright.recordings.period import compute_period
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.arms.external_wrench import SWING_BANDWIDTH
from skywright.vehicle.laws._cascade_gains import compute_cascade_gains
from skywright.vehicle.laws.cascade import SHIFT_BANDWIDTH

AT_ONCE = 1e3  # rad/s, of an estimate without lag
X, V, PHI, RATE, U, DU, DDU, F_EST, S_EST, S_SLOW, SHIFT = range(11)
FORCE, TORQUE = range(2)


class Loop(NamedTuple):
    """Platform, link and gains along x."""

    mass: float  # kg
    first: float  # kg m, of the link about its joint
    second: float  # kg m^2
    gravity: float
    joint: float  # m, distance of the joint below B
    below: float  # m, distance of the bar below the joint
    position: float  # 1/s
    velocity: float  # 1/s
    swing: float  # m/s
    attitude: float  # 1/s
    rate: float  # 1/s
    lead: float  # s
    force: float  # rad/s, of the estimated force
    torque: float  # rad/s, of the estimated torque about the joint, twice
    shift: float = SHIFT_BANDWIDTH


def build_loop(d: Description) -> Loop:
    """Return the loop of a robot under the cascade, in its working posture."""
    model = build_body_model(d.robot, d.world.gravity_mps2)
    gains = compute_cascade_gains(d.robot.control, d.robot, d.world, model[0])
    body, wrench = compute_floating(model, posture(d.robot, "working"), 0)
    assert d.robot.pendulum is not None and d.robot.pendulum.z_m is not None
    joint = -d.robot.pendulum.z_m
    return Loop(
        float(body["mass"]), float(np.linalg.norm(wrench["L_s"])), float(wrench["M_ss"]),
        d.world.gravity_mps2, joint, -float(body["p_BT"][2]) - joint,
        float(gains.k_position[0]), float(gains.k_velocity[0]), float(gains.k_swing),
        float(gains.k_attitude[1]), float(gains.k_rate[1]), float(gains.lead),
        float(gains.wrench[0]), SWING_BANDWIDTH,
    )  # fmt: skip


def build_matrices(p: Loop) -> tuple[Array, Array, Array]:
    """Return (A, B, C): the states above, inputs (F, s), output the bar's distance from the
    plan."""
    A, B = np.zeros((11, 11)), np.zeros((11, 2))
    inverse = np.linalg.inv([[p.mass, p.first], [p.first, p.second]])
    A[X, V] = A[PHI, RATE] = A[U, DU] = A[DU, DDU] = 1.0
    for row, (force, torque) in zip((V, RATE), inverse, strict=True):
        A[row, U], A[row, PHI] = force, -torque * p.first * p.gravity
        B[row] = force, torque
    A[F_EST, F_EST], B[F_EST, FORCE] = -p.force, p.force
    A[S_EST, S_EST], B[S_EST, TORQUE] = -p.torque, p.torque
    A[S_SLOW, S_EST], A[S_SLOW, S_SLOW] = p.torque, -p.torque
    # position of the platform that keeps the bar in place, and its rate
    hang = 1.0 / (p.first * p.gravity)
    A[SHIFT, S_SLOW] = -p.shift * p.below * hang
    A[SHIFT, F_EST] = -p.shift * p.joint / (p.mass * p.gravity)
    A[SHIFT, SHIFT] = -p.shift
    # desired force as a row over the states, and the attitude loop
    wanted = p.velocity * p.position * (np.eye(11)[SHIFT] - np.eye(11)[X])
    wanted += p.velocity * (A[SHIFT] - np.eye(11)[V])
    wanted += p.swing * (np.eye(11)[RATE] - hang * A[S_SLOW])
    wanted = p.mass * wanted - np.eye(11)[F_EST]
    gain = p.attitude * p.rate
    A[DDU] = gain * (wanted - np.eye(11)[U]) - p.rate * np.eye(11)[DU] - np.eye(11)[DDU]
    A[DDU] /= p.lead
    C = np.zeros(11)
    C[X], C[PHI], C[U] = 1.0, p.below, -p.joint / (p.mass * p.gravity)
    return A, B, C


def simulate(p: Loop, inputs: Array, dt: float) -> tuple[Array, Array]:
    """Return (platform, bar) (n,) m for inputs (n, 2), from equilibrium under the first."""
    A, B, C = build_matrices(p)
    step = expm(dt * np.block([[A, B], [np.zeros((2, 13))]]))[:11]
    state = -np.linalg.solve(A, B @ inputs[0])
    out = np.empty((len(inputs), 11))
    for i, now in enumerate(inputs):
        out[i] = state
        state = step[:, :11] @ state + step[:, 11:] @ now
    return out[:, X], out @ C


def take_carrying(run: RunResult) -> tuple[Array, Array, Array, float]:
    """Return (bar's middle from the plan (n, 3), platform's x from it, drag along x, period)."""
    start = next(p.start_s for p in run.phases if p.name == "transport")
    s = run.samples[run.samples["t"] >= start]
    dt = compute_period(s["t"])
    off = s["p_WB"][:, 0] - s["ref_p_WB"][:, 0]
    return compute_tip_errors(s), np.asarray(off), np.asarray(s["f_wind_W"][:, 0]), dt


@click.command("transport-gust", cls=Command, help=__doc__)
@click.argument("table")
@click.option("--run", type=int, required=True, help="Row of the campaign's table, from 0.")
@click.option("--seed", default=1, help="Of the campaign.")
def main(table: str, run: int, seed: int) -> None:
    """Fly one row twice and print the effect of its gust."""
    campaign = build_campaign("bar-transport", [table], seed=seed)
    drawn = draw_run(campaign, run)
    still = {**drawn.varied, "world.wind.kind": "none", "world.wind.mean_mps": 0.0}
    d = load_run(campaign, drawn)
    tip, platform, drag, dt = take_carrying(fly_and_evaluate(d))
    calm_tip, calm_platform, calm_drag, _ = take_carrying(
        fly_and_evaluate(load_run(campaign, drawn._replace(varied=still)))
    )
    n = min(len(tip), len(calm_tip))
    wind, moved, force = (
        (a[:n] - b[:n]) for a, b in ((tip, calm_tip), (platform, calm_platform), (drag, calm_drag))
    )
    loop = build_loop(d)
    alone, lever = (
        simulate(loop, np.outer(force, unit), dt)[0] for unit in ([1.0, 0.0], [0.0, 1.0])
    )
    c = float(lever @ (moved - alone) / (lever @ lever))
    inputs = np.outer(force, [1.0, c])
    model = simulate(loop, inputs, dt)[1]
    worst = int(np.argmax(np.linalg.norm(tip[:n], axis=1)))
    cm = 100.0
    parts = " ".join(f"{axis} {cm * v:.1f}" for axis, v in zip("xyz", tip[worst], strict=True))
    print(f"worst: {cm * np.linalg.norm(tip[worst]):.1f} cm ({parts}), {dt * worst:.1f} s into it")
    calm, blown, said = (cm * v for v in (calm_tip[worst, 0], wind[worst, 0], model[worst]))
    print(
        f"along x: {calm:.1f} cm without wind, {blown:.1f} cm by wind, in the model {said:.1f} cm"
    )
    print(f"rms by wind: {cm * np.std(wind[:, 0]):.1f} cm, model less flight "
          f"{cm * np.std(model - wind[:, 0]):.1f} cm; the drag's lever is {c:.2f} m\n")  # fmt: skip
    print("| linear model | deviation at the worst moment | rms |\n|---|---|---|")
    for name, other in (
        ("unchanged", loop), ("force estimate without lag", loop._replace(force=AT_ONCE)),
        ("estimate of the torque about the joint without lag", loop._replace(torque=AT_ONCE)),
        ("both without lag", loop._replace(force=AT_ONCE, torque=AT_ONCE)),
    ):  # fmt: skip
        found = simulate(other, inputs, dt)[1]
        print(f"| {name} | {cm * found[worst]:.1f} cm | {cm * np.sqrt(np.mean(found**2)):.1f} cm |")


if __name__ == "__main__":
    main()
