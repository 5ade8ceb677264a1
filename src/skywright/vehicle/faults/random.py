"""A fault drawn from the seed: any kind that applies to robot and world, at any time."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.find import find, list_kinds
from skywright.core.spec import NonNegative
from skywright.errors import InputError
from skywright.vehicle.component import Fault


class Random(Fault):
    """One of the other faults; the seed determines its kind, start and severity."""

    class Table(Fault.Table):
        """Kinds to draw from (an empty list: all that apply) and the latest start."""

        among: list[str] = []
        end_s: NonNegative = 100.0

    def resolve(self, robot: Any, world: Any, rng: np.random.Generator) -> Fault:
        """Return the drawn fault, which starts between `start_s` and `end_s`."""
        table = self.table
        if table.end_s < table.start_s:
            raise InputError(
                f"plant.faults.{self.name}.end_s = {table.end_s:g} s is before start_s = "
                f"{table.start_s:g} s"
            )
        start = float(rng.uniform(table.start_s, table.end_s))
        kinds = table.among or [k for k in list_kinds("fault") if k != "random"]
        fitting: list[tuple[type[Fault], dict[str, Any]]] = []
        for kind in kinds:
            cls = find("fault", kind, (), f"plant.faults.{self.name}.among").cls
            drawn = cls.draw_table(rng, robot, world)
            if drawn is not None:
                fitting.append((cls, drawn))
        if not fitting:
            raise InputError(
                f"plant.faults.{self.name}: none of {', '.join(kinds)} applies to this robot "
                "and mission"
            )
        cls, drawn = fitting[int(rng.integers(len(fitting)))]
        return cls(self.name, cls.Table.model_validate({"start_s": start, **drawn}))
