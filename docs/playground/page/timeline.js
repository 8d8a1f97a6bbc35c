// Pitch and duty over the run, above the slider that goes back.

const LEAST_S = 10;
const BANDS = [
  { label: 'pitch', unit: '°', least: 2, values: [['pitchX', 180 / Math.PI], ['pitchY', 180 / Math.PI]] },
  { label: 'duty', unit: '%', least: 20, values: [['dutyX', 1], ['dutyY', 1]] },
];
const PLANES = [{ name: 'forward', colour: '--accent' }, { name: 'sideways', colour: '--other' }];

/** Draw both bands: the ghost below, up to `time` the present run. */
export function draw(canvas, rows, ghost, time) {
  const style = getComputedStyle(canvas);
  const colour = (name) => style.getPropertyValue(name).trim();
  const scale = Math.min(devicePixelRatio, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
  if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
  const context = canvas.getContext('2d');
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  const [start, end] = spanOf(rows, ghost);
  const place = (seconds) => ((seconds - start) / (end - start)) * width;
  let legend = 2;
  const write = (text, colour) => {
    context.fillStyle = colour;
    context.fillText(text, legend, 11);
    legend += context.measureText(`${text} `).width + 4;
  };
  BANDS.forEach(({ label, unit, least, values }, number) => {
    const [top, size] = [(number * height) / 2, height / 2 - 4];
    let most = least;
    for (const run of [rows, ghost]) {
      for (const row of run) for (const [name, factor] of values) most = Math.max(most, Math.abs(row[name]) * factor);
    }
    context.strokeStyle = colour('--edge');
    line(context, [[0, top + size / 2], [width, top + size / 2]]);
    values.forEach(([name, factor], plane) => {
      const points = (run) => outline(run, place, (row) => top + size / 2 - ((row[name] * factor) / most) * (size / 2));
      context.strokeStyle = colour('--ghost');
      line(context, points(ghost));
      context.strokeStyle = colour(PLANES[plane].colour);
      line(context, points(rows));
    });
    context.fillStyle = colour('--ink');
    context.font = '11px system-ui, sans-serif';
    const text = `${label} ±${most.toFixed(most < 10 ? 1 : 0)} ${unit}`;
    context.fillText(text, 2, top + 11);
    legend = Math.max(legend, context.measureText(text).width + 14);
  });
  for (const { name, colour: variable } of PLANES) write(name, colour(variable));
  if (ghost.length) write('before', colour('--ghost'));
  context.strokeStyle = colour('--ink');
  line(context, [[place(time), 0], [place(time), height]]);
}

/** Return the first and the last time of the axis [s]. */
export function spanOf(rows, ghost) {
  const start = rows[0]?.time ?? 0;
  return [start, Math.max(start + LEAST_S, rows.at(-1)?.time ?? 0, ghost.at(-1)?.time ?? 0)];
}

/** Return the lowest and the highest point in each column of pixels, so that nothing is lost. */
function outline(run, place, y) {
  const points = [];
  let column;
  for (const row of run) {
    const [x, height] = [place(row.time), y(row)];
    if (Math.floor(x) !== column) {
      column = Math.floor(x);
      points.push([x, height], [x, height]);
    } else {
      const [low, high] = points.slice(-2);
      low[1] = Math.min(low[1], height);
      high[1] = Math.max(high[1], height);
    }
  }
  return points;
}

function line(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}
