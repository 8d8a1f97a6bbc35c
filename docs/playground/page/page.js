// The page: what the visitor does goes to the worker, what the worker computes is shown.

import { Driving } from './driving.js';
import { Scene } from './scene.js';
import { draw, spanOf } from './timeline.js';

const ROW = ['time', 'x', 'y', 'pitchX', 'pitchY', 'dutyX', 'dutyY', 'gain', 'end'];
const TICK_S = 0.004;
const MARKS_PER_S = 10; // the moments to which the run can go back, as in session.py
const KEPT_TICKS = 30000;
const ENDS = [null, 'has fallen', 'has hit a wall'];
const PLOT_MS = 100;
const RINGING_TICKS = 50;
const RINGING_PERCENT = 40;
const SLOW = 0.1;

const find = (id) => document.getElementById(id);
const controls = Object.fromEntries(
  ['scenario', 'gain', 'sound', 'check', 'time', 'play', 'restart', 'slow'].map((id) => [id, find(id)]),
);

let data;
let scene;
let worker;
let rows = [];
let ghost = [];
let shown = null; // the row of the time line while it is held, else null
let isStarting = false;
let isPlaying = false;
let isReady = false;
let sound = null;

function notice(text, kind = '') {
  const node = find('notice');
  if (node.textContent !== text) node.textContent = text;
  node.dataset.kind = kind;
}

// --- The worker -------------------------------------------------------------------------------

const ANSWERS = {
  loading({ bytes }) {
    const share = Math.min(1, bytes / data.bytes);
    const what = share < 1
      ? `is loading: ${Math.round(100 * share)} % of ${Math.round(data.bytes / 1e6)} MB`
      : 'starts in a few seconds';
    notice(`What you see is recorded. The simulator ${what} …`);
  },
  loaded() {
    isReady = true;
    for (const each of Object.values(controls)) each.disabled = false;
    find('live').hidden = false;
    start(controls.scenario.value);
  },
  failed: ({ text }) => notice(`The simulator can't run here: ${text}`, 'bad'),
  started() {
    isStarting = false;
    notice('');
    play(true);
  },
  rows({ rows: numbers }) {
    if (isStarting) return; // they are of the run before
    for (let at = 0; at < numbers.length; at += ROW.length) {
      rows.push(Object.fromEntries(ROW.map((name, place) => [name, numbers[at + place]])));
    }
    if (rows.length > KEPT_TICKS) rows = rows.slice(-KEPT_TICKS);
    if (sound && !controls.slow.checked) {
      sound.port.postMessage(rows.slice(-numbers.length / ROW.length).map(({ dutyX, dutyY }) => (dutyX + dutyY) / 600));
    }
    if (isPlaying && rows.at(-1)?.end) {
      play(false);
      controls.play.disabled = true;
      notice(`It ${ENDS[rows.at(-1).end]}. Go back on the time line, or start again.`, 'bad');
    }
  },
  back({ time }) {
    const first = rows.findIndex((row) => row.time >= time - 1e-6);
    if (first >= 0) {
      ghost = rows.slice(first);
      rows = rows.slice(0, first);
    }
  },
  hash({ hash, golden, seconds, scenario }) {
    const node = find('hash');
    const isSame = hash === golden;
    node.dataset.kind = isSame ? 'good' : 'bad';
    node.textContent = `${isSame ? '✓ The same bits as everywhere' : `✗ Not those of other machines, ${golden}`}: `
      + `${hash} (${scenario}, computed in ${seconds.toFixed(1)} s)`;
    controls.check.disabled = false;
  },
};

function begin() {
  worker = new Worker('worker.js', { type: 'module' });
  worker.onmessage = ({ data: message }) => ANSWERS[message.kind](message);
  worker.onerror = ({ message }) => ANSWERS.failed({ text: message || 'this browser has no module workers' });
}

function start(scenario) {
  find('purpose').textContent = data.scenarios.find(({ name }) => name === scenario).purpose;
  const { map } = data.scenarios.find(({ name }) => name === scenario);
  scene.showMap(data.maps[map], `${map}.png`);
  showGain(1);
  rows = [];
  ghost = [];
  shown = null;
  isStarting = true;
  worker.postMessage({ kind: 'start', scenario });
}

/** Go on from what is shown, or pause. */
function play(is) {
  if (is && shown) {
    if (shown !== rows.at(-1)) worker.postMessage({ kind: 'back', time: shown.time });
    shown = null;
    notice('');
  }
  isPlaying = is;
  controls.play.disabled = false;
  controls.play.textContent = is ? 'Pause' : 'Go on';
  worker.postMessage({ kind: 'play', isPlaying: is, rate: controls.slow.checked ? SLOW : 1 });
}

/** Let the robot do something, from the moment that is shown. */
function act(message) {
  if (!isReady) return;
  const isRelease = message.forward === 0 && message.rightward === 0;
  if (!isPlaying && !isRelease) play(true);
  worker.postMessage(message);
}

function showGain(factor) {
  controls.gain.value = factor;
  find('gain-value').textContent = `× ${factor.toFixed(2)}`;
}

// --- What the visitor does ----------------------------------------------------------------------

function takeInput() {
  controls.scenario.onchange = () => start(controls.scenario.value);
  controls.restart.onclick = () => start(controls.scenario.value);
  controls.play.onclick = () => play(!isPlaying);
  controls.slow.onchange = () => play(isPlaying);
  controls.gain.oninput = () => {
    const factor = Number(controls.gain.value);
    act({ kind: 'gain', factor });
    showGain(factor);
  };
  controls.time.oninput = () => {
    if (isPlaying) play(false);
    if (!rows.length) return;
    const [first, last] = [rows[0], rows.at(-1)];
    const time = Math.round(MARKS_PER_S * controls.time.value) / MARKS_PER_S;
    shown = rowAt(rows, time) ?? (time < first.time ? first : last);
    showGain(shown.gain);
    controls.play.disabled = false;
    notice('Change something, or press “Go on”: the run continues from here.');
  };
  controls.check.onclick = () => {
    controls.check.disabled = true;
    find('hash').textContent = 'Computing 10 s of the robot …';
    worker.postMessage({ kind: 'hash', scenario: 'stationary', duration: 0 });
  };
  controls.sound.onchange = () => hear(controls.sound.checked);
  // Keys drive the robot, also after a click on a slider or a box.
  addEventListener('pointerup', ({ target }) => target.matches?.('[type="range"], [type="checkbox"]') && target.blur());
  document.addEventListener('visibilitychange', () => document.hidden && isPlaying && play(false));
  addEventListener('keydown', (event) => {
    if (event.code !== 'Space' || !isReady || event.target.matches('button, input, select, a')) return;
    event.preventDefault();
    play(!isPlaying);
  });
  const driving = new Driving((hold) => act({ kind: 'hold', ...hold }));
  driving.enable(true);
  find('stick').append(driving.node);
}

async function hear(is) {
  sound?.context.close();
  sound = null;
  if (!is) return;
  const context = new AudioContext();
  await context.audioWorklet.addModule('motor.js');
  sound = new AudioWorkletNode(context, 'motor', { numberOfInputs: 0 });
  sound.connect(context.destination);
}

// --- What is shown -------------------------------------------------------------------------------

/** Return how much the duty alternates from tick to tick [%], which sounds at 125 Hz. */
function ringing() {
  const last = rows.slice(-RINGING_TICKS);
  const sum = (name) => last.reduce((total, row, number) => total + (number % 2 ? -row[name] : row[name]), 0);
  return last.length ? Math.max(Math.abs(sum('dutyX')), Math.abs(sum('dutyY'))) / last.length : 0;
}

/** Return the row of a time; undefined before the first and after the last one. */
function rowAt(run, time) {
  return run[Math.round((time - run[0]?.time) / TICK_S)];
}

let plotted = 0;

function frame(now) {
  requestAnimationFrame(frame);
  if (!isReady) {
    const { shown: recorded, shownPeriod } = data;
    const number = Math.floor(now / 1000 / shownPeriod) % recorded.length;
    scene.show(Object.fromEntries(ROW.map((name, place) => [name, recorded[number][place]])));
    return;
  }
  const row = shown ?? rows.at(-1);
  if (!row) return;
  scene.show(row, rowAt(ghost, row.time));
  if (now - plotted < PLOT_MS) return;
  plotted = now;
  const [first, last] = spanOf(rows, ghost);
  Object.assign(controls.time, { min: first, max: last });
  controls.time.value = row.time;
  draw(find('plot'), rows, ghost, row.time);
  find('clock').textContent = `${row.time.toFixed(1)} s`;
  const percent = ringing();
  find('ringing').textContent = percent >= RINGING_PERCENT ? `Rings with ±${Math.round(percent)} % duty.` : '';
}

data = await (await fetch('robot.json')).json();
for (const { name } of data.scenarios) controls.scenario.append(new Option(name));
scene = new Scene(find('scene'), data.robot, {
  aim: (newtons) => isReady && notice(newtons ? `A push of ${newtons.toFixed(1)} N` : ''),
  push: (x, y) => act({ kind: 'push', x, y }),
});
takeInput();
find('about').hidden = !/\/playground\/(index.html)?$/.test(location.pathname); // elsewhere it is not part of the site
begin();
requestAnimationFrame(frame);

/** For tests: the hash of a scenario's first seconds, and what is shown. */
window.ballbot = {
  hash: (scenario, duration) => new Promise((resolve) => {
    const usual = ANSWERS.hash;
    ANSWERS.hash = (answer) => { ANSWERS.hash = usual; resolve(answer); };
    worker.postMessage({ kind: 'hash', scenario, duration });
  }),
  get rows() { return rows; },
  get ghost() { return ghost; },
  get isReady() { return isReady; },
  robotOnScreen: () => scene.robotOnScreen(),
};
