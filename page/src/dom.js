// Small helpers for the page's elements; text is only ever set as text.
export const $ = (id) => document.getElementById(id);

export function make(tag, options = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name === 'on') for (const [event, f] of Object.entries(value)) element.addEventListener(event, f);
    else if (name === 'class') element.className = value;
    else if (name === 'text') element.textContent = value;
    else if (name in element && name !== 'list') element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((c) => c !== null && c !== undefined));
  return element;
}

export const button = (text, f, options = {}) =>
  make('button', { type: 'button', text, on: { click: f }, ...options });

export function section(parent, title, open = true, id = '') {
  const body = make('div', { class: 'body' });
  const whole = make('details', { open }, make('summary', { text: title }), body);
  if (id) whole.id = id;
  parent.append(whole);
  return body;
}

export const format = (value, digits, unit) =>
  Number.isFinite(value) ? `${value.toFixed(digits)}${unit ? ` ${unit}` : ''}` : '–';

// Returns whether key presses go to an input field.
export const typing = (event) =>
  event.target instanceof HTMLElement && event.target.matches('input:not([type=range]), select, textarea');
