"""A computed operator at the stick, after McRuer's crossover model: no recording of a person.

An operator who steers an integrator, such as (24), acts near crossover like a gain with a delay, Y
= w_c e^(-s tau) / s open loop (McRuer and Jex 1967, A review of quasi-linear pilot models, (6)).
The lateral stick here is therefore w_c e(t - tau) / v_max, with e the visible error of the tool and
tau the visual and mental delay, followed by the lag of the arm. The phase margin, pi/2 - w_c (tau +
lag), is 73 deg for the practised manner, 75 deg for the careful and 67 deg for the hasty one, who
uses the full stick. A radio between operator and robot reduces it by w_c times its delay. In
addition, the model ignores an error below a threshold, perceives the error with a slow noise (the
remnant), and its hand has a tremor of 8 to 12 Hz. It moves into the contact while the lateral error
is small enough. There it steers a force as an integrator again: a hand that moves at v into a
stiffness k raises the force by k v.

The numbers of the manners are assumptions. They must not change: studies that compare the levels of
assistance (docs/howto/assistance.md) were flown with them.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.run.operator import Sight, Stick
from skywright.vehicle.plant import MISSION_TICK

ARM_S = 0.1  # s, lag of the arm (neuromuscular)
THRESHOLD = 0.002  # m, largest error that is not perceived
REMNANT = 0.0015  # m, rms of the slow noise of the perceived error
REMNANT_S = 1.0  # s, its correlation
TREMOR = 0.02  # rms, of the stick's full deflection
TREMOR_HZ = 10.0
TREMOR_DAMPING = 0.1  # a band of 8 to 12 Hz
STICK_DECIMALS = 3  # resolution of a device of some hundred steps each way
PRESS_S = 0.5  # s, from perceiving completion to pressing the button
STIFFNESS = 150.0  # N/m, of a contact in the operator's internal model
FELT = 0.15  # of the requested force: least force that is perceived as a contact
GOOD = 0.4  # of it, largest force error that counts as correct


class Manner(NamedTuple):
    """A manner of steering."""

    crossover: float  # rad/s, w_c
    delay: float  # s, tau
    size: float  # largest deflection of the stick
    near: float  # m, largest lateral error for lowering
    sink: float  # deflection while lowering


MANNERS = {
    "practised": Manner(crossover=1.0, delay=0.2, size=0.8, near=0.005, sink=0.4),
    "careful": Manner(crossover=0.7, delay=0.28, size=0.6, near=0.005, sink=0.4),
    "hasty": Manner(crossover=1.0, delay=0.3, size=1.0, near=0.008, sink=0.6),
}


class ModelOperator:
    """The computed operator."""

    def __init__(self, manner: str, seed: int, v_max: float) -> None:
        """`manner` is one of MANNERS, `seed` that of noise and tremor, `v_max` (m/s) of (24)."""
        self.manner, self.v_max = MANNERS[manner], v_max
        self._rng = build_stream(seed, "operator")
        self._seen: deque[Sight] = deque(maxlen=1 + round(self.manner.delay / MISSION_TICK))
        self._stick, self._noise = np.zeros(3), np.zeros(3)
        self._shake, self._shaking = np.zeros(3), np.zeros(3)
        self._done = 0.0  # s since the work is perceived as done
        self._held = 0.0  # s for which the force has been perceived as correct
        self._towards = (0.0, 0.0, 0.0)  # the direction of work that these belong to

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick for the view one delay ago."""
        self._seen.append(sight)
        if sight.towards != self._towards:  # a new piece of work
            self._towards, self._done, self._held = sight.towards, 0.0, 0.0
        seen, m = self._seen[0], self.manner
        keep = math.exp(-MISSION_TICK / REMNANT_S)
        fresh = math.sqrt(1.0 - keep**2) * REMNANT
        self._noise = keep * self._noise + fresh * self._rng.standard_normal(3)
        error = -seen.off - self._noise
        wanted = np.where(np.abs(error) > THRESHOLD, m.crossover * error / self.v_max, 0.0)
        axis = int(np.argmax(np.abs(seen.towards)))
        across = float(np.linalg.norm(np.delete(error, axis)))
        wanted[axis] = seen.towards[axis] * self._go_on(seen, across)
        if seen.done:
            self._done += MISSION_TICK
            wanted[:] = 0.0
        wanted = np.clip(wanted, -m.size, m.size)
        self._stick += (1.0 - math.exp(-MISSION_TICK / ARM_S)) * (wanted - self._stick)
        axes = np.clip(self._stick + self._tremble(), -1.0, 1.0)
        done = self._done > PRESS_S or (seen.asked > 0.0 and self._held > seen.hold_s)
        return Stick(np.round(axes, STICK_DECIMALS), done)

    def _go_on(self, seen: Sight, across: float) -> float:
        """Return the stick (1) into the contact; `across` (m) is the lateral error."""
        m = self.manner
        if seen.asked > 0.0 and seen.force > FELT * seen.asked:
            off = seen.asked - seen.force
            self._held += MISSION_TICK * (abs(off) < GOOD * seen.asked)
            return m.crossover * off / (STIFFNESS * self.v_max)
        return m.sink if across < m.near else 0.0

    def close(self) -> None:
        """Nothing to close."""

    def _tremble(self) -> Array:
        """Return the tremor (3,): noise through a resonance, its rms TREMOR."""
        w, h = 2.0 * math.pi * TREMOR_HZ, MISSION_TICK / 10.0
        push = TREMOR * 2.0 * w * math.sqrt(w * TREMOR_DAMPING)  # rms of x'' + 2 z w x' + w^2 x = n
        for _ in range(10):
            n = push * self._rng.standard_normal(3) / math.sqrt(h)
            self._shaking += h * (n - 2 * TREMOR_DAMPING * w * self._shaking - w**2 * self._shake)
            self._shake += h * self._shaking
        return self._shake
