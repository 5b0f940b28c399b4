// Making elements. Text from outside only ever becomes text nodes and plain attributes, never markup.

const byId = (id) => document.getElementById(id);

/** An element with attributes, listeners (onclick: f), style properties (style: {}) and children. */
function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "style") Object.assign(element.style, value);
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

function icon(path, size = 16) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  for (const [name, value] of Object.entries({ width: size, height: size, viewBox: "0 0 16 16", "aria-hidden": "true" }))
    svg.setAttribute(name, value);
  const line = document.createElementNS(space, "path");
  for (const [name, value] of Object.entries({ d: path, fill: "none", stroke: "currentColor", "stroke-width": "1.7",
    "stroke-linecap": "round", "stroke-linejoin": "round" })) line.setAttribute(name, value);
  svg.append(line);
  return svg;
}
const LEFT = "M10 3 5 8l5 5", RIGHT = "M6 3l5 5-5 5", CHECK = "M4 8.5l2.6 2.6L12 5.5", CROSS = "M5 5l6 6M11 5l-6 6", DASH = "M5 8h6";

const settings = JSON.parse(byId("settings").textContent);

const outcomeName = (outcome) => (settings.outcomes[outcome] || [outcome])[0];
const outcomeMeaning = (outcome) => (settings.outcomes[outcome] || ["", ""])[1];
const outcomeTag = (outcome) =>
  h("span", { class: "outcome", title: outcomeMeaning(outcome) },
    h("span", { class: "dot", style: { background: `var(--${outcome})` } }), outcomeName(outcome));

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const seconds = (value) => value < 60 ? `${value.toFixed(1)} s` : `${Math.floor(value / 60)} min ${String(Math.floor(value % 60)).padStart(2, "0")} s`;
const milliseconds = (value) => value < 1000 ? `${Math.round(value)} ms` : `${(value / 1000).toFixed(2)} s`;
const moment = (unix) => new Date(unix * 1000).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "medium" });
const shorten = (text, length) => text.length > length ? `${text.slice(0, length - 1)}…` : text;
