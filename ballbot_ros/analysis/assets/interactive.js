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

  // Whole numbers, of which `PackedNumbers.add_whole` makes two columns.
  function whole(bytes, [high, low]) {
    const lows = column(bytes, low);
    return column(bytes, high).map((each, i) => 32768 * Math.round(each) + Math.round(lows[i]));
  }

  // `Timeline` in processor_figures.py; its data are the intervals within its range.
  function timelineFigure(bytes, { timeline, layout, colors }) {
    const { lane, start, end: length, release: wait, job_end: left } = Object.fromEntries(
      Object.entries(timeline).map(([name, packed]) => [name, whole(bytes, packed)]),
    );
    const isJob = (i) => wait[i] > 0 || left[i] > length[i];
    const words = (i) => `${layout.yaxis.ticktext[lane[i]]}<br>${length[i]} µs from `
      + `${(start[i] * 1e-6).toFixed(6)} s${isJob(i) ? `<br>response ${wait[i] + left[i]} µs` : ''}`;
    const bars = (rows, width, from, lasting) => {
      const color = rows.map((i) => colors[lane[i]]);
      return {
        type: 'bar', orientation: 'h', width, y: rows.map((i) => lane[i]),
        base: rows.map((i) => from(i) * 1e-6), x: rows.map((i) => lasting(i) * 1e-6),
        marker: { color, line: { color, width: 1 } },
        hovertext: rows.map(words), hovertemplate: '%{hovertext}<extra></extra>',
      };
    };
    return {
      range: layout.xaxis.range,
      options: { doubleClick: false },
      get layout() { return { ...layout, xaxis: { ...layout.xaxis, range: this.range } }; },
      get data() {
        const [low, high] = this.range.map((each) => each * 1e6);
        const rows = [...start.keys()].filter(
          (i) => start[i] - wait[i] < high && start[i] + left[i] >= low,
        );
        return [
          bars(rows.filter(isJob), 0.12, (i) => start[i] - wait[i], (i) => wait[i] + left[i]),
          bars(rows, 0.7, (i) => start[i], (i) => length[i]),
        ];
      },
    };
  }

  const LONGEST_TIMELINE_S = 1;

  // The timeline begins where the figures above do, until it is zoomed itself.
  function link(history, timeline, figure, redraw) {
    const first = figure.range;
    const end = history.layout.xaxis.range[1];
    const show = ([low, high], longest) => {
      figure.range = [low, Math.min(high, low + longest)];
      redraw();
    };
    const follow = () => {
      const { range } = history.layout.xaxis;
      show(range[0] <= 0 && range[1] >= end ? first : range, first[1] - first[0]);
    };
    const isZoom = (change) => Object.keys(change).some((key) => key.startsWith('xaxis.'));
    history.on('plotly_relayout', (change) => isZoom(change) && follow());
    timeline.on('plotly_relayout', (change) => (
      isZoom(change) && show(timeline.layout.xaxis.range, LONGEST_TIMELINE_S)
    ));
    timeline.on('plotly_doubleclick', follow);
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
    return Promise.all(Object.entries(figures).map(([id, { data, layout, options }]) => {
      // A finger scrolls the page; the buttons zoom.
      if (layout.height) document.getElementById(id).style.height = `${layout.height}px`;
      const themed = coloured({ data, layout }, colours);
      if (isTouch) themed.layout.dragmode = false;
      const height = document.getElementById(id).clientHeight;
      themed.layout.legend = { ...themed.layout.legend, y: 1 - BUTTONS_PX / height };
      return Plotly.react(id, themed.data, themed.layout, { ...config, ...options });
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
      Object.entries(figures).map(([id, figure]) => [
        id, (figure.timeline ? timelineFigure : unpacked)(bytes, figure),
      ]),
    );
    const scheme = matchMedia('(prefers-color-scheme: dark)');
    const show = (some = drawn) => draw(some, scheme.matches ? dark : {});
    await show();
    scheme.addEventListener('change', () => show());
    addEventListener('beforeprint', () => draw(drawn, {}));
    addEventListener('afterprint', () => show());
    const [history, path, timeline] = ['history', 'path', 'timeline'].map(
      (id) => document.getElementById(id),
    );
    if (path) follow(history, path);
    if (timeline) {
      link(history, timeline, drawn.timeline, () => show({ timeline: drawn.timeline }));
    }
    notice.remove();
  } catch (error) {
    notice.textContent = `The figures cannot be drawn (${error.message}); a newer browser draws them.`;
    throw error;
  }
})();
