// The position of the time line as a line in a plot.

import { element } from './element.js';

export class Playhead {
  #time = null;
  #drawn = new WeakMap();

  /** Move it to a time [s]; hide it without one. */
  moveTo(time) {
    this.#time = time;
  }

  /** Draw it in a chart, if it has moved there. */
  draw(chart) {
    const { min, max } = chart.scales.x;
    const place = [this.#time, min, max, chart.over.clientWidth].join();
    if (this.#drawn.get(chart) === place) return;
    this.#drawn.set(chart, place);
    const line = chart.over.querySelector('.playhead') ?? chart.over.appendChild(element('div', { className: 'playhead' }));
    line.hidden = this.#time === null || this.#time < min || this.#time > max;
    if (!line.hidden) line.style.transform = `translateX(${chart.valToPos(this.#time, 'x')}px)`;
  }
}
