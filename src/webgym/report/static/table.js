// The table of trajectories: search, filters, order. Its state lives in the address, so that it can be shared.

const PAGE = 200;
const LEVELS = { easy: 0, medium: 1, hard: 2 };
const OUTCOMES = Object.keys(settings.outcomes);
const COLUMNS = [
  { key: "outcome", name: "Outcome", width: "158px", by: (row) => OUTCOMES.indexOf(row.outcome), cell: (row) => outcomeTag(row.outcome) },
  { key: "task", name: "Task", width: "auto", by: (row) => row.task.toLowerCase(),
    cell: (row) => h("a", { class: "task", href: addressOf(row.id), title: row.task }, row.task) },
  { key: "site", name: "Website", width: "200px", by: (row) => row.site, cell: (row) => h("div", { class: "cut", title: row.site }, row.site) },
  { key: "domain", name: "Domain", width: "150px", by: (row) => row.domain + row.subdomain,
    cell: (row) => h("div", { class: "cut", title: `${row.domain} / ${row.subdomain}` }, row.domain) },
  { key: "difficulty", name: "Difficulty", width: "104px", by: (row) => row.difficulty,
    cell: (row) => [capital(row.level), h("span", { class: "muted" }, row.difficulty ? ` ${row.difficulty}` : "")] },
  { key: "steps", name: "Steps", width: "72px", number: true, by: (row) => row.steps, cell: (row) => String(row.steps) },
  { key: "seconds", name: "Time", width: "92px", number: true, by: (row) => row.seconds, cell: (row) => seconds(row.seconds) },
];
const FILTERS = {
  outcome: { name: outcomeName, order: (a, b) => OUTCOMES.indexOf(a) - OUTCOMES.indexOf(b) },
  level: { name: capital, order: (a, b) => LEVELS[a] - LEVELS[b] },
  domain: { name: (value) => value, order: (a, b) => a.localeCompare(b) },
  site: { name: (value) => value, order: (a, b) => a.localeCompare(b) },
};

const state = { q: "", outcome: "", level: "", domain: "", site: "", sort: "", down: false };
let shown = PAGE;
let fitting = [];        // the matching rows that are displayed
let total = 0;           // number of matching rows
let turn = 0;            // number of the latest request; replies to earlier ones are ignored

const addressOf = (id, step) => `#/t/${encodeURIComponent(id)}${step ? `/${step}` : ""}`;

function fits(row) {
  if (Object.keys(FILTERS).some((key) => state[key] && row[key] !== state[key])) return false;
  const text = `${row.id}\n${row.task}\n${row.site}\n${row.domain}\n${row.subdomain}\n${row.answer}\n${row.code}`.toLowerCase();
  return state.q.toLowerCase().split(/\s+/).every((word) => text.includes(word));
}

/** The matching rows, in order. */
function choose(rows) {
  const found = rows.filter(fits);
  const column = COLUMNS.find((one) => one.key === state.sort);
  if (!column) return found;
  const sign = state.down ? -1 : 1;
  const keyed = found.map((row) => [column.by(row), row]);
  keyed.sort(([a], [b]) => (a < b ? -sign : a > b ? sign : 0));
  return keyed.map(([, row]) => row);
}

function line(row) {
  const cells = COLUMNS.map((column) => h("td", { class: column.number && "number" }, column.cell(row)));
  const open = (event) => {
    if (!event.target.closest("a") && !getSelection().toString()) location.hash = addressOf(row.id);
  };
  return h("tr", { "data-id": row.id, onclick: open }, cells);
}

async function drawTable() {
  const mine = ++turn;
  try {
    const found = await find(state, shown);
    if (mine !== turn) return;
    fitting = found.rows;
    total = found.total;
  } catch (error) {
    byId("list-count").textContent = String(error.message || error);
    return;
  }
  byId("rows-body").replaceChildren(...fitting.map(line));
  byId("list-count").textContent = total === list.count ? `${total}` : `${total} of ${list.count}`;
  byId("nothing").hidden = total > 0;
  byId("more").hidden = total <= fitting.length;
  byId("more").textContent = `Show ${Math.min(PAGE, total - fitting.length)} more`;
  byId("clear").hidden = !state.q && !Object.keys(FILTERS).some((key) => state[key]);
  for (const head of byId("columns").children) {
    if (head.dataset.key === state.sort) head.setAttribute("aria-sort", state.down ? "descending" : "ascending");
    else head.removeAttribute("aria-sort");
  }
  for (const key of document.querySelectorAll(".key"))
    key.setAttribute("aria-pressed", String(key.dataset.outcome === state.outcome));
  redrawCrumbs();
}

/** Fill the filters with the existing values. */
function fillFilters() {
  for (const [key, { name, order }] of Object.entries(FILTERS)) {
    const select = byId(`filter-${key}`);
    const values = [...list.options[key]].sort(order);
    select.replaceChildren(select.options[0], ...values.map((value) => h("option", { value }, name(value))));
    select.value = state[key];
  }
}

/** The address of the list in its current state. */
function listAddress() {
  const parameters = new URLSearchParams(Object.entries(state).filter(([, value]) => value).map(([key, value]) => [key, value === true ? "1" : value]));
  return `#/${parameters.size ? `?${parameters}` : ""}`;
}

function change(changes) {
  Object.assign(state, changes);
  shown = PAGE;
  history.replaceState(null, "", listAddress());
  byId("search").value = state.q;
  for (const key of Object.keys(FILTERS)) byId(`filter-${key}`).value = state[key];
  drawTable();
}

/** Set the state from an address. */
function readState(query) {
  const parameters = new URLSearchParams(query);
  for (const key of Object.keys(state)) state[key] = key === "down" ? parameters.has(key) : parameters.get(key) || "";
  byId("search").value = state.q;
  fillFilters();
  return drawTable();
}

function beginTable() {
  byId("columns").append(...COLUMNS.map((column) =>
    h("th", { scope: "col", "data-key": column.key, class: column.number && "number", style: { width: column.width } },
      h("button", { type: "button", onclick: () => change(state.sort !== column.key ? { sort: column.key, down: false }
        : state.down ? { sort: "", down: false } : { down: true }) }, column.name))));
  byId("search").addEventListener("input", (event) => change({ q: event.target.value.trimStart() }));
  for (const key of Object.keys(FILTERS)) byId(`filter-${key}`).addEventListener("change", (event) => change({ [key]: event.target.value }));
  byId("clear").addEventListener("click", () => change({ q: "", outcome: "", level: "", domain: "", site: "" }));
  byId("more").addEventListener("click", () => { shown += PAGE; drawTable(); });
  byId("overview").addEventListener("click", (event) => {
    const key = event.target.closest(".key");
    if (!key) return;
    change({ outcome: state.outcome === key.dataset.outcome ? "" : key.dataset.outcome });
    byId("list").scrollIntoView({ block: "start", behavior: "smooth" });
  });
}
