// The notice above the scene.

import { element } from './element.js';

const LOST = { text: 'connection lost: trying again …', kind: 'busy', details: [], link: '' };

/** Shows a notice, or that the connection is lost. */
export class Banner {
  node = element('div', { className: 'banner', role: 'status', hidden: true });
  #banner = null;
  #isConnected = true;

  setConnected(is) {
    this.#isConnected = is;
    this.#draw();
  }

  /** Show a notice; null hides it. */
  show(banner) {
    this.#banner = banner;
    this.#draw();
  }

  #draw() {
    const banner = this.#isConnected ? this.#banner : LOST;
    this.node.hidden = !banner;
    if (!banner) return;
    this.node.dataset.kind = banner.kind;
    const lines = banner.details.map((line) => element('li', { textContent: line }));
    this.node.replaceChildren(
      element('strong', { textContent: banner.text }),
      ...(lines.length ? [element('ul', {}, lines)] : []),
      ...(banner.link
        ? [element('a', { href: banner.link, target: '_blank', textContent: banner.link_text })]
        : []),
    );
  }
}
