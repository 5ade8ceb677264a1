"""Measure wall thickness from A-scans: set-up on a two-step block, readings, acceptance rules.

The same gauge works on a file and on a live stream: `add` takes blocks of A-scans. By default a
reading uses the time between two echoes, which excludes film and paint. In the mode "single" it
uses the time of one echo since the set-up's zero, as a dual probe does on bare metal. Each reading
is accepted or has a reason for its rejection. The rules are our own; they follow common practice
(GE DMS Go+ manual, sections 1 to 7).
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.inspection.echoes import (
    FoundEchoes,
    Pulse,
    compare_shapes,
    compute_timing_std,
    find_echoes,
    list_more_times,
    measure_delay,
)

Mode = Literal["echo-to-echo", "single"]
K95 = 1.96
"""Half width of a 95 % interval in standard deviations."""


class Rules(NamedTuple):
    """Conditions for accepting a reading."""

    snr_db: float = 12.0  # least height of each echo used, over the noise
    least_fsh: float = 0.2  # least height of the first echo
    threshold_fsh: float = 0.06  # least height of an echo
    spacing_m: float = 1e-4  # largest difference of the first two echo spacings
    other_db: float = 15.0  # least height, over the noise, of an echo of another wall
    other_fsh: float = 0.02  # least height of that echo; it arrives before the wall's second
    shape: float = 0.9  # least correlation of the two echoes
    steady_m: float = 5e-5  # largest range of the readings that must agree
    steady_count: int = 5  # least number of these readings
    steady_s: float = 0.3  # their least duration
    doubling: float = 0.05  # relative tolerance for a reading of twice its neighbours
    least_fraction: float = 0.2  # of the nominal wall
    most_fraction: float = 1.2


class GaugeSetup(NamedTuple):
    """The result of the set-up on a two-step block: velocity, zero and a reference echo."""

    pulse: Pulse
    velocity: float  # m/s
    zero: float  # s, time of an echo at zero thickness
    separation: float  # m, between the halves of a dual probe; 0: single element
    steps: tuple[float, float]  # m
    height: float  # FSH, first echo of the thinner step
    echo: Array  # (n,) FSH, A-scan of the thinner step: the reference echo
    first: float  # s, time of its first echo


class Reading(NamedTuple):
    """The thickness from one A-scan, NaN if there is none; `reason` is "" if it is accepted."""

    t: float  # s
    thickness: float  # m
    u95: float  # m, half width of the 95 % interval
    height: float  # FSH of the first echo
    snr_db: float  # of the weakest echo used, over the noise
    reason: str

    @property
    def accepted(self) -> bool:
        """Whether every rule was met."""
        return not self.reason


class GaugeCheck(NamedTuple):
    """The result of a later check on the block; `reasons` is empty if the set-up is still valid."""

    errors: tuple[float, float]  # m, on the two steps
    reasons: tuple[str, ...]


def set_up_gauge(
    ascans: tuple[Array, Array], steps: tuple[float, float], pulse: Pulse, *,
    expected: float = 5920.0, tolerance: float = 0.02, separation: float = 0.0,
) -> GaugeSetup:  # fmt: skip
    """Return velocity and zero from one A-scan (n,) on each step (m) of a block, thin and thick.

    `expected` (m/s) is the velocity of the part's material. `tolerance` is the largest relative
    difference of the block's velocity from it. Raises InputError if the steps are not positive and
    increasing, if a step shows no echo, or if the block is of another material.
    """
    thin, thick = steps
    if not 0 < thin < thick:
        raise InputError(f"block: steps of {thin:g} and {thick:g} m; valid: above 0, growing")
    first, heights = [], []
    for ascan, step in zip(ascans, steps, strict=True):
        found = find_echoes(ascan, pulse, Rules().least_fsh)
        if not found.times or found.amplitudes[0] < 10 ** (Rules().snr_db / 20) * found.noise:
            raise InputError(
                f"block: the step of {1e3 * step:g} mm shows no echo above "
                f"{Rules().least_fsh:.0%} of full screen behind the dead zone of "
                f"{5e5 * expected * pulse.gate_start:.1f} mm; couple the probe, raise the gain or "
                "take a thicker step"
            )
        first.append((ascan, found.times[0]))
        heights.append(found.amplitudes[0])
    ways = [2 * math.hypot(d, separation / 2) for d in steps]
    delay = _measure_between(first[0], first[1], pulse)
    velocity = (ways[1] - ways[0]) / delay if delay > 0 else math.nan
    if not abs(velocity / expected - 1.0) <= tolerance:
        raise InputError(
            f"block: sound takes {1e6 * delay:.3f} us longer in {1e3 * thick:g} than in "
            f"{1e3 * thin:g} mm, {velocity:.0f} m/s; valid: {expected:g} within {tolerance:.0%}; "
            "check the steps, of which none may lie in the dead zone of up to "
            f"{5e5 * expected * pulse.gate_start:.1f} mm, or use a block of the part's material"
        )
    zero = first[0][1] - ways[0] / velocity
    return GaugeSetup(pulse, velocity, zero, separation, steps, heights[0], *first[0])


def check_gauge(
    setup: GaugeSetup, ascans: tuple[Array, Array], *, limit: float = 5e-5, height: float = 0.25
) -> GaugeCheck:
    """Read the block's steps again and return their errors.

    `reasons` lists each error above `limit` (m), each step without an echo, and a relative change
    of the thinner step's first echo above `height`.
    """
    errors, reasons = [], []
    for ascan, step in zip(ascans, setup.steps, strict=True):
        found = find_echoes(ascan, setup.pulse, Rules().threshold_fsh)
        if not found.times:
            errors.append(math.nan)
            reasons.append(f"the step of {1e3 * step:g} mm shows no echo")
            continue
        errors.append(_read_single(setup, ascan, found.times[0]) - step)
        if abs(errors[-1]) > limit:
            reasons.append(
                f"the step of {1e3 * step:g} mm reads {1e3 * (step + errors[-1]):.3f} mm; valid: "
                f"within {1e3 * limit:g} mm"
            )
        if step == setup.steps[0] and abs(found.amplitudes[0] / setup.height - 1.0) > height:
            reasons.append(
                f"its first echo is {found.amplitudes[0] / setup.height:.0%} of what it was; "
                f"valid: within {height:.0%}"
            )
    return GaugeCheck((errors[0], errors[1]), tuple(reasons))


class ThicknessGauge:
    """Converts A-scans to readings; stores the readings that must agree and the earlier sites."""

    def __init__(
        self, setup: GaugeSetup, nominal: float, *, mode: Mode = "echo-to-echo",
        velocity_fraction: float = 0.003, rules: Rules | None = None,
    ) -> None:  # fmt: skip
        """Store set-up and rules; `nominal` (m) is the wall's nominal thickness.

        `velocity_fraction` is the relative standard deviation of the velocity, part against block.
        Raises InputError if the wall is outside the range of the block's steps or lies in the dead
        zone.
        """
        self.setup, self.nominal, self.mode = setup, nominal, mode
        self.velocity_fraction, self.rules = velocity_fraction, rules or Rules()
        dead = 0.5 * setup.velocity * max(setup.pulse.gate_start - setup.zero, 0.0)
        if not setup.steps[0] <= nominal <= setup.steps[1]:
            raise InputError(
                f"gauge: a nominal wall of {1e3 * nominal:g} mm lies outside the block's steps; "
                f"valid: {1e3 * setup.steps[0]:g} to {1e3 * setup.steps[1]:g} mm"
            )
        if nominal <= dead:
            raise InputError(
                f"gauge: a nominal wall of {1e3 * nominal:g} mm lies in the dead zone of "
                f"{1e3 * dead:.1f} mm; use a dual probe or a higher frequency"
            )
        self._last: deque[Reading] = deque()
        self._accepted: list[float] = []  # m, at this site
        self._sites: list[float] = []  # m, median of the accepted readings of each earlier site

    def add(self, t: Iterable[float], ascans: Array) -> list[Reading]:
        """Return the k readings of A-scans (k, n) FSH, taken at `t` (k,) s in increasing order."""
        return [
            self._judge(float(at), ascan)
            for at, ascan in zip(t, np.atleast_2d(ascans), strict=True)
        ]

    def leave_site(self) -> None:
        """Store the median of the accepted readings: the probe leaves the site.

        A site without an accepted reading is no neighbour of later sites. The readings that must
        agree are cleared.
        """
        if self._accepted:
            self._sites.append(float(np.median(self._accepted)))
        self._accepted.clear()
        self._last.clear()

    def restart(self) -> None:
        """Clear the readings that must agree: the probe touches the same site again."""
        self._last.clear()

    def _judge(self, t: float, ascan: Array) -> Reading:
        """Read one A-scan and apply the rules: those of a single reading, then those of several."""
        reading = self._read(t, ascan)
        if reading.reason:
            self._last.clear()
            return reading
        rules = self.rules
        self._last.append(reading)
        while len(self._last) > rules.steady_count and (
            t - self._last[1].t >= rules.steady_s - 1e-9
        ):
            self._last.popleft()
        values = [r.thickness for r in self._last]
        lasted = t - self._last[0].t >= rules.steady_s - 1e-9
        if len(values) < rules.steady_count or not lasted:
            return reading._replace(reason="not yet steady")
        if max(values) - min(values) > rules.steady_m:
            return reading._replace(
                reason=f"not steady: the last {len(values)} readings lie within "
                f"{1e3 * (max(values) - min(values)):.2f} mm"
            )
        if self._sites:
            ratio = reading.thickness / float(np.median(self._sites[-5:]))
            if abs(ratio - 2.0) <= 2.0 * rules.doubling:
                return reading._replace(reason="twice its neighbours: the second echo was read")
        self._accepted.append(reading.thickness)
        return reading

    def _read(self, t: float, ascan: Array) -> Reading:
        """Read one A-scan and apply the rules of a single reading."""
        rules, setup = self.rules, self.setup
        found = find_echoes(ascan, setup.pulse, rules.threshold_fsh)
        first = found.amplitudes[0] if found.times else 0.0
        used = 1 if self.mode == "single" else 2
        weakest = min(found.amplitudes[:used], default=0.0)
        snr = 20 * math.log10(max(weakest, 1e-6) / max(found.noise, 1e-6))

        def refuse(reason: str, thickness: float = math.nan) -> Reading:
            return Reading(t, thickness, math.nan, first, snr, reason)

        if not found.times:
            return refuse("no echo: no coupling, or tilted")
        if found.saturated or first > 1.0:
            return refuse("saturated: lower the gain")
        if first < rules.least_fsh:
            return refuse(f"low signal: {first:.0%} of full screen")
        if len(found.times) < used:
            return refuse("one echo only")
        if snr < rules.snr_db:
            return refuse(f"low signal: {snr:.0f} dB over the noise")
        thickness, spread = self._measure(ascan, found)
        if spread > rules.spacing_m:
            return refuse(f"echo spacings differ by {1e3 * spread:.2f} mm", thickness)
        if used == 2:
            delay = 2.0 * thickness / setup.velocity
            alike = compare_shapes(ascan, setup.pulse, found.times[0], delay, found.noise)
            if alike < rules.shape:
                return refuse(
                    f"the echoes differ in shape (correlation {alike:.2f}): two walls under the "
                    "face that differ by less than a pulse length",
                    thickness,
                )
        other = self._find_other(found, thickness)
        if other > 0.0:
            return refuse(
                f"two walls under the face, {1e3 * thickness:.1f} and {1e3 * other:.1f} mm: a "
                "step, an edge or a pit",
                thickness,
            )
        if not rules.least_fraction <= thickness / self.nominal <= rules.most_fraction:
            return refuse(f"{1e3 * thickness:.2f} mm is outside the range of the wall", thickness)
        timing = math.hypot(*(
            compute_timing_std(setup.pulse, a, found.noise) for a in found.amplitudes[:used]
        ))  # fmt: skip
        std = math.hypot(
            0.5 * setup.velocity * timing, self.velocity_fraction * thickness, spread / 4
        )
        return Reading(t, thickness, K95 * std, first, snr, "")

    def _find_other(self, found: FoundEchoes, thickness: float) -> float:
        """Return the thickness (m) of a second wall under the face, 0 if there is none.

        The first echo of the second wall arrives before the second echo of the wall that is read.
        Normally distributed noise reaches `other_db` = 15 dB in one of 1e6 A-scans.
        """
        setup, first = self.setup, found.times[0]
        strong = max(found.noise * 10 ** (self.rules.other_db / 20), self.rules.other_fsh)
        second = first + 2.0 * thickness / setup.velocity - 4.0 * setup.pulse.width
        for time in list_more_times(found, setup.pulse, strong, most=6):
            if first + 4.0 * setup.pulse.width < time < second:
                return thickness + 0.5 * setup.velocity * (time - first)
        return 0.0

    def _measure(self, ascan: Array, found: FoundEchoes) -> tuple[float, float]:
        """Return the thickness (m) and its difference (m) from the next echo spacing, 0 if none."""
        setup, pulse = self.setup, self.setup.pulse
        if self.mode == "single":
            return _read_single(setup, ascan, found.times[0]), 0.0
        delay = measure_delay(ascan, pulse, found.times[0], found.times[1])
        thickness = 0.5 * setup.velocity * delay
        strong = found.noise * 10 ** (self.rules.snr_db / 20)
        if len(found.times) < 3 or found.amplitudes[2] < strong:
            return thickness, 0.0
        again = measure_delay(ascan, pulse, found.times[1], found.times[2])
        return thickness, abs(0.5 * setup.velocity * again - thickness)


def _read_single(setup: GaugeSetup, ascan: Array, time: float) -> float:
    """Return the thickness (m) from the echo at `time` (s), by correlation with the set-up's echo.

    The result is corrected for the V path of a dual probe.
    """
    delay = _measure_between((setup.echo, setup.first), (ascan, time), setup.pulse)
    way = 0.5 * setup.velocity * (setup.first + delay - setup.zero)
    return math.sqrt(max(way**2 - (setup.separation / 2) ** 2, 0.0))


def _measure_between(
    one: tuple[Array, float], two: tuple[Array, float], pulse: Pulse
) -> float:  # fmt: skip
    """Return the time (s) between the first echoes of two A-scans, correlated as one signal."""
    (a, ta), (b, tb) = one, two
    joined = np.concatenate([a, b])
    shift = a.size / pulse.rate
    return measure_delay(joined, pulse, ta, tb + shift) - shift
