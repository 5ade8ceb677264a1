// The inspection map: the probe's signal on the unrolled surface, drawn while it is measured.
import { make } from './dom.js';

// Similar to Cividis: dark blue to yellow, in the same order for colour-blind eyes.
const RAMP = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];

function shade(x) {
  const k = Math.max(0, Math.min(0.9999, x)) * (RAMP.length - 1), i = Math.floor(k), f = k - i;
  return `rgb(${RAMP[i].map((a, j) => Math.round(a + f * (RAMP[i + 1][j] - a))).join(',')})`;
}

export class InspectionMap {
  constructor(parent, about) {
    this.canvas = make('canvas', { width: 600, height: 420, role: 'img', 'aria-label': about.title });
    this.text = make('p', { class: 'hint' });
    parent.append(this.canvas, this.text);
    this.about = about;
    this.clear();
  }

  clear() {
    this.points = [];
    this.bounds = [Infinity, -Infinity, Infinity, -Infinity];
    this.highest = 1e-6;
    this.draw();
  }

  add(s, c, value) {
    if (!Number.isFinite(s + c + value)) return;
    const last = this.points.at(-1);
    if (last && Math.hypot(s - last[0], c - last[1]) < 4e-4) return; // closer than one pixel
    this.points.push([s, c, Math.abs(value)]);
    const b = this.bounds;
    b[0] = Math.min(b[0], s); b[1] = Math.max(b[1], s);
    b[2] = Math.min(b[2], c); b[3] = Math.max(b[3], c);
    this.highest = Math.max(this.highest, Math.abs(value));
  }

  // Draws the first `n` points (default: all).
  draw(n = this.points.length) {
    const g = this.canvas.getContext('2d'), { width, height } = this.canvas;
    g.fillStyle = '#eceff2';
    g.fillRect(0, 0, width, height);
    if (!this.points.length) {
      this.text.textContent = 'No contact measured yet.';
      return;
    }
    const [s0, s1, c0, c1] = this.bounds, pad = 14;
    const scale = Math.min((width - 2 * pad) / Math.max(s1 - s0, 0.02), (height - 2 * pad) / Math.max(c1 - c0, 0.02));
    const x0 = width / 2 - (scale * (s0 + s1)) / 2, y0 = height / 2 + (scale * (c0 + c1)) / 2;
    const size = Math.max(4, Math.min(14, scale * 0.004));
    for (const [s, c, v] of this.points.slice(0, n)) {
      g.fillStyle = shade(v / this.highest);
      g.fillRect(x0 + scale * s - size / 2, y0 - scale * c - size / 2, size, size);
    }
    this.text.textContent = `${this.about.title}; ${(1e3 * (s1 - s0)).toFixed(0)} × ${(1e3 * (c1 - c0)).toFixed(0)} mm. `
      + `Yellow: ${this.about.value} up to ${this.highest.toFixed(2)}.`;
  }
}
