"""An interrupt in the middle of writing: the recording stays readable, and can go on."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from recorded_columns import PARTS, list_recorded
from skywright.recordings.columns import build_dtype
from skywright.recordings.recording import read_recording
from skywright.recordings.writer import RecordingWriter

FULL = list_recorded(("link1", "link2"), 6, PARTS)
FILES = ("writer.py", "mcap_file.py")


def make_samples(n: int) -> np.ndarray:
    samples = np.zeros(n, build_dtype(FULL.columns))
    samples["t"] = np.arange(n) * 0.01
    return samples


def interrupt_at(line: int, call: Callable[[], None]) -> bool:
    """Raise KeyboardInterrupt at the given line that runs in FILES; False: it had ended before."""
    left = line

    def trace(frame: FrameType, event: str, arg: Any) -> Any:
        nonlocal left
        if not frame.f_code.co_filename.endswith(FILES):
            return None
        if event == "line" and frame.f_code.co_name not in ("roll_back", "_list_groups"):
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


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
    samples = make_samples(40)
    for line in range(1, 500):
        path = tmp_path / f"{line}.mcap"
        writer = RecordingWriter(path, *FULL)
        writer.append(samples[:20])
        interrupted = interrupt_at(line, calls(writer, samples[20:30])[what])
        cut = read_recording(path)  # as a process that ended here would leave it
        assert cut.samples[:20].tobytes() == samples[:20].tobytes()
        if what != "close":
            writer.append(samples[30:])
            writer.close()
            again = read_recording(path)
            assert again.complete
            assert len(again.samples) in (30, 40)
            assert again.samples[-10:].tobytes() == samples[30:].tobytes()
        if not interrupted:
            assert line > 5
            return
    raise AssertionError("it never ended")
