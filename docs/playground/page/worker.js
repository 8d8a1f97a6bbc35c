// The simulator: this package's Python in WebAssembly, at the pace of the page.

import { loadPyodide } from './pyodide/pyodide.mjs';

const TURN_MS = 10;
const TICK_MS = 4;
const MOST_TICKS = 50;

let python;
let session;
let isPlaying = false;
let rate = 1;
let dueMs = 0;
let last = 0;

/** Count the bytes of all downloads. */
function countDownloads(report) {
  const { fetch } = self;
  let bytes = 0;
  self.fetch = async (...words) => {
    const { body, headers, status, statusText, ok, url } = await fetch(...words);
    if (!ok) throw new Error(`${url}: ${status} ${statusText}`);
    const counter = new TransformStream({
      transform(chunk, controller) {
        report((bytes += chunk.length));
        controller.enqueue(chunk);
      },
    });
    return new Response(body.pipeThrough(counter), { headers, status, statusText });
  };
}

async function load() {
  countDownloads((bytes) => postMessage({ kind: 'loading', bytes }));
  const archive = fetch('python.zip').then((answer) => answer.arrayBuffer());
  const pyodide = await loadPyodide({ indexURL: './pyodide/' });
  pyodide.unpackArchive(await archive, 'zip', { extractDir: '/page' });
  pyodide.runPython('import sys; sys.path.insert(0, "/page")');
  python = pyodide.pyimport('session');
  python.use_tables();
  postMessage({ kind: 'loaded' });
}

function turn() {
  const now = performance.now();
  if (session && isPlaying) {
    // A machine that is too slow gets a slower robot instead of a growing debt.
    dueMs = Math.min(dueMs + (now - last) * rate, MOST_TICKS * TICK_MS);
    const ticks = Math.floor(dueMs / TICK_MS);
    if (ticks) advance(ticks);
  }
  last = now;
  setTimeout(turn, TURN_MS);
}

function advance(ticks) {
  dueMs -= ticks * TICK_MS;
  const found = session.advance(ticks);
  const buffer = found.getBuffer('f64');
  const rows = buffer.data.slice();
  buffer.release();
  found.destroy();
  postMessage({ kind: 'rows', rows }, [rows.buffer]);
}

const ACTIONS = {
  start({ scenario }) {
    session?.destroy();
    session = python.Session(scenario);
    dueMs = 0;
    postMessage({ kind: 'started' });
  },
  play(message) {
    ({ isPlaying, rate } = message);
    dueMs = 0;
  },
  hold: ({ forward, rightward }) => session.hold(forward, rightward),
  push: ({ x, y }) => session.push(x, y),
  gain: ({ factor }) => session.scale_gain(factor),
  back({ time }) {
    postMessage({ kind: 'back', time: session.go_back(time) });
  },
  hash({ scenario, duration }) {
    const start = performance.now();
    const hash = python.duty_sha256(scenario, duration);
    const seconds = (performance.now() - start) / 1000;
    postMessage({ kind: 'hash', scenario, hash, golden: python.golden_sha256(scenario), seconds });
  },
};

onmessage = ({ data }) => ACTIONS[data.kind](data);

load().then(turn, (error) => postMessage({ kind: 'failed', text: String(error.message ?? error) }));
