// The source of rows, trajectories and screenshots: the file itself, or the server of a live page.

const embeddedRows = JSON.parse(byId("rows").textContent);   // rows; of a live page, how many there are, their version, and the filters' values
const list = settings.live ? embeddedRows
  : { count: embeddedRows.length, options: Object.fromEntries(["outcome", "level", "domain", "site"].map((key) => [key, [...new Set(embeddedRows.map((row) => row[key]))].filter(Boolean)])) };

const LEVELS = { easy: 0, medium: 1, hard: 2 };
const OUTCOMES = Object.keys(settings.outcomes);
const FILTERS = {
  outcome: { name: outcomeName, order: (a, b) => OUTCOMES.indexOf(a) - OUTCOMES.indexOf(b) },
  level: { name: capital, order: (a, b) => LEVELS[a] - LEVELS[b] },
  domain: { name: String, order: (a, b) => a.localeCompare(b) },
  site: { name: String, order: (a, b) => a.localeCompare(b) },
};
const ORDERS = { outcome: (row) => OUTCOMES.indexOf(row.outcome), task: (row) => row.task.toLowerCase(), domain: (row) => row.domain + row.subdomain };

function fits(row, state) {
  if (Object.keys(FILTERS).some((key) => state[key] && row[key] !== state[key])) return false;
  const text = `${row.id}\n${row.task}\n${row.site}\n${row.domain}\n${row.subdomain}\n${row.answer}\n${row.code}`.toLowerCase();
  return state.q.toLowerCase().split(/\s+/).every((word) => text.includes(word));
}

/** The matching rows of the file, in order. */
function choose(state) {
  const found = embeddedRows.filter((row) => fits(row, state));
  if (!state.sort) return found;
  const by = ORDERS[state.sort] || ((row) => row[state.sort]), sign = state.down ? -1 : 1;
  const keyed = found.map((row) => [by(row), row]);
  keyed.sort(([a], [b]) => (a < b ? -sign : a > b ? sign : 0));
  return keyed.map(([, row]) => row);
}

/** The number of matching rows, and `count` of them from `after` on, in order. */
async function find(state, after, count) {
  if (settings.live) return ask(`api/rows?${question(state, after, count)}`);
  const matching = choose(state);
  return { total: matching.length, rows: matching.slice(after, after + count) };
}

/** Resolves once the whole file has been read: its data come after this script. */
const whole = new Promise((done) => {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", done, { once: true });
  else done();
});

async function trajectory(id) {
  if (settings.live) return ask(`api/trajectory?id=${encodeURIComponent(id)}`);
  await whole;
  const row = embeddedRows.find((each) => each.id === id), size = settings.chunk;
  if (row && row.page === undefined) throw new Error("A report holds a part of a large run's trajectories; “webgym view” shows this one.");
  const element = row && byId(`c-${Math.floor(row.page / size)}`);
  if (!element) throw new Error("This report has no such trajectory.");
  return (await unpacked(element))[row.page % size];
}

/** The values of an element with compressed data. */
async function unpacked(element) {
  const bytes = Uint8Array.from(atob(element.textContent), (character) => character.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).json();
}

/** Show a warning if the screenshots in the run folder cannot be loaded. */
function lookForPictures() {
  const warning = byId("moved"), name = warning.dataset.picture;
  if (!name) return;
  const probe = new Image();
  probe.addEventListener("error", () => { warning.hidden = false; });
  probe.src = wholePicture(name);
}

const wholePicture = (name) => `screenshots/${name.slice(0, 2)}/${name}.png`;

/** Address of a screenshot: embedded, or in the run folder. */
function picture(name) {
  const embedded = byId(`p-${name}`);
  return embedded ? `data:${embedded.textContent}` : wholePicture(name);
}

/** Poll the server for new trajectories while the page is visible. */
function follow(changed) {
  if (!settings.live) return;
  const badge = byId("live");
  badge.hidden = false;
  let isWhole = byId("overview").dataset.whole === "true";
  const showState = () => {
    badge.classList.toggle("whole", isWhole);
    badge.textContent = `${isWhole ? "finished" : "live"}, ${list.count} attempts`;
  };
  showState();
  async function ask() {
    try {
      const reply = await fetch(`api/news?known=${list.count}&version=${list.version}&whole=${isWhole}`);
      if (!reply.ok) throw new Error(String(reply.status));
      const news = await reply.json();
      Object.assign(list, { count: news.count, version: news.version, options: news.options });
      isWhole = news.whole;
      badge.classList.remove("lost");
      showState();
      if (news.overview) changed(news.overview);
    } catch {
      badge.classList.add("lost");
      badge.textContent = "disconnected";
    }
    later();
  }
  const later = () => setTimeout(() => document.hidden ? document.addEventListener("visibilitychange", ask, { once: true }) : ask(), settings.refresh * 1000);
  later();
}
