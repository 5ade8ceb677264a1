// A SpaceMouse over WebHID. Report 1 is the shift of the cap (x right, y towards the user, z down,
// 16 bits each; newer devices add the rotations), 2 the rotations about the same axes, 3 the buttons.
const FULL = 350; // value of a cap at its stop
const STALE_MS = 250; // a moving cap reports every 8 to 16 ms
const DEAD_ZONE = 0.06;
const FILTERS = [{ vendorId: 0x256f }, { vendorId: 0x046d, usagePage: 1, usage: 8 }];
const clamp = (x) => Math.max(-1, Math.min(1, x));

export class Cap {
  constructor() {
    this.shift = [0, 0, 0];
    this.turn = [0, 0, 0];
    this.buttons = 0;
    this.seen = -Infinity; // time (ms) of the last report of an axis
  }

  // Stores a report (a DataView without its number) received at `now` (ms); returns if it is known.
  take(id, data, now) {
    const words = (at) => [0, 2, 4].map((i) => data.getInt16(at + i, true));
    if (id === 1 && (data.byteLength === 6 || data.byteLength >= 12)) {
      this.shift = words(0);
      if (data.byteLength >= 12) this.turn = words(6);
    } else if (id === 2 && data.byteLength >= 6) this.turn = words(0);
    else if (id === 3 && data.byteLength >= 1) {
      this.buttons = data.getUint8(0);
      return true;
    } else return false;
    this.seen = now;
    return true;
  }

  // Returns ahead, left, up and turn to the left, in -1 .. 1, and two buttons.
  read(now) {
    const fresh = now - this.seen <= STALE_MS;
    const axis = (x) => {
      const share = clamp(-x / FULL);
      return fresh && Math.abs(share) > DEAD_ZONE ? share : 0;
    };
    const [right, back, down] = this.shift;
    return {
      v: [axis(back), axis(right), axis(down), axis(this.turn[2])],
      held: (this.buttons & 1) !== 0, stands: (this.buttons & 2) !== 0,
    };
  }
}

export class SpaceMouse {
  constructor(hid = globalThis.navigator?.hid) {
    this.hid = hid;
    this.cap = new Cap();
    this.device = null;
    this.error = '';
    hid?.addEventListener('disconnect', (e) => { if (e.device === this.device) this.forget(); });
  }

  get available() { return Boolean(this.hid); }

  get name() { return this.device?.productName ?? ''; }

  forget() {
    this.device = null;
    this.cap = new Cap();
  }

  // Opens a device: one that this page is allowed to use, or with `ask` one that the user selects.
  async open(ask) {
    try {
      const found = ask ? await this.hid.requestDevice({ filters: FILTERS }) : await this.hid.getDevices();
      const device = found[0];
      if (!device) return;
      if (!device.opened) await device.open();
      this.forget();
      this.device = device;
      device.addEventListener('inputreport', (e) => {
        if (this.device === device) this.cap.take(e.reportId, e.data, performance.now());
      });
      this.error = '';
    } catch (error) {
      this.error = `The SpaceMouse cannot be opened: ${error.message}`;
    }
  }

  read() { return this.device ? this.cap.read(performance.now()) : null; }
}
