// The operator's video: the first-person camera shows pictures at the rate and with the delay of the
// link. All other cameras show the newest state.
const KEEP_S = 12;

export class Video {
  // `link` has delay_s and rate_hz of the scene; it is null without a radio.
  constructor(link) {
    this.link = link;
    this.rows = []; // received [t, row]
    this.shown = null;
  }

  add(t, row) {
    if (!this.link) return;
    if (this.rows.length && t < this.rows.at(-1)[0]) this.rows = [];
    this.rows.push([t, row]);
    while (t - this.rows[0][0] > KEEP_S) this.rows.shift();
  }

  // Returns the picture at time t (s) as [its time, its row]; null before the first one.
  pick(t) {
    if (!this.link) return null;
    const { delay_s: delay, rate_hz: rate } = this.link;
    let due = t - delay;
    if (rate) due = Math.floor(due * rate + 1e-6) / rate; // a picture stays until the next one arrives
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
