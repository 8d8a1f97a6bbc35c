// The position of the time line as a line in all plots.

import { element } from './element.js';

/** viser registers its plots for tests of its own; there is no other access to them. */
function charts() {
  return Object.values(window.__viserTestpoints?.uplots ?? {}).map(({ chart }) => chart);
}

export class Playhead {
  #time = null;
  #drawn = new WeakMap();

  constructor() {
    const draw = () => {
      charts().forEach((chart) => this.#draw(chart));
      requestAnimationFrame(draw);
    };
    requestAnimationFrame(draw);
  }

  /** Move it to a time [s]; hide it without one. */
  moveTo(time) {
    this.#time = time;
  }

  #draw(chart) {
    const { min, max } = chart.scales.x;
    const place = [this.#time, min, max, chart.over.clientWidth].join();
    if (this.#drawn.get(chart) === place) return;
    this.#drawn.set(chart, place);
    const line = chart.over.querySelector('.playhead') ?? chart.over.appendChild(element('div', { className: 'playhead' }));
    line.hidden = this.#time === null || this.#time < min || this.#time > max;
    if (!line.hidden) line.style.transform = `translateX(${chart.valToPos(this.#time, 'x')}px)`;
  }
}
