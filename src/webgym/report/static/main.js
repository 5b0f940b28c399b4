// Routes and keys.

let playing = null;      // the result of drawTrajectory
let open = null;         // id of the displayed trajectory
let scrolled = 0;        // scroll position of the list

function crumbs(id) {
  const at = fitting.findIndex((row) => row.id === id);
  const to = (index, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name,
    disabled: at < 0 || !fitting[index], onclick: () => { location.hash = addressOf(fitting[index].id); } }, icon(path));
  return h("nav", { class: "crumbs", "aria-label": "Trajectories" },
    h("a", { class: "quiet", href: listAddress(), id: "back" }, icon(LEFT), "All trajectories"), h("span", { class: "grow" }),
    at >= 0 && h("span", { class: "where" }, `${at + 1} of ${total}`),
    to(at - 1, LEFT, "Previous trajectory ([)"), to(at + 1, RIGHT, "Next trajectory (])"));
}

/** Called after a change of the list or of the position in it; loads more rows if the last one is displayed. */
function redrawCrumbs() {
  if (open === null) return;
  byId("trajectory").querySelector(".crumbs")?.replaceWith(crumbs(open));
  if (fitting.length < total && fitting.at(-1)?.id === open) { shown += PAGE; drawTable(); }
}

async function showTrajectory(id, step) {
  const place = byId("trajectory");
  if (open === id && playing) { playing.go(step || 1); return; }
  if (open === null) scrolled = scrollY;
  open = id;
  playing = null;
  byId("home").hidden = true;
  place.hidden = false;
  const body = h("div", {}, h("p", { class: "muted" }, "Loading…"));
  place.replaceChildren(crumbs(id), body);
  redrawCrumbs();
  scrollTo(0, 0);
  try {
    const it = await trajectory(id);
    if (open !== id) return;
    document.title = `${shorten(it.task.instruction, 60)} · WebGym`;
    playing = drawTrajectory(it, body, (number) => history.replaceState(null, "", addressOf(id, number)));
    playing.go(Math.min(step || 1, playing.count));
  } catch (error) {
    if (open === id) body.replaceChildren(h("p", { class: "failure-box" }, String(error.message || error)));
  }
}

const title = document.title;

async function showList(query) {
  open = playing = null;
  document.title = title;
  byId("trajectory").hidden = true;
  byId("trajectory").replaceChildren();
  byId("home").hidden = false;
  await readState(query);
  if (open === null) scrollTo(0, scrolled);
}

function route() {
  const [, id, step] = location.hash.match(/^#\/t\/([^/]+)(?:\/(\d+))?$/) || [];
  if (id !== undefined) {
    showTrajectory(decodeURIComponent(id), Number(step) || 1);
    return;
  }
  if (location.hash === "#content") return;
  showList((location.hash.split("?")[1]) || "");
}

function neighbour(by) {
  const at = fitting.findIndex((row) => row.id === open);
  if (at >= 0 && fitting[at + by]) location.hash = addressOf(fitting[at + by].id);
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea")) return;
  if (open === null) {
    if (event.key === "/") { event.preventDefault(); byId("search").focus(); }
    return;
  }
  const act = { ArrowLeft: () => playing && playing.go(playing.current - 1), ArrowRight: () => playing && playing.go(playing.current + 1),
    Home: () => playing && playing.go(1), End: () => playing && playing.go(playing.count),
    "[": () => neighbour(-1), "]": () => neighbour(1), Escape: () => { location.hash = listAddress(); } }[event.key];
  if (act) { event.preventDefault(); act(); }
});

function localTimes() {
  for (const time of document.querySelectorAll("time")) time.textContent = moment(Date.parse(time.dateTime) / 1000);
}

beginTable();
localTimes();
lookForPictures();
addEventListener("hashchange", route);
if (location.hash.startsWith("#/t/")) { readState(""); }
route();
follow((overview) => {
  byId("overview").replaceChildren(...new DOMParser().parseFromString(overview, "text/html").body.childNodes);
  localTimes();
  fillFilters();
  if (open === null) drawTable();
});
