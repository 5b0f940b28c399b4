// Where rows, trajectories and pictures come from: the file itself, or the server behind a live page.

const rows = JSON.parse(byId("rows").textContent);

/** Resolves once the whole file has been read: its data stand behind this script. */
const whole = new Promise((done) => {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", done, { once: true });
  else done();
});

async function trajectory(id) {
  if (settings.live) {
    const reply = await fetch(`api/trajectory?id=${encodeURIComponent(id)}`);
    if (!reply.ok) throw new Error(reply.status === 404 ? "The run holds no such trajectory." : await reply.text());
    return reply.json();
  }
  await whole;
  const element = byId(`t-${rows.findIndex((row) => row.id === id)}`);
  if (!element) throw new Error("The report holds no such trajectory.");
  return JSON.parse(element.textContent);
}

const wholePicture = (name) => `screenshots/${name.slice(0, 2)}/${name}.png`;

/** Address of a picture: embedded if it is, else in the run folder. */
function picture(name) {
  const embedded = byId(`p-${name}`);
  return embedded ? `data:${embedded.textContent}` : wholePicture(name);
}

/** Ask the server for what is new, again and again, while the page is looked at. */
function follow(changed) {
  if (!settings.live) return;
  const badge = byId("live");
  badge.hidden = false;
  let known = rows.length;
  let isWhole = byId("overview").dataset.whole === "true";
  const tell = () => {
    badge.classList.toggle("whole", isWhole);
    badge.textContent = `${isWhole ? "finished" : "live"}, ${known} attempts`;
  };
  tell();
  async function ask() {
    try {
      const reply = await fetch(`api/news?after=${known}&whole=${isWhole}`);
      if (!reply.ok) throw new Error(String(reply.status));
      const news = await reply.json();
      rows.push(...news.rows);
      known += news.rows.length;
      isWhole = news.whole;
      badge.classList.remove("lost");
      tell();
      if (news.overview) changed(news.overview);
    } catch {
      badge.classList.add("lost");
      badge.textContent = "server gone";
    }
    later();
  }
  const later = () => setTimeout(() => document.hidden ? document.addEventListener("visibilitychange", ask, { once: true }) : ask(), settings.refresh * 1000);
  later();
}
