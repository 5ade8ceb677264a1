"""The detour of a blocked segment on a pipe, whose angle is periodic."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.planning.via_points import DETOURS, ROOM, Search

RADIUS, HALF_LENGTH = 0.15, 0.4


@pytest.mark.parametrize("centre_deg", [0.0, 175.0, -175.0, -200.0, 270.0, -540.0])
def test_a_detour_samples_around_its_segment_at_every_angle(centre_deg: float) -> None:
    phi, seen = math.radians(centre_deg), list[Any]()
    a, b = np.array([-0.02, phi - 0.1]), np.array([0.39, phi + 0.1])

    def refuse(point: np.ndarray, *_: Any) -> SimpleNamespace:
        seen.append(point)
        return SimpleNamespace(failure="nothing holds the tip there")

    cylinder = SimpleNamespace(radius=RADIUS, half_length=HALF_LENGTH)
    search: Any = SimpleNamespace(
        prob=SimpleNamespace(cylinder=cylinder), late=lambda: False, next=refuse,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert Search.detour(search, None, a, b) == []  # type: ignore[arg-type]
    points = np.array(seen)
    assert len(points) == DETOURS and np.max(np.abs(points[:, 0])) <= HALF_LENGTH
    assert np.max(np.abs(points[:, 1] - phi)) <= 0.1 + ROOM / RADIUS
    assert points[:, 1].min() < phi - 0.1 and points[:, 1].max() > phi + 0.1
