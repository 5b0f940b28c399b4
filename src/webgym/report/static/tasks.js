// A task set: the list, which the server searches, and the page of one task. The address has the state.

const FACETS = { split: capital, level: capital, domain: String, subdomain: String, source: String, flag: String };
const LABELS = { split: "splits", level: "difficulties", domain: "domains", subdomain: "subdomains", source: "sources", flag: "flags" };
const state = { text: "", split: "", level: "", domain: "", subdomain: "", source: "", flag: "", website: "", page: 1 };
const title = document.title;
let asked = 0;          // number of the latest request; replies to earlier ones are ignored
let open = null;        // id of the displayed task
let at = null;          // its index in the list, if it was opened from there
let total = 0;
let scrolled = 0;

const number = (value) => value.toLocaleString("en-US").replaceAll(",", "\u2009");
const plural = (count, one) => `${number(count)} ${one}${count === 1 ? "" : "s"}`;
const addressOf = (id) => `#/task/${encodeURIComponent(id)}`;
const question = (after, count) => new URLSearchParams([
  ...Object.entries(state).filter(([key, value]) => value && key !== "page"), ["after", after], ["count", count]]);

async function ask(path) {
  const reply = await fetch(path);
  if (!reply.ok) throw new Error(reply.status === 404 ? "This set has no such task." : await reply.text());
  return reply.json();
}

// --- the list ------------------------------------------------------------------------------------------

const COLUMNS = [
  { name: "Task", width: "auto", cell: (row) => h("a", { class: "task", href: addressOf(row.id), title: row.task }, row.task) },
  { name: "Website", width: "200px", cell: (row) => h("button", { type: "button", class: "pick cut", title: `Only tasks on ${row.site}`,
    onclick: (event) => { event.stopPropagation(); change({ website: row.site }); } }, row.site) },
  { name: "Domain", width: "170px", cell: (row) => [h("div", { class: "cut", title: row.domain }, row.domain),
    h("div", { class: "cut muted small", title: row.subdomain }, row.subdomain)] },
  { name: "Difficulty", width: "104px", cell: (row) => [capital(row.level), h("span", { class: "muted" }, ` ${row.difficulty}`)] },
  { name: "Source", width: "150px", cell: (row) => [h("div", { class: "cut", title: row.source }, row.source),
    row.derived && h("div", { class: "muted small" }, "derived")] },
  { name: "Split", width: "72px", cell: (row) => row.split },
];

function line(row, place) {
  const show = (event) => {
    if (event.target.closest("button") || getSelection().toString()) return;
    at = place;
    if (!event.target.closest("a")) location.hash = addressOf(row.id);
  };
  return h("tr", { "data-id": row.id, onclick: show }, COLUMNS.map((column) => h("td", {}, column.cell(row))));
}

async function drawList() {
  const turn = ++asked;
  const first = (state.page - 1) * settings.page;
  let found;
  try {
    found = await ask(`api/tasks?${question(first, settings.page)}`);
  } catch (error) {
    if (turn === asked) byId("list-count").textContent = `Search failed: ${error.message}`;
    return;
  }
  if (turn !== asked) return;
  total = found.total;
  const pages = Math.max(1, Math.ceil(total / settings.page));
  if (state.page > pages) { change({ page: pages }); return; }
  byId("rows-body").replaceChildren(...found.rows.map((row, index) => line(row, first + index)));
  byId("list-count").textContent = number(total);
  byId("nothing").hidden = total > 0;
  drawPager(first, found.rows.length, pages);
}

function drawPager(first, count, pages) {
  const near = (by) => Math.min(Math.max(state.page + by, 1), pages);   // asked at each click: two may come before the next page does
  const go = (by, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name, disabled: near(by) === state.page,
    onclick: () => { change({ page: near(by) }); byId("list").scrollIntoView({ block: "start" }); } }, icon(path));
  byId("pager").hidden = pages < 2;
  byId("pager").replaceChildren(h("span", { class: "muted" }, `${number(first + 1)} to ${number(first + count)} of ${number(total)}`),
    go(-1, LEFT, "Previous page"), go(1, RIGHT, "Next page"));
}

function fillFilters() {
  for (const [facet, name] of Object.entries(FACETS)) {
    const select = byId(`filter-${facet}`);
    const under = facet === "subdomain" && state.domain ? new Set(settings.subdomains[state.domain]) : null;
    const offered = settings.choices[facet].filter(([value]) => !under || under.has(value) || value === state.subdomain);
    if (state[facet] && !offered.some(([value]) => value === state[facet])) offered.push([state[facet], null]);
    select.replaceChildren(h("option", { value: "" }, `All ${LABELS[facet]}`),
      ...offered.map(([value, count]) => h("option", { value }, count === null ? name(value) : `${name(value)} (${number(count)})`)));
    select.value = state[facet];
    select.parentElement.hidden = settings.choices[facet].length === 0;
  }
}

function listAddress() {
  const parameters = new URLSearchParams(Object.entries(state).filter(([key, value]) => value && !(key === "page" && value === 1)));
  return `#/${parameters.size ? `?${parameters}` : ""}`;
}

/** Draw the list according to the state. */
function draw() {
  if (byId("search").value.trim() !== state.text.trim()) byId("search").value = state.text;
  fillFilters();
  byId("website").hidden = !state.website;
  byId("website").replaceChildren(`on ${state.website}`, icon(CROSS, 12));
  byId("website").setAttribute("aria-label", `Remove the filter: tasks on ${state.website}`);
  byId("clear").hidden = !Object.entries(state).some(([key, value]) => value && key !== "page");
  drawList();
}

function change(changes) {
  Object.assign(state, { page: 1 }, changes);
  if ("domain" in changes && !("subdomain" in changes)) state.subdomain = "";
  history.replaceState(null, "", listAddress());
  draw();
}

// --- a task --------------------------------------------------------------------------------------------

function groupCard(it) {
  return h("section", { class: "card", id: "rubric" }, h("h2", {}, `${plural(it.difficulty, "fact")} in ${plural(it.groups.length, "group")}`),
    it.groups.map((group) => h("div", { class: "fact-group" },
      h("h3", {}, h("span", { class: "group-id" }, String(group.id)), group.description),
      h("ul", {}, group.facts.map((fact) => h("li", { class: "fact" }, fact))))));
}

/** The groups of a parent; those that a task has are filled. */
function subset(all, having) {
  const has = new Set(having.map((group) => group.id));
  const known = all.length ? all : having;
  const names = having.map((group) => group.id).join(", ");
  return h("span", { class: "subset", role: "img", "aria-label": `groups ${names}` }, known.map((group) =>
    h("span", { class: has.has(group.id) ? "group-id" : "group-id absent", title: group.description }, String(group.id))));
}

function relative(row, all) {
  return h("a", { class: "relative", href: addressOf(row.id), onclick: () => { at = null; } },
    h("span", { class: "relative-head" }, subset(all, row.groups), h("span", { class: "muted" }, `${row.level}, ${plural(row.difficulty, "fact")}`)),
    h("span", {}, row.task));
}

function familyCard(it) {
  if (!it.parentId && !it.children.length) return null;
  return h("section", { class: "card", id: "family" }, h("h2", {}, "Family"),
    it.parentId && [h("h3", {}, "Derived from"), it.parent ? relative(it.parent, it.parent.groups) : h("p", {}, `${it.parentId}, which is not in this set`),
      it.parent && h("p", { class: "small muted" }, "This task has ", subset(it.parent.groups, it.groups))],
    it.children.length > 0 && [h("h3", {}, `${plural(it.children.length, "task")} derived from it`), it.children.map((child) => relative(child, it.groups))]);
}

const hidden = (name, text) => h("details", { class: "hidden-answer" }, h("summary", {}, name), h("p", { class: "answer" }, text));

function answerCard(it) {
  if (!it.reference && !it.example && !it.solution.length) return null;
  return h("section", { class: "card", id: "answer" }, h("h2", {}, "Answer"),
    it.reference && hidden("Show the reference answer", it.reference),
    it.example && hidden("Show an example of an answer", it.example),
    it.solution.length > 0 && hidden("Show the solution", it.solution.join("\n")));
}

function aboutCard(it) {
  const from = { given: "", derived: "taken from the record", inferred: "inferred by a model" }[it.websiteFrom];
  const facts = [["id", it.id], ["source", it.source], ["split", it.split], ["website", from], ["flags", it.flags.join(", ")], ...Object.entries(it.extra)];
  return h("section", { class: "card", id: "about" }, h("h2", {}, "Task"),
    h("dl", { class: "about" }, facts.filter(([, value]) => value).map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)])));
}

function taskHead(it) {
  const fact = (name, value) => value && h("span", {}, `${name} `, h("b", {}, value));
  const link = /^https?:\/\//i.test(it.website) ? h("a", { href: it.website, target: "_blank", rel: "noopener noreferrer" }, it.website) : it.website;
  return h("header", { class: "task-head" }, h("h1", {}, it.task),
    h("span", { class: "verdict-badge" }, `${capital(it.level)}, ${plural(it.difficulty, "fact")}`),
    h("div", { class: "meta" }, fact("website", link), fact("domain", [it.domain, it.subdomain].filter(Boolean).join(" / ")), fact("source", it.source),
      fact("split", it.split), it.flags.map((flag) => h("span", { class: "flag" }, flag))));
}

function crumbs() {
  const to = (by, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name,
    disabled: at === null || at + by < 0 || at + by >= total, onclick: () => neighbour(by) }, icon(path));
  return h("nav", { class: "crumbs", "aria-label": "Tasks" },
    h("a", { class: "quiet", href: listAddress(), id: "back" }, icon(LEFT), "All tasks"), h("span", { class: "grow" }),
    at !== null && h("span", { class: "where" }, `${number(at + 1)} of ${number(total)}`),
    to(-1, LEFT, "Previous task ([)"), to(1, RIGHT, "Next task (])"));
}

async function neighbour(by) {
  const next = at + by;
  if (at === null || next < 0 || next >= total) return;
  at = next;   // before the reply: another key may come first
  const { rows } = await ask(`api/tasks?${question(next, 1)}`);
  if (at !== next || !rows.length) return;
  state.page = Math.floor(at / settings.page) + 1;
  location.hash = addressOf(rows[0].id);
}

async function showTask(id) {
  const place = byId("task");
  if (open === null) scrolled = scrollY;
  open = id;
  byId("home").hidden = true;
  place.hidden = false;
  const body = h("div", {}, h("p", { class: "muted" }, "Loading…"));
  place.replaceChildren(crumbs(), body);
  scrollTo(0, 0);
  try {
    const it = await ask(`api/task?id=${encodeURIComponent(id)}`);
    if (open !== id) return;
    document.title = `${shorten(it.task, 60)} · WebGym`;
    body.replaceChildren(taskHead(it), h("div", { class: "columns" },
      h("div", { class: "stack" }, ...[groupCard(it), familyCard(it)].filter(Boolean)),
      h("aside", { class: "side" }, ...[answerCard(it), aboutCard(it)].filter(Boolean),
        h("p", { class: "hint" }, h("span", {}, h("kbd", {}, "["), " ", h("kbd", {}, "]"), " tasks"), h("span", {}, h("kbd", {}, "Esc"), " list")))));
  } catch (error) {
    if (open === id) body.replaceChildren(h("p", { class: "failure-box" }, String(error.message || error)));
  }
}

// --- routes and keys -----------------------------------------------------------------------------------

function showList(query) {
  open = at = null;
  document.title = title;
  byId("task").hidden = true;
  byId("task").replaceChildren();
  byId("home").hidden = false;
  const parameters = new URLSearchParams(query);
  for (const key of Object.keys(state)) state[key] = key === "page" ? Math.max(1, Number.parseInt(parameters.get(key), 10) || 1) : parameters.get(key) || "";
  draw();
  scrollTo(0, scrolled);
}

function route() {
  const [, id] = location.hash.match(/^#\/task\/([^/]+)$/) || [];
  if (id !== undefined) showTask(decodeURIComponent(id));
  else if (location.hash !== "#content") showList(location.hash.split("?")[1] || "");
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea")) return;
  const act = (open === null ? { "/": () => byId("search").focus() }
    : { "[": () => neighbour(-1), "]": () => neighbour(1), Escape: () => { location.hash = listAddress(); } })[event.key];
  if (act) { event.preventDefault(); act(); }
});

let typing;
byId("columns").append(...COLUMNS.map((column) => h("th", { scope: "col", style: { width: column.width } }, h("span", { class: "head" }, column.name))));
byId("search").addEventListener("input", (event) => { clearTimeout(typing); typing = setTimeout(() => change({ text: event.target.value.trim() }), 150); });
for (const facet of Object.keys(FACETS)) byId(`filter-${facet}`).addEventListener("change", (event) => change({ [facet]: event.target.value }));
byId("website").addEventListener("click", () => change({ website: "" }));
byId("clear").addEventListener("click", () => change(Object.fromEntries(Object.keys(state).map((key) => [key, key === "page" ? 1 : ""]))));
byId("overview").addEventListener("click", (event) => {
  const pick = event.target.closest(".pick");
  if (!pick || !pick.dataset.value) return;
  change({ [pick.dataset.facet]: pick.dataset.value });
  byId("list").scrollIntoView({ block: "start", behavior: "smooth" });
});
addEventListener("hashchange", route);
route();
