"""The page's stick: what keys and a gamepad say of hands and platform; the page's code in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

PROGRAM = """
const heard = {{}};
globalThis.HTMLElement = class {{}};
globalThis.HTMLButtonElement = class {{}};
globalThis.addEventListener = (name, f) => {{ (heard[name] ??= []).push(f); }};
globalThis.document = {{ addEventListener: globalThis.addEventListener }};
let pads = [];
Object.defineProperty(globalThis, 'navigator', {{ value: {{ getGamepads: () => pads }} }});
const {{ Stick }} = await import({source!r});
const stick = new Stick(), out = [];
const press = (kind, code) => heard[kind].forEach((f) => f({{ code, target: null, preventDefault() {{}} }}));
stick.active = true;
for (const [kind, what] of {steps}) {{
  if (kind === 'pad') pads = what; else if (kind === 'blur') heard.blur.forEach((f) => f());
  else if (kind === 'active') stick.active = what; else press(kind, what);
  out.push(stick.read());
}}
console.log(JSON.stringify(out));
"""  # noqa: E501


def run(repository: Path, tmp_path: Path, *steps: tuple[str, Any]) -> list[dict[str, Any]]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on PATH (Node.js runs the page's code)")
    source = (repository / "page" / "src" / "stick.js").as_uri()
    program = tmp_path / "stick.mjs"
    program.write_text(PROGRAM.format(source=source, steps=json.dumps(steps)))
    ran = subprocess.run([node, str(program)], capture_output=True, text=True, check=True)
    found: list[dict[str, Any]] = json.loads(ran.stdout)
    return found


def pad(axes: list[float], *pressed: int) -> list[dict[str, Any]]:
    buttons = [{"pressed": k in pressed} for k in range(8)]
    return [{"connected": True, "id": "pad", "axes": axes, "buttons": buttons}]


def test_keys_move_the_platform_with_the_dead_man_alone(repository: Path, tmp_path: Path) -> None:
    """Right, ahead, turn to the left, climb; half a deflection a key."""
    w, a, q, r, space = run(
        repository, tmp_path, ("keydown", "KeyW"), ("keydown", "KeyA"), ("keydown", "KeyQ"),
        ("keydown", "KeyR"), ("keydown", "Space"),
    )  # fmt: skip
    assert w["flight"] == [0, 0.5, 0, 0] and w["v"] == [0.5, 0, 0] and w["held"] is False
    assert a["flight"] == [-0.5, 0.5, 0, 0]
    assert q["flight"] == [-0.5, 0.5, 0.5, 0] and q["v"] == [0.5, 0.5, 0]
    assert r["flight"] == [-0.5, 0.5, 0.5, 0.5]
    assert space["held"] is True


def test_enter_says_that_it_is_done_with_the_dead_man_alone(
    repository: Path, tmp_path: Path
) -> None:
    """Without it the key belongs to the button that has the focus."""
    early, space, enter = run(
        repository, tmp_path, ("keydown", "Enter"), ("keydown", "Space"), ("keydown", "Enter")
    )
    assert [x["stands"] for x in (early, space, enter)] == [False, False, True]


def test_keys_whose_release_is_not_seen_do_not_stay(repository: Path, tmp_path: Path) -> None:
    *_, last = run(repository, tmp_path, ("keydown", "Space"), ("keydown", "KeyD"), ("blur", 0))
    assert not any(last["flight"]) and last["held"] is False


def test_keys_belong_to_the_page_where_nobody_asks_for_the_stick(
    repository: Path, tmp_path: Path
) -> None:
    *_, last = run(repository, tmp_path, ("active", False), ("keydown", "KeyW"))
    assert not any(last["flight"])


def test_a_gamepad_says_the_same_beyond_its_dead_zone(repository: Path, tmp_path: Path) -> None:
    found = run(
        repository, tmp_path, ("pad", pad([0.05, -0.05, 0.02, 0.07])),
        ("pad", pad([0.4, -1.0, -0.5, 0.25], 4)), ("pad", pad([2.0, -3.0, 0.0, 0.0], 5, 0)),
    )  # fmt: skip
    rest, moved, wild = found
    assert not any(rest["flight"]) and rest["held"] is False
    assert moved["flight"] == pytest.approx([0.4, 1.0, 0.5, -0.25]) and moved["held"] is True
    assert wild["flight"] == [1, 1, 0, 0] and wild["stands"] is True  # cut to the full deflection
