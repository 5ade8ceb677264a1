// The offset of the operator's hand, tool or peg from its target: a cross seen along the contact's
// axis, a bar for the distance into the contact or the force, and both as text.
import { make } from './dom.js';

const INK = '#0b4f8a', MARK = '#b3005e', SOFT = '#5b6670';
const RANGE = 0.06; // m, from the centre to the edge
const NAMES = [['ahead', 'back'], ['left', 'right'], ['up', 'down']];

export class Sight {
  constructor(parent) {
    this.box = make('div', { class: 'sight', hidden: true });
    this.canvas = make('canvas', { width: 260, height: 140, role: 'img', 'aria-label': 'Where it is from its place' });
    this.words = make('p', { id: 'sightwords' });
    this.box.append(this.canvas, this.words);
    parent.append(this.box);
    this.seen = null;
  }

  take(m) {
    this.seen = m;
  }

  hide() {
    this.seen = null;
    this.box.hidden = true;
  }

  draw() {
    const m = this.seen;
    if (!m || m === this.drawn) return;
    this.drawn = m;
    this.box.hidden = false;
    const into = m.towards.findIndex((x) => x !== 0), sign = m.towards[into];
    const across = [0, 1, 2].filter((i) => i !== into);
    const left = -m.off[into] * sign; // remaining distance into the contact
    const c = this.canvas.getContext('2d'), h = 140, r = 62;
    c.clearRect(0, 0, 260, h);
    c.strokeStyle = SOFT;
    c.lineWidth = 1;
    for (const part of [1 / 3, 1]) { c.beginPath(); c.arc(70, 70, part * r, 0, 2 * Math.PI); c.stroke(); }
    c.beginPath(); c.moveTo(8, 70); c.lineTo(132, 70); c.moveTo(70, 8); c.lineTo(70, 132); c.stroke();
    // the robot's left is left in the picture; ahead, or up, is above
    const side = across.includes(1) ? 1 : across[0], top = across.find((i) => i !== side);
    const clip = (x) => Math.max(-1, Math.min(1, x / RANGE));
    c.fillStyle = MARK;
    c.beginPath();
    c.arc(70 - r * clip(m.off[side]), 70 - r * clip(m.off[top]), 6, 0, 2 * Math.PI);
    c.fill();
    c.fillStyle = INK;
    const bar = (x, share, mark, text) => {
      c.strokeRect(x, 8, 22, 112);
      c.fillRect(x, 120 - 112 * Math.max(0, Math.min(1, share)), 22, 112 * Math.max(0, Math.min(1, share)));
      if (mark !== null) { c.strokeStyle = MARK; c.lineWidth = 2; c.beginPath(); c.moveTo(x - 5, 120 - 112 * mark); c.lineTo(x + 27, 120 - 112 * mark); c.stroke(); c.strokeStyle = SOFT; c.lineWidth = 1; }
      c.font = '11px sans-serif';
      c.fillText(text, x - 2, 134);
    };
    bar(160, left / RANGE, null, 'to go');
    if (m.asked > 0) bar(215, m.force / (2 * m.asked), 0.5, 'force');
    const say = (i) => `${Math.abs(1e3 * m.off[i]).toFixed(0)} mm too far ${NAMES[i][m.off[i] > 0 ? 0 : 1]}`;
    this.words.textContent = [...across.map(say), left > 0 ? `${(1e3 * left).toFixed(0)} mm to go` : `${(-1e3 * left).toFixed(0)} mm beyond`].join(', ')
      + (m.asked > 0 ? `; force ${m.force.toFixed(1)} N of ${m.asked.toFixed(1)} N, to be held ${m.hold_s.toFixed(0)} s.` : m.done ? '; it is done: press Enter with Space held.' : '.');
  }
}
