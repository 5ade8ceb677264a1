"""The video that a page draws: how late, and how many pictures; by the page's own code in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from skywright.description.world.radio import Radio
from skywright.ground.video import describe_video
from skywright.links.radio import VIDEO, Way


def test_without_a_radio_there_is_no_delay() -> None:
    assert describe_video(Radio()) is None


def test_without_a_video_the_states_are_as_late_as_the_radio() -> None:
    assert describe_video(Radio(delay_s=0.2)) == {"delay_s": 0.2, "rate_hz": None}


@pytest.mark.parametrize("rate_hz", [5.0, 25.0])
def test_a_picture_is_as_late_as_the_radio_delivers_it(rate_hz: float) -> None:
    radio = Radio(delay_s=0.15, bandwidth_kbps=4000.0, video_kbps=2000.0, video_rate_hz=rate_hz)
    found = describe_video(radio)
    assert found is not None and found["rate_hz"] == rate_hz
    way = Way(radio, 1, "down")
    way.send(0.0, VIDEO, round(125.0 * radio.video_kbps / rate_hz), "picture")
    assert way.receive(found["delay_s"] - 1e-4) == []
    assert way.receive(found["delay_s"] + 1e-4) == ["picture"]


def _pick(repository: Path, tmp_path: Path, link: object, times: list[float]) -> list[float]:
    """Return the time of the picture that the page shows at each time; states come at 50 Hz."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on PATH (Node.js runs the page's code)")
    program = tmp_path / "pick.mjs"
    source = (repository / "page" / "src" / "video.js").as_uri()
    program.write_text(
        f"import {{ Video }} from {source!r};\n"
        f"const video = new Video({json.dumps(link)}), out = [];\n"
        f"let k = 0;\n"
        f"for (const t of {json.dumps(times)}) {{\n"
        f"  for (; 0.02 * k <= t + 1e-9; k++) video.add(0.02 * k, [k]);\n"
        f"  out.push(video.pick(t)?.[0] ?? null);\n"
        f"}}\nconsole.log(JSON.stringify(out));\n"
    )
    ran = subprocess.run([node, str(program)], capture_output=True, text=True, check=True)
    found: list[float] = json.loads(ran.stdout)
    return found


def test_the_page_shows_pictures_that_are_late_and_stay(repository: Path, tmp_path: Path) -> None:
    times = [round(1.0 + 0.02 * k, 2) for k in range(100)]
    seen = _pick(repository, tmp_path, {"delay_s": 0.3, "rate_hz": 10.0}, times)
    assert sorted(set(seen)) == pytest.approx([0.7 + 0.1 * k for k in range(20)], abs=0.021)
    for t, picture in zip(times, seen, strict=True):
        assert 0.3 - 1e-6 <= t - picture <= 0.3 + 0.1 + 0.02


def test_states_are_late_and_come_with_every_frame(repository: Path, tmp_path: Path) -> None:
    times = [1.0, 1.02, 1.5]
    seen = _pick(repository, tmp_path, {"delay_s": 0.2, "rate_hz": None}, times)
    assert seen == pytest.approx([0.8, 0.82, 1.3])
    assert _pick(repository, tmp_path, None, times) == [None] * 3
