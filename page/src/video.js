// The operator's video: what the first-person camera shows is as late as the link, and comes in
// pictures. All other cameras show the newest state.
const KEEP_S = 12;

export class Video {
  // `link` is { delay_s, rate_hz } of the scene, or null without a radio.
  constructor(link) {
    this.link = link;
    this.rows = []; // [t, row] that came
    this.shown = null;
  }

  add(t, row) {
    if (!this.link) return;
    if (this.rows.length && t < this.rows.at(-1)[0]) this.rows = [];
    this.rows.push([t, row]);
    while (t - this.rows[0][0] > KEEP_S) this.rows.shift();
  }

  // The picture at time t (s): its own time and its row; null while none has come.
  pick(t) {
    if (!this.link) return null;
    const { delay_s: delay, rate_hz: rate } = this.link;
    let due = t - delay;
    if (rate) due = Math.floor(due * rate + 1e-6) / rate; // a picture stays until the next one comes
    let found = null;
    for (const entry of this.rows) {
      if (entry[0] > due + 1e-6) break;
      found = entry;
    }
    this.shown = found ?? this.rows[0] ?? null;
    return this.shown;
  }

  get words() {
    if (!this.link) return '';
    const rate = this.link.rate_hz ? `, ${this.link.rate_hz.toFixed(0)} pictures/s` : '';
    return `video: ${(1e3 * this.link.delay_s).toFixed(0)} ms late${rate}`;
  }
}
