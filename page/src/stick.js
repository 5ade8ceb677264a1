// The operator's stick: keyboard, gamepad and SpaceMouse, with a dead-man switch. Axes are ahead,
// left, up, and turn to the left, in -1 .. 1.
import { typing } from './dom.js';
import { SpaceMouse } from './spacemouse.js';

const KEYS = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyR: [2, 1], KeyF: [2, -1],
  KeyQ: [3, 1], KeyE: [3, -1],
};
const DEAD_ZONE = 0.08;
const clamp = (x) => Math.max(-1, Math.min(1, x));

export class Stick {
  constructor() {
    this.down = new Set();
    this.size = 0.5; // deflection of a pressed key, as a share of the full one
    this.active = false; // whether keys act on the stick
    this.mouse = new SpaceMouse();
    addEventListener('keydown', (e) => {
      // a list with the focus, such as that of the speed, must not block the dead-man switch
      const taken = typing(e) && !e.target.matches('select');
      if (!this.active || taken || e.ctrlKey || e.metaKey || e.altKey) return;
      if (!(e.code in KEYS) && e.code !== 'Space' && e.code !== 'Enter') return;
      if (e.code === 'Enter' && !this.down.has('Space')) return; // Enter alone presses the button with the focus
      e.preventDefault(); // prevents scrolling and the press of a button
      this.down.add(e.code);
    });
    addEventListener('keyup', (e) => {
      if (this.down.delete(e.code)) e.preventDefault();
    });
    // a key whose release the page does not receive must not stay pressed
    for (const event of ['blur', 'pagehide']) addEventListener(event, () => this.down.clear());
    document.addEventListener('visibilitychange', () => this.down.clear());
  }

  read() {
    const v = [0, 0, 0, 0];
    for (const code of this.down) if (code in KEYS) v[KEYS[code][0]] += this.size * KEYS[code][1];
    let held = this.down.has('Space'), stands = this.down.has('Enter');
    const pad = Array.from(navigator.getGamepads?.() ?? []).find((p) => p?.connected);
    if (pad) {
      const dead = (x) => (Number.isFinite(x) && Math.abs(x) > DEAD_ZONE ? -x : 0);
      v[0] += dead(pad.axes[1]);
      v[1] += dead(pad.axes[0]);
      v[2] += dead(pad.axes[3]);
      v[3] += dead(pad.axes[2]);
      held ||= Boolean(pad.buttons[4]?.pressed || pad.buttons[5]?.pressed);
      stands ||= Boolean(pad.buttons[0]?.pressed);
    }
    const cap = this.mouse.read();
    if (cap) {
      cap.v.forEach((x, i) => { v[i] += x; });
      held ||= cap.held;
      stands ||= cap.stands;
    }
    const [ahead, left, up, turn] = v.map(clamp);
    return { v: [ahead, left, up], flight: [-left, ahead, turn, up], held, stands: held && stands, pad: pad?.id ?? this.mouse.name };
  }
}
