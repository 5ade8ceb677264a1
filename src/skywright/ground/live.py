"""The live view: a run in 3-D in the browser while it is flown (`skywright run ... --view`).

The view listens on this computer only unless told otherwise. It paces the run (real time, x5, as
fast as it goes) and can pause it, as long as somebody watches: without a connected browser the
run goes on as fast as it can, and it ends as usual when the browser is closed.
"""

from __future__ import annotations

import math
import os
import sys
import time
import webbrowser
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.reports.scene3d import Scene3d, build_views, set_camera, start_server, stop_server
from skywright.reports.trace3d import build_legend, build_trace, draw_trace, list_judged
from skywright.run.kind import load_kind
from skywright.vehicle.instruments.eddy_current import LIFT_OFF_THRESHOLD

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.ground.operators import ViewOperator
    from skywright.run.planning import MissionPlan
    from skywright.vehicle.simulated import SimulatedVehicle

SPEEDS = {"real time": 1.0, "x5": 5.0, "fastest": math.inf}
FRAME_PERIOD = 0.04  # s of wall time between pictures
NUMBER_PERIOD = 0.2  # s of wall time between updates of the numbers
TRACE_PERIOD = 0.1  # s of simulated time between points of the trace
TRACE_CHUNK = 10  # points drawn at once


class LiveView:
    """Shows a run in the browser; an observer of `run_mission`."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        open_browser: bool | None = None,
        wait_s: float = 20.0,
        stay_s: float = 3.0,
        stick: ViewOperator | None = None,
    ) -> None:
        """`host`: who may connect (127.0.0.1: this computer only); `port` 0 takes a free one.

        `open_browser` None opens one where there is a display. The run waits up to `wait_s` (s of
        wall time) for the first browser and keeps the last picture for `stay_s` (s). `stick` is
        an operator whose buttons it shows.
        """
        self.host, self.port = host, port
        self.wait_s, self.stay_s, self.stick = wait_s, stay_s, stick
        self._open_browser = _has_display() if open_browser is None else open_browser
        self.server: Any = None
        self.speed = 1.0
        self.paused = False
        self._duration = 0.0
        self._next_frame = self._next_numbers = self._next_point = 0.0
        self._rows: list[NDArray[Any]] = []
        self._judged: list[bool] = []
        self._judged_phases: tuple[str, ...] = ()
        self._chunks = 0
        self._phase = ""
        self._pace_seen = (0.0, -1e9, "")  # mission time, wall time, what was said
        self._anchor: tuple[float, float, float] | None = None  # wall time, mission time, speed

    @property
    def url(self) -> str:
        """Address of the view."""
        host = "localhost" if self.host in ("0.0.0.0", "127.0.0.1") else self.host
        return f"http://{host}:{self.server.get_port()}"

    def watched(self) -> bool:
        """Whether a browser is connected."""
        return self.server is not None and len(self.server.get_clients()) > 0

    # --- Observer ------------------------------------------------------------------------------

    def on_plan(self, plan: MissionPlan, description: Description) -> None:
        """Start the server, draw the world and wait for a browser."""
        d = description
        self._duration = plan.duration_s
        self.server = start_server(self.host, self.port)
        self._scene = Scene3d(self.server, d.robot, d.true_world)
        self._judged_phases = list_judged(d.robot, d.world)
        self._scene.draw_sketch(load_kind(d.mission.kind).figures().sketch(d, plan.way))
        start = np.array([d.mission.start_x_m, d.mission.start_y_m, 0.0])
        planned = [table["p_WB"][::25] for table in plan.segments.values() if len(table)]
        views = build_views(d.robot, d.true_world, np.concatenate([start[None], *planned]))
        set_camera(self.server, views[0])
        self._scene.draw_wind(views[0].look_at + [0.0, 0.0, 0.75])
        self._build_panel(d)
        wait = f" (waiting up to {self.wait_s:g} s for a browser)" if self.wait_s > 0 else ""
        print(f"live view: {self.url}{wait}", file=sys.stderr, flush=True)
        if self._open_browser:
            webbrowser.open(self.url)
        self._wait_for_browser()

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Show the state, and hold the run back to the chosen speed."""
        if self.server is None:
            return
        self._phase = phase
        if t >= self._next_point:
            self._next_point = t + TRACE_PERIOD
            self._rows.append(_latest(vehicle))
            self._judged.append(phase in self._judged_phases)
        wall = time.perf_counter()
        if wall >= self._next_frame:
            self._next_frame = wall + FRAME_PERIOD
            self._show(t, phase, vehicle, wall)
        self._pace(t, phase, vehicle)

    def close(self) -> None:
        """Show the landed robot for a few seconds, then stop the server."""
        if self.server is None:
            return
        self._draw_rows()
        self._status.content = "### flight over\nThe report follows in the terminal."
        landed = self._phase == "land"  # whoever interrupts a run does not want to wait
        end = time.perf_counter() + (self.stay_s if landed else 0.0)
        while self.watched() and time.perf_counter() < end:
            time.sleep(0.05)
        stop_server(self.server)
        self.server = None

    # --- panel ---------------------------------------------------------------------------------

    def _build_panel(self, d: Description) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        gui.set_panel_label(f"{d.mission.name}: {d.robot.name} in {d.world.name}")
        self._status = gui.add_markdown("### waiting")
        self._bar = gui.add_progress_bar(0.0)
        self._numbers = gui.add_markdown("")
        speed = gui.add_button_group("speed", tuple(SPEEDS))
        pause = gui.add_button("pause")
        swatch = '<div><span style="color:{};-webkit-text-stroke:1px #888">&#9632;</span> {}</div>'
        if self.stick is not None:
            self.stick.build_panel(gui)
        legend = "".join(swatch.format(*e) for e in build_legend(d.robot, d.world, False))
        gui.add_html(f'<div style="font-size:12px;padding:0 8px">{legend}</div>')

        @speed.on_click
        def _(_: Any) -> None:
            self.speed = SPEEDS[speed.value]

        @pause.on_click
        def _(_: Any) -> None:
            self.paused = not self.paused
            pause.label = "go on" if self.paused else "pause"

    def _wait_for_browser(self) -> None:
        end = time.perf_counter() + self.wait_s
        while not self.watched() and time.perf_counter() < end:
            time.sleep(0.05)

    # --- every picture ---------------------------------------------------------------------------

    def _show(self, t: float, phase: str, vehicle: SimulatedVehicle, wall: float) -> None:
        row = _latest(vehicle)
        if not np.isfinite(row["p_WB"]).all():
            return
        with self.server.atomic():
            self._scene.show(self._scene.compute_poses(row), 0)
            if len(self._rows) > TRACE_CHUNK:
                self._draw_rows()
        if wall >= self._next_numbers:
            self._next_numbers = wall + NUMBER_PERIOD
            self._status.content = (
                f"### {phase.replace('_', ' ')}\n{t:.1f} s, {self._describe_pace(t, wall)}"
            )
            self._bar.value = float(np.clip(100.0 * t / max(self._duration, 1e-3), 0.0, 100.0))
            self._numbers.content = build_numbers(row[0], vehicle)

    def _describe_pace(self, t: float, wall: float) -> str:
        """The pace that is reached, from the last half second or more."""
        t_before, wall_before, text = self._pace_seen
        if wall - wall_before > 0.5:
            text = f"{(t - t_before) / (wall - wall_before):.1f} x real time"
            self._pace_seen = (t, wall, text)
        return text

    def _draw_rows(self) -> None:
        """Draw the trace since the last piece; its end starts the next piece."""
        if len(self._rows) < 2:
            return
        rows = np.concatenate(self._rows)
        points, colours = build_trace(
            rows, np.array(self._judged), self._scene.robot.arm is not None
        )
        draw_trace(self.server, f"/trace/{self._chunks}", points, colours)
        self._chunks += 1
        del self._rows[:-1], self._judged[:-1]

    def _pace(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Sleep until the wall clock has caught up; nobody watching: do not wait."""
        while self.paused and self.watched():
            self._anchor = None
            time.sleep(0.02)
        if math.isinf(self.speed) or not self.watched():
            self._anchor = None
            return
        now = time.perf_counter()
        if self._anchor is None or self._anchor[2] != self.speed:
            self._anchor = (now, t, self.speed)
        start, t_start, speed = self._anchor
        ahead = start + (t - t_start) / speed - now
        if ahead > 0.0:
            time.sleep(min(ahead, 0.1))
        elif ahead < -0.5:  # the computer is slower than that: do not try to catch up
            self._anchor = None


def build_numbers(row: Any, vehicle: SimulatedVehicle) -> str:
    """Return the key numbers of one sample as a Markdown table."""
    lines = [("height", f"{row['p_WB'][2]:.2f} m")]
    speed = float(np.linalg.norm(row["v_WB"]))
    lines.append(("speed", f"{speed:.2f} m/s"))
    if "probe" in vehicle.offers and vehicle.world.pipe is not None:
        probe = vehicle.read_memory("eddy current")
        lift_off = float(probe["lift_axis"] @ (row["ec"] - probe["null"]))
        touching = "contact" if vehicle.in_contact() else "no contact"
        near = float(row["gap"]) < 0.02  # further away gap and tilt mean nothing
        lines += [
            ("probe says", f"**{touching}**"),
            ("lift-off", f"{lift_off:.1f} (contact below {LIFT_OFF_THRESHOLD:g})"),
            ("push", f"{row['f_normal']:.2f} N" if near else "–"),
            ("air gap", f"{1e3 * max(float(row['gap']), 0.0):.2f} mm" if near else "–"),
            ("probe tilt", f"{math.degrees(row['tilt']):.1f}°" if near else "–"),
        ]
    busiest = float(row["rotor_thrust"].max()) / vehicle.robot.rotors.thrust_max_n
    lines.append(("busiest rotor", f"{100 * busiest:.0f} %"))
    return "| | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in lines)


def _latest(vehicle: SimulatedVehicle) -> NDArray[Any]:
    """The newest sample of the vehicle, (1,)."""
    return vehicle.last_sample.copy()


def _has_display() -> bool:
    """Whether a browser would have a screen to open on."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
