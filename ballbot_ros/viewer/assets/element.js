/** Create an element with properties, which may include `dataset` and `style`, and children. */
export function element(tag, properties = {}, children = []) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === 'dataset' || name === 'style') Object.assign(node[name], value);
    else if (name === 'role' || name.startsWith('aria-')) node.setAttribute(name, value);
    else node[name] = value;
  }
  node.append(...children);
  return node;
}

/** Whether a key event belongs to a field in which the user types. */
export function isTyping(event) {
  return event.target instanceof Element && event.target.matches('input, textarea, select, [contenteditable]');
}
