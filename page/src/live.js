// A live flight: many pages watch it, one controls it.
import { $, button, format, make, section } from './dom.js';
import { Layout, readLive } from './frames.js';
import { Intervene, showChecklist } from './intervene.js';
import { InspectionMap } from './map.js';
import { Plots } from './plots.js';
import { Reserve } from './reserve.js';
import { Setup, showLogbook, tellBackend } from './setup.js';
import { Sight } from './sight.js';
import { Stick } from './stick.js';
import { Video } from './video.js';

const PLOT_PERIOD = 200, MAP_PERIOD = 500, STICK_PERIOD = 33, HERE_PERIOD = 500; // ms
const PAUSED = 1, HELD = 2, ASKED = 4;
const SILENT = 'nobody';

export class Live {
  constructor(view, side, foot, loaded, fail) {
    Object.assign(this, { view, side, foot, loaded, fail });
    this.state = null;
    this.data = null;
    this.frame = null;
    this.seq = 0;
    this.count = 0; // frames received
    this.question = 0; // number of the last question about back ends
    this.asked = this.answered = ''; // its contents, and the last contents with an answer
    this.stick = new Stick();
    this.delay = null;
    this.lost = ''; // name of the page that took control from this one, or SILENT
    this.had = this.given = false; // in control at the last message; control given back by this page
  }

  async start() {
    const choices = await (await fetch('choices.json')).json();
    this.build(choices);
    this.connect();
    setInterval(() => this.drawPlots(), PLOT_PERIOD);
    setInterval(() => this.map?.draw(), MAP_PERIOD);
    setInterval(() => this.steer(), STICK_PERIOD);
    setInterval(() => this.here(), HERE_PERIOD);
  }

  build(choices) {
    const { side, foot } = this;
    this.choices = choices;
    this.take = button('Take control', () => {
      this.given = Boolean(this.state?.mine);
      this.send({ k: this.given ? 'release' : 'take' });
    }, { id: 'take', class: 'primary' });
    this.pause = button('❚❚ pause', () => this.send({ k: 'pause', on: !this.paused }), { id: 'pause' });
    this.speed = make('select', { 'aria-label': 'Speed', id: 'speed' });
    for (const [x, text] of [[0.25, '× 0.25'], [1, 'real time'], [2, '× 2'], [5, '× 5'], [0, 'fastest']]) {
      this.speed.append(make('option', { value: x, text, selected: x === 1 }));
    }
    this.speed.addEventListener('change', () => this.send({ k: 'speed', x: Number(this.speed.value) }));
    this.land = button('Land now', () => this.send({ k: 'order', what: 'land' }), { id: 'land', class: 'stop', title: 'Draw back from the contact and land in place' });
    this.abort = button('Abort', () => this.send({ k: 'order', what: 'abort' }), { id: 'abort', class: 'stop', title: 'Draw back from the contact, fly home the way it came and land' });
    this.who = make('span', { class: 'who', id: 'who', role: 'status' });
    this.intervene = new Intervene((message) => this.send(message));
    foot.append(make('div', { class: 'bar' }, this.take, this.pause, this.speed, this.land, this.abort, this.who), this.intervene.bar);

    this.told = make('p', { id: 'told', role: 'status' });
    this.alarms = make('ul', { class: 'alarms', id: 'alarms', 'aria-live': 'assertive' });
    this.alarmSection = section(side, 'Messages', true, 'messages');
    this.alarmSection.append(this.told, this.alarms);
    if (Object.keys(choices.missions).length) {
      this.setupBox = section(side, 'Set up a flight', true, 'setup');
      this.setup = new Setup(this.setupBox, choices, (wish) => this.send({ k: 'start', ...wish }), () => this.ask());
    }
    this.checkBox = section(side, 'Pre-flight checklist', true, 'checklist');
    this.checkBox.parentElement.hidden = true;
    this.stickBox = section(side, 'Stick', true, 'stick');
    this.stickBox.parentElement.hidden = true;
    this.stickText = make('p', { id: 'sticktext', role: 'status' });
    this.stickBox.append(make('p', {}, make('kbd', { text: 'Space' }), ' held: the stick counts. ',
      make('kbd', { text: 'W' }), make('kbd', { text: 'S' }), ' ahead, back; ', make('kbd', { text: 'A' }), make('kbd', { text: 'D' }), ' left, right; ',
      make('kbd', { text: 'R' }), make('kbd', { text: 'F' }), ' up, down; ', make('kbd', { text: 'Q' }), make('kbd', { text: 'E' }), ' turn the platform; ',
      make('kbd', { text: 'Enter' }), ' it is done. ',
      'Gamepad: both sticks, a shoulder button held, button A. SpaceMouse: left button held, right button.'), this.stickText);
    const mouse = this.stick.mouse;
    if (mouse.available) {
      const told = make('span', { class: 'hint', id: 'spacemouse', role: 'status' });
      const show = () => { told.textContent = mouse.error || (mouse.name ? `SpaceMouse: ${mouse.name}` : ''); };
      mouse.open(false).then(show);
      this.stickBox.append(make('p', {}, button('Use a SpaceMouse', () => mouse.open(true).then(show)), ' ', told));
    }
    const size = make('input', { type: 'range', min: 0.1, max: 1, step: 0.1, value: 0.5, 'aria-label': 'Deflection of the keys' });
    size.addEventListener('input', () => { this.stick.size = Number(size.value); });
    this.stickBox.append(make('label', {}, make('span', { text: 'Deflection of the keys' }), size));
    this.sight = new Sight(this.stickBox);
    this.trainBox = section(side, 'Training: disturb the flight', false, 'training');
    this.numbersBox = section(side, 'Numbers and plots', true, 'numbers');
    for (const box of [this.trainBox, this.numbersBox]) box.parentElement.hidden = true; // no flight yet
    this.mapBox = section(side, 'Inspection map', true, 'map');
    this.mapBox.parentElement.hidden = true;
    this.logBox = section(side, 'Logbook', true, 'logbook');
    this.aboutBox = section(side, 'Station', false, 'station');
    this.aboutText = make('p', { class: 'hint' });
    this.invite = button('Invite another browser', () => this.send({ k: 'invite' }));
    this.kill = button('Kill the flight', () => this.send({ k: 'stop' }), { title: 'For a flight that does not answer; its recording is kept' });
    this.aboutBox.append(this.aboutText, this.invite, make('p', { id: 'invitation' }), this.kill);
    this.videoBox = make('p', { id: 'video', role: 'status' });
    $('view').append(this.videoBox);
    this.capability = make('i');
    this.capabilityText = make('span');
    this.reserveBox = make('div', {}, make('div', { class: 'row' }, make('span', { text: 'Thrust left' }), make('div', { class: 'meter' }, this.capability), this.capabilityText));
    this.numbersBox.append(this.reserveBox);
    this.reserve = new Reserve(this.reserveBox);
    this.nearest = make('p', { class: 'hint', id: 'nearest' });
    this.numbersBox.append(this.nearest);
    this.plotBox = make('div');
    this.numbersBox.append(this.plotBox);
    this.update();
  }

  connect() {
    const ws = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/ws`);
    this.ws = ws;
    ws.binaryType = 'arraybuffer';
    ws.onopen = () => { $('banner').hidden = true; };
    ws.onmessage = (e) => (typeof e.data === 'string' ? this.hear(JSON.parse(e.data)) : this.take_(e.data));
    ws.onclose = () => {
      this.state = null;
      this.update();
      this.fail('No connection to the ground station. Trying again ...');
      setTimeout(() => this.connect(), 1500);
    };
  }

  send(message) {
    if (this.ws?.readyState === WebSocket.OPEN && this.ws.bufferedAmount < 4000) this.ws.send(JSON.stringify(message));
  }

  hear(m) {
    if (m.k === 'you') this.name = m.name;
    else if (m.k === 'told') this.told.textContent = m.text;
    else if (m.k === 'sight') this.sight.take(m);
    else if (m.k === 'pong') this.delay = performance.now() - m.w;
    else if (m.k === 'invited') $('invitation').textContent = `For one browser, within 10 minutes: ${m.address}`;
    else if (m.k === 'logbook') showLogbook(this.logBox, m.entries, this.choices.missions, (e) => { this.setup?.fill(e); $('setup').open = true; $('start')?.focus(); });
    else if (m.k === 'backends') {
      if (m.n === this.question) { this.answered = this.asked; this.setup?.offer(m); }
    } else if (m.k === 'state') {
      const before = this.state;
      this.state = m;
      if (m.mine) this.lost = '';
      else if (this.had && !this.given) this.lost = m.controller || SILENT;
      this.had = m.mine;
      if (m.note !== before?.note || (m.mine && !before?.mine)) this.told.textContent = m.note;
      if (m.scene && m.scene !== before?.scene) this.load();
      if (this.setup && m.flying !== before?.flying) $('setup').open = !m.flying;
      this.update();
      if (m.mine && !m.flying && !(before?.mine && !before.flying)) this.ask();
    }
  }

  // Asks which back ends can fly the flight of the form, if it differs from the last one asked for.
  ask() {
    if (!this.setup || !this.state?.mine || this.state.flying) return;
    const wish = { ...this.setup.read(), backend: 'physics', seed: null };
    this.asked = JSON.stringify(wish);
    if (this.asked !== this.answered) this.send({ k: 'choose', n: ++this.question, ...wish });
  }

  async load() {
    const answer = await fetch('scene.json');
    if (!answer.ok) return;
    const data = await answer.json();
    if (data.version !== 1) { this.fail(`This page reads data of version 1, not ${data.version}.`); return; }
    this.data = data;
    this.layout = new Layout(data.layout);
    this.frame = null;
    this.reserve.reset();
    this.intervene.load(data);
    this.video = new Video(data.video);
    this.view.load(data);
    this.loaded();
    this.trainBox.parentElement.hidden = !data.disturbances.length;
    this.numbersBox.parentElement.hidden = false;
    this.plots?.destroy();
    this.plotBox.replaceChildren();
    this.plots = new Plots(this.plotBox, data.layout.channels, null);
    this.loadIndex = data.layout.channels.findIndex((c) => c.name === 'busiest rotor');
    this.reserveBox.hidden = this.loadIndex < 0;
    this.mapBox.parentElement.hidden = !data.layout.map;
    this.mapBox.replaceChildren();
    this.map = data.layout.map ? new InspectionMap(this.mapBox, data.layout.map) : null;
    this.trainBox.replaceChildren(make('p', { class: 'hint', text: 'Each can be used once a flight; the logbook repeats it at the same time.' }),
      ...data.disturbances.map((d) => button(d.label, () => this.send({ k: 'disturb', what: d.name }), { 'data-name': d.name })));
    this.traced = -1;
    this.update();
  }

  take_(buffer) {
    const frame = readLive(buffer);
    if (!frame || !this.layout || frame.row.length !== this.layout.size) return;
    this.count++;
    this.frame = frame;
    this.fresh = true;
    this.video.add(frame.t, frame.row);
    this.plots.add(frame.t, frame.row, this.layout.channels);
    const m = this.layout.map, k = this.layout.trace;
    this.map?.add(frame.row[m], frame.row[m + 1], frame.row[m + 2]);
    if (frame.t < this.traced) this.traced = -1;
    if (frame.t - this.traced >= 0.08) {
      this.traced = frame.t;
      this.view.addTrace(frame.row[k], frame.row[k + 1], frame.row[k + 2], frame.row[k + 3]);
    }
  }

  get paused() {
    return Boolean(this.state?.status?.paused);
  }

  update() {
    const s = this.state, status = s?.status ?? {}, flying = Boolean(s?.flying), mine = Boolean(s?.mine);
    const going = flying && status.over === false;
    this.take.disabled = !s;
    this.take.textContent = mine ? 'Give control back' : s?.controller ? 'Take over control' : 'Take control';
    this.take.classList.toggle('primary', !mine);
    for (const b of [this.pause, this.speed, this.land, this.abort]) b.disabled = !(going && mine);
    const clock = this.data?.paced === false ? 'The vehicle has a clock of its own' : '';
    for (const b of [this.pause, this.speed]) [b.disabled, b.title] = [b.disabled || clock !== '', clock];
    this.invite.disabled = !mine;
    this.kill.disabled = !(flying && mine);
    this.abort.disabled ||= Boolean(status.order);
    this.land.disabled ||= status.order === 'land';
    this.pause.textContent = this.paused ? '▶ go on' : '❚❚ pause';
    if (document.activeElement !== this.speed && status.speed !== undefined) this.speed.value = status.speed;
    this.who.textContent = !s ? '' : mine ? 'You control.' : s.controller ? `${s.controller} controls; you watch.`
      : `${this.lost === SILENT ? 'You lost control. ' : ''}Nobody controls; you watch.`;
    this.who.classList.toggle('error', Boolean(this.lost));
    if (this.setup) {
      this.setup.go.disabled = flying || !mine;
      this.setup.go.textContent = flying ? 'A flight is under way' : mine ? 'Start the flight' : 'Start the flight (take control first)';
    }
    for (const b of this.trainBox.querySelectorAll('button')) {
      b.disabled = !(going && mine) || b.dataset.name in (status.disturbed ?? {});
    }
    $('title').textContent = this.data ? `${this.data.mission}: ${this.data.robot} in ${this.data.world}, seed ${this.data.seed}${tellBackend(this.data.backend)}` : 'Ground station';
    const phases = status.phases ?? [];
    $('phase').textContent = !s ? 'no connection' : flying && !this.data ? 'planning' : going ? (phases.at(-1)?.[0] ?? 'planning').replaceAll('_', ' ') : flying ? 'planning' : 'no flight';
    $('what').textContent = going ? status.what : flying ? '' : s ? 'Take control, choose a mission and start it.' : '';
    if (flying && status.over) $('what').textContent = 'The flight is over; it is being evaluated.', $('phase').textContent = 'landed';
    this.alarms.replaceChildren(...this.listAlarms(status, going).map((text) => make('li', { text })));
    const asked = Boolean(status.asked) && going && !status.pilot?.flies;
    this.intervene.update(status, going && mine, going);
    this.flying = going && Boolean(status.pilot?.flies);
    this.stick.active = (asked || this.flying) && mine;
    this.stickBox.parentElement.hidden = !((this.data?.operated || this.flying) && going);
    this.checkBox.parentElement.hidden = !(this.data?.checklist?.length && (going || status.over));
    if (!this.checkBox.parentElement.hidden) this.showChecklist(status.checklist ?? []);
    if (!asked) this.sight.hide();
    this.aboutText.textContent = !s ? '' : `${s.watchers} page${s.watchers === 1 ? '' : 's'} here; you are ${this.name}. ${this.count} frames came, ${s.skipped} were skipped. `
      + `${s.refused} messages refused. Way there and back ${format(this.delay ?? NaN, 0, 'ms')}. `
      + `Cost in the simulation ${format(status.cost_ms ?? NaN, 2, 'ms')} a tick. `
      + `A stick is ${format(status.stick_ms ?? NaN, 0, 'ms')} old when it comes (median).`;
  }

  // The list closes when all checks have passed, so that numbers and plots stay visible.
  showChecklist(found) {
    const state = JSON.stringify([this.state.scene, found]);
    if (state === this.checkedState) return;
    const failed = found.some((c) => !c.passed);
    if (found.length !== this.checkedCount) $('checklist').open = !found.length || failed;
    [this.checkedState, this.checkedCount] = [state, found.length];
    showChecklist(this.checkBox, this.data.checklist, found);
  }

  listAlarms(status, going) {
    const out = [];
    if (this.lost === SILENT) out.push('You lost control: the station did not hear this page for 2 s. The computer or the network is too slow. Press Take control.');
    else if (this.lost) out.push(`${this.lost} took control from this page.`);
    for (const c of status.checklist ?? []) if (!c.passed) out.push(`Pre-flight check failed: ${c.says}.`);
    if (this.state?.silent && !status.over && status.scene) out.push('The simulation has been silent for 2 s.');
    for (const a of status.alarms ?? []) out.push(a.text);
    if (status.said) out.push(status.said);
    if (!going) return out;
    const manual = Boolean(status.pilot?.flies), what = status.order === 'land' ? 'land now' : 'abort';
    if (status.order) out.push(`You ordered: ${what}.${manual ? ' It is flown when the robot is given back.' : ''}`);
    out.push(...this.intervene.tell(status));
    if (status.asked && !manual) out.push(`The mission asks for the operator. ${status.asked}`);
    if (status.holding && !manual) out.push('No stick for more than 1 s: the robot holds.');
    const late = this.frame?.late ?? 0;
    if (late > 200) out.push(`The computer is too slow for this speed: ${late.toFixed(0)} ms late.`);
    for (const [name, t] of Object.entries(status.disturbed ?? {})) {
      out.push(`Disturbance since ${t.toFixed(1)} s: ${this.data?.disturbances.find((d) => d.name === name)?.label ?? name}.`);
    }
    return out;
  }

  // Called for every frame of the display.
  step() {
    if (!this.frame || !this.fresh || !this.layout) return;
    this.fresh = false;
    const { row, t, late, flags } = this.frame;
    const late_ = this.view.mode === this.data.camera.name ? this.video.pick(t) : null;
    this.view.show(late_ ? late_[1] : row, this.layout, late_ ? late_[0] : t);
    this.videoBox.textContent = late_ ? this.video.words : '';
    $('clock').textContent = `${t.toFixed(1)} s${flags & PAUSED ? ', paused' : ''}, ${late.toFixed(0)} ms late`;
    if (flags & ASKED && !this.flying) this.sight.draw();
    if (flags & ASKED || this.flying) {
      const age = this.state?.status?.age_s;
      this.stickText.textContent = `${flags & HELD ? 'The stick counts.' : 'Let go: nothing is moved.'} Input age ${age == null ? '–' : `${(1e3 * age).toFixed(0)} ms`}.`;
    }
  }

  drawPlots() {
    if (!this.frame || !this.plots) return;
    const first = this.layout.channels, row = this.frame.row;
    this.plots.show(row, first);
    this.plots.draw();
    this.reserve.draw(this.state?.status?.left_n ?? []);
    const near = this.state?.status?.nearest;
    this.nearest.textContent = near ? `Nearest: ${near.replaceAll('_', ' ')}.` : '';
    if (this.loadIndex >= 0) {
      const left = Math.max(0, 100 - row[first + this.loadIndex]);
      this.capability.style.width = `${left}%`;
      this.capability.style.background = left < 15 ? '#b3005e' : '#0b4f8a';
      this.capabilityText.textContent = `${left.toFixed(0)} %${left < 15 ? ', little' : ''}`;
    }
  }

  // Sends the stick values with a sequence number and the time at which they were read.
  steer() {
    if (!this.stick.active || !document.hasFocus()) return;
    const { v, flight, held, stands, pad } = this.stick.read(), hands = !this.flying;
    this.seq++;
    this.send({
      k: 'stick', s: this.seq, w: performance.now() / 1000, d: held, b: hands && stands,
      v: hands ? v : [0, 0, 0], f: hands ? [0, 0, 0, 0] : flight,
    });
    this.stickBox.title = pad;
  }

  here() {
    if (!this.state) return;
    this.send({ k: 'ping', w: performance.now() });
    if (this.state.mine) this.send({ k: 'here' });
  }
}
