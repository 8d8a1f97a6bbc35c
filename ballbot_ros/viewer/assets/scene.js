/** Keep an element exactly over the scene, whose canvas appears and changes its size. */
export function followScene(node) {
  const place = (canvas) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    Object.assign(node.style, {
      left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px`,
    });
    node.classList.toggle('is-narrow', width < 560);
  };
  const attach = () => {
    const canvas = document.querySelector('#root canvas');
    if (!canvas) return false;
    new ResizeObserver(() => place(canvas)).observe(canvas);
    addEventListener('resize', () => place(canvas));
    return true;
  };
  if (attach()) return;
  const observer = new MutationObserver(() => attach() && observer.disconnect());
  observer.observe(document.body, { childList: true, subtree: true });
}

/** Call a function once the page has drawn the robot. */
export function whenDrawn(act) {
  // The table of the panel appears with the first state of the robot, next to it in the scene.
  const isShown = document.querySelector('#root canvas') && document.querySelector('#root table');
  requestAnimationFrame(isShown ? () => requestAnimationFrame(act) : () => whenDrawn(act));
}
