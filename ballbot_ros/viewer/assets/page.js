// The overlay on viser's scene: banner, transport bar, time line and stick.

import { Banner } from './banner.js';
import { charts } from './charts.js';
import { Driving } from './driving.js';
import { element } from './element.js';
import { showSmallValues } from './legend.js';
import { Link } from './link.js';
import { Playhead } from './playhead.js';
import { followScene, whenDrawn } from './scene.js';
import { Transport } from './transport.js';

const link = new Link();
const banner = new Banner();
const transport = new Transport((request) => link.send(request));
const driving = new Driving((request) => link.send(request));
const playhead = new Playhead();
const root = element('div', { id: 'overlay' }, [
  banner.node,
  element('div', { className: 'overlay-foot' }, [driving.node, transport.node]),
]);

link.on('may_steer', (may) => root.classList.toggle('only-watches', !may));
link.on('connected', (is) => {
  banner.setConnected(is);
  if (is) whenDrawn(() => link.send({ drawn: true }));
  else driving.enable(false);
});
link.on('state', (state) => {
  banner.show(state.banner);
  transport.show(state);
  if (!state.timeline) playhead.moveTo(null);
  driving.enable(state.can_drive && !root.classList.contains('only-watches'));
});
link.on('time', (time) => {
  transport.moveTo(time);
  playhead.moveTo(time);
});

function drawCharts() {
  for (const chart of charts()) {
    showSmallValues(chart);
    playhead.draw(chart);
  }
  requestAnimationFrame(drawCharts);
}

/** Uncover the page when viser's panel has our controls. */
function uncover() {
  if (document.querySelector('#welcome')) document.documentElement.classList.remove('is-connecting');
  else requestAnimationFrame(uncover);
}

// The chooser of the view keeps the focus after a choice, and with it the keys.
addEventListener('click', ({ target }) => {
  if (target.closest?.('[role="option"]')) setTimeout(() => document.activeElement.blur());
});

document.body.append(root);
followScene(root);
drawCharts();
uncover();
link.connect();
