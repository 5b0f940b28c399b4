// The source of rows, trajectories and screenshots: the file itself, or the server of a live page.

const embeddedRows = JSON.parse(byId("rows").textContent);   // rows; of a live page, how many there are, their version, and the filters' values
const list = settings.live ? embeddedRows
  : { count: embeddedRows.length, options: Object.fromEntries(["outcome", "level", "domain", "site"].map((key) => [key, [...new Set(embeddedRows.map((row) => row[key]))].filter(Boolean)])) };

/** The first `count` matching rows, in order, and the number of all matching ones. */
async function find(state, count) {
  if (!settings.live) {
    const fitting = choose(embeddedRows);
    return { total: fitting.length, rows: fitting.slice(0, count) };
  }
  const parameters = Object.entries(state).filter(([, value]) => value).map(([key, value]) => [key, String(value)]);
  const reply = await fetch(`api/rows?${new URLSearchParams([...parameters, ["after", "0"], ["count", String(count)]])}`);
  if (!reply.ok) throw new Error(await reply.text());
  return reply.json();
}

/** Resolves once the whole file has been read: its data come after this script. */
const whole = new Promise((done) => {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", done, { once: true });
  else done();
});

async function trajectory(id) {
  if (settings.live) {
    const reply = await fetch(`api/trajectory?id=${encodeURIComponent(id)}`);
    if (!reply.ok) throw new Error(reply.status === 404 ? "This run has no such trajectory." : await reply.text());
    return reply.json();
  }
  await whole;
  const number = embeddedRows.findIndex((row) => row.id === id), size = settings.chunk;
  const element = byId(`c-${Math.floor(number / size)}`);
  if (number < 0 || !element) throw new Error("This report has no such trajectory.");
  return (await unpacked(element))[number % size];
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
