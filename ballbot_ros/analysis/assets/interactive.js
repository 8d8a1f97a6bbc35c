// Draws the interactive figures of a report. Everything is in the page: nothing is requested.
(async () => {
  'use strict';

  const text = (id) => document.getElementById(id).textContent;
  const notice = document.getElementById('figures-notice');
  const EVENT_POINTS = 1000;
  const BUTTONS_PX = 30;

  function inflated(id) {
    const bytes = Uint8Array.from(atob(text(id)), (character) => character.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
    return new Response(stream);
  }

  async function loadPlotly() {
    const script = document.createElement('script');
    script.textContent = await inflated('plotly').text();
    document.head.append(script);
  }

  // The layout of a column is that of `PackedNumbers` in interactive.py.
  function column(bytes, [offset, count, low, high]) {
    const values = new Float64Array(count);
    let steps = 0;
    for (let i = 0; i < count; i++) {
      steps = (steps + bytes[offset + i] + 256 * bytes[offset + count + i]) & 0xffff;
      values[i] = steps === 65535 ? NaN : low + ((high - low) * steps) / 65534;
    }
    return values;
  }

  function curve(bytes, { packed, ...rest }) {
    const columns = Object.entries(packed).map(([key, each]) => [key, column(bytes, each)]);
    return { ...rest, ...Object.fromEntries(columns) };
  }

  // A band of points for each interval, since the hover finds points.
  function events({ intervals }, duration) {
    const step = duration / EVENT_POINTS;
    return intervals.map(([start, end, lane, color, words]) => {
      const count = Math.max(2, Math.ceil((end - start) / step) + 1);
      const x = Array.from({ length: count }, (_, i) => start + ((end - start) * i) / (count - 1));
      return {
        type: 'scatter', mode: 'lines', x, y: x.map(() => lane), yaxis: 'y', showlegend: false,
        line: { color, width: 14 }, hovertemplate: `${words}<extra></extra>`,
      };
    });
  }

  function unpacked(bytes, { data, layout }) {
    const duration = layout.xaxis.range ? layout.xaxis.range[1] : 0;
    const traces = data.flatMap((trace) => {
      if (trace.intervals) return events(trace, duration);
      return trace.packed ? [curve(bytes, trace)] : [trace];
    });
    return { data: traces, layout };
  }

  function coloured(value, colours) {
    if (typeof value === 'string') return colours[value] ?? value;
    if (Array.isArray(value)) return value.map((each) => coloured(each, colours));
    if (value === null || typeof value !== 'object' || ArrayBuffer.isView(value)) return value;
    return Object.fromEntries(
      Object.entries(value).map(([key, each]) => [key, coloured(each, colours)]),
    );
  }

  const isTouch = matchMedia('(pointer: coarse)').matches;
  const config = {
    responsive: true, displaylogo: false, displayModeBar: isTouch || 'hover',
    modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d'],
    toImageButtonOptions: { scale: 2 },
  };

  function draw(figures, colours) {
    return Promise.all(Object.entries(figures).map(([id, { data, layout }]) => {
      // A finger scrolls the page; the buttons zoom.
      if (layout.height) document.getElementById(id).style.height = `${layout.height}px`;
      const themed = coloured({ data, layout }, colours);
      if (isTouch) themed.layout.dragmode = false;
      const height = document.getElementById(id).clientHeight;
      themed.layout.legend = { ...themed.layout.legend, y: 1 - BUTTONS_PX / height };
      return Plotly.react(id, themed.data, themed.layout, config);
    }));
  }

  // The ball on the track where the hover is in time.
  function follow(history, path) {
    const track = path.data.findIndex((trace) => trace.name === 'track');
    const cursor = path.data.findIndex((trace) => trace.name === 'ball');
    if (cursor < 0) return; // of several tracks
    const { x, y, customdata: times } = path.data[track];
    history.on('plotly_hover', ({ xvals, points }) => {
      const time = points[0]?.x ?? xvals[0];
      let row = times.findIndex((each) => each >= time);
      if (row < 0) row = times.length - 1;
      Plotly.restyle(path, { x: [[x[row]]], y: [[y[row]]] }, [cursor]);
    });
    history.on('plotly_unhover', () => Plotly.restyle(path, { x: [[]], y: [[]] }, [cursor]));
  }

  try {
    const [bytes, { figures, dark }] = await Promise.all([
      inflated('numbers').arrayBuffer().then((buffer) => new Uint8Array(buffer)),
      inflated('description').json(),
      loadPlotly(),
    ]);
    const drawn = Object.fromEntries(
      Object.entries(figures).map(([id, figure]) => [id, unpacked(bytes, figure)]),
    );
    const scheme = matchMedia('(prefers-color-scheme: dark)');
    const show = () => draw(drawn, scheme.matches ? dark : {});
    await show();
    scheme.addEventListener('change', show);
    addEventListener('beforeprint', () => draw(drawn, {}));
    addEventListener('afterprint', show);
    const path = document.getElementById('path');
    if (path) follow(document.getElementById('history'), path);
    notice.remove();
  } catch (error) {
    notice.textContent = `The figures cannot be drawn (${error.message}); a newer browser draws them.`;
    throw error;
  }
})();
