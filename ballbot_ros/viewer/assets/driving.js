// Driving by the keys, the stick on the screen, and a gamepad of the browser.

import { element, isForFocused } from './element.js';

const SEND_MS = 50;
const DEAD_ZONE = 0.1;
const KEY_SPEED_STEP = 0.1;

const DIRECTIONS = {
  KeyW: [1, 0], ArrowUp: [1, 0], KeyS: [-1, 0], ArrowDown: [-1, 0],
  KeyA: [0, -1], ArrowLeft: [0, -1], KeyD: [0, 1], ArrowRight: [0, 1],
};

const clamp = (value) => Math.max(-1, Math.min(1, value));
const isNeutral = ([forward, rightward]) => forward === 0 && rightward === 0;

/** Sends `{forward, rightward}` while a stick is held, and once after its release. */
export class Driving {
  #send;
  #isEnabled = false;
  #keys = new Set();
  #keySpeed = 0.5;
  #stick = [0, 0];
  #isHeld = false;
  #knob = element('div', { className: 'knob' });
  #label = element('output');
  #pad = element('div', { className: 'stick', role: 'application', 'aria-label': 'Stick' }, [this.#knob]);
  node = element('div', { className: 'driving', hidden: true }, [this.#pad, this.#label]);

  constructor(send) {
    this.#send = send;
    // Before viser, which moves the camera by the same keys.
    addEventListener('keydown', (event) => this.#onKeyDown(event), { capture: true });
    addEventListener('keyup', (event) => this.#onKeyUp(event), { capture: true });
    addEventListener('blur', () => this.#release());
    document.addEventListener('visibilitychange', () => document.hidden && this.#release());
    this.#pad.onpointerdown = (event) => {
      this.#pad.setPointerCapture(event.pointerId);
      this.#onPointer(event);
    };
    this.#pad.onpointermove = (event) => {
      if (this.#pad.hasPointerCapture(event.pointerId)) this.#onPointer(event);
    };
    this.#pad.onlostpointercapture = () => { this.#stick = [0, 0]; };
    setInterval(() => this.#update(), SEND_MS);
  }

  /** Show the stick and take keys, or neither. */
  enable(is) {
    this.#isEnabled = is;
    this.node.hidden = !is;
    if (!is) this.#release();
  }

  #onKeyDown(event) {
    if (!this.#isEnabled || isForFocused(event) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.code in DIRECTIONS) this.#keys.add(event.code);
    else if (event.key === '+' || event.key === '-') this.#changeKeySpeed(event.key);
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
    this.#update();
  }

  #onKeyUp(event) {
    if (this.#keys.delete(event.code)) this.#update();
  }

  #changeKeySpeed(key) {
    const step = key === '+' ? KEY_SPEED_STEP : -KEY_SPEED_STEP;
    this.#keySpeed = Math.max(KEY_SPEED_STEP, Math.min(1, this.#keySpeed + step));
  }

  #onPointer({ clientX, clientY }) {
    const { left, top, width, height } = this.#pad.getBoundingClientRect();
    const right = (2 * (clientX - left)) / width - 1;
    const forward = 1 - (2 * (clientY - top)) / height;
    const reach = Math.max(1, Math.hypot(right, forward));
    this.#stick = [forward / reach, right / reach];
    this.#update();
  }

  #release() {
    this.#keys.clear();
    this.#stick = [0, 0];
  }

  /** Return forward and rightward of the input that is not neutral: stick, gamepad or keys. */
  #value() {
    if (!isNeutral(this.#stick)) return this.#stick;
    const gamepad = gamepadValue();
    if (!isNeutral(gamepad)) return gamepad;
    const held = [...this.#keys].map((code) => DIRECTIONS[code]);
    return [0, 1].map((axis) => clamp(held.reduce((sum, each) => sum + each[axis], 0)) * this.#keySpeed);
  }

  #update() {
    const value = this.#isEnabled && !document.hidden ? this.#value() : [0, 0];
    const [forward, rightward] = value;
    this.#knob.style.transform = `translate(${50 * rightward}%, ${-50 * forward}%)`;
    this.#label.textContent = `keys ${Math.round(100 * this.#keySpeed)} % (+ −)`;
    if (this.#isHeld || !isNeutral(value)) this.#send({ forward, rightward });
    this.#isHeld = !isNeutral(value);
  }
}

/** Forward by the left stick, rightward by the right or the left one. */
function gamepadValue() {
  for (const gamepad of navigator.getGamepads()) {
    if (!gamepad?.connected) continue;
    const axis = (number) => {
      const value = gamepad.axes[number] ?? 0;
      return Math.abs(value) < DEAD_ZONE ? 0 : clamp(value);
    };
    const value = [-axis(1), Math.abs(axis(2)) > Math.abs(axis(0)) ? axis(2) : axis(0)];
    if (!isNeutral(value)) return value;
  }
  return [0, 0];
}
