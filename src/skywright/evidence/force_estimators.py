"""Force of a compliant arm: `python -m skywright.evidence.force_estimators`.

Suarez 2020 estimates the force of a hand from its Cartesian deflection, (25)-(28). It is compared
with the static equilibrium of the links (vehicle/arms/contact_force.py). On a bench each estimator
closes the force loop at 2 N, up and forward, in the L pose and with the arm almost stretched, with
the reading zeroed before contact (tare) and without. The table gives the true contact force.
"""

import json
import math
from typing import Any, NamedTuple

import click
import numpy as np

from skywright.description.loader import load_description
from skywright.evidence.command import Command
from skywright.models.compliant_arms import find_hands
from skywright.models.rigid_body import build_body_model
from skywright.models.things.bench import Bench
from skywright.models.things.box import Box
from skywright.run.backends import build_vehicle
from skywright.vehicle.arms.ports import HandState
from skywright.vehicle.arms_interface import Arms

FORCE = 2.0  # N, of the paper's trials
HEIGHT = 1.5  # m, of the clamped platform
GAP = 0.004  # m, between the hand and the box
SIZE = 0.05  # m, edge of the box: small enough for the forearm
POSES = {"L": (0.0, 0.0, 0.0, -90.0), "stretched": (-80.0, 0.0, 0.0, -10.0)}  # deg
BACK = (60.0, 0.0, 0.0, -120.0)
WAYS = {"up": (0.0, 0.0, 1.0), "forward": (1.0, 0.0, 0.0)}
SETTLE, HOLD = 5.0, 5.0  # s


class Row(NamedTuple):
    """One trial: mean and rms error of the true force (N), the estimated force, its lever arm."""

    pose: str
    direction: str
    estimator: str
    tare: bool
    true_mean_n: float
    rms_error_n: float
    estimated_mean_n: float
    lever_m: float
    saturated: bool


def measure(
    pose: str, direction: str, estimator: str, tare: bool, robot: str = "bimanual", seed: int = 1
) -> Row:
    """Press once and measure."""
    d = load_description(
        "waypoints", robot=robot, seed=seed,
        sets=["mission.estimator=truth", f"robot.control.force_estimator={estimator}"],
    )  # fmt: skip
    assert d.robot.arm is not None
    q = np.radians(np.tile(POSES[pose], d.robot.arm.sides))
    way = np.array(WAYS[direction])
    hand = np.array([0.0, 0.0, HEIGHT])
    hand += find_hands(build_body_model(d.robot, d.world.gravity_mps2), q)[0]
    # the ball's foremost point in that direction, then the gap, then the box
    radius = d.robot.arm.hand.radius_m
    angle = math.radians(POSES[pose][0] + POSES[pose][3])
    centre = hand - radius * np.array([-math.sin(angle), 0.0, -math.cos(angle)])
    place = centre + (radius + GAP + 0.5 * SIZE) * way
    box = Box(x_m=place[0], y_m=place[1], z_m=place[2], size_x_m=SIZE, size_y_m=0.2, size_z_m=SIZE)
    world = d.world.model_copy(update={"things": {"bench": Bench(z_m=HEIGHT), "box": box}})
    blocks: list[Any] = []
    vehicle = build_vehicle(d._replace(world=world), blocks.append)
    arms = Arms(vehicle)

    def wait(seconds: float) -> Any:
        vehicle.flush()
        blocks.clear()
        for _ in range(round(seconds / 0.02)):
            vehicle.tick()
        vehicle.flush()
        return np.concatenate(blocks)

    for angles in (BACK, (BACK[0], *POSES[pose][1:]), POSES[pose]):  # approach from below
        arms.move_to(np.radians(np.tile(angles, d.robot.arm.sides)))
        wait(4.0)
    wait(4.0)
    if tare:
        arms.tare()
        wait(1.0)
    arms.push({"left": FORCE * way}, ramp_s=1.0)
    wait(SETTLE)
    rows = wait(HOLD)
    true, said = rows["left_f_W"] @ way, rows["left_est_f_W"] @ way
    state = vehicle.read(HandState)
    return Row(
        pose, direction, estimator, tare, float(true.mean()),
        float(np.sqrt(np.mean((true - FORCE) ** 2))), float(said.mean()),
        float(state.lever[0]), bool(state.saturated[0]),
    )  # fmt: skip


def compare(robot: str = "bimanual", seed: int = 1) -> list[Row]:
    """Measure every pose, direction and estimator; with tare for the L pose only."""
    return [
        measure(pose, direction, estimator, tare, robot, seed)
        for pose in POSES
        for direction in WAYS
        for estimator in ("cartesian", "torque")
        for tare in ((False, True) if pose == "L" else (False,))
    ]


@click.command("force-estimators", cls=Command)
@click.option("--seed", default=1)
@click.option("--json", "as_json", is_flag=True)
def main(seed: int, as_json: bool) -> None:
    """Print the table."""
    rows = compare(seed=seed)
    if as_json:
        print(json.dumps({"rows": [row._asdict() for row in rows]}))
        return
    print(f"{FORCE:g} N requested for {HOLD:g} s, platform clamped, seed {seed}\n")
    print("| pose | push | estimator | tare | true mean (N) | rms error (N) | estimate (N) "
          "| lever (m) | joints at a limit |\n|---|---|---|---|---|---|---|---|---|")  # fmt: skip
    for r in rows:
        print(
            f"| {r.pose} | {r.direction} | {r.estimator} | {'yes' if r.tare else 'no'} "
            f"| {r.true_mean_n:.2f} | {r.rms_error_n:.2f} | {r.estimated_mean_n:.2f} "
            f"| {r.lever_m:.2f} | {'yes' if r.saturated else ''} |"
        )


if __name__ == "__main__":
    main()
