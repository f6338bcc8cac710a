// The metrics table: sortable by any column, filtered, with the paper's numbers on request.
const AT_FIRST = 100;

/** The verdict on the difference between a row and the best one. */
function verdictText({ name, p }) {
  if (name === "equal") return "equal to the best";
  if (p === null) return "";
  const number = p < 0.001 ? "p < 0.001" : `p = ${p.toFixed(p < 0.1 ? 3 : 2)}`;
  return name === "unclear" ? `not significant, ${number}` : `${name}, ${number}`;
}

function scoreTable() {
  const T = D.table;
  if (!T || !T.rows.length) return without("table");
  const state = { sort: null, down: false, isBestFirst: true, paper: false, all: T.rows.length <= 2 * AT_FIRST, filter: "" };
  const several = (of) => new Set(T.rows.map(of)).size > 1;
  const axes = (T.axes ?? []).map((axis, i) => ({ name: axis, text: true, of: (row) => row.factors[i], shown: (row) => row.shown.factors[i], numeric: T.rows.every((row) => row.factors[i] === null || (row.factors[i].trim() !== "" && Number.isFinite(+row.factors[i]))) }));
  // Axes that identify every variant replace its name.
  const named = (of) => new Set(T.rows.filter((row) => row.variant !== null).map(of)).size;
  const areNames = axes.length > 0 && named((row) => row.variant) === named((row) => JSON.stringify(row.factors));
  const columns = [
    several((row) => row.stage) && { name: "stage", text: true, of: (row) => row.stage },
    several((row) => row.variant) && !areNames && { name: "variant", text: true, of: (row) => row.variant ?? "", shown: (row) => row.shown.variant ?? "" },
    { name: "estimate", text: true, of: (row) => row.estimate, shown: (row) => row.shown.estimate, about: (row) => row.shown.variant },
    several((row) => row.set) && { name: "set", text: true, of: (row) => row.set },
    ...axes.filter((axis) => several(axis.of)),
    ...T.metrics.map((metric, i) => ({ name: metric.name, head: metric.plain || metric.name, metric, i, of: (row) => row.means[i] })),
    { name: "density", of: (row) => row.density, decimals: 3, title: "the share of pixels with ground truth that are valid" },
    { name: "frames", of: (row) => row.frames, decimals: 0, title: "frames with at least one scored pixel" },
  ].filter(Boolean);
  const cell = (column, row) => {
    const value = column.of(row);
    const words = column.shown?.(row) ?? value ?? "";
    if (column.text) return el("td", { className: "text", title: column.about?.(row) ?? words }, column.name === "estimate" ? [row.colour ? swatch(row) : "", " ", words] : words);
    const decimals = column.metric?.decimals ?? column.decimals;
    const text = value === null ? "–" : column.name === "frames" ? value.toLocaleString("en") : value.toFixed(decimals);
    const td = el("td", { title: value === null ? "" : String(value) }, text);
    if (column.metric) {
      if (row.best.includes(column.i)) {
        td.className = "best";
        td.append("*");
      }
      const interval = row.intervals?.[column.i];
      const verdict = column.i === T.leading ? row.verdict : null;
      if (verdict) td.append(el("span", { className: "beside verdict", title: verdict.p === null ? "" : `adjusted p = ${verdict.p}` }, verdictText(verdict)));
      if (interval) td.append(el("span", { className: "beside" }, `[${interval.map((end) => end.toFixed(decimals)).join(", ")}]`));
      const paper = state.paper ? row.paper?.[column.i] : null;
      if (paper !== null && paper !== undefined) td.append(el("span", { className: "beside" }, `paper ${paper.toFixed(2)}`));
    }
    return td;
  };
  const compare = (column, a, b) => {
    const [x, y] = [column.of(a), column.of(b)];
    if (x === null || y === null) return (x === null) - (y === null);
    const order = column.text && !column.numeric ? String(x).localeCompare(String(y), "en", { numeric: true }) : x - y;
    return state.down ? -order : order;
  };
  // The best rows come first. Rows of other stages and pixel sets have other values, so they are sorted separately.
  const leading = columns.find((column) => column.metric && column.i === T.leading);
  const bestFirst = leading ? T.best_first.map((i) => T.rows[i]) : T.rows;
  const inOrder = () => (state.isBestFirst ? bestFirst : T.rows);
  const body = el("tbody"), head = el("tr"), more = el("p", { className: "quiet" });
  const show = () => {
    head.replaceChildren(...columns.map((column) => {
      const metric = column.metric;
      const arrow = metric ? (metric.more ? " ↑" : " ↓") : "";
      const sorted = state.sort === column;
      const sort = () => {
        state.down = sorted ? !state.down : Boolean(metric?.more) || column.name === "frames" || column.name === "density";
        state.sort = column;
        show();
        head.children[columns.indexOf(column)].firstChild.focus();
      };
      const [name, aside] = (column.head ?? column.name).split(/ (?=\()/);
      const title = metric ? `${metric.formula}\n${metric.source}` : column.title ?? "";
      return el("th", { className: column.text ? "text" : "", scope: "col", "aria-sort": sorted ? (state.down ? "descending" : "ascending") : "none" },
        el("button", { type: "button", onclick: sort, title }, `${name}${arrow}${sorted ? (state.down ? " ▾" : " ▴") : ""}`),
        el("small", {}, metric?.unit || aside || "\u00a0"));
    }));
    orders.forEach(({ mark }) => mark());
    const words = state.filter.toLowerCase().split(/\s+/).filter(Boolean);
    const text = (row) => [row.stage, row.variant, row.estimate, row.set, row.shown.variant, row.shown.estimate].join(" ").toLowerCase();
    let rows = inOrder().filter((row) => words.every((word) => text(row).includes(word)));
    if (state.sort) rows = [...rows].sort((a, b) => compare(state.sort, a, b));
    const shown = state.all ? rows : rows.slice(0, AT_FIRST);
    body.replaceChildren(...shown.map((row) => el("tr", {}, columns.map((column) => cell(column, row)))));
    more.replaceChildren(...(shown.length < rows.length ? [`${shown.length} of ${rows.length} rows. `, el("button", { type: "button", onclick: () => { state.all = true; show(); } }, "show all")] : []));
  };
  const controls = [];
  const orders = leading && T.rows.length > 1 ? [[true, `best ${leading.head} first`], [false, "order of the experiment"]].map(([isBestFirst, text]) => {
    const button = el("button", { type: "button", onclick: () => { state.sort = null; state.isBestFirst = isBestFirst; show(); } }, text);
    return { button, mark: () => button.setAttribute("aria-pressed", String(!state.sort && state.isBestFirst === isBestFirst)) };
  }) : [];
  controls.push(...orders.map(({ button }) => button));
  if (T.rows.some((row) => row.paper)) controls.push(label("the paper's numbers (Martins et al. 2018)", el("input", { type: "checkbox", id: "paper", onchange: (event) => { state.paper = event.target.checked; show(); } })));
  if (T.rows.length > 12) controls.push(label("filter rows", el("input", { type: "text", placeholder: "words", oninput: (event) => { state.filter = event.target.value; show(); } })));
  byId("table-body").append(
    el("p", { className: "quiet" }, `${T.about}${T.best ? `; * ${T.best}` : ""}. Click a column to sort.`),
    ...(T.tested ?? []).map((text) => el("p", { className: "quiet tested" }, text)),
    el("div", { className: "controls" }, controls),
    el("div", { className: "scrolls tall", tabIndex: 0, role: "group", ariaLabel: "table of metrics" }, el("table", { id: "scores" }, el("thead", {}, head), body)),
    more);
  show();
}
