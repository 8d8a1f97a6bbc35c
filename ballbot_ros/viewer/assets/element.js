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

/** Whether a key is for the element with the focus: a field of text, a slider or a list. */
export function isForFocused({ target, key }) {
  if (!(target instanceof Element)) return false;
  if (target.matches('input:not([readonly]), textarea, select, [contenteditable]')) return true;
  return target.matches('[role="slider"], [readonly]') && /^(Arrow|Home|End|Page)/.test(key);
}
