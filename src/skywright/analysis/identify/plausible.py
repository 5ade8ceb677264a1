"""Plausibility of a fit: prediction of the flight, and physical limits of the values.

A fit always returns numbers. They become a robot file only if they predict held-out parts of the
flight and are plausible for a robot that resembles its file.
"""

from collections.abc import Sequence

import numpy as np

from skywright.analysis.identify.fit import LEAST_R2, Fit
from skywright.description.robot.spec import Robot
from skywright.errors import InputError

LARGEST_ERROR = 1.0
"""m/s^2, maximum rms error of the specific force on held-out parts: a tenth of the weight."""


def check_fit(fit: Fit, robot: Robot, logs: str, notes: Sequence[str] = ()) -> None:
    """Raise InputError if a fit does not predict the flight or exceeds physical limits."""
    p = fit.prediction
    error = (p.measured - p.predicted)[p.held_out]
    spread = max(float(np.sum(p.measured[:, 3:].var(axis=0))), 1e-12)
    whole = 1.0 - float(np.sum(np.mean(error[:, 3:] ** 2, axis=0))) / spread
    each = p.r_squared(p.predicted)[3:]
    fitted = {e.parameter.name.partition(".")[2] for e in fit.estimates if e.identified}
    bad = [
        f"{r:.3g} about {axis}"
        for r, axis in zip(each, "xyz", strict=True)
        if not r >= LEAST_R2 and f"inertia_{axis}{axis}_kgm2" in fitted
    ]
    if not whole >= LEAST_R2:
        given_up = [
            f"{r:.3g} about {axis}"
            for r, axis, unused in zip(fit.given_up_r2, "xyz", fit.unused, strict=True)
            if unused
        ]
        without = " without the parameters of these axes" if given_up else ""
        bad = [*given_up, f"{whole:.3g} about all axes{without}", *bad]
    force = float(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=1))))
    turns = ", ".join(f"{v:.2g}" for v in p.measured[:, 3:].std(axis=0))
    wrong = f"{logs}: the log does not match robot {robot.name!r}"
    told = "; ".join(notes)
    advice = (
        "give the correct robot (rotors, arms, mass), and a flight with rotations and "
        "accelerations; " + told
    )
    if bad and force <= LARGEST_ERROR:  # thrust and weight match
        wrong = f"{logs}: the flight does not identify the rotation of robot {robot.name!r}"
        advice = (
            f"its specific force is predicted to {force:.2g} m/s², its angular acceleration is "
            f"{turns} rad/s² (rms about x, y, z): add a flight that rolls, pitches and yaws more, "
            "or correct the order, places and spins of the rotors; " + told
        )
    if bad:
        raise InputError(
            f"{wrong}: R² of the angular acceleration on held-out parts is {', '.join(bad)}; at "
            f"least {LEAST_R2:g} is needed; {advice}"
        )
    if not force <= LARGEST_ERROR:
        raise InputError(
            f"{wrong}: the specific force on held-out parts is off by {force:.2g} m/s² (rms); at "
            f"most {LARGEST_ERROR:g} is possible; {advice}"
        )
    for e in fit.estimates:
        q = e.parameter
        low = q.low - e.half_width if q.low == 0.0 else q.low  # an interval that contains zero
        if e.identified and not low <= e.value <= q.high:
            raise InputError(
                f"{wrong}: {q.name} ({q.meaning}) would be {e.value:.4g} {q.unit}".rstrip()
                + f"; valid: {q.low:.4g} to {q.high:.4g}, its file has {q.nominal:.4g}; {advice}"
            )
