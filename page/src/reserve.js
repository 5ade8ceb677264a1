// The remaining force in each direction: a ring seen from above, the robot's front up, and numbers.
import { make } from './dom.js';

const INK = '#0b4f8a', LOW = '#b3005e', SOFT = '#5b6670', FILL = '#0b4f8a33';

export class Reserve {
  constructor(parent) {
    this.canvas = make('canvas', { width: 280, height: 190, role: 'img', 'aria-label': 'Force that is left in each direction' });
    this.words = make('p', { class: 'hint', id: 'left' });
    parent.append(this.canvas, this.words);
    this.most = 0;
  }

  reset() {
    this.most = 0;
  }

  draw(left) {
    const c = this.canvas.getContext('2d'), n = left.length - 2;
    c.clearRect(0, 0, 280, 190);
    if (n < 3) { this.words.textContent = ''; return; }
    const level = left.slice(0, n), [up, down] = left.slice(n), pushes = level.some((x) => x !== null);
    this.most = Math.max(this.most, ...level.map((x) => x ?? 0), 1);
    const r = 68, x0 = 96, y0 = 95;
    const at = (k, share) => [x0 - r * share * Math.sin(2 * Math.PI * k / n), y0 - r * share * Math.cos(2 * Math.PI * k / n)];
    c.strokeStyle = SOFT;
    c.lineWidth = 1;
    for (const share of [0.5, 1]) { c.beginPath(); c.arc(x0, y0, r * share, 0, 2 * Math.PI); c.stroke(); }
    if (pushes) {
      c.beginPath();
      level.forEach((x, k) => { const [px, py] = at(k, (x ?? 0) / this.most); if (k) c.lineTo(px, py); else c.moveTo(px, py); });
      c.closePath();
      c.fillStyle = FILL; c.fill();
      c.strokeStyle = INK; c.lineWidth = 2; c.stroke();
    }
    c.font = '12px sans-serif';
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    const low = (x) => x !== null && x < 0.15 * this.most;
    for (const k of [0, n / 4, n / 2, (3 * n) / 4]) {
      const x = level[k];
      const [px, py] = at(k, 1.22);
      c.fillStyle = low(x) ? LOW : '#000';
      c.fillText(x === null ? '–' : x.toFixed(1), px, py);
    }
    c.fillStyle = '#000';
    c.textAlign = 'left';
    c.fillText(`up ${up === null ? '–' : up.toFixed(1)} N`, 192, 75);
    c.fillText(`down ${down === null ? '–' : down.toFixed(1)} N`, 192, 115);
    this.words.textContent = pushes
      ? 'Force left at this attitude, in N: ahead is up in the ring, left is left.'
      : 'Force left at this attitude. The rotors push sideways only by tilting the robot.';
  }
}
