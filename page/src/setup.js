// The form that sets up and starts a flight, and the logbook of earlier flights.
import { button, make } from './dom.js';

export class Setup {
  // `start` starts the flight of the form; `ask` asks which back ends can fly it.
  constructor(parent, choices, start, ask) {
    this.choices = choices;
    this.mission = this.choose(choices.missions, null);
    if (choices.proposed) this.mission.value = choices.proposed;
    else if (choices.missions['pipe-weld-scan']) this.mission.value = 'pipe-weld-scan';
    this.robot = this.choose(choices.robots, 'as the mission says');
    this.world = this.choose(choices.worlds, 'as the mission says');
    this.backend = this.choose(choices.backends, null);
    this.flownBy = make('p', { class: 'hint' });
    this.refused = make('ul', { class: 'hint', id: 'refused', role: 'status' });
    this.backend.addEventListener('change', () => this.tellBackend());
    this.tellBackend();
    this.seed = make('input', { type: 'number', min: 0, step: 1, placeholder: 'as the mission says' });
    this.sets = make('textarea', { spellcheck: false, placeholder: 'world.wind.kind=steady\nworld.wind.mean_mps=3' });
    this.about = make('p', { class: 'hint' });
    this.hands = make('input', { type: 'checkbox', id: 'byhand' });
    const byHand = make('label', { class: 'check' }, this.hands, make('span', { text: 'I do the work by hand: the mission asks me for the stick' }));
    const tell = () => {
      this.about.textContent = choices.missions[this.mission.value] ?? '';
      byHand.hidden = !choices.operated.includes(this.mission.value);
    };
    this.mission.addEventListener('change', tell);
    tell();
    const field = (name, element) => make('label', {}, make('span', { text: name }), element);
    this.go = make('button', { type: 'submit', text: 'Start the flight', class: 'primary', id: 'start' });
    for (const element of [this.mission, this.robot, this.world, this.sets]) element.addEventListener('change', ask);
    const form = make('form', {}, field('Mission', this.mission), this.about, byHand, field('Robot', this.robot),
      field('World', this.world), field('Seed', this.seed),
      field('Other values, one KEY=VALUE a line', this.sets), field('Back end', this.backend), this.flownBy, this.refused, this.go);
    form.addEventListener('submit', (e) => {
      e.preventDefault();
      start(this.read());
    });
    parent.append(form);
  }

  choose(options, none) {
    const select = make('select');
    if (none !== null) select.append(make('option', { value: '', text: none }));
    for (const [name, what] of Object.entries(options)) select.append(make('option', { value: name, text: name, title: what }));
    return select;
  }

  tellBackend() {
    this.flownBy.textContent = `${this.backend.value}: ${this.choices.backends[this.backend.value]}.`;
  }

  // Shows which back ends can fly the flight of the form: `found` is the station's answer.
  offer(found) {
    const refused = found.refused ?? {};
    const lines = found.wrong ? [found.wrong] : Object.entries(refused).map(([name, why]) => `Not ${name}: ${why}`);
    for (const option of this.backend.options) option.disabled = option.value in refused;
    if (this.backend.value in refused) {
      lines.unshift(`${this.backend.value} does not fly this; another back end is chosen.`);
      this.backend.value = [...this.backend.options].find((o) => !o.disabled)?.value ?? this.backend.value;
    }
    this.tellBackend();
    this.refused.replaceChildren(...lines.map((text) => make('li', { text })));
  }

  read() {
    const seed = this.seed.value.trim();
    return {
      mission: this.mission.value, robot: this.robot.value || null, world: this.world.value || null,
      operated: this.hands.checked && this.choices.operated.includes(this.mission.value),
      backend: this.backend.value, seed: seed === '' ? null : Number(seed),
      sets: this.sets.value.split('\n').map((s) => s.trim()).filter(Boolean),
    };
  }

  // Fills the form with the entry of a flight in the logbook.
  fill(entry) {
    this.mission.value = entry.mission;
    [this.robot.value, this.world.value] = (entry.asked ?? []).map((x) => x ?? '');
    this.seed.value = entry.seed ?? '';
    this.sets.value = (entry.sets ?? []).join('\n');
    this.hands.checked = Boolean(entry.operated);
    this.backend.value = entry.backend in this.choices.backends ? entry.backend : 'physics';
    this.mission.dispatchEvent(new Event('change'));
  }
}

// Returns the name of a back end other than 'physics', for a line that names a flight.
export const tellBackend = (name) => (name && name !== 'physics' ? `, ${name}` : '');

export function showLogbook(parent, entries, known, repeat) {
  if (!entries.length) {
    parent.replaceChildren(make('p', { class: 'hint', text: 'No flight yet.' }));
    return;
  }
  const table = make('table', { class: 'log' }, make('tr', {}, make('th', { text: 'when (UTC)' }), make('th', { text: 'flight' }), make('th', { text: '' })));
  for (const e of entries) {
    const acts = make('td');
    if (e.directory && e.outcome !== 'killed') {
      for (const page of ['report', 'replay']) {
        if (page === 'report' && !['succeeded', 'failed', 'aborted'].includes(e.outcome)) continue;
        if (page === 'replay' && !['succeeded', 'failed', 'aborted'].includes(e.outcome)) continue;
        acts.append(make('a', { href: `flights/${e.number}/${page}.html`, target: '_blank', rel: 'noopener', text: page }), ' ');
      }
    }
    if (e.mission in known) acts.append(button('repeat', () => repeat(e), { title: 'Fill in the same flight, disturbances included' }));
    table.firstChild.after(make('tr', {},
      make('td', { text: e.when }),
      make('td', {}, make('b', { text: `${e.mission}: ${e.outcome}` }), make('div', { text: `${e.robot ?? ''} in ${e.world ?? ''}, seed ${e.seed ?? '–'}${tellBackend(e.backend)}` }),
        e.reason ? make('div', { class: 'hint', text: e.reason }) : null),
      acts));
  }
  parent.replaceChildren(table);
}
