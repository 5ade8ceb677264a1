"""Every number of a description has a range, by its own bounds or by the unit in its name."""

import types
import typing
from collections.abc import Iterator
from typing import Any, Union, get_args, get_origin

import annotated_types
import pytest

from skywright.core.find import GROUPS, list_kinds, load_built_in
from skywright.core.ranges import BARE, NAMED, OTHERS, UNITS, check_range, find_range
from skywright.core.spec import Spec
from skywright.description.loader import SPECS, load_description
from skywright.description.mission.spec import find_mission_spec
from skywright.errors import InputError


def list_specs() -> set[type[Spec]]:
    """All tables of the four roots, of the built-in components, things and kinds."""
    found: set[type[Spec]] = set()

    def visit(annotation: Any) -> None:
        new = isinstance(annotation, type) and annotation not in found
        if new and issubclass(annotation, Spec):
            found.add(annotation)
            for field in annotation.model_fields.values():
                visit(field.annotation)
        for inner in get_args(annotation):
            visit(inner)

    for spec in SPECS.values():
        visit(spec)
    for kind in list_kinds("kind"):
        visit(find_mission_spec(kind, [])[1])
    for group in set(GROUPS) - {"kind"}:
        for kind in list_kinds(group):
            try:
                visit(getattr(load_built_in(group, kind), "Table", None))
            except AssertionError:  # a module that only serves others
                continue
    return found


def iterate_bounds(annotation: Any, metadata: tuple[Any, ...] = ()) -> Iterator[bool]:
    """For each number in a field's type: whether it has both bounds of its own."""
    origin = get_origin(annotation)
    if origin is typing.Annotated:
        inner, *more = get_args(annotation)
        flat = [m for x in more for m in getattr(x, "metadata", [x])]
        yield from iterate_bounds(inner, (*metadata, *flat))
    elif origin in (Union, types.UnionType):
        for inner in get_args(annotation):
            yield from iterate_bounds(inner, metadata)
    elif origin in (list, dict, tuple):
        for inner in get_args(annotation):
            yield from iterate_bounds(inner)
    elif annotation in (float, int):
        low = any(isinstance(m, annotated_types.Gt | annotated_types.Ge) for m in metadata)
        high = any(isinstance(m, annotated_types.Lt | annotated_types.Le) for m in metadata)
        yield low and high


def test_every_number_has_a_range() -> None:
    specs = list_specs()
    assert len(specs) > 80
    missing = [
        f"{spec.__name__}.{name}"
        for spec in specs
        for name, field in spec.model_fields.items()
        if not all(iterate_bounds(field.annotation, tuple(field.metadata)))
        and name not in BARE
        and find_range(name) == OTHERS
    ]
    assert not missing, f"no unit in the name, no bounds and not in BARE: {missing}"


def test_the_longest_end_of_a_name_counts() -> None:
    for ends in (UNITS, NAMED):
        for i, end in enumerate(ends):
            assert not any(end.endswith(earlier) for earlier in list(ends)[:i]), end
    assert find_range("spring_n_per_m") == UNITS["_n_per_m"]
    assert find_range("position_time_constant_s") == NAMED["time_constant_s"]


@pytest.mark.parametrize(
    ("key", "bad", "good", "valid"),
    [
        ("robot.control.tilt_max_deg", 500, 20, "0.001 to 89"),
        ("robot.rotors.time_constant_s", 1e6, 0.05, "0.0001 to 60"),
        ("robot.rotors.time_constant_s", 1e-9, 0.0, "0.0001 to 60"),
        ("world.pipe.friction", 100, 0.0, "1e-06 to 5"),
        ("robot.control.rate_hz", 1e-6, 1000, "0.01 to 100000"),
        ("robot.probe.spring_n_per_m", 1e-9, 200, "0.1 to 1e+08"),
        ("robot.probe.spring_n_per_m", 1e12, 2000, "0.1 to 1e+08"),
        ("robot.arm.motor1.stall_torque_nm", 1e-9, 3, "0.001 to 10000"),
        ("world.wind.mean_mps", 1e308, 2, "1e-06 to 150"),
        ("mission.seed", 2**70, 2**40, "0 to "),
    ],
)
def test_implausible_numbers(key: str, bad: float, good: float, valid: str) -> None:
    with pytest.raises(InputError, match=rf"--set: {key}: .* is implausible; valid: ") as told:
        load_description("pipe-weld-scan", sets=[f"{key}={bad!r}"])
    assert valid in str(told.value)
    try:
        load_description("pipe-weld-scan", sets=[f"{key}={good!r}"])
    except InputError as error:
        assert "implausible" not in str(error)


def test_what_is_no_number_passes() -> None:
    check_range("mass_kg", True)
    check_range("mass_kg", "text")
    check_range("mass_kg", [1.0, None])
    with pytest.raises(ValueError, match="1e-09 is implausible"):
        check_range("mass_kg", [1.0, -1e-9])


def test_a_place_may_be_zero_by_rounding() -> None:
    d = load_description(
        "pipe-weld-scan", sets=["world.pipe.x_m=6e-17", "world.pipe.yaw_deg=-1e-66"]
    )
    assert d.world.pipe is not None and d.world.pipe.x_m == 6e-17
    with pytest.raises(InputError, match="diameter_m: 1e-12 is implausible"):
        load_description("pipe-weld-scan", sets=["world.pipe.diameter_m=1e-12"])


def test_what_a_table_has_by_default_it_takes_as_input() -> None:
    """A user's table with one key is validated whole, its defaults included."""
    checked = 0
    for spec in list_specs():
        if any(field.is_required() for field in spec.model_fields.values()):
            continue
        table = spec()
        assert spec.model_validate(table.model_dump()) == table, spec
        checked += 1
    assert checked > 30
