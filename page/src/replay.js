// The replay of a recorded flight: slider, phases, speed.
import { $, button, make, section, typing } from './dom.js';
import { InspectionMap } from './map.js';
import { Layout, Recorded } from './frames.js';
import { Plots } from './plots.js';
import { tellBackend } from './setup.js';

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];

export class Replay {
  constructor(view, data, side, foot) {
    this.view = view;
    this.data = data;
    this.layout = new Layout(data.layout);
    this.t = 0;
    this.speed = 1;
    this.playing = false;
    this.side = side;
    this.foot = foot;
  }

  async start() {
    const { data, view, layout, side, foot } = this;
    this.frames = await Recorded.unpack(data.frames, layout.size);
    view.load(data);
    $('title').textContent = `${data.mission}: ${data.robot} in ${data.world}, seed ${data.seed}${tellBackend(data.backend)}`;
    const result = section(side, 'Result');
    result.append(make('p', {}, make('b', { text: data.outcome }), data.reason ? `: ${data.reason}` : ''));
    if (data.alarms.length) {
      const list = make('ul', { class: 'alarms' });
      for (const a of data.alarms) list.append(make('li', { text: a.text }));
      result.append(make('p', { text: 'Rules that acted:' }), list);
    }
    const numbers = section(side, 'Numbers and plots');
    this.plots = new Plots(numbers, data.layout.channels, (t) => this.seek(t));
    const n = this.frames.n, k0 = layout.channels;
    this.plots.fill(Array.from(this.frames.t), data.layout.channels.map((c, i) =>
      Array.from(this.frames.column(k0 + i), (v) => (Number.isFinite(v) ? v : null))));
    this.mapCount = new Uint32Array(n);
    if (data.layout.map) {
      this.map = new InspectionMap(section(side, 'Inspection map'), data.layout.map);
      const [s, c, v] = [0, 1, 2].map((i) => this.frames.column(layout.map + i));
      for (let i = 0; i < n; i++) { this.map.add(s[i], c[i], v[i]); this.mapCount[i] = this.map.points.length; }
    }
    const [x, y, z, q] = [0, 1, 2, 3].map((i) => this.frames.column(layout.trace + i));
    for (let i = 0; i < n; i++) view.addTrace(x[i], y[i], z[i], q[i]);
    this.build(foot);
    this.readHash();
    addEventListener('hashchange', () => this.readHash());
    addEventListener('keydown', (e) => this.key(e));
  }

  build(foot) {
    const { data } = this;
    this.play = button('▶ play', () => this.toggle(), { id: 'play', title: 'Play or pause (space)' });
    this.slider = make('input', { type: 'range', id: 'time', min: 0, max: data.duration, step: 0.01, 'aria-label': 'Time, s' });
    this.slider.addEventListener('input', () => { this.playing = false; this.seek(parseFloat(this.slider.value)); });
    const speed = make('select', { 'aria-label': 'Speed' });
    for (const s of SPEEDS) speed.append(make('option', { value: s, text: `× ${s}`, selected: s === 1 }));
    speed.addEventListener('change', () => { this.speed = parseFloat(speed.value); });
    const strip = make('div', { id: 'phases', role: 'group', 'aria-label': 'Phases' });
    this.bands = data.phases.map((p) => {
      const odd = p.outcome !== 'done' ? ` (${p.outcome})` : '';
      const band = button('', () => this.seek(p.start + 0.05), {
        title: `${p.name}: ${p.start.toFixed(1)} to ${p.end.toFixed(1)} s${odd}`, class: p.outcome !== 'done' ? 'odd' : '',
      });
      band.append(make('span', { text: p.name + odd }));
      band.style.flexGrow = Math.max(p.end - p.start, 0.01);
      strip.append(band);
      return band;
    });
    foot.append(strip, make('div', { class: 'bar' }, this.play, this.slider, speed));
  }

  key(e) {
    if (typing(e) || e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.code === 'Space' && !(e.target instanceof HTMLButtonElement)) { e.preventDefault(); this.toggle(); }
    else if (e.target !== this.slider && e.target !== this.view.canvas && e.code === 'ArrowRight') this.seek(this.t + 1);
    else if (e.target !== this.slider && e.target !== this.view.canvas && e.code === 'ArrowLeft') this.seek(this.t - 1);
  }

  readHash() {
    const t = /[#&]t=(\d+(\.\d+)?)/.exec(location.hash), v = /[#&]view=([^&]+)/.exec(location.hash);
    if (v) this.view.look(decodeURIComponent(v[1]));
    this.seek(t ? parseFloat(t[1]) : 0);
  }

  toggle() {
    if (!this.playing && this.t >= this.data.duration - 0.02) this.t = 0;
    this.playing = !this.playing;
    this.play.textContent = this.playing ? '❚❚ pause' : '▶ play';
  }

  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.data.duration);
    this.show();
  }

  // Called for every frame of the display, with the wall time (s) since the last one.
  step(dt) {
    if (this.playing) {
      this.t += dt * this.speed;
      if (this.t >= this.data.duration) { this.t = this.data.duration; this.toggle(); }
      this.show();
    }
    if (this.play.textContent.includes('pause') !== this.playing) this.play.textContent = this.playing ? '❚❚ pause' : '▶ play';
  }

  show() {
    const { data, layout, t } = this;
    this.slider.value = t;
    $('clock').textContent = `${t.toFixed(1)} / ${data.duration.toFixed(1)} s`;
    let at = data.phases.findIndex((p) => t < p.end);
    if (at < 0) at = data.phases.length - 1;
    $('phase').textContent = data.phases[at]?.name ?? 'nothing recorded';
    $('what').textContent = data.phases[at]?.what ?? '';
    this.bands.forEach((b, i) => { b.classList.toggle('on', i === at); b.setAttribute('aria-current', i === at); });
    if (!this.frames.n) return;
    const i = this.frames.find(t), row = this.frames.row(i);
    this.view.show(row, layout, t);
    this.view.cutTrace(i + 1);
    this.plots.show(row, layout.channels);
    if (!this.marked || performance.now() - this.marked > 100 || !this.playing) {
      this.marked = performance.now();
      this.plots.mark(t);
      this.map?.draw(this.mapCount[i]);
    }
  }
}
