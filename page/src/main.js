// The ground station's page: a live flight, or the replay of a recorded one.
import { $, button, make } from './dom.js';
import { Live } from './live.js';
import { Replay } from './replay.js';
import { View } from './scene.js';

const VERSION = 1;

function buildViews(view) {
  const box = $('views');
  view.onmode = (name) => {
    for (const b of box.children) b.setAttribute('aria-pressed', b.textContent === name);
  };
  return () => {
    $('empty').hidden = true;
    $('legend').hidden = false;
    box.replaceChildren(...view.names.map((name) => button(name, () => view.look(name), { 'aria-pressed': name === view.mode })));
    const legend = $('legend').lastElementChild;
    legend.replaceChildren(...view.data.legend.map(([colour, text]) => {
      const swatch = make('i');
      swatch.style.background = colour;
      return make('div', {}, swatch, text);
    }));
    const line = (kind, text) => make('div', {}, make('i', { class: kind }), text);
    if (view.data.layout.arrows.length) {
      legend.append(line('force', 'force, measured or estimated (4 cm for 1 N)'), line('force demanded', 'force, demanded'));
    }
  };
}

function fail(text) {
  $('banner').hidden = false;
  $('banner').textContent = text;
}

async function begin() {
  let view;
  try {
    view = new View($('canvas'), $('labels'));
  } catch {
    fail('This browser cannot draw in 3-D (WebGL is not available).');
    return;
  }
  const loaded = buildViews(view);
  const inside = $('data');
  let player;
  if (inside || document.documentElement.dataset.mode === 'replay') {
    const data = inside ? JSON.parse(inside.textContent) : await (await fetch('data.json')).json();
    if (data.version !== VERSION) { fail(`This page reads data of version ${VERSION}, not ${data.version}.`); return; }
    player = new Replay(view, data, $('side'), $('foot'));
    await player.start();
    loaded();
  } else {
    player = new Live(view, $('side'), $('foot'), loaded, fail);
    await player.start();
  }
  window.skywright = { view, player };
  let last = performance.now();
  (function draw(now) {
    requestAnimationFrame(draw);
    player.step(Math.min((now - last) / 1000, 0.5));
    last = now;
    view.render();
  })(last);
  document.documentElement.dataset.ready = 'yes';
}

begin().catch((error) => fail(`The page failed: ${error.message}`));
