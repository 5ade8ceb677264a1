"""What is computed of a description is built once and shared."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import pytest

from skywright.description.loader import load_description
from skywright.models.rigid_body import build_body_model
from skywright.models.scene import build_scene
from skywright.run.planning import plan_mission
from skywright.run.run import build_vehicle
from skywright.run.setup import Setup


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each builder is called, by whoever imported it."""
    found: Counter[str] = Counter()

    def count(function: Any) -> Any:
        def counted(*args: Any, **kwargs: Any) -> Any:
            found[function.__name__] += 1
            return function(*args, **kwargs)

        return counted

    for function in (build_scene, build_body_model):
        for module in [m for n, m in sys.modules.items() if n.startswith("skywright.")]:
            if vars(module).get(function.__name__) is function:
                monkeypatch.setattr(module, function.__name__, count(function))
    return found


def test_planning_and_vehicle_build_one_nominal_scene_and_one_plant(counts: Counter[str]) -> None:
    d = load_description("pipe-weld-scan")
    setup = Setup(d)
    assert plan_mission(d, setup).feasible
    assert counts["build_scene"] == 1 and counts["build_body_model"] == 1
    build_vehicle(d, setup=setup)
    assert counts["build_scene"] == 2


def test_two_setups_share_nothing() -> None:
    d = load_description("waypoints")
    a, b = Setup(d), Setup(d)
    assert a.model is a.model and a.model is not b.model and a.scene is not b.scene
