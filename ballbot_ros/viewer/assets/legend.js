// Values in the legends of plots.

const SMALL = 0.1;
const DIGITS = 3;
const seen = new WeakSet();

/** Show the digits of small values in a chart: uPlot shows three decimals of any value. */
export function showSmallValues(chart) {
  if (seen.has(chart)) return;
  seen.add(chart);
  for (const series of chart.series.slice(1)) {
    const usual = series.value;
    series.value = (self, value, ...where) => {
      const isSmall = value && Math.abs(value) < SMALL;
      return isSmall ? String(Number(value.toPrecision(DIGITS))) : usual(self, value, ...where);
    };
  }
}
