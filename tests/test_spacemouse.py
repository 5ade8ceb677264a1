"""The page's reader of a SpaceMouse, run in Node.js with reports as the device sends them."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = """
import { Cap, SpaceMouse } from %s;
const bytes = (...b) => new DataView(Uint8Array.from(b).buffer);
const out = {};
const cap = new Cap();
out.rest = cap.read(0);
// 175 to the right (0xaf 0x00), 350 away from the user (-350 = 0xa2 0xfe), 35 down (0x23 0x00)
out.shift = [cap.take(1, bytes(0xaf, 0, 0xa2, 0xfe, 0x23, 0), 1000), cap.read(1010)];
// turned clockwise as seen from above by 350 (0x5e 0x01)
out.turn = [cap.take(2, bytes(0, 0, 0, 0, 0x5e, 1), 1000), cap.read(1010)];
out.buttons = [cap.take(3, bytes(1, 0), 1000), cap.read(1010).held, cap.read(1010).stands,
  cap.take(3, bytes(3, 0), 1000), cap.read(1010).held, cap.read(1010).stands];
out.stale = cap.read(1300);
out.beyond = [cap.take(1, bytes(0, 0, 0, 0x80, 0, 0), 2000), cap.read(2000).v[0]];
out.small = [cap.take(1, bytes(0, 0, 0xf6, 0xff, 0, 0), 2000), cap.read(2000).v[0]];
const six = new Cap();
out.six = [six.take(1, bytes(0, 0, 0xa2, 0xfe, 0, 0, 0, 0, 0, 0, 0xa2, 0xfe), 5), six.read(5).v];
out.junk = [1, 2, 3, 23].map((id) => new Cap().take(id, bytes(), 0));
out.short = new Cap().take(1, bytes(1, 2, 3), 0);
// a browser with a device: opened, read, gone
const listeners = {};
const device = { opened: false, productName: 'SpaceMouse Compact',
  async open() { this.opened = true; },
  addEventListener(name, f) { listeners[name] = f; } };
const hid = { async requestDevice() { return [device]; },
  async getDevices() { return []; },
  addEventListener(name, f) { listeners[name] = f; } };
const mouse = new SpaceMouse(hid);
await mouse.open(false);
out.none = mouse.read();
await mouse.open(true);
listeners.inputreport({ reportId: 1, data: bytes(0, 0, 0xa2, 0xfe, 0, 0) });
out.device = [device.opened, mouse.name, mouse.read().v[0]];
listeners.disconnect({ device });
out.gone = [mouse.read(), mouse.name];
out.without = new SpaceMouse(undefined).available;
const refused = async () => { throw new Error('refused'); };
const refusing = new SpaceMouse({ ...hid, requestDevice: refused });
await refusing.open(true);
out.refused = refusing.error;
console.log(JSON.stringify(out));
"""


def test_reports_of_a_spacemouse_move_the_stick_as_the_cap_is_moved(repository: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on PATH (Node.js runs the page's source)")
    module = (repository / "page" / "src" / "spacemouse.js").as_uri()
    done = subprocess.run(
        [node, "--input-type=module", "-e", SCRIPT % json.dumps(module)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = json.loads(done.stdout)
    assert found["rest"] == {"v": [0, 0, 0, 0], "held": False, "stands": False}
    taken, state = found["shift"]
    assert taken and state["v"] == pytest.approx([1.0, -0.5, -0.1, 0.0])  # ahead, left, up, turn
    taken, state = found["turn"]
    assert taken and state["v"][3] == -1.0
    assert found["buttons"] == [True, True, False, True, True, True]
    assert found["stale"]["v"] == [0, 0, 0, 0] and found["stale"]["held"]  # it reports no changes
    assert found["beyond"] == [True, 1] and found["small"] == [True, 0]
    assert found["six"] == [True, [1, 0, 0, 1]]
    assert not any(found["junk"]) and not found["short"]
    assert found["none"] is None and found["device"] == [True, "SpaceMouse Compact", 1]
    assert found["gone"] == [None, ""] and found["without"] is False
    assert found["refused"] == "The SpaceMouse cannot be opened: refused"
