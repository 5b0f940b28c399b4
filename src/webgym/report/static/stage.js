// A screenshot with the action drawn on it.

/** The target of an action, as text. */
const aim = (place) => place.on ? ` “${shorten(place.on, 60)}”` : place.mark !== undefined ? ` element ${place.mark}` : place.point ? " the page" : "";

/** A short description of an action. */
function sentence(action) {
  const on = aim(action);
  switch (action.name) {
    case "click": return `${action.keys ? `${action.keys}-click` : "Click"}${on}`;
    case "double_click": return `Double-click${on}`;
    case "right_click": return `Right-click${on}`;
    case "hover": return `Hover over${on}`;
    case "drag": return `Drag${aim(action.from)}${action.path ? ` through ${action.path.length} points` : ""} to${on}`;
    case "type": return `Type “${shorten(action.text, 80)}” into${on || " the field"}`;
    case "press": return `Press ${shorten(action.keys, 80)}`;
    case "upload": return `Choose “${shorten(action.text, 80)}” at${on}`;
    case "scroll": return `Scroll ${action.direction}${on && ` at${on}`}`;
    case "wait": return `Wait ${action.seconds} s`;
    case "back": return "Go back";
    case "navigate": return `Open ${shorten(action.text, 100)}`;
    case "answer": return `Answer “${shorten(action.text, 160)}”`;
    default: return action.name;
  }
}

const SHORT = { click: "click", double_click: "double", right_click: "right", hover: "hover", drag: "drag", type: "type", press: "press", upload: "upload",
  scroll: "scroll", wait: "wait", back: "back", navigate: "open", answer: "answer" };
const ARROWS = { up: "↑", down: "↓", left: "←", right: "→" };
const share = (value) => `${value}%`;

function bubbleAt(x, y, text) {
  const right = x > 55, low = y > 80;
  return h("div", { class: "bubble", style: {
    [right ? "right" : "left"]: share(Math.max(1, right ? 100 - x : x)),
    [low ? "bottom" : "top"]: low ? `calc(${share(100 - y)} + 22px)` : `calc(${share(y)} + 22px)` } }, text);
}

/** The center of a target, percent of the screenshot; null if the screenshot does not show it. */
function middleOf(place) {
  if (!place.box) return place.point || null;
  const [left, top, width, height] = place.box;
  return [left + width / 2, top + height / 2];
}

/** The mark of a target: a frame around an element, a ring around a point. */
function placeMark(place) {
  if (place.box) {
    const [left, top, width, height] = place.box;
    return [h("div", { class: "target", style: { left: share(left), top: share(top), width: share(width), height: share(height) } })];
  }
  return place.point ? [h("div", { class: "ring", style: { left: share(place.point[0]), top: share(place.point[1]) } })] : [];
}

/** The marks of an action. Positions are percentages of the screenshot. */
function marks(action) {
  if (!action) return [];
  switch (action.name) {
    case "click": case "double_click": case "right_click": case "hover": case "drag": case "type": case "upload": {
      const middle = middleOf(action);
      if (!middle) return [h("div", { class: "bubble key center bottom" }, sentence(action))];
      const said = action.name === "click" ? action.keys : action.name === "type" || action.name === "upload" ? action.text || "(nothing)" : SHORT[action.name];
      const low = action.box ? action.box[1] + action.box[3] - 2 : middle[1];
      return [...(action.from ? placeMark(action.from) : []), ...(action.path ?? []).flatMap((point) => placeMark({ point })), ...placeMark(action), said && bubbleAt(middle[0], low, said)].filter(Boolean);
    }
    case "scroll": return [...placeMark(action), h("div", { class: `bubble key center ${action.direction === "up" ? "top" : "bottom"}` },
      `${ARROWS[action.direction]} ${sentence(action)}`)];
    case "press": return [h("div", { class: "bubble key center bottom" }, sentence(action))];
    case "back": return [h("div", { class: "bubble key left top" }, "← Go back")];
    case "navigate": return [h("div", { class: "bubble key center top" }, `Open ${shorten(action.text, 120)}`)];
    case "wait": return [h("div", { class: "bubble key center top" }, sentence(action))];
    case "answer": return [h("div", { class: "bubble key center bottom" }, shorten(action.text, 240))];
    default: return [];
  }
}

/** The message in place of a missing screenshot, which may be due to a report that was moved. */
function whereIsIt(name) {
  if (settings.live) return "This screenshot is not in the run folder.";
  return `This screenshot is not embedded, and ${picture(name)} does not exist. If the report was moved, move it back into its run folder, or write it with --embed.`;
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
