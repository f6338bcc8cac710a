// Everything except tables, figures and frames: the head, notes, times, and the command to repeat the run.
function head() {
  const made = D.environment?.finished_utc;
  byId("experiment").textContent = D.experiment;
  byId("about").textContent = D.description;
  const frames = D.condition?.frames ?? 0;
  byId("made").textContent = [
    D.variants > 1 ? plural(D.variants, "variant") : null, plural(frames, "frame"), D.condition?.condition && D.condition.condition !== "complete" ? `recording ${D.condition.condition}` : null,
    made ? `run ended ${made.replace(/T(\d\d)-(\d\d)-(\d\d)Z/, " $1:$2:$3 UTC")}` : null, `page by depthloom ${D.depthloom}`].filter(Boolean).join(" · ");
  byId("theme").addEventListener("click", () => setDark(!isDark()));
  const notes = [...(D.notes ?? [])];
  byId("notes").append(...notes.map((note) => el("p", { className: "note" }, note)));
}

function contents() {
  byId("contents").append(...[...document.querySelectorAll("main section")].map((section) => el("a", { href: `#${section.id}` }, section.querySelector("h2").textContent)));
}

const grid = (columns, rows) => el("div", { className: "scrolls tall", tabIndex: 0, role: "group" }, el("table", {}, el("thead", {}, el("tr", {}, columns.map(([name, text]) => el("th", { className: text ? "text" : "" }, name)))), el("tbody", {}, rows)));
const terms = (pairs) => el("dl", {}, pairs.filter(([, value]) => value !== null && value !== undefined && value !== "").flatMap(([term, value]) => [el("dt", {}, term), el("dd", {}, value)]));

function effects() {
  if (!D.answers.length) return without("effects");
  for (const { title, table } of D.answers) {
    const rows = table.rows.map((row, at) => el("tr", {}, row.map((text, column) => el("td", { className: [table.columns[column].text ? "text" : "", table.best[at].includes(column) ? "best" : ""].join(" ").trim(), title: text }, table.best[at].includes(column) ? `${text}*` : text))));
    byId("effects-body").append(
      el("h3", {}, title), el("p", { className: "quiet" }, `${table.about}${table.best.some((places) => places.length) ? "; * best" : ""}.`),
      grid(table.columns.map((column) => [column.name, column.text]), rows), ...table.notes.map((note) => el("p", { className: "quiet" }, `${note}.`)));
  }
}

function times() {
  const E = D.environment, body = byId("time-body");
  if (!E && !D.timings.length && !D.failures.in_all) return without("time");
  if (E) {
    const network = E.networks ? [E.networks.engine, E.networks.version, E.networks.ran_on?.length ? `on ${E.networks.ran_on.join(", ")}` : null].filter(Boolean).join(" ") : null;
    body.append(terms([
      ["machine", [E.os, E.architecture, E.cores ? plural(E.cores, "core") : null, E.simd?.length ? E.simd.join(", ") : null].filter(Boolean).join(", ")],
      ["depthloom", E.depthloom], ["networks", network], ["workers", E.workers === undefined ? null : String(E.workers)],
    ]));
  }
  if (D.timings.length) {
    const rows = D.timings.map((row) => ({ ...row, ms: row.frames ? row.cpu_ms / row.frames : 0 }));
    const whole = rows.reduce((sum, row) => sum + row.cpu_ms, 0) || 1;
    rows.sort((a, b) => b.cpu_ms - a.cpu_ms);
    const most = rows[0].cpu_ms || 1, SHOWN = 300;
    body.append(
      el("p", { className: "quiet" }, `CPU time of all threads, longest first. Values reused from earlier runs took no CPU time.${rows.length > SHOWN ? ` Shown: the first ${SHOWN} of ${rows.length} rows; \`depthloom runs timings\` prints all.` : ""}`),
      grid([["stage", true], ["variant", true], ["node", true], ["phase", true], ["calls"], ["CPU ms per call"], ["median CPU ms"], ["total CPU s"], ["share"], [""]], rows.slice(0, SHOWN).map((row) => el("tr", {},
        [row.stage, row.variant ?? "", row.node, row.phase].map((text) => el("td", { className: "text", title: text }, text)),
        [row.frames.toLocaleString("en"), short(row.ms, 3), row.median_ms === null ? "–" : short(row.median_ms, 3), short(row.cpu_ms / 1000, 3), `${((100 * row.cpu_ms) / whole).toFixed(1)} %`].map((text) => el("td", {}, text)),
        el("td", { className: "text" }, el("span", { className: "bar", style: { width: `${Math.max(1, (120 * row.cpu_ms) / most)}px` } }))))));
  }
  if (D.failures.in_all) {
    const { in_all, listed } = D.failures;
    body.append(el("h3", {}, "Failures"), listed.length < in_all ? el("p", { className: "quiet" }, `Shown: the first ${listed.length} of ${in_all} failures.`) : "",
      grid([["stage", true], ["frame", true], ["node", true], ["error", true]], listed.map((of) => el("tr", {}, el("td", { className: "text" }, of.stage),
        el("td", { className: "text" }, el("button", { type: "button", onclick: () => goTo(D.pictures.find((part) => part.name === of.stage)?.run, of.position) }, of.frame)), el("td", { className: "text" }, of.node), el("td", { className: "text wraps" }, of.what)))));
  }
}

/** The commit of the experiment's folder, and whether the experiment's files differ from it. */
function commit() {
  const G = D.environment?.git;
  if (!G) return null;
  const state = { true: "the experiment's files were modified", false: "the experiment's files were not modified" }[G.modified] ?? "unknown whether the experiment's files were modified";
  return [el("code", {}, G.commit), `, ${state}`];
}

function again() {
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
  const K = D.keys, body = byId("again-body"), command = D.environment?.arguments;
  if (command) body.append(el("p", {}, "Original command:"), el("pre", { id: "command" }, command.map(quoted).join(" ")));
  body.append(
    el("p", {}, "To repeat the run with the same parameters, from the run's folder:"), el("pre", {}, "depthloom run experiment.resolved.yaml"),
    el("p", {}, "Two runs with the same plan key are the same run. Nodes with the same cache key produce the same values: ", el("code", {}, "depthloom inspect --keys RUN"), " prints the keys, ", el("code", {}, "depthloom verify RUN --verify-bytes"), " recomputes the values and compares them."),
    terms([["plan key", el("code", {}, K.plan)], ["git commit", commit()], ["depthloom", D.environment?.depthloom ?? null]]));
  const parameters = (of) => el("td", { className: "text wraps" }, Object.entries(of.params ?? {}).map(([name, value]) => `${name}: ${typeof value === "string" ? value : JSON.stringify(value)}`).join(", "));
  body.append(
    el("details", {}, el("summary", {}, `sources (${K.sources.length})`), grid([["stage", true], ["source", true], ["kind", true], ["parameters", true]], K.sources.map((of) => el("tr", {}, el("td", { className: "text" }, of.stage), el("td", { className: "text" }, of.name), el("td", { className: "text" }, `${of.kind} ${of.version}`), parameters(of))))),
    el("details", {}, el("summary", {}, `nodes (${K.nodes_in_all}${K.nodes.length < K.nodes_in_all ? `, the first ${K.nodes.length}` : ""}) with their hashes (of kind, version, parameters and inputs)`),
      grid([["stage", true], ["variant", true], ["node", true], ["kind", true], ["node hash", true], ["parameters", true]], K.nodes.map((of) => el("tr", {}, el("td", { className: "text" }, of.stage), el("td", { className: "text" }, of.variant ?? ""), el("td", { className: "text" }, of.name), el("td", { className: "text" }, `${of.kind} ${of.version}`), el("td", { className: "text", title: of.node_hash }, el("code", {}, of.node_hash.slice(0, 12))), parameters(of))))));
}

for (const part of [head, scoreTable, effects, distanceFigure, frameViews, frameFigure, learningFigures, times, again, contents]) part();
// Prints in light colours.
let wasDark = false;
addEventListener("beforeprint", () => { wasDark = isDark(); setDark(false); });
addEventListener("afterprint", () => setDark(wasDark));
