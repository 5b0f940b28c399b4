// The page of one trajectory.

/** The steps, and a last frame with the page after them. What an observation notices is what the action before it did:
 *  it stands with that action, or before the first one. */
function framesOf(it) {
  const end = it.final && { ...it.final, label: "End", action: null, end: true };
  const looks = [...it.steps.map((step, index) => ({ ...step, label: `Step ${index + 1}` })), ...(end ? [end] : [])];
  return looks.map((look, index) => ({ ...look, number: index + 1, before: index ? [] : look.notices, notices: looks[index + 1]?.notices ?? [] }));
}

function sign(passed) {
  const [css, path, said] = passed === true ? ["yes", CHECK, "confirmed"] : passed === false ? ["no", CROSS, "not confirmed"] : ["", DASH, "not judged"];
  return h("span", { class: `sign ${css}`, role: "img", "aria-label": said }, icon(path, 14));
}

const cite = (it, number, text, go) => h("button", { type: "button", class: "cite", "data-step": number, onclick: () => go(number) }, text);

/** A reason with the steps that it names as links, followed by the other steps that the judgement cites. */
function reason(it, judged, go) {
  const named = new Set();
  const parts = judged.reason.split(/\b(step \d+)\b/i).map((part, index) => {
    const number = index % 2 ? Number(part.slice(5)) : 0;
    if (number < 1 || number > it.steps.length + (it.final ? 1 : 0)) return part;
    named.add(number - 1);
    return cite(it, number, part, go);
  });
  const others = (judged.steps || []).filter((index) => !named.has(index));
  return h("div", { class: "why" }, parts, others.map((index) => [" ", cite(it, index + 1, index < it.steps.length ? `step ${index + 1}` : "end", go)]));
}

function finding(it, what, judged, go) {
  const passed = judged ? judged.passed : null;
  return h("li", { class: "finding", "data-passed": String(passed) }, sign(passed),
    h("div", {}, h("div", { class: "what" }, what), judged && judged.reason && reason(it, judged, go)));
}

function rubricCard(it, go) {
  const facts = it.groups.flatMap((group) => group.facts);
  const confirmed = facts.filter((fact) => fact.passed).length;
  return h("section", { class: "card", id: "rubric" },
    h("h2", {}, it.verdict ? `Facts: ${confirmed} of ${facts.length} confirmed` : `Facts: ${facts.length}${it.blind ? "" : ", not judged"}`),
    it.groups.map((group) => [
      it.groups.length > 1 && group.description && h("h3", {}, group.description),
      h("ul", {}, group.facts.map((fact) => finding(it, fact.text, fact, go))),
    ]));
}

function answerCard(it, go) {
  const verdict = it.verdict;
  const found = verdict && [
    verdict.reference && finding(it, "The answer agrees with the reference answer", verdict.reference, go),
    verdict.response && finding(it, verdict.judge.startsWith("offline/") ? "The answer has the form that the task asks for" : "Every claim in the answer is visible in a screenshot", verdict.response, go),
    verdict.blocked && verdict.blocked.passed && finding(it, "The website blocked the agent", { ...verdict.blocked, passed: null }, go),
  ].filter(Boolean);
  return h("section", { class: "card", id: "answer" }, h("h2", {}, "Answer"),
    it.answer === null ? h("p", { class: "muted" }, "No answer was given.") : h("p", { class: "answer" }, it.answer),
    it.task.reference && [h("h3", {}, "Reference"), h("p", { class: "answer" }, it.task.reference)],
    verdict && verdict.fault && h("p", { id: "fault" }, `Failed by: ${verdict.fault}`),
    found && found.length > 0 && [h("h3", {}, `Judged by ${verdict.judge}`), h("ul", {}, found)],
    verdict && verdict.confidence !== null && h("p", { class: "muted", id: "confidence" }, `${Math.round(verdict.confidence * 100)}% of the samples agree`));
}

function failureCard(it) {
  const failure = it.failure || it.judgeFailure;
  return failure && h("section", { class: "card", id: "failure" }, h("h2", {}, it.failure ? "Error" : "Judge error"),
    h("div", { class: "failure-box" }, h("code", {}, failure.code), h("p", {}, failure.message)));
}

const ENDINGS = { answered: "answered", budget_spent: "step budget spent", straggler: "ended as a straggler",
  site_refused: "start page refused", environment_failed: "environment failed", policy_failed: "policy failed", cancelled: "cancelled" };

function taskHead(it) {
  const task = it.task;
  const fact = (name, value) => value && h("span", {}, `${name} `, h("b", {}, value));
  return h("header", { class: "task-head" },
    h("h1", {}, task.instruction),
    it.blind ? h("span", {}) : h("span", { class: "verdict-badge" }, outcomeTag(it.outcome)),
    h("div", { class: "meta" },
      fact("website", task.site), fact("domain", [task.domain, task.subdomain].filter(Boolean).join(" / ")),
      fact("difficulty", task.level && `${task.level}, ${task.difficulty} ${task.difficulty === 1 ? "fact" : "facts"}`),
      fact("ending", ENDINGS[it.ending] || it.ending), fact("took", seconds(it.seconds))));
}

/** All verdicts: that of the run's own judge, and later ones of other judges. */
function judgesOf(it) {
  const own = { judge: it.verdict ? it.verdict.judge : "judge of the run", outcome: it.outcome, groups: it.groups, verdict: it.verdict,
    judgeFailure: it.judgeFailure, judgeSeconds: it.judgeSeconds };
  return [own, ...it.others];
}

function judgeCard(judges, chosen, choose) {
  if (judges.length < 2) return null;
  return h("section", { class: "card", id: "judges" }, h("h2", {}, `${judges.length} judges`),
    h("div", { class: "judges", role: "group", "aria-label": "Judges" }, judges.map((each) =>
      h("button", { type: "button", class: "judge", "aria-pressed": String(each === chosen), onclick: () => choose(each) },
        h("span", { class: "judge-name" }, each.judge), outcomeTag(each.outcome)))));
}

/** The facts and claims whose judgement cites the screenshot of a frame. */
function foundHere(it, index) {
  const verdict = it.verdict || {};
  const all = [...it.groups.flatMap((group) => group.facts), verdict.response && { ...verdict.response, text: "The answer" },
    verdict.blocked && verdict.blocked.passed && { ...verdict.blocked, passed: null, text: "The website blocked the agent" }];
  const here = all.filter((each) => each && (each.steps || []).includes(index));
  return here.length ? h("ul", { class: "here", "aria-label": "Judged by this screenshot" }, here.map((each) =>
    h("li", { class: "finding", "data-passed": String(each.passed) }, sign(each.passed), h("div", {}, h("div", { class: "what" }, each.text), h("div", { class: "why" }, each.reason))))) : null;
}

function costOf(verdict) {
  const cost = verdict && verdict.cost;
  if (!cost) return null;
  return `${cost.replies} replies${cost.cached ? `, ${cost.cached} from the cache` : ""}, ${cost.tokens} tokens${cost.dollars ? `, $${cost.dollars.toFixed(4)}` : ""}`;
}

function aboutCard(it) {
  const facts = [["attempt", it.id], ["policy", it.policy], ["judge", it.verdict && it.verdict.judge], ["split", it.task.split],
    ["seed", it.seed], ["started", moment(it.started)], ["judging took", it.judgeSeconds && milliseconds(it.judgeSeconds * 1000)], ["judging cost", costOf(it.verdict)]];
  return h("section", { class: "card" }, h("h2", {}, "Attempt"),
    h("dl", { class: "about" }, facts.filter(([, value]) => value).map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)])));
}

const NOTICES = { navigation_failed: "Navigation failed", download_refused: "Download refused", action_failed: "Action failed", dialog: "Dialog",
  popup: "Popup", still_loading: "Still loading", crashed: "Crashed", reply_unreadable: "Reply unreadable", shortened: "Shortened", changed: "Changed since the picture", unchanged: "Nothing changed", no_effect: "No effect", limited: "Limited by us" };
const BAD = new Set(["navigation_failed", "action_failed", "crashed", "reply_unreadable"]);

function noticeList(frame) {
  const notice = (lead) => ([kind, text]) => h("p", { class: `notice ${BAD.has(kind) ? "bad" : ""}` }, h("b", {}, lead + (NOTICES[kind] || kind)), " ", text);
  const notices = [...frame.before.map(notice("Before the first step: ")), ...frame.notices.map(notice(""))];
  if (frame.error) notices.push(h("p", { class: "notice bad" }, h("b", {}, "No action in this reply"), " ", frame.error));
  if (frame.memory) notices.push(h("p", { class: "notice" }, h("b", {}, "The memory was corrected"), " ", frame.memory));
  return notices.length ? h("div", { class: "notices" }, notices) : null;
}

function timeList(frame) {
  const shownTimes = [["reply", frame.replyMs], ["until the next screenshot", frame.waited], ...Object.entries(frame.ms)];
  const tokens = frame.tokens && (frame.tokens[0] || frame.tokens[1]) ? `${frame.tokens[0]} + ${frame.tokens[1]}` : null;
  return h("div", { class: "times" },
    frame.at !== undefined && h("span", {}, "at ", h("b", {}, seconds(frame.at))),
    shownTimes.filter(([, value]) => value !== null && value !== undefined).map(([name, value]) => h("span", {}, `${name} `, h("b", {}, milliseconds(value)))),
    tokens && h("span", {}, "tokens ", h("b", {}, tokens)),
    h("a", { href: wholePicture(frame.shot), target: "_blank", rel: "noopener" }, "full size"));
}

function frameView(it, frame, count, go, open) {
  const did = frame.end ? "After the last action" : frame.action ? sentence(frame.action) : "No action";
  const at = frame.number;
  const step = (to, path, name) => h("button", { type: "button", class: "quiet", "aria-label": name, title: name, disabled: to < 1 || to > count, onclick: () => go(to) }, icon(path));
  const reply = !frame.end && h("details", { class: "reply", open }, h("summary", {}, "Reply"), h("pre", {}, frame.reply || "(empty)"));
  return [
    h("div", { class: "now" },
      h("div", { class: "did", id: "did" }, h("b", {}, did),
        frame.changed === false && h("span", { class: "muted" }, "  · nothing changed")),
      h("span", { class: "count" }, `${frame.label}${frame.end ? "" : ` of ${it.steps.length}`}`),
      step(at - 1, LEFT, "Previous step (←)"), step(at + 1, RIGHT, "Next step (→)")),
    h("div", { class: "address", title: frame.title }, frame.status !== null && h("span", { class: `status ${frame.status >= 400 ? "bad" : ""}` }, String(frame.status)),
      h("span", { class: "url" }, frame.url)),
    stage(frame, frame.action, `Screenshot, ${frame.label.toLowerCase()}: ${frame.title}. ${did}`),
    noticeList(frame), foundHere(it, at - 1), timeList(frame), reply,
  ];
}

const provenBy = (it) => new Set(it.groups.flatMap((group) => group.facts).filter((fact) => fact.passed).flatMap((fact) => fact.steps || []));

function filmstrip(frames, go) {
  return h("div", { class: "film", role: "group", "aria-label": "Steps" }, frames.map((frame) =>
    h("button", { type: "button", class: "frame", "data-step": frame.number, "aria-label": `${frame.label}: ${frame.action ? sentence(frame.action) : frame.end ? "after the last action" : "no action"}`, onclick: () => go(frame.number) },
      image(frame.shot, "", true), h("span", { class: "proof", title: "Evidence of a fact", hidden: true }),
      h("span", { class: "cap" }, h("span", {}, frame.end ? "End" : String(frame.number)), h("span", {}, frame.end ? "" : frame.action ? frame.action.name : "no action")))));
}

/** The keys of a report. */
const reportKeys = () => h("p", { class: "hint" }, h("span", {}, h("kbd", {}, "←"), " ", h("kbd", {}, "→"), " steps"), h("span", {}, h("kbd", {}, "["), " ", h("kbd", {}, "]"), " trajectories"), h("span", {}, h("kbd", {}, "Esc"), " list"));

/** Draw a trajectory; the result has a function that goes to one of its frames. */
function drawTrajectory(it, place, moved, hint = reportKeys()) {
  const frames = framesOf(it);
  const view = h("div", { class: "view" });
  let current = 0, open = true;
  function go(number) {
    const frame = frames[number - 1];
    if (!frame || number === current) return;
    const reply = view.querySelector("details.reply");
    if (reply) open = reply.open;
    current = number;
    view.replaceChildren(...frameView(judged, frame, frames.length, go, open).filter(Boolean));
    for (const thumb of film.children) {
      if (Number(thumb.dataset.step) === number) {
        thumb.setAttribute("aria-current", "step");
        film.scrollTo({ top: thumb.offsetTop - film.clientHeight / 2 + thumb.clientHeight / 2,
          left: thumb.offsetLeft - film.clientWidth / 2 + thumb.clientWidth / 2 });
      } else thumb.removeAttribute("aria-current");
    }
    moved(number);
  }
  /** Show the verdict of one of the judges. */
  function choose(judge) {
    const at = current;
    judged = { ...it, ...judge };
    side.replaceChildren(...[failureCard(judged), judgeCard(judges, judge, choose), rubricCard(judged, go), answerCard(judged, go), aboutCard(judged), hint].filter(Boolean));
    const proven = provenBy(judged);
    [...film.children].forEach((thumb, index) => { thumb.querySelector(".proof").hidden = !proven.has(index); });
    current = 0;
    if (at) go(at);
  }
  const film = filmstrip(frames, go);
  const judges = judgesOf(it);
  let judged = it;
  const side = h("aside", { class: "side" });
  const player = frames.length ? h("section", { class: "card player", "aria-label": "Steps" }, h("div", { class: "reel" }, film), view)
    : h("section", { class: "card" }, h("p", { class: "muted" }, "No screenshots: the attempt ended before its first step."));
  place.replaceChildren(taskHead(it), h("div", { class: "columns" },
    h("div", {}, player),
    side));
  choose(judges[0]);
  return { go, get current() { return current; }, count: frames.length };
}
