// The sound of the motors: the duty, held for a tick of 4 ms each, as a loudspeaker would have it.

const TICK_S = 0.004;
const FIRST_TICKS = 20;
const MOST_TICKS = 100;

class Motor extends AudioWorkletProcessor {
  #duties = [];
  #place = 0;
  #isWaiting = true;
  #level = 0;

  constructor() {
    super();
    this.port.onmessage = ({ data }) => {
      this.#duties.push(...data);
      if (this.#duties.length > MOST_TICKS) this.#duties.splice(0, this.#duties.length - FIRST_TICKS);
    };
  }

  process(inputs, [[channel]]) {
    if (this.#isWaiting) this.#isWaiting = this.#duties.length < FIRST_TICKS;
    for (let sample = 0; sample < channel.length; sample += 1) {
      let wanted = 0;
      if (!this.#isWaiting) {
        wanted = this.#duties[0];
        this.#place += 1 / (TICK_S * sampleRate);
        if (this.#place >= 1) {
          this.#place -= 1;
          this.#duties.shift();
          this.#isWaiting = !this.#duties.length;
        }
      }
      this.#level += 0.2 * (wanted - this.#level);
      channel[sample] = this.#level;
    }
    return true;
  }
}

registerProcessor('motor', Motor);
