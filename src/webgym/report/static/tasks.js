// A task set: the list, which the server searches, and the page of one task.

const FACETS = { split: capital, level: capital, domain: String, subdomain: String, source: String, flag: String };
const COLUMNS = [
  { name: "Task", width: "auto", cell: (row) => h("a", { class: "task", href: addressOf(row.id), title: row.task }, row.task) },
  { name: "Website", width: "200px", cell: (row) => h("button", { type: "button", class: "pick cut", title: `Only tasks on ${row.site}`,
    onclick: () => change({ website: row.site }) }, row.site) },
  { name: "Domain", width: "170px", cell: (row) => [h("div", { class: "cut", title: row.domain }, row.domain),
    h("div", { class: "cut muted small", title: row.subdomain }, row.subdomain)] },
  { name: "Difficulty", width: "104px", cell: (row) => [capital(row.level), h("span", { class: "muted" }, ` ${row.difficulty}`)] },
  { name: "Source", width: "150px", cell: (row) => [h("div", { class: "cut", title: row.source }, row.source),
    row.derived && h("div", { class: "muted small" }, "derived")] },
  { name: "Split", width: "72px", cell: (row) => row.split },
];

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
  return h("a", { class: "relative", href: addressOf(row.id) },
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

function showTask(it, body) {
  body.replaceChildren(taskHead(it), h("div", { class: "columns" },
    h("div", { class: "stack" }, ...[groupCard(it), familyCard(it)].filter(Boolean)),
    h("aside", { class: "side" }, ...[answerCard(it), aboutCard(it)].filter(Boolean),
      h("p", { class: "hint" }, h("span", {}, h("kbd", {}, "["), " ", h("kbd", {}, "]"), " tasks"), h("span", {}, h("kbd", {}, "Esc"), " list")))));
  return null;
}

function optionsOf(facet) {
  const under = facet === "subdomain" && state.domain ? new Set(settings.subdomains[state.domain]) : null;
  return settings.choices[facet].filter(([value]) => !under || under.has(value) || value === state.subdomain)
    .map(([value, count]) => [value, `${FACETS[facet](value)} (${number(count)})`]);
}

/** The filter by website, which has a button in place of a list. */
function drawWebsite() {
  byId("website").hidden = !state.website;
  byId("website").replaceChildren(`on ${state.website}`, icon(CROSS, 12));
  byId("website").setAttribute("aria-label", `Remove the filter: tasks on ${state.website}`);
}

byId("website").addEventListener("click", () => change({ website: "" }));
begin({
  item: "task",
  place: "task",
  names: ["task", "tasks", "set"],
  size: settings.page,
  columns: COLUMNS,
  search: "text",
  filters: Object.keys(FACETS),
  options: optionsOf,
  state: { website: "" },
  narrows: { subdomain: "domain" },
  find: (wanted, after, count) => ask(`api/tasks?${question(wanted, after, count)}`),
  count: number,
  drawn: drawWebsite,
  load: (id) => ask(`api/task?id=${encodeURIComponent(id)}`),
  show: showTask,
  title: (it) => it.task,
});
