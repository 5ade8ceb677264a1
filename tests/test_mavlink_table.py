"""The generated page of robots and missions over MAVLink."""

from __future__ import annotations

import importlib.util
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "docs" / "generate_mavlink.py"


def test_the_page_is_what_the_commands_answer() -> None:
    spec = importlib.util.spec_from_file_location("generate_mavlink", SCRIPT)
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.PAGE.read_text("utf-8") == script.build()
