// Runs before viser's page, which takes its colour scheme from the address.
'use strict';

const dark = matchMedia('(prefers-color-scheme: dark)');
const parameters = location.search.slice(1).replace(/(^|&)darkMode=?(?=&|$)/, '').replace(/^&/, '');
// The token stays last: the server looks for it at the end of the address.
const search = [...(dark.matches ? ['darkMode'] : []), ...(parameters ? [parameters] : [])].join('&');
history.replaceState(null, '', search ? `?${search}` : location.pathname);
dark.addEventListener('change', () => location.reload());

// viser prevents the default of a press that may begin a drag, from a listener that it registers as
// passive; browsers report this as an error.
const addEventListener = EventTarget.prototype.addEventListener;
EventTarget.prototype.addEventListener = function add(type, listener, options) {
  const isPress = type === 'pointerdown' && options?.passive;
  addEventListener.call(this, type, listener, isPress ? { ...options, passive: false } : options);
};
