// Frames: one row of float32 values for each instant; reports/frames.py describes their order.
export const decode = (text, Type) =>
  new Type(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

export class Layout {
  constructor(layout) {
    this.parts = layout.parts;
    this.arrows = 7 * layout.parts;
    this.trace = this.arrows + 6 * layout.arrows.length;
    this.map = this.trace + 4;
    this.channels = this.map + 3;
    this.size = layout.size;
  }
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The frames of a recording: `row(i)` gives one, `t` their times (s).
export class Recorded {
  static async unpack(packed, size) {
    const out = new Recorded();
    out.t = packed.n ? decode(packed.t, Float32Array) : new Float32Array(0);
    out.n = packed.n;
    out.size = size;
    const planes = packed.n ? await inflate(decode(packed.body, Uint8Array)) : new Uint8Array(0);
    const count = packed.n * size;
    const bytes = new Uint8Array(4 * count); // byte 0 of all numbers, then byte 1, ...
    for (let b = 0; b < 4; b++) {
      for (let i = 0; i < count; i++) bytes[4 * i + b] = planes[b * count + i];
    }
    out.columns = new Float32Array(bytes.buffer); // one column after another
    return out;
  }

  column(k) {
    return this.columns.subarray(k * this.n, (k + 1) * this.n);
  }

  row(i) {
    const row = new Float32Array(this.size);
    for (let k = 0; k < this.size; k++) row[k] = this.columns[k * this.n + i];
    return row;
  }

  // Returns the index of the last frame at or before t.
  find(t) {
    let low = 0, high = this.n - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.t[middle] <= t + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }
}

// Header of a live frame, see ground/link.py: magic, sequence, mission time, wall time, phase,
// flags, lateness.
export function readLive(buffer) {
  const v = new DataView(buffer);
  if (v.byteLength < 36 || v.getUint32(0, true) !== 0x31594b53) return null;
  return {
    seq: v.getUint32(4, true), t: v.getFloat64(8, true), wall: v.getFloat64(16, true),
    phase: v.getUint16(24, true), flags: v.getUint16(26, true), late: v.getFloat32(28, true),
    row: new Float32Array(buffer, 36),
  };
}
