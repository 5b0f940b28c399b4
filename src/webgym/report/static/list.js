// A list that is searched, filtered, ordered and paged, and the page of one of its items. The address has the state.
//
// `begin` takes what differs between lists:
//   item      begins the address of an item: #/<item>/<id>
//   place     id of the element that shows an item
//   names     what one item, several and all of them are called
//   size      rows of a page
//   columns   {name, width, cell(row)}, with a `key` if the list can be ordered by it, `number` for numbers
//   search    name of the search in the state
//   filters   names of the filters in the state; options(name) gives their values and what they are called
//   state     what else belongs to the state, by name
//   narrows   filters that are cleared when another one changes: {subdomain: "domain"}
//   find      (state, after, count) => the number of matching rows, and those from `after` on
//   count     (total) => the number that is displayed
//   drawn     called when the list was drawn
//   load      (id) => the content of an item's page
//   show      (content, element, id) => draws it; what it returns has `go(step)`, `current` and `count` if it has steps
//   title     (content) => of the document

let viewer = null;
let state = {};
let rows = [];           // of the displayed page
let first = 0;           // index of its first row
let total = 0;           // number of matching rows
let turn = 0;            // number of the latest request; replies to earlier ones are ignored
let open = null;         // id of the displayed item
let at = null;           // its index in the list, if it is known
let reached = null;      // the item that was reached from its neighbour, with its index
let player = null;       // what `show` returned
let scrolled = 0;        // scroll position of the list
const title = document.title;

const number = (value) => value.toLocaleString("en-US").replaceAll(",", "\u2009");
const plural = (count, one) => `${number(count)} ${one}${count === 1 ? "" : "s"}`;
const addressOf = (id, step) => `#/${viewer.item}/${encodeURIComponent(id)}${step ? `/${step}` : ""}`;

/** The address of the list in its current state. */
function listAddress() {
  const parameters = new URLSearchParams(Object.entries(state)
    .filter(([key, value]) => value && !(key === "page" && value === 1)).map(([key, value]) => [key, value === true ? "1" : value]));
  return `#/${parameters.size ? `?${parameters}` : ""}`;
}

/** The state, as parameters of a request for rows. */
const question = (state, after, count) => new URLSearchParams([
  ...Object.entries(state).filter(([key, value]) => value && key !== "page"), ["after", after], ["count", count]]);

async function ask(path) {
  const reply = await fetch(path);
  if (!reply.ok) throw new Error(reply.status === 404 ? `This ${viewer.names[2]} has no such ${viewer.names[0]}.` : await reply.text());
  return reply.json();
}

// --- the list ------------------------------------------------------------------------------------------

function line(row) {
  const show = (event) => {
    if (!event.target.closest("a, button") && !getSelection().toString()) location.hash = addressOf(row.id);
  };
  return h("tr", { "data-id": row.id, onclick: show }, viewer.columns.map((column) => h("td", { class: column.number && "number" }, column.cell(row))));
}

async function drawRows() {
  const mine = ++turn, after = (state.page - 1) * viewer.size;
  let found;
  try {
    found = await viewer.find(state, after, viewer.size);
  } catch (error) {
    if (mine === turn) byId("list-count").textContent = `Search failed: ${error.message}`;
    return;
  }
  if (mine !== turn) return;
  total = found.total;
  const pages = Math.max(1, Math.ceil(total / viewer.size));
  if (state.page > pages) { change({ page: pages }); return; }
  [rows, first] = [found.rows, after];
  byId("rows-body").replaceChildren(...rows.map(line));
  byId("list-count").textContent = viewer.count(total);
  byId("nothing").hidden = total > 0;
  drawPager(pages);
  if (open !== null) redrawCrumbs();
}

function drawPager(pages) {
  const near = (by) => Math.min(Math.max(state.page + by, 1), pages);   // asked at each click: two may come before the next page does
  const go = (by, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name, disabled: near(by) === state.page,
    onclick: () => { change({ page: near(by) }); byId("list").scrollIntoView({ block: "start" }); } }, icon(path));
  byId("pager").hidden = pages < 2;
  byId("pager").replaceChildren(h("span", { class: "muted" }, `${number(first + 1)} to ${number(first + rows.length)} of ${number(total)}`),
    go(-1, LEFT, "Previous page"), go(1, RIGHT, "Next page"));
}

/** Fill the filters with the existing values. */
function fillFilters() {
  for (const key of viewer.filters) {
    const select = byId(`filter-${key}`), offered = [...viewer.options(key)];
    if (state[key] && !offered.some(([value]) => value === state[key])) offered.push([state[key], state[key]]);
    select.replaceChildren(select.options[0], ...offered.map(([value, name]) => h("option", { value }, name)));
    select.value = state[key];
    select.parentElement.hidden = offered.length === 0;
  }
}

/** Draw the list according to the state. */
function drawList() {
  if (byId("search").value.trim() !== state[viewer.search].trim()) byId("search").value = state[viewer.search];
  fillFilters();
  byId("clear").hidden = !cleared.some((key) => state[key]);
  for (const head of byId("columns").children) {
    if (head.dataset.key && head.dataset.key === state.sort) head.setAttribute("aria-sort", state.down ? "descending" : "ascending");
    else head.removeAttribute("aria-sort");
  }
  for (const key of document.querySelectorAll(".key[data-facet]"))
    key.setAttribute("aria-pressed", String(key.dataset.value === state[key.dataset.facet]));
  viewer.drawn();
  return drawRows();
}

function change(changes) {
  Object.assign(state, { page: 1 }, changes);
  for (const [narrow, wide] of Object.entries(viewer.narrows || {}))
    if (wide in changes && !(narrow in changes)) state[narrow] = "";
  history.replaceState(null, "", listAddress());
  drawList();
}

/** Order by a column, then in the other direction, then not at all. */
const orderBy = (key) => change(state.sort !== key ? { sort: key, down: false } : state.down ? { sort: "", down: false } : { down: true });

// --- an item -------------------------------------------------------------------------------------------

/** The index of an item in the list; null if it is not known. */
function indexOf(id) {
  const here = rows.findIndex((row) => row.id === id);
  return here >= 0 ? first + here : reached && reached.id === id ? reached.at : null;
}

function crumbs() {
  const to = (by, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name,
    disabled: at === null || at + by < 0 || at + by >= total, onclick: () => neighbour(by) }, icon(path));
  const [one, many] = viewer.names;
  return h("nav", { class: "crumbs", "aria-label": capital(many) },
    h("a", { class: "quiet", href: listAddress(), id: "back" }, icon(LEFT), `All ${many}`), h("span", { class: "grow" }),
    at !== null && h("span", { class: "where" }, `${number(at + 1)} of ${number(total)}`),
    to(-1, LEFT, `Previous ${one} ([)`), to(1, RIGHT, `Next ${one} (])`));
}

function redrawCrumbs() {
  at = indexOf(open);
  byId(viewer.place).querySelector(".crumbs")?.replaceWith(crumbs());
}

async function neighbour(by) {
  const next = at + by;
  if (at === null || next < 0 || next >= total) return;
  at = next;   // before the reply: another key may come first
  const found = await viewer.find(state, next, 1);
  if (at !== next || !found.rows.length) return;
  state.page = Math.floor(next / viewer.size) + 1;
  reached = { id: found.rows[0].id, at: next };
  location.hash = addressOf(reached.id);
}

async function showItem(id, step) {
  if (open === id && player) { player.go(step); return; }
  const place = byId(viewer.place);
  if (open === null) scrolled = scrollY;
  [open, player, at] = [id, null, indexOf(id)];
  byId("home").hidden = true;
  place.hidden = false;
  const body = h("div", {}, h("p", { class: "muted" }, "Loading…"));
  place.replaceChildren(crumbs(), body);
  scrollTo(0, 0);
  try {
    const it = await viewer.load(id);
    if (open !== id) return;
    document.title = `${shorten(viewer.title(it), 60)} · WebGym`;
    player = viewer.show(it, body, id);
    player?.go(Math.min(step, player.count));
  } catch (error) {
    if (open === id) body.replaceChildren(h("p", { class: "failure-box" }, String(error.message || error)));
  }
}

// --- routes and keys -----------------------------------------------------------------------------------

/** Set the state from the query of an address. */
function readState(query) {
  const parameters = new URLSearchParams(query);
  for (const key of Object.keys(state))
    state[key] = key === "page" ? Math.max(1, Number.parseInt(parameters.get(key), 10) || 1) : key === "down" ? parameters.has(key) : parameters.get(key) || "";
  return drawList();
}

async function showList(query) {
  open = at = player = null;
  document.title = title;
  byId(viewer.place).hidden = true;
  byId(viewer.place).replaceChildren();
  byId("home").hidden = false;
  await readState(query);
  if (open === null) scrollTo(0, scrolled);
}

function route() {
  const [, item, id, step] = location.hash.match(/^#\/(\w+)\/([^/]+)(?:\/(\d+))?$/) || [];
  if (item === viewer.item) showItem(decodeURIComponent(id), Number(step) || 1);
  else if (location.hash !== "#content") showList(location.hash.split("?")[1] || "");
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea")) return;
  const inItem = { "[": () => neighbour(-1), "]": () => neighbour(1), Escape: () => { location.hash = listAddress(); },
    ...(player && { ArrowLeft: () => player.go(player.current - 1), ArrowRight: () => player.go(player.current + 1), Home: () => player.go(1), End: () => player.go(player.count) }) };
  const act = (open === null ? { "/": () => byId("search").focus() } : inItem)[event.key];
  if (act) { event.preventDefault(); act(); }
});

let cleared = [];        // what the button “Clear” clears
let typing;

function begin(given) {
  viewer = given;
  cleared = [viewer.search, ...viewer.filters, ...Object.keys(viewer.state || {})];
  state = { ...Object.fromEntries(cleared.map((key) => [key, ""])), sort: "", down: false, page: 1 };
  byId("columns").append(...viewer.columns.map(({ key, name, width, number: isNumber }) =>
    h("th", { scope: "col", "data-key": key, class: isNumber && "number", style: { width } },
      key ? h("button", { type: "button", onclick: () => orderBy(key) }, name) : h("span", { class: "head" }, name))));
  byId("search").addEventListener("input", (event) => {
    clearTimeout(typing);
    typing = setTimeout(() => change({ [viewer.search]: event.target.value.trim() }), 150);
  });
  for (const key of viewer.filters) byId(`filter-${key}`).addEventListener("change", (event) => change({ [key]: event.target.value }));
  byId("clear").addEventListener("click", () => change(Object.fromEntries(cleared.map((key) => [key, ""]))));
  byId("overview").addEventListener("click", (event) => {
    const { facet, value } = event.target.closest("[data-facet]")?.dataset || {};
    if (!value) return;
    change({ [facet]: state[facet] === value ? "" : value });
    byId("list").scrollIntoView({ block: "start", behavior: "smooth" });
  });
  addEventListener("hashchange", route);
  if (location.hash.startsWith(`#/${viewer.item}/`)) readState("");
  route();
}
