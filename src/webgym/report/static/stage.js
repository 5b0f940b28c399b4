// A screenshot with the action drawn on it.

/** What an action does, in a few words. */
function sentence(action) {
  const on = action.on ? ` “${shorten(action.on, 60)}”` : action.mark !== undefined ? ` element ${action.mark}` : action.point ? " the page" : "";
  switch (action.name) {
    case "click": return `Click${on}`;
    case "type": return `Type “${shorten(action.text, 80)}” into${on || " the field"}`;
    case "scroll": return `Scroll ${action.direction}`;
    case "wait": return `Wait ${action.seconds} s`;
    case "back": return "Go back";
    case "navigate": return `Open ${shorten(action.text, 100)}`;
    case "answer": return `Answer “${shorten(action.text, 160)}”`;
    default: return action.name;
  }
}

const SHORT = { click: "click", type: "type", scroll: "scroll", wait: "wait", back: "back", navigate: "open", answer: "answer" };
const share = (value) => `${value}%`;

function bubbleAt(x, y, text) {
  const right = x > 55, low = y > 80;
  return h("div", { class: "bubble", style: {
    [right ? "right" : "left"]: share(Math.max(1, right ? 100 - x : x)),
    [low ? "bottom" : "top"]: low ? `calc(${share(100 - y)} + 22px)` : `calc(${share(y)} + 22px)` } }, text);
}

/** The marks that show an action. Places are percent of the picture. */
function marks(action) {
  if (!action) return [];
  switch (action.name) {
    case "click": case "type": {
      const drawn = [];
      let [x, y] = action.point || [];
      if (action.box) {
        const [left, top, width, height] = action.box;
        drawn.push(h("div", { class: "target", style: { left: share(left), top: share(top), width: share(width), height: share(height) } }));
        [x, y] = [left + width / 2, top + height / 2];
      }
      if (x === undefined) return [h("div", { class: "bubble key center bottom" }, sentence(action))];
      if (!action.box) drawn.push(h("div", { class: "ring", style: { left: share(x), top: share(y) } }));
      if (action.name === "type") drawn.push(bubbleAt(x, action.box ? action.box[1] + action.box[3] - 2 : y, action.text || "(nothing)"));
      return drawn;
    }
    case "scroll": return [h("div", { class: `bubble key center ${action.direction === "down" ? "bottom" : "top"}` },
      `${action.direction === "down" ? "↓" : "↑"} Scroll ${action.direction}`)];
    case "back": return [h("div", { class: "bubble key left top" }, "← Go back")];
    case "navigate": return [h("div", { class: "bubble key center top" }, `Open ${shorten(action.text, 120)}`)];
    case "wait": return [h("div", { class: "bubble key center top" }, sentence(action))];
    case "answer": return [h("div", { class: "bubble key center bottom" }, shorten(action.text, 240))];
    default: return [];
  }
}

/** What is said in place of a picture that is not there. A report may have been moved away from its pictures. */
function whereIsIt(name) {
  if (settings.live) return "This picture is not in the run folder.";
  return `This report has no picture of its own here, and ${picture(name)} is not beside it. If it was moved, move it back into its folder, or write it with --embed.`;
}

function image(name, alt, lazy) {
  const shownImage = h("img", { alt, loading: lazy ? "lazy" : "eager", decoding: "async", src: picture(name) });
  shownImage.addEventListener("error", () => {
    shownImage.replaceWith(h("div", { class: "absent", role: "img", "aria-label": alt }, lazy ? "" : whereIsIt(name)));
  }, { once: true });
  return shownImage;
}

function stage(look, action, alt) {
  const [width, height] = look.size;
  return h("figure", { class: "stage", style: { aspectRatio: `${width} / ${height}` } },
    image(look.shot, alt, false), ...marks(action));
}
