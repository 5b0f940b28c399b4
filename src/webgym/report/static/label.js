// The labelling page: one trajectory after the other, with the judge's verdict hidden until it is labelled.

const CHOICES = [["success", "Success", "s", "success"], ["failure", "Failure", "f", "failure"], ["unsure", "Cannot tell", "u", "truncated"],
  ["not_executable", "Cannot be done", "x", "cancelled"]];

let annotator = stored("webgym-annotator") || "";
let queue = [];          // the attempts to label: {id, level}
let labels = {};         // by attempt: {label, note}
let shownId = null;
let player = null;       // the result of drawTrajectory
let saving = Promise.resolve();

const who = () => `annotator=${encodeURIComponent(annotator)}`;
const addressOf = (id) => `#/t/${encodeURIComponent(id)}`;
const indexOf = (id) => queue.findIndex((each) => each.id === id);

async function ask(path, options) {
  const reply = await fetch(path, options);
  if (!reply.ok) throw new Error(await reply.text());
  return reply.json();
}

function say(text, isBad = false) {
  byId("said").textContent = text;
  byId("said").classList.toggle("bad", isBad);
}

// --- the annotator ---------------------------------------------------------------------------------------

async function begin(name) {
  annotator = name.trim();
  byId("who").hidden = annotator !== "";
  byId("desk").hidden = annotator === "";
  if (!annotator) { byId("name").focus(); return; }
  stored("webgym-annotator", annotator);
  byId("annotator").textContent = annotator;
  try {
    ({ queue, labels } = await ask(`api/labels?${who()}`));
  } catch (error) { say(String(error.message), true); return; }
  drawProgress();
  const [, asked] = location.hash.match(/^#\/t\/([^/]+)$/) || [];
  const wanted = asked === undefined ? undefined : decodeURIComponent(asked);
  if (wanted !== undefined && indexOf(wanted) >= 0) show(wanted);
  else if (queue.length) show((queue.find((each) => !labels[each.id]) || queue[0]).id);
  else byId("place").replaceChildren(h("p", { class: "muted" }, "This run has no attempts to label."));
}

byId("who").addEventListener("submit", (event) => { event.preventDefault(); begin(byId("name").value); });
byId("change").addEventListener("click", () => { byId("name").value = annotator; begin(""); });

// --- progress ------------------------------------------------------------------------------------

function drawProgress() {
  const done = queue.filter((each) => labels[each.id]).length;
  byId("bar").max = Math.max(queue.length, 1);
  byId("bar").value = done;
  const levels = [...new Set(queue.map((each) => each.level))].filter(Boolean);
  byId("progress").textContent = [`${done} of ${queue.length} labelled`,
    ...levels.map((level) => `${level} ${queue.filter((each) => each.level === level && labels[each.id]).length}/${queue.filter((each) => each.level === level).length}`)].join(" · ");
  byId("finished").hidden = !queue.length || done < queue.length;
}

function drawChoices() {
  const current = labels[shownId];
  byId("choices").replaceChildren(...CHOICES.map(([label, name, key, colour]) =>
    h("button", { type: "button", class: "choice", "data-label": label, "aria-pressed": String(Boolean(current) && current.label === label), onclick: () => put(label) },
      h("span", { class: "dot", style: { background: `var(--${colour})` } }), name, " ", h("kbd", {}, key.toUpperCase()))));
  byId("where").textContent = `${indexOf(shownId) + 1} of ${queue.length}`;
}

// --- one trajectory -----------------------------------------------------------------------------------

async function show(id) {
  const step = shownId === id && player ? player.current : 1;
  if (shownId !== id) {
    player = null;  // until it is drawn, it cannot be labelled
    byId("place").replaceChildren(h("p", { class: "muted" }, "Loading…"));
  }
  shownId = id;
  history.replaceState(null, "", addressOf(id));
  byId("note").value = (labels[id] || {}).note || "";
  drawChoices();
  try {
    const it = await ask(`api/labels/trajectory?id=${encodeURIComponent(id)}&${who()}`);
    if (shownId !== id) return;
    const body = h("div", {});
    player = drawTrajectory(it, body, () => {}, null);
    byId("place").replaceChildren(body);
    player.go(Math.min(step, player.count));
    if (step === 1) scrollTo(0, 0);
  } catch (error) { say(String(error.message), true); }
}

/** Labels are saved sequentially, in the order in which they were given. */
function put(label) {
  const body = { id: shownId, annotator, label, note: byId("note").value };
  if (player) saving = saving.then(() => save(body));
}

async function save(body) {
  try {
    await ask("api/labels", { method: "POST", headers: { "Content-Type": "application/json", "X-WebGym-Token": settings.token },
      body: JSON.stringify(body) });
  } catch (error) { say(`Not saved: ${error.message}`, true); return; }
  labels[body.id] = { label: body.label, note: body.note };
  say(`Saved: ${CHOICES.find(([label]) => label === body.label)[1].toLowerCase()}`);
  drawProgress();
  if (shownId === body.id) show(body.id);
}

/** Show the next attempt without a label, wrapping around; if all are labelled, the next one. */
function next() {
  const at = indexOf(shownId);
  const following = [...queue.slice(at + 1), ...queue.slice(0, at)];
  const to = following.find((each) => !labels[each.id]) || following[0];
  if (to) { say(""); show(to.id); }
}

function previous() {
  const at = indexOf(shownId);
  if (at > 0) { say(""); show(queue[at - 1].id); }
}

byId("next").addEventListener("click", next);
byId("previous").addEventListener("click", previous);
byId("note").addEventListener("change", () => { if (labels[shownId]) put(labels[shownId].label); });

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input, textarea")) {
    if (event.key === "Escape" || (event.key === "Enter" && event.target.id === "note")) event.target.blur();
    return;
  }
  if (byId("desk").hidden) return;
  const choice = CHOICES.find(([, , key]) => key === event.key.toLowerCase());
  const act = choice ? () => put(choice[0]) : { n: next, p: previous, m: () => byId("note").focus(),
    ArrowLeft: () => player && player.go(player.current - 1), ArrowRight: () => player && player.go(player.current + 1),
    Home: () => player && player.go(1), End: () => player && player.go(player.count) }[event.key];
  if (act && (!event.repeat || event.key.startsWith("Arrow"))) { event.preventDefault(); act(); }
});

begin(annotator);
