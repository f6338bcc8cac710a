// Shared by all parts of the page. Text from the experiment becomes text nodes and properties, never markup.
const D = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);

/** Creates an element with properties, listeners and children. */
function el(tag, properties = {}, ...inner) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "style") Object.assign(made.style, value);
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...inner.flat().filter((one) => one !== undefined && one !== null));
  return made;
}

const plural = (count, what) => `${count.toLocaleString("en")} ${what}${count === 1 ? "" : "s"}`;
/** A checkbox comes before its text, any other input after it. */
const label = (text, input) => el("label", {}, input.type === "checkbox" ? [input, text] : [text, input]);
const choose = (options, chosen, change) =>
  el("select", { onchange: (event) => change(event.target.value) },
    options.map(([value, text]) => el("option", { value, selected: value === chosen }, text)));

/** A number with about `digits` significant digits, without needless zeros. */
function short(number, digits = 4) {
  if (number === null || number === undefined || !Number.isFinite(number)) return "–";
  if (number === 0) return "0";
  const size = Math.abs(number);
  if (size >= 1e6 || size < 1e-4) return number.toExponential(digits - 1);
  return number.toFixed(Math.max(0, Math.min(8, digits - 1 - Math.floor(Math.log10(size)))));
}

const unitOf = (metric) => D.table?.metrics.find((one) => one.name === metric)?.unit || "";
const plainOf = (metric) => D.table?.metrics.find((one) => one.name === metric)?.plain || metric;

/** Line styles. */
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [4, 2], [14, 4], [2, 6], [6, 2, 2, 2, 2, 2]];
for (const of of [...D.estimates, ...(D.table?.rows ?? [])]) of.dash = DASHES[(of.dash ?? 0) % DASHES.length];
function swatch(of) {
  const [svg, line] = ["svg", "line"].map((tag) => document.createElementNS("http" + "://www.w3.org/2000/svg", tag));
  for (const [name, value] of Object.entries({ class: "line", width: 34, height: 8, "aria-hidden": "true" })) svg.setAttribute(name, value);
  for (const [name, value] of Object.entries({ x1: 0, x2: 34, y1: 4, y2: 4, stroke: of.colour, "stroke-width": 3, "stroke-dasharray": of.dash.join(" ") })) line.setAttribute(name, value);
  svg.append(line);
  return svg;
}

// Light or dark: follows the system until the user chooses.
const themed = [];
const isDark = () => document.documentElement.classList.contains("dark");
function setDark(dark) {
  document.documentElement.classList.toggle("dark", dark);
  themed.forEach((redraw) => redraw());
}
const system = matchMedia("(prefers-color-scheme: dark)");
document.documentElement.classList.toggle("dark", system.matches);
system.addEventListener("change", () => setDark(system.matches));
const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const faint = (hex, share) => hex + Math.round(255 * share).toString(16).padStart(2, "0");

/** Removes a section that has nothing to show. */
function without(id) {
  byId(id).remove();
}

/** A group of checkboxes, one per item; `change` gets the set of selected keys. */
function ticks(title, items, ticked, change) {
  const chosen = new Set(ticked);
  const boxes = items.map(({ key, inner, title }) => {
    const box = el("input", { type: "checkbox", checked: chosen.has(key), onchange: () => { box.checked ? chosen.add(key) : chosen.delete(key); change(chosen); } });
    box.dataset.key = key;
    return el("label", { title }, box, inner);
  });
  const set = (keys) => {
    chosen.clear();
    keys.forEach((key) => chosen.add(key));
    boxes.forEach((of) => { of.firstChild.checked = chosen.has(items[boxes.indexOf(of)].key); });
    change(chosen);
  };
  const group = el("fieldset", { className: "pick" }, el("legend", {}, title), boxes);
  if (items.length > 3) {
    group.append(el("button", { type: "button", onclick: () => set(items.map((item) => item.key)) }, "all"), el("button", { type: "button", onclick: () => set([]) }, "none"));
  }
  return group;
}
