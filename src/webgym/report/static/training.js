// The same tasks before and after a training, step by step.

let home = "";           // run folder of the screenshots that are not embedded

/** Address of a screenshot: embedded, or in the run folder of its evaluation. */
function picture(name) {
  const embedded = byId(`p-${name}`);
  return embedded ? `data:${embedded.textContent}` : `${home}/screenshots/${name.slice(0, 2)}/${name}.png`;
}

function stepOf(step, number) {
  const said = step.action ? sentence(step.action) : step.error || "No action";
  return h("li", { class: "shot" }, stage(step, step.action, `Step ${number}: ${said}`),
    h("div", { class: "shot-cap" }, h("b", {}, String(number)), " ", said),
    step.changed === false && h("div", { class: "shot-cap muted" }, "nothing changed"));
}

function sideOf(it, name, place) {
  home = place;
  const count = `${it.steps.length} ${it.steps.length === 1 ? "step" : "steps"}`;
  return h("div", { class: "side-by" },
    h("h3", {}, name, " ", outcomeTag(it.outcome), h("span", { class: "muted" }, ` ${count}`)),
    h("ol", { class: "shots" }, it.steps.map((step, index) => stepOf(step, index + 1))),
    h("p", { class: "answer" }, h("span", { class: "muted" }, "Answer: "), it.answer === null ? "none" : it.answer || "(empty)"));
}

function pairOf([before, after]) {
  const task = after.task;
  return h("section", { class: "card pair-card" },
    h("h2", {}, task.instruction),
    h("p", { class: "muted" }, [task.site, task.level, task.reference ? `reference: ${task.reference}` : ""].filter(Boolean).join(" · ")),
    h("div", { class: "pair" }, sideOf(before, "Before", settings.homes[0]), sideOf(after, "After", settings.homes[1])));
}

// The data come after this script.
document.addEventListener("DOMContentLoaded", () => {
  const place = byId("pairs");
  for (let number = 0; place && number < Number(place.dataset.count); number += 1) {
    place.append(pairOf(JSON.parse(byId(`pair-${number}`).textContent)));
  }
}, { once: true });
