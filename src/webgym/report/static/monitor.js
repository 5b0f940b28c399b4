// The monitor: one cell per attempt on a canvas, so that a thousand of them cost one element, and figures beside it.

const LARGEST = 34, SMALLEST = 5, HEIGHT = 380;   // of a cell, of the grid; CSS pixels
const NUMBERED = 20;                              // cells from this size on show their number of steps
const NEWEST = 1200;                              // points of the curve
let feed = null;
let layout = { size: LARGEST, columns: 1 };
let history = [];
let draws = 0;
let isDue = false;

const percent = (share) => share === null ? "–" : `${(share * 100).toFixed(1)}%`;
const clock = (value) => {
  if (value === null) return "–";
  const whole = Math.floor(value), pad = (number) => String(number).padStart(2, "0");
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return hours ? `${hours}:${pad(minutes)}:${pad(whole % 60)}` : `${minutes}:${pad(whole % 60)}`;
};

/** Size a canvas for the resolution of the screen; its drawing context. */
function prepared(canvas, width, height) {
  const ratio = devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  return pen;
}

/** The current colors of the theme, because a canvas cannot use CSS variables. */
function colors() {
  const found = new Map();
  for (const dot of document.querySelectorAll("[data-state]")) found.set(dot.dataset.state, getComputedStyle(dot).backgroundColor);
  return found;
}

function drawCells() {
  const canvas = byId("cells"), cells = feed.cells, width = canvas.parentElement.clientWidth;
  const places = cells.reduce((most, cell) => Math.max(most, cell[0] + 1), 0);
  let size = LARGEST;
  while (size > SMALLEST && Math.ceil(places / Math.max(1, Math.floor(width / size))) * size > HEIGHT) size -= 1;
  const columns = Math.max(1, Math.floor(width / size)), height = Math.max(size, Math.ceil(places / columns) * size);
  layout = { size, columns };
  const pen = prepared(canvas, width, height), found = colors(), gap = size > 10 ? 2 : 1, side = size - gap;
  const most = cells.reduce((longest, cell) => Math.max(longest, cell[3]), 10);
  const ink = getComputedStyle(canvas).color;
  pen.font = `600 ${Math.min(12, size * 0.4)}px ${getComputedStyle(canvas).fontFamily}`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const [place, , state, steps] of cells) {
    const x = (place % columns) * size, y = Math.floor(place / columns) * size, filled = side * Math.min(1, steps / most);
    pen.fillStyle = found.get(state || "") || found.get("");
    pen.globalAlpha = 0.35;
    pen.fillRect(x, y, side, side);
    pen.globalAlpha = 0.5;
    pen.fillRect(x, y + side - filled, side, filled);
    pen.globalAlpha = 1;
    if (size < NUMBERED) continue;
    pen.fillStyle = ink;
    pen.fillText(String(steps), x + side / 2, y + side / 2 + 1);
  }
  canvas.setAttribute("aria-label", `${cells.length} attempts in progress: ${settings.states.map((state) => `${feed.states[state]} ${state}`).join(", ")}`);
}

function drawPace() {
  const canvas = byId("pace"), width = canvas.parentElement.clientWidth - 40, height = 90;
  const pen = prepared(canvas, width, height), style = getComputedStyle(canvas);
  if (history.length < 2) return;
  const from = history[0].at, span = Math.max(1, history.at(-1).at - from);
  const most = Math.max(1, ...history.map((point) => point.steps_per_second));
  pen.strokeStyle = getComputedStyle(document.querySelector("[data-state=thinking]")).backgroundColor;
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (const point of history) pen.lineTo((point.at - from) / span * width, height - 18 - point.steps_per_second / most * (height - 34));
  pen.stroke();
  pen.fillStyle = style.color;
  pen.font = `12px ${style.fontFamily}`;
  pen.fillText(`maximum ${most.toFixed(1)}`, 0, 10);
  pen.fillText(`last ${clock(span)}`, 0, height - 3);
}

const cellsOf = (row) => row.map((value, index) => h(index ? "td" : "th", index ? { class: "number" } : { scope: "row" }, value));
function table(id, head, lines) {
  byId(id).replaceChildren(h("thead", {}, h("tr", {}, head.map((name, index) => h("th", { scope: "col", class: index && "number" }, name)))),
    h("tbody", {}, lines.map((row) => h("tr", {}, cellsOf(row)))));
  byId(id).closest(".card").hidden = !lines.length;
}

const tile = (name, value, note) => h("div", { class: "tile" }, h("dt", {}, name),
  h("dd", {}, h("span", { class: "value" }, value), h("span", { class: "note" }, note)));
const briefly = (value) => value === null ? "–" : milliseconds(value * 1000);

function drawFigures() {
  byId("bar").max = Math.max(1, feed.total);
  byId("bar").value = feed.done;
  byId("done").textContent = `${feed.done} of ${feed.total}`;
  byId("left").textContent = feed.seconds_left === null ? "" : `${clock(feed.seconds_left)} left`;
  byId("tiles").replaceChildren(
    tile("Success rate", percent(feed.success.of_judged), `${feed.success.won} of ${feed.success.judged} judged`),
    tile("Success of all finished", percent(feed.success.of_done), `of ${feed.success.done}`),
    tile("Steps per second", feed.steps_per_second.toFixed(1), `${feed.steps} steps`),
    tile("Trajectories per minute", feed.trajectories_per_minute.toFixed(1), `${feed.done - feed.earlier} this session`),
    tile("In progress", String(feed.cells.length), "attempts"),
    tile("Elapsed", clock(feed.seconds), feed.earlier ? `${feed.earlier} done in earlier sessions` : ""));
  for (const count of document.querySelectorAll("[data-count]")) count.textContent = feed.states[count.dataset.count] ?? 0;
  table("levels", ["", "of judged", "", "of all done", ""], settings.levels.map((level) => [level, feed.levels[level]])
    .filter(([, one]) => one.done)
    .map(([level, one]) => [capital(level), percent(one.of_judged), `${one.won} of ${one.judged}`, percent(one.of_done), `of ${one.done}`]));
  table("queues", ["", "waiting", "running", "waited", "took"], Object.entries(feed.queues)
    .map(([kind, one]) => [kind, String(one.waiting), String(one.running), briefly(one.wait), briefly(one.service)]));
  table("ends", ["", ""], Object.entries(feed.outcomes).filter(([, count]) => count).map(([outcome, count]) => [outcomeTag(outcome), String(count)]));
  table("errors", ["", ""], Object.entries(feed.errors).filter(([, count]) => count).map(([code, count]) => [code, String(count)]));
  byId("warnings").replaceChildren(...feed.warnings.map((text) => h("p", { class: "warning", role: "alert" }, text)));
}

function draw() {
  isDue = false;
  byId("monitor").hidden = !feed;
  if (!feed) { byId("warnings").replaceChildren(); return; }
  drawFigures();
  drawCells();
  drawPace();
  document.documentElement.dataset.draws = String(draws += 1);
}

/** Draw before the next frame, once for all updates until then. */
function drawSoon() {
  if (!isDue) requestAnimationFrame(draw);
  isDue = true;
}

function say(word, sentence) {
  const badge = byId("live");
  badge.hidden = false;
  badge.textContent = word;
  badge.classList.toggle("whole", word === "not running");
  badge.classList.toggle("lost", word === "disconnected" || word === "stopped");
  byId("said").textContent = sentence;
}

function update(message) {
  feed = message.feed;
  if (message.error) say("stopped", message.error);
  else if (!feed) say("not running", "No collector is running.");
  else if (feed.is_stale) say("stopped", `No update from the collector for ${clock(feed.age)}: it was killed, or its machine is not responding.`);
  else {
    say("live", "Collecting.");
    history.push({ at: feed.at, steps_per_second: feed.steps_per_second });
    history = history.slice(-NEWEST);
  }
  drawSoon();
}

/** Show a tooltip for the cell under the pointer. */
function showTooltip(event) {
  const box = byId("cells").getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
  const column = Math.floor(x / layout.size), place = Math.floor(y / layout.size) * layout.columns + column;
  const cell = feed && column < layout.columns && feed.cells.find((one) => one[0] === place);
  const tip = byId("tip");
  tip.hidden = !cell;
  if (!cell) return;
  const [, id, state, steps, since] = cell;
  tip.replaceChildren(h("strong", {}, id), h("br"), `${state || "between states"} for ${seconds(since)}, ${steps} steps`);
  tip.style.left = `${Math.max(0, Math.min(x + 14, box.width - tip.offsetWidth))}px`;
  tip.style.top = `${y + 16}px`;
}

byId("cells").addEventListener("pointermove", showTooltip);
byId("cells").addEventListener("pointerleave", () => { byId("tip").hidden = true; });
byId("theme").addEventListener("click", drawSoon);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawSoon);
addEventListener("resize", drawSoon);
const events = new EventSource("api/monitor");
events.addEventListener("history", (event) => { history = JSON.parse(event.data); });
events.addEventListener("feed", (event) => update(JSON.parse(event.data)));
events.addEventListener("error", () => say("disconnected", "The connection to the server is lost; the page shows the last figures received."));
