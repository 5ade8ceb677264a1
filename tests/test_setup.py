"""What is computed of a description is built once and shared."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import pytest

from exact_map import EXACT
from skywright.description.loader import load_description
from skywright.description.world.structure import build_surface
from skywright.description.world.surface import build_cylinder
from skywright.models.allocation import build_allocator
from skywright.models.rigid_body import build_body_model
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup

BUILDERS = (
    build_scene, build_body_model, build_rotors, build_allocator, build_cylinder, build_surface,
)  # fmt: skip


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each builder is called, by whoever imported it."""
    found: Counter[str] = Counter()

    def count(function: Any) -> Any:
        def counted(*args: Any, **kwargs: Any) -> Any:
            found[function.__name__] += 1
            return function(*args, **kwargs)

        return counted

    for mission in ("pipe-weld-scan", "wall-contact"):  # import what they fly with
        setup = Setup(load_description(mission))
        plan_mission(setup.description, setup)
        build_vehicle(setup.description, setup=setup)
    for function in BUILDERS:
        for module in [m for n, m in sys.modules.items() if n.startswith("skywright.")]:
            if vars(module).get(function.__name__) is function:
                monkeypatch.setattr(module, function.__name__, count(function))
    return found


@pytest.mark.parametrize(
    ("mission", "surface"), [("pipe-weld-scan", "build_cylinder"), ("waypoints", "")]
)
def test_planning_and_vehicle_build_everything_once(
    counts: Counter[str], mission: str, surface: str
) -> None:
    d = load_description(mission, sets=EXACT)  # else the true surface is built beside the map's
    setup = Setup(d)
    assert plan_mission(d, setup).feasible
    build_vehicle(d, setup=setup)
    assert setup.scene is setup.scene
    once = {f.__name__: 1 for f in BUILDERS if not f.__name__.endswith(("_cylinder", "_surface"))}
    once |= {"build_scene": 2} | ({surface: 1} if surface else {})  # the nominal one, the plant
    assert counts == once


def test_two_setups_share_nothing() -> None:
    d = load_description("waypoints")
    a, b = Setup(d), Setup(d)
    assert a.model is a.model and a.model is not b.model and a.scene is not b.scene
    assert a.rotors is a.rotors and a.rotors is not b.rotors
