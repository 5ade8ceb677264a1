"""Contents of `skywright show` for a robot, world or mission, as plain rows."""

import math
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from skywright.core.keys import iterate_leaves
from skywright.core.spec import Source
from skywright.description.loader import Description
from skywright.description.lookup import Subject
from skywright.description.robot.limbs import list_limbs, list_servos
from skywright.description.robot.sourced import list_unsourced
from skywright.description.robot.spec import Robot, Sensors
from skywright.description.world.gnss import Gnss
from skywright.description.world.localisation import TotalStation
from skywright.description.world.spec import Link, Mocap, Wind, World
from skywright.description.world.thing import Placed
from skywright.description.world.things import locate_thing
from skywright.description.world.wind import compute_dryden_scales
from skywright.errors import InputError
from skywright.models.capability import check_can_fly, compute_capability
from skywright.models.docked import build_docked, compute_docked_press, find_stance
from skywright.models.force_resolution import compute_force_resolution
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.run.check import count_unsourced, list_assumed


class Section(NamedTuple):
    """A titled list of (name, value)."""

    title: str
    rows: list[tuple[str, str]]


class Summary(NamedTuple):
    """A summary of one subject."""

    kind: str
    name: str
    description: str
    sections: list[Section]
    assumed: list[str]
    picture: str | None = None
    urdf: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the `--json` object."""
        return {
            "kind": self.kind,
            "name": self.name,
            "description": self.description,
            "sections": {s.title: dict(s.rows) for s in self.sections},
            "guesses": self.assumed,
            "picture": self.picture,
            "urdf": self.urdf,
        }


def build_summary(subject: Subject) -> Summary:
    """Summarise a robot, a world, or a mission with its robot and world."""
    if subject.robot is not None:
        robot = subject.robot
        sections = [*describe_robot(robot), describe_sources(robot, subject.sources)]
        assumed = list_assumed({"robot": robot}, subject.sources)
        assumed += count_unsourced(robot, subject.sources)
        text = robot.description + (f" ({robot.paper})" if robot.paper else "")
        return Summary("robot", robot.name, text, sections, assumed)
    if subject.world is not None:
        world = subject.world
        assumed = list_assumed({"world": world}, subject.sources)
        return Summary("world", world.name, world.description, describe_world(world), assumed)
    assert subject.description is not None
    return _summarise_mission(subject.description)


def _summarise_mission(description: Description) -> Summary:
    mission = description.mission
    sections = [
        *describe_mission(description),
        *describe_world(description.world),
        *describe_robot(description.robot),
    ]
    assumed = list_assumed(description.roots, description.sources)
    assumed += count_unsourced(description.robot, description.sources)
    return Summary("mission", mission.name, mission.description, sections, assumed)


def describe_mission(description: Description) -> list[Section]:
    """Describe the task and requirements of a mission."""
    m = description.mission
    rows = [("robot", m.robot), ("world", m.world), ("seed", str(m.seed))]
    rows += [("control law", description.law.kind if description.law else "default")]
    rows += [("estimator", m.estimator.kind), ("hover height", f"{m.hover_height_m:g} m")]
    task = [
        (key.removeprefix("task."), f"{value:g}" if isinstance(value, float) else str(value))
        for key, value in iterate_leaves(m.task, "task")
        if value is not None
    ]
    limits = [
        (name, f"{r.sense} {r.limit:g}{' ' + r.unit if r.unit else ''}")
        for name, r in m.requirements.items()
    ]
    plant = [
        (key.removeprefix("plant."), f"{value:g}")
        for key, value in iterate_leaves(description.plant, "plant")
    ]
    return [
        Section("Mission", rows),
        Section("Task", task),
        Section("Requirements", limits),
        Section("Plant (deviations from the nominal model)", plant),
    ]


def describe_wind(wind: Wind) -> tuple[str, str]:
    """Describe the wind: kind, and gusts."""
    if wind.kind == "none":
        return "none", ""
    blow = f"{wind.kind}, {wind.mean_mps:g} m/s toward {wind.toward_deg:g} deg"
    if wind.kind == "dryden":
        along, _, up = compute_dryden_scales(wind).sigma
        return blow, f"gusts of {along:.2g} m/s rms along and across, {up:.2g} m/s vertical"
    if wind.kind == "fan":
        fan = wind.fan
        jet = (
            f"{fan.turbulence:.0%} turbulence, outlet at ({fan.x_m:g}, {fan.y_m:g}, {fan.z_m:g}) m"
        )
        if fan.sweep_deg > 0.0:
            jet += f", sweeping {fan.sweep_deg:g} deg to each side in {fan.sweep_period_s:g} s"
        return blow, jet
    return blow, ""


def describe_mocap(mocap: Mocap) -> tuple[str, str]:
    """Describe the motion capture: rate, and delay, noise, drop-outs and artefacts."""
    noise = f"{1e3 * mocap.position_noise_m:g} mm, {math.degrees(mocap.attitude_noise_rad):.2g} deg"
    note = f"delay {1e3 * mocap.latency_s:g} ms, noise {noise}"
    note += f", {mocap.dropout_fraction:.2g} of the samples missing"
    if mocap.outlier_fraction > 0.0:
        note += f", {mocap.outlier_fraction:.2g} artefacts of up to {mocap.outlier_m:g} m"
    return f"{mocap.rate_hz:g} Hz", note


def describe_gnss(gnss: Gnss) -> tuple[str, str]:
    """Describe satellite navigation: kind and rate, and delay, white and slow errors, heading."""
    e = gnss.errors

    def length(x: float) -> str:
        return f"{x:g} m" if x >= 0.1 else f"{1e3 * x:g} mm"

    note = f"delay {1e3 * gnss.latency_s:g} ms, noise {length(e.noise_level_m)} level and "
    note += f"{length(e.noise_up_m)} up, drift {length(e.drift_level_m)} and "
    note += f"{length(e.drift_up_m)} over {e.drift_time_s:g} s, heading {e.heading_noise_deg:g} deg"
    note += f" and {e.heading_error_deg:g} deg for good"
    if gnss.dropout_fraction > 0.0:
        note += f", {gnss.dropout_fraction:.2g} of the fixes missing"
    return f"{gnss.fix} at {gnss.rate_hz:g} Hz", note


def describe_total_station(station: TotalStation) -> tuple[str, str]:
    """Describe a total station: rate, and position, delay and noise."""
    s = station
    note = f"at ({s.x_m:g}, {s.y_m:g}, {s.z_m:g}) m, delay {1e3 * s.latency_mean_s:g} ms, noise "
    note += f"{1e3 * s.range_noise_m:g} mm along and {1e3 * s.pointing_noise_m:g} mm across"
    for start, stop in s.blocked_s:
        note += f", blocked from {start:g} to {stop:g} s"
    return f"{s.rate_mean_hz:g} Hz", note + "; with the robot's tracking camera"


def describe_localisation(world: World) -> tuple[str, str, str]:
    """Describe the external localisation: name, kind or rate, and errors."""
    if world.localisation == "gnss":
        return "satellite navigation", *describe_gnss(world.gnss)
    if world.localisation == "total-station":
        return "total station", *describe_total_station(world.total_station)
    return "motion capture", *describe_mocap(world.mocap)


def describe_link(link: Link) -> tuple[str, str]:
    """Describe the link between robot and controller."""
    if link.delay_s == link.jitter_s == link.loss_fraction == 0.0:
        return "none", "the controller is on board"
    jitter = f"jitter {1e3 * link.jitter_s:g} ms"
    return f"{1e3 * link.delay_s:g} ms each way", f"{jitter}, {link.loss_fraction:.2g} lost"


def describe_inertial(sensors: Sensors) -> list[tuple[str, str, str]]:
    """Return name, noise and bias of gyroscope, accelerometer and their vibration."""
    s = sensors
    gyro = f"noise {s.gyro_noise_rad_s_sqrthz:g} rad/s/sqrt(Hz)"
    accel = f"noise {s.accel_noise_mps2_sqrthz:g} m/s^2/sqrt(Hz)"
    shake = f"{s.vibration_mps2:g} m/s^2, {s.vibration_rad_s:g} rad/s"
    return [
        ("gyroscope", "1000 Hz", f"{gyro}, bias {s.gyro_bias_rad_s:g} rad/s"),
        ("accelerometer", "1000 Hz", f"{accel}, bias {s.accel_bias_mps2:g} m/s^2"),
        ("vibration", shake, "of the unit, from one rotor at full thrust"),
    ]


def describe_world(world: World) -> list[Section]:
    """Describe structure, wind and external localisation."""
    rows = [("gravity", f"{world.gravity_mps2:g} m/s^2")]
    rows.append(("air density", f"{world.air_density_kg_m3:g} kg/m^3"))
    if world.pipe is not None:
        p = world.pipe
        rows.append(("pipe", f"diameter {p.diameter_m:g} m, length {p.length_m:g} m"))
        rows.append(("pipe centre", f"({p.x_m:g}, {p.y_m:g}, {p.z_m:g}) m"))
        rolled = f", roll {p.roll_deg:g} deg" * (p.roll_deg != 0.0)
        rows.append(
            ("pipe axis", f"yaw {p.yaw_deg:g} deg, inclination {p.inclination_deg:g} deg{rolled}")
        )
        varies = f", varying by {p.friction_variation:.0%} along the surface"
        rows.append(("friction", f"{p.friction:g}" + varies * (p.friction_variation > 0)))
        rows.append(("supports", "two posts" if p.supports else "none"))
    for w in world.list_welds():
        angle = f"{w.angle_deg:g} deg from the circumference"
        rows.append(("weld", f"{angle}, offset {w.offset_m:g} m"))
    if world.structure is not None:
        s = world.structure
        curved = "" if s.radius_m is None else f" of {s.radius_m:g} m radius"
        place = f"({s.x_m:g}, {s.y_m:g}, {s.z_m:g}) m"
        rows.append(("structure", f"{s.shape}{curved} that faces {s.facing}, at {place}"))
        if s.slope_deg:
            rows.append(("slope", f"{s.slope_deg:g} deg toward {s.slope_toward_deg:g} deg"))
        rows.append(("friction of the tip", f"{s.friction:g}"))
    for name, tube in world.tubes.items():
        ends = f"({tube.x_m:g}, {tube.y_m:g}, {tube.z_m:g}) to "
        ends += f"({tube.to_x_m:g}, {tube.to_y_m:g}, {tube.to_z_m:g}) m"
        rows.append((name, f"tube of {tube.diameter_m:g} m diameter from {ends}"))
    for name, thing in world.things.items():
        at = ""
        if isinstance(thing, Placed):
            at = " at ({:.4g}, {:.4g}, {:.4g}) m".format(*locate_thing(world.things, name).p)
        rows.append((name, thing.describe() + at))
    rows.append(("wind", ": ".join(filter(None, describe_wind(world.wind)))))
    name, *said = describe_localisation(world)
    rows.append((name, ", ".join(said)))
    rows.append(("link", ": ".join(describe_link(world.link))))
    return [Section("World", rows)]


def describe_robot(robot: Robot) -> list[Section]:
    """Describe masses, rotors, joints, sensors, limits; hover power and endurance."""
    p, r, c = robot.platform, robot.rotors, robot.control
    masses = [("platform", f"{p.mass_kg:g} kg")]
    total = p.mass_kg
    if robot.arm is not None:
        limbs = list_limbs(robot)
        arm = sum(limb.link.mass_kg for limb in limbs) + robot.arm.sides * robot.arm.hand.mass_kg
        masses.append(("arm", f"{arm:.4g} kg in {len(limbs)} links"))
        total += arm
    if robot.probe is not None:
        masses.append(("probe", f"{robot.probe.mass_kg:g} kg"))
        total += robot.probe.mass_kg
    if robot.docking is not None:
        masses.append(("docking gear", f"{robot.docking.mass_kg:g} kg"))
        total += robot.docking.mass_kg
    masses.append(("total", f"{total:.3g} kg, {total * 9.81:.1f} N"))
    model = build_body_model(robot)
    for which in ("folded", "working") if robot.arm is not None else ("folded",):
        com = compute_body(model, posture(robot, which))[1]
        name = "centre of mass" + (f", {which}" if robot.arm is not None else "")
        masses.append((name, "(" + ", ".join(f"{round(1e3 * x):d}" for x in com) + ") mm"))
    masses.append(("size", f"diameter {p.diameter_m:g} m, landing gear {p.gear_height_m:g} m"))
    rotors = [
        ("number", f"{len(r.azimuth_deg)} at {_span(r.radii)} m from the centre"),
        ("azimuth", _degrees(r.azimuth_deg)),
        ("tilt alpha / beta", f"{_degrees(r.alpha_deg)} / {_degrees(r.beta_deg)}"),
        ("propeller", f"radius {r.propeller_radius_m:g} m, time constant {r.time_constant_s:g} s"),
        ("thrust of each", f"{r.thrust_min_n:g} to {r.thrust_max_n:g} N"),
    ]
    sections = [Section("Masses", masses), Section("Rotors", rotors)]
    if robot.arm is not None:
        joints = []
        for limb in list_limbs(robot):
            name, link = limb.name, limb.link
            size = f"{link.length_m:g} m, {link.mass_kg:g} kg"
            if link.joint == "fixed":
                joints.append((name, f"fixed, {size}"))
                continue
            low, high, folded, working = (
                link.describe(x) for x in (*link.reach, link.rest("folded"), link.rest("working"))
            )
            way = "along" if link.joint == "slide" else "about"
            span = f"{low} to {high} (folded {folded}, working {working})"
            joints.append((name, f"{link.joint} {way} {link.axis}, {size}, {span}"))
        for name, servo in list_servos(robot):
            speed = f"{servo.no_load_speed_rad_s:g} rad/s"
            joints.append((name, f"stall torque {servo.stall_torque_nm:g} N m, {speed} at no load"))
        sections.append(Section("Arm", joints))
    if robot.probe is not None:
        b = robot.probe
        spring = f"{b.spring_n_per_m:g} N/m over {b.spring_travel_m * 1000:g} mm"
        kind = "eddy current" if robot.force_sensor is None else "force sensor"
        probe = [("kind", kind), ("length", f"{b.length_m:g} m")]
        probe += [("spring", spring), ("nominal push", f"{b.force_n:g} N")]
        if robot.force_sensor is not None:
            f = robot.force_sensor
            steps = [-1e3 * f.soft_slope_n_per_count, -1e3 * f.hard_slope_n_per_count]
            bends = f.soft_offset_n + f.soft_slope_n_per_count * f.limit_count
            text = f"{f.adc_bits} bits, {steps[0]:.2g} mN a count up to {bends:.1f} N, then "
            text += f"{steps[1]:.2g} mN, at most {f.hard_offset_n:.1f} N"
            probe.append(("force sensor", text))
            probe.append(("its spring", f"{f.stiffness_n_per_m:.0f} N/m by its calibration"))
        fine = compute_force_resolution(robot)
        if fine is not None:
            each = ", ".join(
                f"{name} {n:.2g} N" for name, n in zip(fine.servos, fine.steps, strict=True)
            )
            count = math.degrees(float(np.max(fine.angles)))
            probe.append(
                ("one servo count", f"{count:.3g} deg; at work it changes the force: {each}")
            )
            probe.append(
                ("smallest controllable force", f"{fine.smallest:.2g} N, {fine.rms:.1g} N rms held")
            )
        sections.append(Section("Probe", probe))
    if robot.docking is not None:
        g = robot.docking
        docking = [
            ("feet", f"{g.feet} at {g.radius_m:g} m from the axis, {g.height_m:g} m up"),
            ("lining", f"friction {g.friction:g}, {g.stiffness_n_per_m:g} N/m a foot"),
        ]
        sections.append(Section("Docking gear", docking))
    sensors = [(name, f"{size}, {note}") for name, size, note in describe_inertial(robot.sensors)]
    if robot.arm is not None:
        sensors.append(("joint encoders", f"{c.rate_hz:g} Hz"))
    sections.append(Section("Sensors", sensors))
    control = [
        ("position", f"{c.position_bandwidth_rad_s:g} rad/s, damping {c.position_damping:g}"),
        ("attitude", f"{c.attitude_bandwidth_rad_s:g} rad/s, damping {c.attitude_damping:g}"),
        ("rate", f"{c.rate_hz:g} Hz"),
        ("largest speed", f"{c.speed_max_mps:g} m/s, {c.acceleration_max_mps2:g} m/s^2"),
        ("largest tilt", f"{c.tilt_max_deg:g} deg"),
    ]
    return [*sections, Section("Control", control), _describe_limits(robot)]


def _describe_limits(robot: Robot) -> Section:
    """Describe the static limits, or why the robot cannot fly."""
    try:
        check_can_fly(robot)
    except InputError as error:
        return Section("Limits", [("cannot fly", str(error))])
    k = compute_capability(robot)
    b = robot.battery
    hover = "/".join(f"{t:.1f}" for t in k.hover_thrust)
    rows = [
        ("arm posture", k.posture),
        ("hover thrusts", f"{hover} N"),
        ("hover power", f"{k.hover_power:.0f} W"),
        ("endurance", f"{k.endurance / 60:.1f} min ({b.energy_wh:g} W h)"),
        ("payload", f"{k.payload:.2f} kg at {k.thrust_fraction:.0%} of the thrust"),
    ]
    force = float(np.nanmin(k.lateral_force))
    if force > 1e-6:
        rows.append(("sideways, level", f"at least {force:.1f} N in every direction"))
        roll, pitch = (math.degrees(t) for t in k.hover_tilt)
        rows.append(("hover tilt limit", f"roll {roll:.1f} deg, pitch {pitch:.1f} deg"))
    else:
        rows.append(("sideways, level", "none: moves by tilting"))
    rows.append(
        ("wind held", f"at least {float(np.nanmin(k.wind_limit)):.1f} m/s from any direction")
    )
    if robot.docking is not None and robot.probe is not None:
        docked = build_docked(robot)
        try:
            press = compute_docked_press(docked, find_stance(docked))
            rows.append(("press while docked", f"{press.force:.1f} N, level and calm"))
        except InputError as error:
            rows.append(("press while docked", str(error)))
    return Section("Limits (computed)", rows)


def describe_sources(robot: Robot, sources: dict[str, Source]) -> Section:
    """Count the numbers by the kind of their source."""
    counts = Counter(source.kind for source in sources.values())
    rows = [(kind, str(count)) for kind, count in counts.most_common()]
    bare = len(list_unsourced(robot, sources))
    if bare:
        rows.append(("no source", str(bare)))
    return Section("Sources of the numbers", rows)


def _span(values: list[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _degrees(values: list[float]) -> str:
    if len({abs(v) for v in values}) == 1 and len(set(values)) == 1:
        return f"{values[0]:g} deg"
    return ", ".join(f"{v:g}" for v in values) + " deg"
