// Interactive figures: uPlot draws them, and the number at the pointer is shown beside it.
const THIN = 100; // pixels: the percentiles of a bin with fewer are unreliable

/**
 * A figure in `place`: `lines` of { values, stroke, dash, width, points, hidden }, `bands` of [upper, lower, fill], by place among the lines.
 * `hoverText(i)` returns the content of the hover box at the i-th x; `clicked(i)` is called on a click there.
 */
function figure(place, { x, lines, bands = [], height = 340, xLabel, yLabel, yRange, xRange, log = false, hoverText, clicked, sync, bars = false, whole = false }) {
  place.replaceChildren();
  const quiet = () => colourOf("--quiet"), grid = () => colourOf("--line") + "88";
  const axis = (text, size) => ({ label: text, labelSize: 22, size, stroke: quiet, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 5 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" });
  const hover = el("div", { className: "hover", hidden: true });
  const values = (_, ticks) => ticks.map((tick) => (tick === null ? "" : String(+tick.toPrecision(6))));
  const options = {
    width: Math.max(280, place.clientWidth), height,
    scales: {
      x: { time: false, ...(xRange ? { range: (u, min, max) => (u.zoomed ? [min, max] : xRange) } : {}) },
      y: { ...(log ? { distr: 3 } : {}), ...(yRange ? { range: () => yRange } : {}) },
    },
    legend: { show: false },
    cursor: { drag: { x: true, y: false, setScale: true }, points: { show: !bars, size: 7 }, ...(sync ? { sync: { key: sync, setSeries: false } } : {}) },
    axes: [{ ...axis(xLabel, 46), values, ...(whole ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 1e4, 2e4, 5e4, 1e5, 1e6] } : {}) }, { ...axis(yLabel, 62), ...(log ? {} : { values }) }],
    series: [{}, ...lines.map((line) => ({
      stroke: line.stroke, width: line.width ?? 2, dash: line.dash, spanGaps: line.spanGaps ?? false, fill: line.fill,
      points: line.points ?? { show: false }, ...(bars ? { paths: uPlot.paths.bars({ size: [1, 200], align: 0 }) } : {}),
    }))],
    bands: bands.map(([upper, lower, fill]) => ({ series: [upper + 1, lower + 1], fill })),
    hooks: {
      setCursor: [(u) => {
        const i = u.cursor.idx;
        if (i === null || i === undefined || u.cursor.left < 0 || !hoverText) return void (hover.hidden = true);
        const inner = hoverText(i);
        if (!inner) return void (hover.hidden = true);
        hover.replaceChildren(inner);
        hover.hidden = false;
        const left = u.cursor.left + u.over.offsetLeft, room = place.clientWidth;
        hover.style.top = "8px";
        hover.style.left = left > room / 2 ? "" : `${left + 14}px`;
        hover.style.right = left > room / 2 ? `${room - left + 14}px` : "";
      }],
      setSelect: [(u) => { u.zoomed = u.select.width > 0; }],
    },
  };
  const plot = new uPlot(options, [x, ...lines.map((line) => line.values)], place);
  plot.over.addEventListener("dblclick", () => reset());
  place.append(hover);
  const reset = () => {
    plot.zoomed = false;
    plot.setScale("x", xRange ? { min: xRange[0], max: xRange[1] } : { min: x[0], max: x[x.length - 1] });
  };
  const zoom = (factor) => {
    const { min, max } = plot.scales.x, middle = (min + max) / 2, half = ((max - min) / 2) * factor;
    const [from, to] = [Math.max(xRange ? xRange[0] : x[0], middle - half), Math.min(xRange ? xRange[1] : x[x.length - 1], middle + half)];
    plot.zoomed = true;
    if (to > from) plot.setScale("x", { min: from, max: to });
  };
  if (clicked) {
    let down = 0;
    plot.over.addEventListener("mousedown", (event) => { down = event.clientX; });
    plot.over.addEventListener("click", (event) => { if (Math.abs(event.clientX - down) < 4 && plot.cursor.idx !== null) clicked(plot.cursor.idx); });
    plot.over.style.cursor = "pointer";
  }
  const resized = new ResizeObserver(() => { if (place.isConnected && place.clientWidth > 0) plot.setSize({ width: place.clientWidth, height }); });
  resized.observe(place);
  const redraw = () => plot.redraw();
  themed.push(redraw);
  return { plot, reset, zoom, gone: () => { resized.disconnect(); themed.splice(themed.indexOf(redraw), 1); plot.destroy(); } };
}

const zoomButtons = (now) => [
  el("button", { type: "button", onclick: () => now().zoom(0.5) }, "zoom in"),
  el("button", { type: "button", onclick: () => now().zoom(2) }, "zoom out"),
  el("button", { type: "button", onclick: () => now().reset() }, "reset zoom"),
];

/** A table in the hover box. */
const hoverTable = (title, head, rows) => el("div", {}, el("b", {}, title), el("table", {}, el("thead", {}, el("tr", {}, head.map((text) => el("th", {}, text)))), el("tbody", {}, rows)));

/** The initially selected estimates: all if there are few; else those that all variants share, then the best of each name by the table's first error metric, then the next best. */
const FEW = 7;
function atFirst(places) {
  if (places.length <= FEW) return places;
  const metrics = D.table?.metrics ?? [], error = metrics.findIndex((metric) => !metric.more), by = Math.max(0, error);
  const value = (place) => {
    const of = D.estimates[place], row = D.table?.rows.find((row) => row.stage === of.stage && row.variant === of.variant && row.estimate === of.name && row.set === of.set);
    const mean = row?.means[by] ?? null;
    return mean === null ? Infinity : metrics[by].more ? -mean : mean;
  };
  const shared = places.filter((place) => D.estimates[place].variant === null);
  const ranked = places.filter((place) => !shared.includes(place)).map((place) => [value(place), place]).sort((a, b) => (a[0] === b[0] ? a[1] - b[1] : a[0] - b[0]));
  // The best of each name first, because the best few of one method are often similar.
  const isFirst = ([, place], i) => ranked.findIndex(([, other]) => D.estimates[other].name === D.estimates[place].name) === i;
  const others = [...ranked.filter(isFirst), ...ranked.filter((one, i) => !isFirst(one, i))];
  const chosen = new Set([...shared, ...others.map(([, place]) => place)].slice(0, Math.max(5, Math.min(shared.length + 1, FEW))));
  return places.filter((place) => chosen.has(place));
}
const tickedAtFirst = (places) => (places.length <= FEW ? "" : ` Initially selected: estimates that all variants share, and the best by ${(D.table?.metrics.find((metric) => !metric.more) ?? D.table?.metrics[0])?.name ?? "their position"}.`);

const named = (place) => ({ key: place, inner: [swatch(D.estimates[place]), D.estimates[place].label] });

function distanceFigure() {
  const all = D.distances.estimates;
  if (!all.length) return without("distance");
  const by = new Map(all.map((of) => [of.estimate, of]));
  const anyCommon = all.some((of) => of.common.count.some((count) => count > 0));
  const state = { set: anyCommon ? "common" : "valid", on: new Set(atFirst([...by.keys()])), wide: false, bands: true, log: false, figure: null, counts: null };
  const plot = el("div", { className: "plot", id: "distance-plot" }), histogram = el("div", { className: "plot", id: "distance-counts" });
  const truth = new Map(D.distances.truth);
  const metres = [...new Set([...truth.keys(), ...all.flatMap((of) => of.metres)])].sort((a, b) => a - b);
  const x = metres.map((metre) => metre + 0.5);
  const xRange = [metres[0], metres[metres.length - 1] + 1];
  const at = new Map(all.map((of) => [of.estimate, new Map(of.metres.map((metre, i) => [metre, i]))]));
  const count = (place, metre) => { const i = at.get(place).get(metre); return i === undefined ? 0 : by.get(place)[state.set].count[i]; };
  const value = (place, percentile, metre) => { const i = at.get(place).get(metre); return i === undefined ? null : by.get(place)[state.set].percentiles[percentile][i]; };
  const show = () => {
    const on = [...by.keys()].filter((place) => state.on.has(place));
    const most = Math.max(0, ...on.flatMap((place) => metres.map((metre) => count(place, metre))));
    const thin = (place, metre) => most > 10 * THIN && count(place, metre) < THIN;
    const lines = [], bands = [];
    let middle = 0, low = Infinity;
    const tops = [];
    for (const place of on) {
      const of = D.estimates[place], first = lines.length;
      const column = (percentile, keep) => metres.map((metre) => { const number = value(place, percentile, metre); return number === null || !keep(metre) || (state.log && number <= 0) ? null : number; });
      const sure = (metre) => !thin(place, metre);
      for (const percentile of [0, 1, 3, 4]) lines.push({ values: column(percentile, sure), stroke: "transparent", width: 0 });
      lines.push({ values: column(2, sure), stroke: of.colour, dash: of.dash });
      lines.push({ values: column(2, (metre) => !sure(metre)), stroke: of.colour, width: 0, points: { show: true, size: 6, stroke: of.colour, fill: () => colourOf("--ground") } });
      if (state.bands && state.wide) bands.push([first + 3, first, faint(of.colour, 0.12)]);
      if (state.bands) bands.push([first + 2, first + 1, faint(of.colour, 0.22)]);
      const top = state.bands ? (state.wide ? 4 : 3) : 2;
      for (const metre of metres) {
        if (!sure(metre)) continue;
        tops.push(value(place, top, metre) ?? 0);
        middle = Math.max(middle, value(place, 2, metre) ?? 0);
        const bottom = value(place, state.bands ? (state.wide ? 0 : 1) : 2, metre);
        if (bottom > 0) low = Math.min(low, bottom);
      }
    }
    // The range covers all lines, and all bands except those of few bins: an extreme one would flatten the others.
    tops.sort((a, b) => a - b);
    const high = Math.max(middle, tops[Math.floor(0.97 * (tops.length - 1))] ?? 0);
    const hoverText = (i) => {
      const metre = metres[i];
      const rows = on.filter((place) => count(place, metre) > 0).map((place) => el("tr", {},
        el("td", { className: "text" }, swatch(D.estimates[place]), " ", D.estimates[place].label),
        [2, 1, 3, 0, 4].map((percentile) => el("td", {}, short(value(place, percentile, metre), 3))),
        el("td", {}, count(place, metre).toLocaleString("en"), thin(place, metre) ? " (few)" : "")));
      return hoverTable(`ground-truth distance ${metre} to ${metre + 1} m: ${(truth.get(metre) ?? 0).toLocaleString("en")} pixels with ground truth`, ["|error| in m", "median", "25 %", "75 %", "5 %", "95 %", "pixels"], rows);
    };
    const zoomed = state.figure?.plot.zoomed ? { ...state.figure.plot.scales.x } : null;
    state.figure?.gone();
    state.counts?.gone();
    const yRange = state.log ? [Math.max(low === Infinity ? 0.01 : low, high / 1e5 || 0.01), Math.max(high, 0.02)] : [0, (high || 1) * 1.04];
    state.figure = figure(plot, { x, lines, bands, height: 360, xLabel: "ground-truth distance, m", yLabel: "|error|, m", yRange, xRange, log: state.log, hoverText, sync: "distance" });
    const counts = metres.map((metre) => truth.get(metre) ?? 0);
    state.counts = figure(histogram, { x, lines: [{ values: counts, stroke: "#8d99ae", fill: "#8d99ae66", width: 1 }], height: 130, xLabel: "ground-truth distance, m", yLabel: "pixels with ground truth", xRange, yRange: [0, Math.max(1, ...counts) * 1.05], bars: true, sync: "distance", hoverText: (i) => el("span", {}, `${metres[i]} to ${metres[i] + 1} m: ${counts[i].toLocaleString("en")} pixels with ground truth`) });
    if (zoomed) [state.figure, state.counts].forEach((of) => { of.plot.zoomed = true; of.plot.setScale("x", { min: zoomed.min, max: zoomed.max }); });
  };
  const box = (text, name) => label(text, el("input", { type: "checkbox", checked: state[name], onchange: (event) => { state[name] = event.target.checked; show(); } }));
  const both = () => ({ zoom: (factor) => [state.figure, state.counts].forEach((of) => of.zoom(factor)), reset: () => [state.figure, state.counts].forEach((of) => of.reset()) });
  byId("distance-body").append(
    el("p", { className: "quiet" }, `The absolute error per metre of ground-truth distance. Line: median; band: 25 to 75 %. A hollow dot marks a bin of fewer than ${THIN} pixels. Drag to zoom, double-click to reset the zoom.${D.estimates_in_all > D.estimates.length ? ` Shown: ${D.estimates.length} of ${D.estimates_in_all} estimates (those that all variants share, and the best by ${D.table.metrics[0].name}); error_vs_distance.csv contains all.` : ""}${tickedAtFirst([...by.keys()])}`),
    ticks("estimates", [...by.keys()].map(named), state.on, (on) => { state.on = on; show(); }),
    el("div", { className: "controls" },
      anyCommon ? label("pixels", choose([["common", "pixels that are valid in all estimates"], ["valid", "valid pixels of each estimate"]], state.set, (set) => { state.set = set; show(); })) : "Each estimate is evaluated on its own valid pixels, so the pixel sets differ.",
      box("25 to 75 %", "bands"), box("also 5 to 95 %", "wide"), box("logarithmic", "log"), zoomButtons(both)),
    plot, histogram);
  show();
}

function frameFigure() {
  const parts = D.scores.filter((part) => part.lines.length);
  if (!parts.length) return without("by-frame");
  const state = { part: parts[0], metric: null, set: null, on: new Set(), figure: null };
  const plot = el("div", { className: "plot", id: "by-frame-plot" }), controls = el("div"), hint = el("p", { className: "quiet" });
  const lines = () => state.part.lines.filter((line) => line.set === state.set && state.on.has(line.estimate) && line.values[state.metric]);
  const show = () => {
    const part = state.part, shown = lines();
    state.figure?.gone();
    const points = { show: part.positions.length <= 120, size: 5 };
    const x = part.positions;
    state.figure = figure(plot, {
      x, height: 300, whole: true, xLabel: "frame, by position", yLabel: [plainOf(state.metric), unitOf(state.metric)].filter(Boolean).join(", "),
      xRange: [x[0] - 0.5, x[x.length - 1] + 0.5],
      lines: shown.map((line) => ({ values: line.values[state.metric], stroke: D.estimates[line.estimate].colour, dash: D.estimates[line.estimate].dash, width: 1.5, points })),
      hoverText: (i) => hoverTable(`${part.ids[i]} (position ${x[i]})`, ["", plainOf(state.metric), "pixels"], shown.map((line) => el("tr", {}, el("td", { className: "text" }, swatch(D.estimates[line.estimate]), " ", D.estimates[line.estimate].label), el("td", {}, short(line.values[state.metric][i])), el("td", {}, line.pixels[i]?.toLocaleString("en") ?? "–")))),
      clicked: (i) => goTo(part.run, x[i]),
    });
    hint.textContent = `Click a frame to show its images. Drag to zoom, double-click to reset the zoom.${part.positions.length < part.frames ? ` Shown: ${part.positions.length} of ${part.frames.toLocaleString("en")} frames; scores.csv contains all.` : ""}`;
  };
  const setUp = () => {
    const part = state.part;
    const metrics = [...new Set(part.lines.flatMap((line) => Object.keys(line.values)))];
    const sets = [...new Set(part.lines.map((line) => line.set))];
    state.metric = metrics.includes(state.metric) ? state.metric : metrics.includes("abs_rel") ? "abs_rel" : metrics[0];
    state.set = sets.includes(state.set) ? state.set : sets.includes("all") ? "all" : sets[0];
    const places = [...new Set(part.lines.map((line) => line.estimate))];
    state.on = new Set(atFirst(places));
    controls.replaceChildren(
      ticks("estimates", places.map(named), state.on, (on) => { state.on = on; show(); }),
      el("div", { className: "controls" },
        parts.length > 1 ? label("stage", choose(parts.map((of) => [of.name, of.name]), part.name, (name) => { state.part = parts.find((of) => of.name === name); setUp(); })) : null,
        label("metric", choose(metrics.map((name) => [name, plainOf(name)]), state.metric, (metric) => { state.metric = metric; show(); })),
        sets.length > 1 ? label("pixel set", choose(sets.map((set) => [set, set]), state.set, (set) => { state.set = set; show(); })) : null,
        zoomButtons(() => state.figure)));
    show();
  };
  byId("by-frame-body").append(hint, controls, plot);
  setUp();
}

function learningFigures() {
  if (!D.curves.length) return without("learning");
  for (const curve of D.curves) {
    const numbers = [...curve.loss, ...curve.validation].filter((number) => number !== null);
    if (!numbers.length) continue;
    const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
    const state = { log: low > 0 && high > 10 * low, figure: null };
    const plot = el("div", { className: "plot" });
    const validated = curve.validation.some((number) => number !== null);
    const show = () => {
      state.figure?.gone();
      state.figure = figure(plot, {
        x: curve.step, height: 260, whole: true, xLabel: "step", yLabel: "loss", log: state.log, xRange: [0, curve.step[curve.step.length - 1] || 1],
        lines: [
          { values: curve.loss, stroke: "#0077bb", points: { show: curve.loss.length < 40, size: 5 } },
          ...(validated ? [{ values: curve.validation, stroke: "#cc3311", spanGaps: true, points: { show: true, size: 5 } }] : []),
        ],
        hoverText: (i) => el("span", {}, `step ${curve.step[i].toLocaleString("en")}: loss ${short(curve.loss[i])}${curve.validation[i] === null ? "" : `, validation ${short(curve.validation[i])}`}`),
      });
    };
    const key = (colour, text) => el("span", {}, el("span", { className: "swatch", style: { borderTopColor: colour, marginRight: ".4em", verticalAlign: "middle" } }), text);
    byId("learning-body").append(el("h3", {}, curve.label), el("div", { className: "controls" }, key("#0077bb", "training"), validated ? key("#cc3311", "validation") : null,
      low > 0 ? label("logarithmic", el("input", { type: "checkbox", checked: state.log, onchange: (event) => { state.log = event.target.checked; show(); } })) : null, zoomButtons(() => state.figure)), plot);
    show();
  }
}
