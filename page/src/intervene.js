// Intervention in a mission in flight: the pilot's switch and modes; orders next, retry, retract.
import { button, make } from './dom.js';

const ORDERS = [
  ['next', 'Next', 'End the hold that is flown now; after a retract, leave the contact out'],
  ['retry', 'Retry', 'Draw back from the contact and try it again'],
  ['retract', 'Retract', 'Draw back from the contact and hold'],
];
const DONE = { next: 'the hold ends', retry: 'the contact is tried again', retract: 'the robot draws back and holds' };

const SAY_MS = 8000;

export class Intervene {
  // `send` is a function that sends a message to the station.
  constructor(send) {
    this.send = send;
    this.fly = button('Take over the robot', () => send({ k: 'order', what: this.flown ? 'give_back' : 'take_over' }), { id: 'fly' });
    this.mode = make('select', { id: 'mode', 'aria-label': 'What the stick does with the platform' });
    this.mode.addEventListener('change', () => send({ k: 'mode', what: this.mode.value }));
    this.orders = ORDERS.map(([what, text, title]) => {
      const b = button(text, () => this.order(what), { id: what, title });
      b.dataset.title = title;
      return b;
    });
    this.bar = make('div', { class: 'bar', id: 'intervene', role: 'group', 'aria-label': 'Intervene' }, this.fly, this.mode, ...this.orders);
    this.bar.hidden = true;
  }

  // Sends an order and states it for SAY_MS.
  order(what) {
    this.ordered = what;
    clearTimeout(this.saying);
    this.saying = setTimeout(() => { this.ordered = null; }, SAY_MS);
    this.send({ k: 'order', what });
  }

  load(data) {
    this.flies = Boolean(data.flies);
    this.mode.replaceChildren(...(data.modes ?? []).map((m) =>
      make('option', { value: m.name, text: `${m.name} mode`, title: m.what })));
    this.what = Object.fromEntries((data.modes ?? []).map((m) => [m.name, m.what]));
    this.ordered = null;
  }

  get flown() {
    return Boolean(this.pilot?.switch || this.pilot?.flies);
  }

  update(status, allowed, going) {
    this.pilot = status.pilot;
    this.bar.hidden = !(going && this.flies);
    this.fly.disabled = !allowed;
    this.fly.textContent = this.flown ? 'Give the robot back' : 'Take over the robot';
    this.fly.title = this.flown ? 'The robot brakes, returns to where you took over, and the mission goes on' : 'Fly the platform by the stick; the mission waits';
    this.mode.disabled = !allowed;
    if (this.pilot?.mode && document.activeElement !== this.mode) this.mode.value = this.pilot.mode;
    for (const b of this.orders) {
      const refusal = status.refusals?.[b.id];
      b.disabled = !allowed || refusal !== '';
      b.title = refusal ? `${b.dataset.title}. Now: ${refusal}.` : b.dataset.title;
    }
  }

  // Returns the sentences on the pilot's flight and on the orders.
  tell(status) {
    const out = [], pilot = status.pilot;
    if (pilot?.flies) {
      out.push(`You or another page fly the robot in ${pilot.flown} mode: ${this.what[pilot.flown] ?? ''}. The arms stay; rules only tell.`);
      if (pilot.lacks) out.push(`${pilot.lacks}.`);
      if (!(status.age_s < 1)) out.push('No stick for more than 1 s: after 5 s the robot is taken back, comes home and lands.');
    } else if (pilot?.switch) out.push('The robot is taken over.');
    if (status.waits) out.push('The robot has drawn back from the contact and holds: retry, next, abort or land now. Without an order it comes home after 120 s.');
    else if (this.ordered && !status.said && !status.order) out.push(`Ordered: ${DONE[this.ordered]}.`);
    return out;
  }
}

// Shows the pre-flight checklist: the names of the checks and their results.
export function showChecklist(parent, names, found) {
  const table = make('table', { class: 'numbers', id: 'checks' });
  for (const name of names) {
    const c = found.find((x) => x.name === name);
    const value = !c ? 'not checked yet' : c.value === null ? 'not measured' : `${Number(c.value.toPrecision(3))} ${c.unit}`;
    const state = !c ? '○' : c.passed ? '✓ passed' : '✗ FAILED';
    table.append(make('tr', { class: c && !c.passed ? 'over' : '' }, make('th', { scope: 'row', text: name }),
      make('td', { text: value }),
      make('td', { class: 'limit', text: c ? `limit ${Number(c.limit.toPrecision(3))} ${c.unit}` : '' }),
      make('td', { text: state })));
  }
  const failed = found.filter((c) => !c.passed);
  parent.replaceChildren(table, make('p', { class: 'hint', text: failed.length ? `The motors are not started: ${failed.map((c) => c.says).join('; ')}.`
    : found.length ? 'Every check passed; the motors may turn.' : 'Checked before the motors turn. A check that fails ends the flight on the ground.' }));
}
