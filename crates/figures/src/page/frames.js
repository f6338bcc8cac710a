// Frames: linked views of image, maps and errors, and the values of the pixel under the pointer.

/** What stands between two colours, by a polynomial: turbo (Anton Mikhailov, Google, Apache-2.0), and magma (Matt Zucker's fit, CC0). */
const poly = (terms, t) => terms.reduceRight((sum, term) => sum * t + term, 0);
const TURBO = [[0.13572138, 4.6153926, -42.66032258, 132.13108234, -152.94239396, 59.28637943], [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604], [0.1066733, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973]];
const MAGMA = [[-0.002136485, 0.251660541, 8.353717279, -27.66873309, 52.17613981, -50.76852536, 18.65570507], [-0.000749655, 0.677523243, -3.577719514, 14.26473078, -27.94360607, 29.04658282, -11.48977352], [-0.005386128, 2.494026599, 0.31446790, -13.64921319, 12.94416944, 4.23415300, -5.601961508]];
const colours = (terms) => Uint32Array.from({ length: 256 }, (_, i) => {
  const [r, g, b] = terms.map((of) => Math.max(0, Math.min(255, Math.round(255 * poly(of, i / 255)))));
  return (255 << 24) | (b << 16) | (g << 8) | r;
});
const LOOKS = { turbo: colours(TURBO), magma: colours(MAGMA), grey: Uint32Array.from({ length: 256 }, (_, i) => (255 << 24) | (i << 16) | (i << 8) | i) };
const KEPT = 192e6; // bytes of decoded maps

const CONDITION = /^([\w.]+)\s*(<=|>=|!=|==?|<|>)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)$/i;
const COMPARISONS = { "<": (a, b) => a < b, ">": (a, b) => a > b, "<=": (a, b) => a <= b, ">=": (a, b) => a >= b, "=": (a, b) => a === b, "==": (a, b) => a === b, "!=": (a, b) => a !== b };

let goTo = () => {};

/** A picture of its base64, with its bytes as they are. */
function bitmapOf(text, type) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = raw.charCodeAt(i);
  return createImageBitmap(new Blob([bytes], { type }), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}

/** A map of its PNG: see maps.rs. */
async function decoded(line) {
  const [width, height, fullWidth, fullHeight, png] = line.split(" ");
  const [w, h] = [+width, +height], n = w * h;
  const bitmap = await bitmapOf(png, "image/png");
  const context = new OffscreenCanvas(w, bitmap.height).getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  const { data } = context.getImageData(0, 0, w, bitmap.height);
  bitmap.close();
  const codes = new Uint16Array(n), there = new Uint8Array(Math.ceil(n / 8));
  for (let i = 0; i < n; i++) codes[i] = data[4 * i] | (data[4 * (n + i)] << 8);
  for (let i = 0; i < there.length; i++) there[i] = data[4 * (2 * n + i)];
  return { w, h, full: [+fullWidth, +fullHeight], codes, there, bytes: 3 * n };
}

const numberAt = (map, scale, i) => ((map.there[i >> 3] >> (i & 7)) & 1 ? (scale.log ? scale.from * Math.exp(scale.step * map.codes[i]) : scale.from + scale.step * map.codes[i]) : null);

/** All numbers of a scale, by their code. */
const tables = new Map();
function numbersOf(scale) {
  const key = `${scale.log} ${scale.from} ${scale.step}`;
  if (!tables.has(key)) tables.set(key, Float32Array.from({ length: 65536 }, (_, code) => (scale.log ? scale.from * Math.exp(scale.step * code) : scale.from + scale.step * code)));
  return tables.get(key);
}

const UNITS = { depth: "m", disparity: "px", "ground-truth-disparity": "px", weight: "", mask: "" };
const isDisparity = (layer) => layer.type === "disparity" || layer.type === "ground-truth-disparity";

function frameViews() {
  const parts = D.pictures.filter((part) => part.frames.length);
  if (!parts.length) {
    byId("frames-body").append(el("p", { className: "quiet" }, "No map was recorded; `record:` in the experiment selects the recorded outputs."));
    return;
  }
  if (!("OffscreenCanvas" in window)) {
    byId("frames-body").append(el("p", { className: "note" }, "This browser cannot show the images: it does not support OffscreenCanvas. Use a browser of 2023 or later."));
    return;
  }
  // What was scored is looked at first.
  const first = parts.find((part) => D.scores.some((of) => of.run === part.run)) ?? parts[0];
  const kept = new Map();
  let keptBytes = 0;
  const state = { part: first, place: 0, visible: [], views: [], at: null, zoom: 1, pan: [0, 0], relative: false, wanted: 0, busy: false, drawn: 0 };
  const box = byId("frames-body");
  const range = el("input", { type: "range", id: "slider", min: 0, step: 1, ariaLabel: "frame" });
  const told = el("output", { id: "frame-name", htmlFor: "slider" });
  const grid = el("div", { className: "views", id: "views" });
  const values = el("tbody"), place = el("p", { className: "quiet", id: "pixel" }), bars = el("div", { className: "bars" });
  const jump = el("div"), which = el("div"), wrong = el("div");

  // What there is of a frame: the lines of its element, which may not have come yet.
  const linesOf = (part, frame) => {
    const element = byId(`p${D.pictures.indexOf(part)}-${frame.position}`);
    const isWhole = element && (element.nextSibling || document.readyState !== "loading");
    return isWhole ? element.textContent.split("\n") : null;
  };
  const lines = new Map();
  const line = (part, frame, layer) => {
    const key = `${part.run}-${frame.position}`;
    if (!lines.has(key)) {
      const found = linesOf(part, frame);
      if (!found) return undefined;
      lines.set(key, found);
      if (lines.size > 12) lines.delete(lines.keys().next().value);
    }
    return lines.get(key)[layer] || null;
  };
  /** A map or an image of a frame; null: the frame has no such map; undefined: not loaded yet. */
  const value = (part, frame, layer) => {
    const key = `${part.run}-${frame.position}-${layer}`;
    if (kept.has(key)) {
      const found = kept.get(key);
      kept.delete(key); // the most recently used one is removed last
      kept.set(key, found);
      return found;
    }
    const text = line(part, frame, layer);
    if (!text) return text;
    const made = text[0] === "j" ? picture(text.slice(1)) : decoded(text);
    kept.set(key, made);
    made.then((of) => {
      keptBytes += of.bytes;
      for (const [old, promise] of kept) {
        if (keptBytes <= KEPT) break;
        kept.delete(old);
        promise.then((gone) => { keptBytes -= gone.bytes; gone.bitmap?.close(); });
      }
    });
    return made;
  };
  const picture = async (text) => {
    const bitmap = await bitmapOf(text, "image/jpeg");
    return { bitmap, w: bitmap.width, h: bitmap.height, bytes: 4 * bitmap.width * bitmap.height };
  };

  // The views there can be of a stage run: its maps, and the errors of its estimates.
  const viewsOf = (part) => {
    const views = [];
    part.layers.forEach((layer, i) => {
      if (!layer.there) return;
      const name = layer.labels.length ? `${layer.labels.slice(0, 3).join(", ")}${layer.labels.length > 3 ? " …" : ""}` : layer.name;
      views.push({ key: `m${i}`, layer: i, name, title: layer.name, kind: layer.role === "image" ? "image" : layer.type });
      if (layer.truth !== null && layer.truth !== undefined) views.push({ key: `e${i}`, layer: i, truth: layer.truth, name: `error of ${name}`, title: `|estimate − ground truth| of ${layer.name}`, kind: "error" });
    });
    return views;
  };
  const shownAtFirst = (views, part) => {
    const role = (view) => part.layers[view.layer].role;
    const keys = [views.find((view) => role(view) === "image"), views.find((view) => role(view) === "truth")].filter(Boolean).map((view) => view.key);
    const estimates = views.filter((view) => role(view) === "estimate" && view.kind !== "error").slice(0, 4);
    estimates.forEach((view) => { keys.push(view.key); const error = views.find((of) => of.kind === "error" && of.layer === view.layer); if (error) keys.push(error.key); });
    if (!estimates.length) keys.push(...views.filter((view) => !keys.includes(view.key)).slice(0, 4).map((view) => view.key));
    return keys;
  };

  // Colours: the same range on all frames, that of the ground truth if there is any; errors always have the same range.
  const errorRange = (layer) => (state.relative ? [0.01, 1] : isDisparity(layer) ? [0.1, 20] : [0.05, 20]);
  const isShare = (kind) => kind === "weight" || kind === "mask";
  const rangeOf = (kind) => (isShare(kind) ? [0, 1] : state.part.colours[kind]);
  const looks = new Map();
  /** The colour of each code. */
  const lookOf = (kind, scale) => {
    const [from, to] = rangeOf(kind) ?? [0, 1];
    const key = `${kind} ${scale.log} ${scale.step} ${from} ${to}`;
    if (!looks.has(key)) {
      if (looks.size > 40) looks.clear();
      const table = isShare(kind) ? LOOKS.grey : LOOKS.turbo;
      const near = kind !== "depth"; // what is near is red, as is a large disparity
      const look = new Uint32Array(65536), numbers = numbersOf(scale);
      const map = scale.log ? Math.log : (number) => number;
      const [a, b] = [map(Math.max(from, 1e-6)), map(to)];
      for (let code = 0; code < 65536; code++) {
        const share = Math.max(0, Math.min(1, (map(numbers[code]) - (scale.log ? a : from)) / ((scale.log ? b - a : to - from) || 1)));
        look[code] = table[Math.round(255 * (near ? share : 1 - share))];
      }
      looks.set(key, look);
    }
    return looks.get(key);
  };

  const paint = (view, map, truth) => {
    const layer = state.part.layers[view.layer], canvas = view.canvas;
    if (canvas.width !== map.w || canvas.height !== map.h) { canvas.width = map.w; canvas.height = map.h; view.data = null; }
    const context = (view.context ??= canvas.getContext("2d"));
    if (map.bitmap) return void context.drawImage(map.bitmap, 0, 0);
    view.data ??= context.createImageData(map.w, map.h);
    const out = (view.pixels = view.data === view.of ? view.pixels : new Uint32Array(view.data.data.buffer));
    view.of = view.data;
    const { codes, there } = map, n = codes.length;
    if (view.kind === "error") {
      const other = state.part.layers[view.truth];
      const estimates = numbersOf(layer.scale), truths = numbersOf(other.scale), table = LOOKS.magma;
      const [from, to] = errorRange(layer), a = Math.log(from), k = 255 / (Math.log(to) - a), relative = state.relative;
      for (let i = 0; i < n; i++) {
        const byte = i >> 3, bit = 1 << (i & 7);
        if (!(there[byte] & truth.there[byte] & bit)) { out[i] = 0; continue; }
        const t = truths[truth.codes[i]];
        let error = Math.abs(estimates[codes[i]] - t);
        if (relative) error /= t;
        const share = k * (Math.log(error) - a);
        out[i] = table[share <= 0 ? 0 : share >= 255 ? 255 : share | 0];
      }
    } else {
      const look = lookOf(view.kind, layer.scale);
      for (let i = 0; i < n; i++) out[i] = (there[i >> 3] >> (i & 7)) & 1 ? look[codes[i]] : 0;
    }
    context.putImageData(view.data, 0, 0);
  };

  const colourBars = () => {
    const one = (text, table, from, to) => {
      const canvas = el("canvas", { width: 256, height: 1 }), context = canvas.getContext("2d"), data = context.createImageData(256, 1);
      new Uint32Array(data.data.buffer).set(table);
      context.putImageData(data, 0, 0);
      return el("span", {}, `${text}: ${from}`, canvas, to);
    };
    const kinds = [...new Set(state.views.map((view) => view.kind))];
    const pieces = kinds.flatMap((kind) => {
      const found = rangeOf(kind);
      if (kind === "error") {
        const layer = state.part.layers[state.views.find((view) => view.kind === "error").layer], [from, to] = errorRange(layer);
        return [one("error, logarithmic", LOOKS.magma, state.relative ? `${100 * from} %` : `${from} ${UNITS[layer.type]}`, state.relative ? `${100 * to} %` : `${to} ${UNITS[layer.type]}`)];
      }
      if (!found) return [];
      if (kind === "depth") return [one("depth, logarithmic", LOOKS.turbo, `${short(found[1], 3)} m`, `${short(found[0], 3)} m`)];
      if (isDisparity({ type: kind })) return [one(kind, LOOKS.turbo, `${short(found[0], 3)} px`, `${short(found[1], 3)} px`)];
      return [one(kind, LOOKS.grey, "0", "1")];
    });
    bars.replaceChildren(...pieces, el("span", {}, "invalid pixels: background colour"));
  };

  // The pixel under the pointer, as shares of width and height.
  const pixelOf = (map) => {
    const x = Math.min(map.w - 1, Math.floor(state.at[0] * map.w)), y = Math.min(map.h - 1, Math.floor(state.at[1] * map.h));
    return [x, y, y * map.w + x];
  };
  let reading = 0;
  const read = async () => {
    const turn = ++reading, part = state.part, frame = part.frames[state.place];
    for (const view of state.views) {
      const mark = view.mark;
      mark.hidden = !state.at;
      if (state.at) Object.assign(mark.style, { left: `${100 * state.zoom * (state.at[0] - state.pan[0])}%`, top: `${100 * state.zoom * (state.at[1] - state.pan[1])}%` });
    }
    if (!state.at) return;
    const maps = await Promise.all(part.layers.map((_, i) => value(part, frame, i) ?? null));
    if (turn !== reading || !state.at) return;
    const first = maps.find((map) => map?.full) ?? maps.find(Boolean);
    if (first) {
      const [x, y] = pixelOf(first), [w, h] = first.full ?? [first.w, first.h];
      place.textContent = `${frame.id}, at column ${Math.min(w - 1, Math.floor(((x + 0.5) * w) / first.w))}, row ${Math.min(h - 1, Math.floor(((y + 0.5) * h) / first.h))} of ${w} × ${h}`;
    }
    const numbers = maps.map((map, i) => (map?.codes ? numberAt(map, part.layers[i].scale, pixelOf(map)[2]) : null));
    values.replaceChildren(...part.layers.flatMap((layer, i) => {
      if (layer.role === "image" || !layer.there) return [];
      const unit = UNITS[layer.type] ?? "", number = numbers[i];
      const text = number === null ? "invalid" : layer.type === "mask" ? (number > 0.5 ? "set" : "not set") : `${short(number, layer.type === "weight" ? 3 : 4)} ${unit}`;
      const error = number !== null && layer.truth !== null && layer.truth !== undefined && numbers[layer.truth] !== null ? number - numbers[layer.truth] : null;
      return [el("tr", {}, el("td", { className: "text", title: layer.name }, layer.labels.length ? layer.labels.slice(0, 3).join(", ") : layer.name), el("td", { className: "text" }, layer.role === "other" ? layer.type : layer.role), el("td", {}, maps[i] ? text : "–"), el("td", {}, error === null ? "" : `${error >= 0 ? "+" : "−"}${short(Math.abs(error), 3)} ${unit}${isDisparity(layer) ? "" : ` (${short((100 * Math.abs(error)) / numbers[layer.truth], 2)} %)`}`))];
    }));
    for (const view of state.views) {
      const number = numbers[view.layer], unit = UNITS[part.layers[view.layer].type] ?? "";
      const error = view.kind === "error" && number !== null && numbers[view.truth] !== null ? Math.abs(number - numbers[view.truth]) : null;
      view.told.textContent = view.kind === "image" ? "" : view.kind === "error" ? (error === null ? "–" : state.relative ? `${short((100 * error) / numbers[view.truth], 3)} %` : `${short(error, 3)} ${unit}`) : number === null ? "–" : `${short(number)} ${unit}`;
    }
  };
  const point = (at) => { state.at = at; read(); };

  const transform = () => {
    const limit = 1 - 1 / state.zoom;
    state.pan = state.pan.map((share) => Math.max(0, Math.min(limit, share)));
    for (const view of state.views) view.canvas.style.transform = `scale(${state.zoom}) translate(${-100 * state.pan[0]}%, ${-100 * state.pan[1]}%)`;
    read();
  };
  const zoomAt = (factor, at = state.at ?? [0.5, 0.5]) => {
    const zoom = Math.max(1, Math.min(24, state.zoom * factor));
    state.pan = at.map((share, i) => share - ((share - state.pan[i]) * state.zoom) / zoom);
    state.zoom = zoom;
    transform();
  };
  const over = (event) => {
    const box = event.currentTarget.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width / state.zoom + state.pan[0], (event.clientY - box.top) / box.height / state.zoom + state.pan[1]].map((share) => Math.max(0, Math.min(0.999999, share)));
  };
  const keyed = (event) => {
    const step = event.shiftKey ? 0.05 : 0.005, [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -2], ArrowDown: [0, 2] }[event.key] ?? [0, 0];
    if (dx || dy) point((state.at ?? [0.5, 0.5]).map((share, i) => Math.max(0, Math.min(0.999999, share + step * [dx, dy][i]))));
    else if (event.key === "+") zoomAt(1.5);
    else if (event.key === "-") zoomAt(1 / 1.5);
    else if (event.key === "0") zoomAt(1 / 24);
    else return;
    event.preventDefault();
  };
  const card = (view) => {
    view.canvas = el("canvas", { width: 8, height: 3 });
    view.mark = el("i", { hidden: true });
    view.none = el("p", {}, "");
    view.told = el("span");
    let dragged = null;
    const glass = el("div", {
      className: `glass ${view.kind === "image" ? "image" : ""}`, tabIndex: 0, role: "img", ariaLabel: `${view.name}; arrow keys move the selected pixel, plus and minus zoom`,
      onpointermove: (event) => {
        if (dragged && event.buttons) {
          const box = event.currentTarget.getBoundingClientRect();
          state.pan = [dragged.pan[0] - (event.clientX - dragged.x) / box.width / state.zoom, dragged.pan[1] - (event.clientY - dragged.y) / box.height / state.zoom];
          transform();
        } else point(over(event));
      },
      onpointerdown: (event) => { if (state.zoom > 1) { dragged = { x: event.clientX, y: event.clientY, pan: state.pan }; event.currentTarget.setPointerCapture(event.pointerId); } point(over(event)); },
      onpointerup: () => { dragged = null; },
      onkeydown: keyed,
      ondblclick: (event) => zoomAt(state.zoom > 1 ? 1 / 24 : 4, over(event)),
    }, view.canvas, view.mark, view.none);
    glass.addEventListener("wheel", (event) => { if (event.ctrlKey || event.metaKey) { event.preventDefault(); zoomAt(event.deltaY < 0 ? 1.25 : 0.8, over(event)); } }, { passive: false });
    return el("figure", { className: "view", title: view.title }, el("figcaption", {}, el("span", {}, view.name), view.told), glass);
  };

  const draw = async () => {
    const part = state.part, frame = part.frames[state.place], views = state.views;
    const needed = [...new Set(views.flatMap((view) => (view.truth === undefined ? [view.layer] : [view.layer, view.truth])))];
    const asked = needed.map((layer) => [layer, value(part, frame, layer)]);
    const late = asked.some(([, of]) => of === undefined);
    const maps = new Map(await Promise.all(asked.map(async ([layer, of]) => [layer, (await of) ?? null])));
    if (part !== state.part || views !== state.views) return false;
    for (const view of views) {
      const map = maps.get(view.layer), truth = view.truth === undefined ? true : maps.get(view.truth);
      const there = map && truth && (truth === true || map.codes?.length === truth.codes?.length);
      view.none.textContent = there ? "" : late ? "…" : "not on this frame";
      view.canvas.style.visibility = there ? "" : "hidden";
      if (there) paint(view, map, truth);
    }
    const at = state.visible.indexOf(state.place);
    told.textContent = `${frame.id} · position ${frame.position} · ${at < 0 ? "not among the" : `${at + 1} of`} ${state.visible.length}${isFiltered() ? " that match" : ""}`;
    range.setAttribute("aria-valuetext", told.textContent);
    wrong.replaceChildren(...(frame.failures ?? []).map((what) => el("p", { className: "note" }, `failed on this frame: ${what}`)));
    state.drawn += 1;
    read();
    return true;
  };
  // One frame is drawn at a time; of those requested in the meantime only the last.
  const show = async (place) => {
    state.wanted = place;
    if (state.busy) return;
    state.busy = true;
    let isDrawn;
    try {
      do {
        state.place = state.wanted;
        range.value = Math.max(0, state.visible.indexOf(state.place));
        isDrawn = await draw();
      } while (!isDrawn || state.wanted !== state.place);
    } finally {
      state.busy = false;
    }
  };
  goTo = (run, position) => {
    const part = parts.find((of) => of.run === run);
    if (!part) return;
    if (part !== state.part) setUp(part);
    // The nearest that has pictures.
    const nearest = part.frames.reduce((best, frame, i) => (Math.abs(frame.position - position) < Math.abs(part.frames[best].position - position) ? i : best), 0);
    // A frame that was selected is shown, whether it matches the filter or not.
    if (!state.visible.includes(nearest)) clearFilter();
    show(nearest);
    byId("frames").scrollIntoView();
    range.focus({ preventScroll: true });
  };

  // The frames that an estimate is worst and best on.
  const jumps = () => {
    const part = D.scores.find((of) => of.run === state.part.run);
    jump.replaceChildren();
    if (!part) return;
    const pictured = new Set(state.part.frames.map((frame) => frame.position));
    const lines = part.lines.filter((line) => line.set === D.estimates[line.estimate].set || !part.lines.some((of) => of.estimate === line.estimate && of.set === D.estimates[line.estimate].set));
    if (!lines.length) return;
    const of = { line: lines.find((line) => D.estimates[line.estimate].name.startsWith("fus")) ?? lines[0], metric: null };
    const chips = el("div");
    const list = () => {
      const metrics = Object.keys(of.line.values);
      of.metric = metrics.includes(of.metric) ? of.metric : metrics.includes("abs_rel") ? "abs_rel" : metrics[0];
      const more = D.table?.metrics.find((metric) => metric.name === of.metric)?.more;
      const ranked = part.positions.map((position, i) => [of.line.values[of.metric][i], position, part.ids[i]]).filter(([number]) => number !== null).sort((a, b) => (more ? a[0] - b[0] : b[0] - a[0]));
      // No frame is in both lists, so with few frames the lists are shorter.
      const most = Math.min(5, Math.floor(ranked.length / 2));
      const chip = ([number, position, id]) => el("button", { type: "button", className: pictured.has(position) ? "jump" : "jump absent", title: pictured.has(position) ? `position ${position}` : `position ${position} has no images in this page: shows the nearest frame that does`, onclick: () => goTo(part.run, position) }, `${id}: ${short(number, 3)}`);
      const select = (options, chosen, change, name) => { const made = choose(options, chosen, change); made.ariaLabel = name; return made; };
      chips.replaceChildren(
        el("div", { className: "controls" }, most ? "Worst and best frames of" : "The only frame of",
          select(lines.map((line, i) => [String(i), D.estimates[line.estimate].label]), String(lines.indexOf(of.line)), (i) => { of.line = lines[+i]; list(); }, "estimate"), "by",
          select(metrics.map((name) => [name, plainOf(name)]), of.metric, (name) => { of.metric = name; list(); }, "metric")),
        most ? el("div", { className: "chips" }, el("b", {}, "worst"), ranked.slice(0, most).map(chip)) : el("div", { className: "chips" }, ranked.map(chip)),
        most ? el("div", { className: "chips" }, el("b", {}, "best"), ranked.slice(-most).reverse().map(chip)) : "");
    };
    jump.append(chips);
    list();
  };

  // The frames that slider and buttons move through: those that match the filter.
  const filter = { part: null, line: null };
  const idField = el("input", { type: "text", id: "filter-id", placeholder: "part of a frame id", autocomplete: "off" });
  const conditionField = el("input", { type: "text", id: "filter-condition", autocomplete: "off" });
  const matched = el("output", { id: "filter-count", className: "quiet", htmlFor: "filter-id filter-condition" });
  const conditions = el("span", { className: "controls" });
  const example = () => `${Object.keys(filter.line.values).find((name) => name === "abs_rel") ?? Object.keys(filter.line.values)[0]} > 0.2`;
  const isFiltered = () => Boolean(idField.value.trim() || conditionField.value.trim());
  /** Whether a frame matches the condition on a metric; a text if the condition is invalid. */
  const conditionOf = (text) => {
    if (!text || !filter.line) return () => true;
    const metrics = Object.keys(filter.line.values), found = CONDITION.exec(text);
    if (!found) return `expected a metric, a comparison and a number, for example ${example()}`;
    const [, name, comparison, number] = found;
    const metric = metrics.find((known) => known === name) ?? metrics.find((known) => [known, plainOf(known)].some((one) => one.toLowerCase() === name.toLowerCase()));
    if (!metric) return `unknown metric ${name}; available: ${metrics.join(", ")}`;
    const values = filter.line.values[metric], at = new Map(filter.part.positions.map((position, i) => [position, i]));
    return (frame) => {
      const value = values[at.get(frame.position)] ?? null;
      return value !== null && COMPARISONS[comparison](value, +number);
    };
  };
  const filterFrames = () => {
    const { frames } = state.part, words = idField.value.toLowerCase().split(/\s+/).filter(Boolean);
    const condition = conditionOf(conditionField.value.trim()), isInvalid = typeof condition === "string";
    conditionField.setAttribute("aria-invalid", String(isInvalid));
    const matches = (frame) => words.every((word) => frame.id.toLowerCase().includes(word)) && (isInvalid || condition(frame));
    state.visible = frames.map((_, place) => place).filter((place) => matches(frames[place]));
    range.max = Math.max(0, state.visible.length - 1);
    range.disabled = !state.visible.length;
    matched.textContent = isInvalid ? condition : isFiltered() ? `${state.visible.length} of ${plural(frames.length, "frame")} match` : "";
  };
  const applyFilter = () => {
    filterFrames();
    if (!state.visible.length || state.visible.includes(state.place)) return show(state.place);
    return show(state.visible.find((place) => place > state.place) ?? state.visible[state.visible.length - 1]);
  };
  const clearFilter = () => {
    idField.value = conditionField.value = "";
    applyFilter();
  };
  for (const field of [idField, conditionField]) {
    field.addEventListener("input", applyFilter);
    field.addEventListener("keydown", (event) => {
      if (event.key === "Enter") range.focus();
      if (event.key === "Escape") clearFilter();
    });
  }
  /** The estimates whose metrics a condition can use. */
  const setUpFilter = () => {
    filter.part = D.scores.find((of) => of.run === state.part.run) ?? null;
    const lines = (filter.part?.lines ?? []).filter((line) => Object.keys(line.values).length);
    filter.line = lines.find((line) => D.estimates[line.estimate].name.startsWith("fus")) ?? lines[0] ?? null;
    idField.value = conditionField.value = "";
    if (!filter.line) return conditions.replaceChildren();
    conditionField.placeholder = example();
    const names = lines.map((line, i) => [String(i), lines.some((of) => of !== line && of.estimate === line.estimate) ? `${D.estimates[line.estimate].label}, ${line.set}` : D.estimates[line.estimate].label]);
    const select = choose(names, String(lines.indexOf(filter.line)), (i) => { filter.line = lines[+i]; applyFilter(); });
    select.ariaLabel = "estimate of the condition";
    conditions.replaceChildren(label("and", conditionField), "of", select);
  };

  const lay = (keys) => {
    const all = viewsOf(state.part);
    state.views = all.filter((view) => keys.has(view.key));
    grid.replaceChildren(...state.views.map(card));
    transform();
    colourBars();
    show(state.place);
  };
  const setUp = (part) => {
    state.part = part;
    state.place = Math.min(state.place, part.frames.length - 1);
    setUpFilter();
    filterFrames();
    const views = viewsOf(part), first = shownAtFirst(views, part);
    const kindOf = (view) => (view.kind === "error" ? "error" : part.layers[view.layer].role);
    const groups = [["image", "images"], ["truth", "ground truth"], ["estimate", "estimates"], ["error", "errors"], ["other", "intermediate maps"]];
    const chosen = new Map();
    const together = () => lay(new Set([...chosen.values()].flatMap((set) => [...set])));
    which.replaceChildren(...groups.map(([kind, title]) => {
      const of = views.filter((view) => kindOf(view) === kind);
      if (!of.length) return "";
      const on = of.map((view) => view.key).filter((key) => first.includes(key));
      chosen.set(kind, new Set(on));
      return ticks(title, of.map((view) => ({ key: view.key, inner: view.kind === "error" ? view.name.replace("error of ", "") : view.name, title: view.title })), on, (keys) => { chosen.set(kind, keys); together(); });
    }));
    jumps();
    together();
  };

  const size = (share) => { grid.style.setProperty("--view", `${share}rem`); };
  const step = (by) => {
    const next = by > 0 ? state.visible.find((place) => place > state.place) : state.visible.findLast((place) => place < state.place);
    if (next !== undefined) show(next);
  };
  range.addEventListener("input", () => { if (state.visible.length) show(state.visible[+range.value]); });
  const steps = D.steps, all = D.pictures.reduce((sum, part) => sum + part.frames_in_all, 0), here = parts.reduce((sum, part) => sum + part.frames.length, 0);
  const hasDetails = (part) => part.layers.some((layer, i) => layer.role === "other" || (layer.role === "image" && i > 0));
  const reduced = [
    here < all ? `${here} of ${all.toLocaleString("en")} frames are shown${here > 3 ? ", the worst and the best among them" : ""} (\`depthloom report RUN --page-frames ${all}\` shows more)${D.every > 1 ? ` (maps were recorded on every ${D.every}th frame)` : ""}` : null,
    parts.some((part) => part.layers.length < part.maps_in_all && part.layers.every((layer) => layer.there)) ? `${parts.map((part) => `${part.layers.length} of ${part.maps_in_all}`).join(", ")} recorded maps are shown: those of the displayed estimates` : null,
    parts.some((part) => part.detailed < part.frames.length && hasDetails(part)) ? `intermediate maps and further images are shown on ${parts.map((part) => `${part.detailed} of ${part.frames.length}`).join(", ")} frames, evenly spaced, with the worst` : null,
    `maps are at most ${steps.widest} columns wide, each sample is one recorded pixel; depths are exact to ${short(50 * steps.depth, 2)} %, disparities to 1/${Math.round(2 / steps.disparity_px)} px, confidences to 1/512`,
  ].filter(Boolean);
  box.append(
    el("p", { className: "quiet" }, `${reduced.join("; ")}. The recording contains all frames and maps at full resolution.`),
    D.damaged ? el("p", { className: "note" }, `${plural(D.damaged, "map")} could not be read: damaged bytes`) : "",
    parts.length > 1 ? el("div", { className: "controls" }, label("stage", choose(parts.map((part) => [String(part.run), part.name]), String(first.run), (run) => { state.place = 0; setUp(parts.find((part) => String(part.run) === run)); }))) : "",
    jump,
    el("details", {}, el("summary", {}, "views"), which),
    el("div", { className: "controls", id: "filter" }, label("frames with", idField), conditions, el("button", { type: "button", onclick: clearFilter }, "all frames"), matched),
    el("div", { className: "slider" }, el("button", { type: "button", ariaLabel: "previous frame", onclick: () => step(-1) }, "◀"), el("button", { type: "button", ariaLabel: "next frame", onclick: () => step(1) }, "▶"), range, told),
    wrong, grid, bars,
    el("div", { className: "controls" },
      label("relative errors", el("input", { type: "checkbox", id: "relative", onchange: (event) => { state.relative = event.target.checked; colourBars(); show(state.place); } })),
      label("image size", choose([["15", "small"], ["23", "medium"], ["38", "large"], ["80", "one per row"]], "23", size)),
      el("button", { type: "button", onclick: () => zoomAt(1.5) }, "zoom in"), el("button", { type: "button", onclick: () => zoomAt(1 / 1.5) }, "zoom out"), el("button", { type: "button", onclick: () => zoomAt(1 / 24) }, "reset zoom"),
      el("span", { className: "quiet" }, "Zoom with Ctrl and the mouse wheel, or by double-click; all images zoom together.")),
    place, el("div", { className: "scrolls" }, el("table", { id: "values" }, el("thead", {}, el("tr", {}, ["map", "role", "value", "estimate − ground truth"].map((text, i) => el("th", { className: i < 2 ? "text" : "" }, text)))), values)));
  place.textContent = "Hover over an image to see the values of all maps at that pixel.";
  setUp(first);
  // Used only by the test.
  window.depthloomPage = { show, state };
  addEventListener("DOMContentLoaded", () => { lines.clear(); show(state.place); });
}
