// Runs before viser's page, which takes its colour scheme from the address.
'use strict';

const dark = matchMedia('(prefers-color-scheme: dark)');
const parameters = location.search.slice(1).replace(/(^|&)darkMode=?(?=&|$)/, '').replace(/^&/, '');
// The token stays last: the server looks for it at the end of the address.
const search = [...(dark.matches ? ['darkMode'] : []), ...(parameters ? [parameters] : [])].join('&');
history.replaceState(null, '', search ? `?${search}` : location.pathname);
dark.addEventListener('change', () => location.reload());
