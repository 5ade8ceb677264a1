"""The frame: addresses of everything that a tick touches, in one small array.

`Frame` (Python) collects the arrays and keeps them alive; `open_frame` (compiled) turns the
addresses back into typed views. A call from Python then has one argument instead of thirty.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit
from numpy.typing import NDArray

from skywright.core.pointers import as_pointer
from skywright.core.types import BELIEF, REFERENCE, SAMPLE
from skywright.inspection.eddy_current import ProbeSignal
from skywright.models.allocation import Allocator
from skywright.models.rigid_body import BODY_MODEL, KINEMATICS
from skywright.sim.inertial import INERTIAL
from skywright.sim.link import LINK
from skywright.sim.plant import PLANT
from skywright.vehicle.guard import GUARD

F8, C16 = np.float64, np.complex128

# places in the frame: an address each, then the sizes
(
    _BELIEF, _PLANT, _GUARD, _MODEL, _KIN, _TABLE, _SAMPLES, _QPOS, _QVEL, _SENSORS, _SITE_P,
    _SITE_R, _CTRL, _XFRC, _B, _P, _T_MIN, _T_MAX, _THRUST, _EC_TABLE, _EC_MU, _EC_KS, _EC_KC,
    _EC_PHASE, _EC_NUMBERS, _MJ_MODEL, _MJ_DATA, _LAW, _PAIRS, _INERTIAL,
    _LINK, _ESTIMATOR, _ACT, _STIFF, _ARMS_LAW, _BODY_P, _BODY_R, _ADDRESSES,
) = range(38)  # fmt: skip
(
    _N_TABLE, _N_SAMPLES, _NQ, _NV, _NSENSOR, _NSITE, _NU, _NBODY, _N_ROTORS, _FULL, _N_TILT,
    _N_GAP, _N_BLEND, _N_MODES, _N_PAIRS, _END,
) = range(_ADDRESSES, _ADDRESSES + 16)  # fmt: skip


class Views(NamedTuple):
    """What compiled code sees; b to stiff are (1,) arrays of a record each."""

    b: Any
    pl: Any
    im: Any
    lk: Any
    g: Any
    model: Any
    kin: Any
    stiff: Any
    table: Any
    samples: Any
    qpos: Any
    qvel: Any
    sensordata: Any
    site_xpos: Any
    site_xmat: Any
    body_xpos: Any
    body_xmat: Any
    ctrl: Any
    act: Any
    xfrc: Any
    B: Any
    P: Any
    t_min: Any
    t_max: Any
    full: int
    thrust: Any
    probe: ProbeSignal
    belief_address: int
    law_address: int
    estimator_address: int
    arms_law_address: int
    mj_model: int
    mj_data: int
    pair_friction: Any


@njit(cache=True, error_model="numpy")
def open_frame(f: Any) -> Views:
    """Return typed views on everything in the frame."""
    probe_numbers = carray(as_pointer(f[_EC_NUMBERS]), 8, F8)
    shape = (f[_N_TILT], f[_N_GAP], f[_N_BLEND])
    probe = ProbeSignal(
        carray(as_pointer(f[_EC_TABLE]), shape, C16),
        carray(as_pointer(f[_EC_MU]), (f[_N_TILT], f[_N_GAP]), C16),
        probe_numbers[0], probe_numbers[1], probe_numbers[2], probe_numbers[3], probe_numbers[4],
        probe_numbers[5],
        carray(as_pointer(f[_EC_KS]), f[_N_MODES], F8),
        carray(as_pointer(f[_EC_KC]), f[_N_MODES], F8),
        carray(as_pointer(f[_EC_PHASE]), f[_N_MODES], F8),
        probe_numbers[6], probe_numbers[7],
    )  # fmt: skip
    n = f[_N_ROTORS]
    return Views(
        carray(as_pointer(f[_BELIEF]), 1, BELIEF),
        carray(as_pointer(f[_PLANT]), 1, PLANT),
        carray(as_pointer(f[_INERTIAL]), 1, INERTIAL),
        carray(as_pointer(f[_LINK]), 1, LINK),
        carray(as_pointer(f[_GUARD]), 1, GUARD),
        carray(as_pointer(f[_MODEL]), 1, BODY_MODEL),
        carray(as_pointer(f[_KIN]), 1, KINEMATICS),
        carray(as_pointer(f[_STIFF]), 1, KINEMATICS),
        carray(as_pointer(f[_TABLE]), f[_N_TABLE], REFERENCE),
        carray(as_pointer(f[_SAMPLES]), f[_N_SAMPLES], SAMPLE),
        carray(as_pointer(f[_QPOS]), f[_NQ], F8),
        carray(as_pointer(f[_QVEL]), f[_NV], F8),
        carray(as_pointer(f[_SENSORS]), f[_NSENSOR], F8),
        carray(as_pointer(f[_SITE_P]), (f[_NSITE], 3), F8),
        carray(as_pointer(f[_SITE_R]), (f[_NSITE], 9), F8),
        carray(as_pointer(f[_BODY_P]), (f[_NBODY], 3), F8),
        carray(as_pointer(f[_BODY_R]), (f[_NBODY], 9), F8),
        carray(as_pointer(f[_CTRL]), f[_NU], F8),
        carray(as_pointer(f[_ACT]), f[_NU] - f[_N_ROTORS], F8),
        carray(as_pointer(f[_XFRC]), (f[_NBODY], 6), F8),
        carray(as_pointer(f[_B]), (6, n), F8),
        carray(as_pointer(f[_P]), (n, 6), F8),
        carray(as_pointer(f[_T_MIN]), n, F8),
        carray(as_pointer(f[_T_MAX]), n, F8),
        f[_FULL],
        carray(as_pointer(f[_THRUST]), n, F8),
        probe,
        f[_BELIEF],
        f[_LAW],
        f[_ESTIMATOR],
        f[_ARMS_LAW],
        f[_MJ_MODEL],
        f[_MJ_DATA],
        carray(as_pointer(f[_PAIRS]), (f[_N_PAIRS], 5), F8),
    )


class Frame:
    """Collects addresses and keeps the arrays behind them alive; `array` goes to compiled code."""

    def __init__(
        self, belief: NDArray[Any], plant: NDArray[Any], inertial: NDArray[Any],
        link: NDArray[Any], guard: NDArray[Any], model: NDArray[Any], kin: NDArray[Any],
        samples: NDArray[Any], sim: Any, allocator: Allocator, thrust: NDArray[Any],
        probe: ProbeSignal, law_address: int, estimator_address: int, arms_law_address: int,
    ) -> None:  # fmt: skip
        """`sim` is a Simulation; `law_address` 0 where the law is plain Python."""
        numbers = np.array([
            probe.nose, probe.weld_s, probe.weld_c, probe.weld_0, probe.weld_half_width,
            probe.footprint, probe.texture_amplitude, probe.noise,
        ])  # fmt: skip
        a = allocator
        arrays: dict[int, Any] = {
            _BELIEF: belief, _PLANT: plant, _INERTIAL: inertial, _LINK: link, _GUARD: guard,
            _MODEL: model, _KIN: kin, _STIFF: np.zeros_like(kin),
            _SAMPLES: samples, _QPOS: sim.qpos, _QVEL: sim.qvel, _SENSORS: sim.sensordata,
            _SITE_P: sim.site_xpos, _SITE_R: sim.site_xmat,
            _BODY_P: sim.body_xpos, _BODY_R: sim.body_xmat, _CTRL: sim.ctrl,
            _ACT: sim.act, _XFRC: sim.xfrc,
            _B: a.B, _P: a.P, _T_MIN: a.t_min, _T_MAX: a.t_max, _THRUST: thrust,
            _EC_TABLE: np.ascontiguousarray(probe.table, C16),
            _EC_MU: np.ascontiguousarray(probe.d_log_mu, C16),
            _EC_KS: probe.texture_ks, _EC_KC: probe.texture_kc, _EC_PHASE: probe.texture_phase,
            _EC_NUMBERS: numbers, _PAIRS: sim.pair_friction,
        }  # fmt: skip
        sizes = {
            _N_SAMPLES: len(samples), _NQ: len(sim.qpos), _NV: len(sim.qvel),
            _NSENSOR: len(sim.sensordata), _NSITE: len(sim.site_xpos), _NU: len(sim.ctrl),
            _NBODY: len(sim.xfrc), _N_ROTORS: len(thrust), _FULL: int(a.full),
            _N_TILT: probe.table.shape[0], _N_GAP: probe.table.shape[1],
            _N_BLEND: probe.table.shape[2], _N_MODES: len(probe.texture_ks),
            _N_PAIRS: len(sim.pair_friction),
        }  # fmt: skip
        self.array = np.zeros(_END, np.int64)
        for place, value in arrays.items():
            assert value.flags.c_contiguous
            self.array[place] = value.ctypes.data
        for place, size in sizes.items():
            self.array[place] = size
        self.array[_MJ_MODEL], self.array[_MJ_DATA] = sim.model_address, sim.data_address
        self.array[_LAW], self.array[_ESTIMATOR] = law_address, estimator_address
        self.array[_ARMS_LAW] = arms_law_address
        self._alive: list[Any] = [*arrays.values(), sim]
        self._table: Any = None

    def set_table(self, table: NDArray[Any]) -> None:
        """Point the frame at another reference table (rows of REFERENCE, contiguous)."""
        self._table = table
        self.array[_TABLE], self.array[_N_TABLE] = table.ctypes.data, len(table)
