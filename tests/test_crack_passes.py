"""Passes of a search for cracks: beside the path in gusts, near the top, over missed parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from skywright.description.loader import load_description
from skywright.description.world.spec import Pipe
from skywright.description.world.surface import build_cylinder, roll_points, unroll_points
from skywright.description.world.wind import compute_gust_scales
from skywright.inspection.indications import FlawFinder
from skywright.missions.crack_scan.again import SIGMAS, build_passes
from skywright.missions.crack_scan.cover import build_sector, compute_cover, list_gaps
from skywright.missions.crack_scan.lateral import MORE, compute_lateral_std
from skywright.missions.crack_scan.plan import plan
from skywright.models.rigid_body import compute_body, posture
from skywright.planning.scan import choose_axes
from skywright.run.limits import compute_gust_drag
from skywright.run.setup import Setup

NO_ERRORS = ["plant.map_error_m=0", "plant.map_error_deg=0", "plant.map_error_size_m=0"]


def look(side: str, kind: str, mean: float) -> float:
    wind = [f"world.wind.kind={kind}", f"world.wind.mean_mps={mean}"]
    sets = [*wind, f"mission.task.side={side}"]
    return compute_lateral_std(Setup(load_description("crack-scan", sets=sets)))


def test_gusts_add_what_the_position_loop_lets_through() -> None:
    """Against the variance of loop and gusts as one linear system, along the wind over the top."""
    d = load_description("crack-scan", sets=[
        "world.wind.kind=dryden", "world.wind.mean_mps=2", "mission.task.side=top"
    ])  # fmt: skip
    s = Setup(d)
    c, mass = s.robot.control, compute_body(s.model, posture(s.robot, "working"))[0]
    w, w_i = c.position_bandwidth_rad_s, c.position_integral_rad_s
    friction = 0.5 * c.friction_feed_forward * s.robot.probe.force_n / s.task.speed_mps
    sigma, time = (x[0] for x in compute_gust_scales(s.world.wind, 2.0))
    drag = compute_gust_drag(s, 2.0)[0]
    A = np.array([
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [-w_i * w**2, -(w**2), -(2 * c.position_damping * w + friction / mass), drag / mass],
        [0.0, 0.0, 0.0, -1.0 / time],
    ])  # fmt: skip
    noise = np.diag([0.0, 0.0, 0.0, 2.0 * sigma**2 / time])
    added = math.sqrt(solve_continuous_lyapunov(A, -noise)[1, 1])
    own = s.task.procedure.lateral_std_m
    assert compute_lateral_std(s) == pytest.approx(math.hypot(own, MORE * added), rel=0.01)
    assert added > own  # the case is none that the procedure's deviation hides


def test_a_steady_wind_moves_no_pass_and_gusts_along_the_pipe_less() -> None:
    own = load_description("crack-scan").mission.task.procedure.lateral_std_m
    assert look("top", "steady", 4.0) == own
    assert own < look("side", "dryden", 2.0) < look("top", "dryden", 2.0)
    assert look("top", "dryden", 1.0) < look("top", "dryden", 2.0)


OVER, SIDE = (75, 105), (-15, 15)


@pytest.mark.parametrize(
    ("inclined", "arc", "level"),
    [(1.0, OVER, True), (1.0, SIDE, False), (6.0, OVER, False), (0.0, OVER, False)],
)
def test_near_the_top_the_probe_follows_a_level_pipe(inclined, arc, level) -> None:
    cylinder = build_cylinder(Pipe(inclination_deg=inclined, yaw_deg=30.0))
    corners = np.column_stack([[0.0, 0.1], np.radians(arc)])
    axes = choose_axes(cylinder, corners)
    assert np.allclose(axes.T @ axes, np.eye(3)) and np.linalg.det(axes) > 0
    off = math.degrees(math.acos(min(float(axes[:, 2] @ cylinder.R_WP[:, 2]), 1.0)))
    assert off == pytest.approx(inclined if level else 0.0, abs=1e-6)
    if level:  # across the pipe nothing changes
        assert np.allclose(axes[:, 0], cylinder.R_WP[:, 0])


def test_an_array_keeps_across_its_passes_over_the_top_or_the_sector_is_refused() -> None:
    """Of a pipe inclined by 1 deg the heading would turn by 180 deg over the top."""
    top = [*NO_ERRORS, "mission.task.side=top"]
    found = plan(Setup(load_description("crack-scan", sets=[*top, "world.pipe.inclination_deg=1"])))
    assert found.feasible, found.blocked_by
    R = found.segments["scan"]["R_WB"]
    yaw = np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    assert np.ptp(yaw) < math.radians(0.5)
    steep = plan(Setup(load_description("crack-scan", sets=[*top, "world.pipe.inclination_deg=6"])))
    assert not steep.feasible
    assert steep.blocked_by is not None and "askew to its passes" in steep.blocked_by


def test_passes_go_on_beyond_the_ends_of_what_was_missed() -> None:
    """By what the tip may lag and the last coil is ahead of it: the ends are covered then."""
    task, std, ahead = load_description("crack-scan").mission.task, 0.0005, 0.004
    sector = build_sector(task, 0.2, 0.00344)
    s, c = sector.cells.T
    hole = (np.abs(s - 0.1) < 0.02) & (np.abs(c) < 0.01)
    before = compute_cover(sector, s[~hole], c[~hole])
    gap = list_gaps(before)[0]
    ((a, b),) = build_passes(before, 0.0434, 0.041, std, ahead).reshape(-1, 2, 2)
    beyond = SIGMAS * std + ahead
    assert sorted([a[0], b[0]]) == pytest.approx([gap.start[0] - beyond, gap.end[0] + beyond])
    # coils that lag behind by 2.33 deviations, and trail the tip by `ahead`
    along = np.linspace(*sorted([a[0], b[0]]), 300) - beyond * np.sign(b[0] - a[0])
    grid = np.stack(np.meshgrid(along, a[1] + np.linspace(-0.02, 0.02, 16), indexing="ij"), -1)
    flown = np.concatenate([grid.reshape(-1, 2), sector.cells[~hole]])
    assert compute_cover(sector, flown[:, 0], flown[:, 1]).fraction == 1.0


def test_sound_metal_beside_a_weld_is_no_crack() -> None:
    """The probe steps along a weld, askew: some coils stay over it, others leave it and return."""
    rng = np.random.default_rng(5)
    step, weld = 1e-4, 0.04
    down, side = np.arange(0.16, weld, -step), np.arange(0.0, 0.04, step)
    s = np.concatenate([down, np.full(len(side), weld), down[::-1]])
    c = np.concatenate([np.zeros(len(down)), side, np.full(len(down), 0.04)])
    offset = np.linspace(-0.02, 0.02, 16)
    skew = math.radians(20.0)
    S, C = s[:, None] - math.sin(skew) * offset, c[:, None] + math.cos(skew) * offset
    up = -50.0 * np.exp(-0.5 * ((S - weld) / 0.004) ** 2) + rng.normal(0.0, 0.5, S.shape)
    finder = FlawFinder()
    finder.add(0.01 * np.arange(len(s)), 1j * up, S, C)
    found = finder.find()
    assert {x.nature for x in found} == {"weld"} and all(x.height < 0 for x in found)
    # a crack 30 mm from it stays one, however long the weld is
    up += 45.0 * np.exp(-0.5 * (np.hypot(S - 0.08, C - 0.01) / 0.0015) ** 2)
    finder = FlawFinder()
    finder.add(0.01 * np.arange(len(s)), 1j * up, S, C)
    assert [x.nature for x in finder.find() if x.height > 0] == ["crack"]


@pytest.mark.parametrize("centre", [90.0, 180.0, 350.0, -180.0])
def test_a_sector_has_no_seam_in_its_middle(centre: float) -> None:
    """A search that covers all of it says so, wherever the sector lies around the pipe."""
    task = load_description("crack-scan", sets=[
        "mission.task.side=angle", f"mission.task.centre_angle_deg={centre}"
    ]).mission.task  # fmt: skip
    pipe = build_cylinder(Pipe())
    sector = build_sector(task, pipe.radius, 3.4e-3)
    places, _ = roll_points(pipe, sector.cells[:, 0], sector.cells[:, 1])
    s, c, _ = unroll_points(pipe, places, near=task.get_centre() * pipe.radius)
    cover = compute_cover(sector, s, c)
    assert cover.fraction == 1.0 and cover.hole_m < 1e-3
