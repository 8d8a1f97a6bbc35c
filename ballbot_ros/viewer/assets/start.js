// Runs before viser's page, which takes its colour scheme from the address.
'use strict';

document.documentElement.classList.add('is-connecting');

// The token leaves the address at once, where others may see it; this tab keeps it for reloads.
const query = new URLSearchParams(location.search);
if (query.has('token')) sessionStorage.setItem('token', query.get('token'));
query.delete('token');

const dark = matchMedia('(prefers-color-scheme: dark)');
if (dark.matches) query.set('darkMode', '');
else query.delete('darkMode');
history.replaceState(null, '', query.size ? `?${query}` : location.pathname);
dark.addEventListener('change', () => location.reload());

// viser shows the address that it connects to, which therefore has no token: it is added when the
// address reaches the thread that connects.
const { postMessage } = Worker.prototype;
Worker.prototype.postMessage = function post(message, ...others) {
  const token = sessionStorage.getItem('token');
  const whole = message?.server && token ? { server: `ws://${location.host}/?token=${token}` } : {};
  postMessage.call(this, message?.server ? { ...message, ...whole } : message, ...others);
};

// viser prevents the default of a press that may begin a drag, from a listener that it registers as
// passive; browsers report this as an error.
const addEventListener = EventTarget.prototype.addEventListener;
EventTarget.prototype.addEventListener = function add(type, listener, options) {
  const isPress = type === 'pointerdown' && options?.passive;
  addEventListener.call(this, type, listener, isPress ? { ...options, passive: false } : options);
};
