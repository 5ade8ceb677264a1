"""An interrupt in the middle of writing: the recording stays readable, and can go on."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from recorded_columns import list_recorded
from skywright.recordings.columns import build_dtype
from skywright.recordings.recording import read_recording
from skywright.recordings.writer import RecordingWriter

RECORDED = list_recorded(("link1", "link2"), 6, ("loads",))
FILES = ("writer.py", "mcap_file.py")


def make_samples(n: int) -> np.ndarray:
    samples = np.zeros(n, build_dtype(RECORDED.columns))
    samples["t"] = np.arange(n) * 0.01
    return samples


def run(call: Callable[[], None], interrupt_at: int | None = None) -> list[tuple[str, int]]:
    """Return the lines of FILES that a call runs, in order; raise KeyboardInterrupt at one."""
    ran: list[tuple[str, int]] = []

    def trace(frame: FrameType, event: str, arg: Any) -> Any:
        if not frame.f_code.co_filename.endswith(FILES):
            return None
        if event == "line" and frame.f_code.co_name not in ("roll_back", "_list_groups"):
            ran.append((frame.f_code.co_filename, frame.f_lineno))
            if len(ran) - 1 == interrupt_at:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return ran


def calls(writer: RecordingWriter, samples: np.ndarray) -> dict[str, Callable[[], None]]:
    return {
        "append": lambda: writer.append(samples),
        "event": lambda: writer.event(0.5, "again"),
        "text": lambda: writer.text("/new/topic", 0.5, "text"),
        "close": writer.close,
    }


@pytest.mark.parametrize("what", ["append", "event", "text", "close"])
def test_an_interrupt_at_any_line_leaves_a_recording_that_goes_on(
    what: str, tmp_path: Path
) -> None:
    """At the first and at the last time that each line runs."""
    samples = make_samples(40)

    def begin(name: str) -> tuple[Path, RecordingWriter]:
        path = tmp_path / f"{name}.mcap"
        writer = RecordingWriter(path, *RECORDED)
        writer.append(samples[:20])
        return path, writer

    def go_on(path: Path, writer: RecordingWriter) -> None:
        cut = read_recording(path)  # as a process that ended here would leave it
        assert cut.samples[:20].tobytes() == samples[:20].tobytes()
        if what == "close":
            return
        writer.append(samples[30:])
        writer.close()
        again = read_recording(path)
        assert again.complete
        assert len(again.samples) in (30, 40)
        assert again.samples[-10:].tobytes() == samples[30:].tobytes()

    path, writer = begin("whole")
    ran = run(calls(writer, samples[20:30])[what])
    go_on(path, writer)
    first = {line: i for i, line in reversed(list(enumerate(ran)))}
    last = {line: i for i, line in enumerate(ran)}
    assert len(first) > 5
    for i in sorted({*first.values(), *last.values()}):
        path, writer = begin(str(i))
        with pytest.raises(KeyboardInterrupt):
            run(calls(writer, samples[20:30])[what], interrupt_at=i)
        go_on(path, writer)
