// The bar with buttons, speeds and the time line.

import { element, isForFocused } from './element.js';

/** Sends `{press}`, `{rate}` and `{seek}`. */
export class Transport {
  node = element('div', { className: 'transport', hidden: true });
  #send;
  #buttons = [];
  #timeline = null;
  #time = 0;
  #slider = null;
  #isDragging = false;
  #isHeld = false;
  #waiting = null;
  #shown = '';

  constructor(send) {
    this.#send = send;
    // Before viser, which moves the camera by some of these keys.
    addEventListener('keydown', (event) => this.#onKey(event), { capture: true });
    this.node.addEventListener('pointerdown', () => { this.#isHeld = true; });
    // After the click, which comes next.
    for (const type of ['pointerup', 'pointercancel']) addEventListener(type, () => setTimeout(() => this.#letGo()));
  }

  #letGo() {
    this.#isHeld = false;
    if (this.#waiting) this.show(this.#waiting);
  }

  /** Show the buttons, speeds and time line of a state; later, if one is held, which would lose its click. */
  show(state) {
    this.#waiting = this.#isHeld ? state : null;
    if (this.#isHeld) return;
    const { buttons, rates, rate, timeline } = state;
    const shown = JSON.stringify([buttons, rates, rate, timeline]);
    if (shown === this.#shown) return;
    this.#shown = shown;
    this.#buttons = buttons;
    this.#timeline = timeline;
    this.#slider = null;
    this.node.hidden = !buttons.length && !timeline;
    const row = element('div', { className: 'transport-row' }, [
      element('div', { className: 'group' }, buttons.filter(({ label }) => label).map((button) => this.#button(button))),
      element('div', { className: 'group rates', role: 'group', 'aria-label': 'Speed' },
        rates.map((each) => this.#rate(each, each === rate))),
    ]);
    this.node.replaceChildren(...(timeline ? [this.#line(timeline)] : []), row);
    this.moveTo(this.#time);
  }

  /** Move the position on the time line [s]. */
  moveTo(time) {
    this.#time = time;
    if (!this.#slider || this.#isDragging) return;
    this.#slider.value = time;
    this.#label();
  }

  #button({ name, label, tip, is_pressed: isPressed, key }) {
    return element('button', {
      type: 'button', textContent: label, title: key ? `${tip || label} (${keyName(key)})` : tip,
      'aria-pressed': isPressed, dataset: { name },
      onclick: (event) => this.#press(event, { press: name }),
    });
  }

  #rate(rate, isChosen) {
    return element('button', {
      type: 'button', textContent: rate, 'aria-pressed': isChosen, dataset: { rate },
      onclick: (event) => this.#press(event, { rate }),
    });
  }

  #press(event, request) {
    if (event.detail) event.currentTarget.blur(); // so that Space does not press it again
    this.#send(request);
  }

  #line({ end, marks }) {
    this.#slider = element('input', {
      type: 'range', min: 0, max: end, step: 'any', 'aria-label': 'Time',
      onpointerdown: () => { this.#isDragging = true; },
      onpointerup: ({ currentTarget }) => {
        this.#isDragging = false;
        currentTarget.blur(); // so that the keys drive
      },
      onpointercancel: () => { this.#isDragging = false; },
      oninput: () => {
        this.#label();
        this.#send({ seek: this.#slider.valueAsNumber });
      },
    });
    const ticks = marks.map(({ time, kind, text }) => element('button', {
      type: 'button', className: 'mark', title: `${time.toFixed(2)} s: ${text}`,
      dataset: { kind }, style: { left: `${(100 * time) / (end || 1)}%` },
      onclick: () => this.#send({ seek: time }),
    }));
    return element('div', { className: 'timeline' }, [
      element('div', { className: 'track' }, [this.#slider, element('div', { className: 'marks' }, ticks)]),
      element('output'),
    ]);
  }

  #label() {
    const { end } = this.#timeline;
    const output = this.node.querySelector('output');
    output.textContent = `${this.#slider.valueAsNumber.toFixed(2)} / ${end.toFixed(2)} s`;
  }

  #onKey(event) {
    if (isForFocused(event) && event.target !== this.#slider) return;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const button = this.#buttons.find(({ key }) => key && key === event.key);
    if (!button) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    this.#send({ press: button.name });
  }
}

function keyName(key) {
  return { ' ': 'Space', ArrowLeft: '←', ArrowRight: '→' }[key] ?? key;
}
