// Draws a frame when it is asked for one, in the headless browser that renders pictures and films.
//
// viser draws whenever the browser offers a frame, several times for each change, at a resolution
// that depends on the speed. Here nothing is drawn before `takePicture`, a pixel of the scene is a
// pixel of the picture, and messages are applied when they arrive, as on a hidden page.

history.replaceState(null, '', `?fixedDpr=1&${location.search.slice(1)}`);
Object.defineProperty(document, 'hidden', { get: () => true });

const callbacks = new Map();
let lastId = 0;
window.requestAnimationFrame = (callback) => {
  callbacks.set(++lastId, callback);
  return lastId;
};
window.cancelAnimationFrame = (id) => callbacks.delete(id);

window.drawFrame = () => {
  const due = [...callbacks.values()];
  callbacks.clear();
  for (const callback of due) callback(performance.now());
};

// Images, such as the robot's display, load in the background.
const loading = new Set();
const createElement = document.createElementNS;
document.createElementNS = (...names) => {
  const element = createElement.apply(document, names);
  if (element instanceof HTMLImageElement) {
    loading.add(element);
    for (const end of ['load', 'error']) {
      element.addEventListener(end, () => loading.delete(element));
    }
  }
  return element;
};

const later = () => new Promise((resolve) => setTimeout(resolve, 0));
/** Wait until React has put into the scene what is there to put. */
const idle = () => new Promise((resolve) => requestIdleCallback(resolve, { timeout: 1000 }));

async function until(condition, deadline) {
  while (!condition()) {
    if (performance.now() > deadline) throw new Error('the page does not follow');
    await later();
  }
}

// viser fits the shadows to the camera's place in the last frame, which the first one lacks.
let isFirst = true;

/** Return the scene after the message with this frame number, as the data URL of a PNG. */
window.takePicture = async (number, seconds) => {
  const deadline = performance.now() + 1e3 * seconds;
  await until(() => document.getElementById('frame')?.textContent === String(number), deadline);
  do { // an image begins to load only when React has put its node into the scene
    await until(() => loading.size === 0, deadline);
    await idle();
  } while (loading.size > 0);
  if (isFirst) window.drawFrame();
  isFirst = false;
  window.drawFrame();
  const canvas = document.querySelector('canvas[data-engine]');
  const blob = await new Promise((resolve) => canvas.toBlob(resolve, 'image/png'));
  return new Promise((resolve) => {
    const reader = new FileReader();
    reader.addEventListener('load', () => resolve(reader.result));
    reader.readAsDataURL(blob);
  });
};
