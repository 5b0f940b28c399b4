// The trajectories of a run: the list, and a page for each.

const COLUMNS = [
  { key: "outcome", name: "Outcome", width: "158px", cell: (row) => outcomeTag(row.outcome) },
  { key: "task", name: "Task", width: "auto", cell: (row) => h("a", { class: "task", href: addressOf(row.id), title: row.task }, row.task) },
  { key: "site", name: "Website", width: "200px", cell: (row) => h("div", { class: "cut", title: row.site }, row.site) },
  { key: "domain", name: "Domain", width: "150px", cell: (row) => h("div", { class: "cut", title: `${row.domain} / ${row.subdomain}` }, row.domain) },
  { key: "difficulty", name: "Difficulty", width: "104px", cell: (row) => [capital(row.level), h("span", { class: "muted" }, row.difficulty ? ` ${row.difficulty}` : "")] },
  { key: "steps", name: "Steps", width: "72px", number: true, cell: (row) => String(row.steps) },
  { key: "seconds", name: "Time", width: "92px", number: true, cell: (row) => seconds(row.seconds) },
];

function localTimes() {
  for (const time of document.querySelectorAll("time")) time.textContent = moment(Date.parse(time.dateTime) / 1000);
}

localTimes();
lookForPictures();
begin({
  item: "t",
  place: "trajectory",
  names: ["trajectory", "trajectories", "run"],
  size: settings.page,
  columns: COLUMNS,
  search: "q",
  filters: Object.keys(FILTERS),
  options: (key) => [...list.options[key]].sort(FILTERS[key].order).map((value) => [value, FILTERS[key].name(value)]),
  find,
  count: (total) => total === list.count ? number(total) : `${number(total)} of ${number(list.count)}`,
  drawn: () => {},
  load: trajectory,
  show: (it, body, id) => drawTrajectory(it, body, (step) => history.replaceState(null, "", addressOf(id, step))),
  title: (it) => it.task.instruction,
});
follow((overview) => {
  byId("overview").replaceChildren(...new DOMParser().parseFromString(overview, "text/html").body.childNodes);
  localTimes();
  if (open === null) drawList();
});
