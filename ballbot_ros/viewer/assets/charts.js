// The charts of viser's plots.

const enlarged = new Set();

/** viser registers its plots for tests of its own, except enlarged ones. */
function registered() {
  return Object.values(window.__viserTestpoints?.uplots ?? {}).map(({ chart }) => chart);
}

/** Find the enlarged charts: they share the cursor with the others, which see whose it is. */
function findEnlarged(small) {
  const isSmall = new Set(small);
  for (const { cursor } of small) {
    cursor.sync.filters.sub = (_, chart) => {
      if (!isSmall.has(chart)) enlarged.add(chart);
      return true;
    };
  }
  const known = new Set([...small, ...enlarged].map(({ over }) => over));
  for (const over of document.querySelectorAll('.u-over')) {
    if (!known.has(over)) over.dispatchEvent(new MouseEvent('mouseleave'));
  }
}

/** Return all charts on the page. */
export function charts() {
  const small = registered();
  for (const chart of enlarged) if (!chart.root.isConnected) enlarged.delete(chart);
  findEnlarged(small);
  return [...small, ...enlarged];
}
