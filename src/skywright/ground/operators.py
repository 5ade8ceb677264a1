"""Operators at the stick while a mission flies (`skywright run MISSION --operator SOURCE`).

- `view`: keyboard or gamepad at the ground station's page, see page_operator.py;
- `udp:PORT` or `udp:HOST:PORT`: a client of the gateway, see gateway_operator.py;
- `model:practised`, `model:careful`, `model:hasty`: a computed operator, see operator_model.py.

The sticks are recorded in the run's directory (operator.csv), from which the run is repeated.
Simulated time follows the wall clock while a person is at the stick.
"""

from __future__ import annotations

from typing import Any

from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.ground.operator_model import MANNERS, ModelOperator
from skywright.ground.person import Person

SOURCES = "view, udp:PORT, udp:HOST:PORT, " + ", ".join(f"model:{name}" for name in MANNERS)


def open_operator(source: str, description: Description) -> Person | ModelOperator:
    """Return the operator of `source`; a computed one draws from the mission's seed.

    The gateway's operator is ground.gateway_operator.GatewayOperator. Raises InputError for another
    name.
    """
    kind, _, rest = source.partition(":")
    if source in ("view", "page"):
        from skywright.ground.page_operator import PageOperator

        return PageOperator()
    if kind == "model" and rest in MANNERS:
        mission: Any = description.mission
        return ModelOperator(rest, mission.seed, mission.task.stick_speed_mps)
    raise InputError(f"--operator {source[:80]!r}; valid: {SOURCES}")
