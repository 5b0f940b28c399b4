// A screenshot with the action drawn on it.

/** What an action did, in a line. */
function sentence(action) {
  const { words, entered } = action;
  return shorten(words.includes(entered) ? words : `${words}: “${entered}”`, 160);
}

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

/** The marks of an action: its targets, and what was entered there. Positions are percentages of the screenshot. */
function marks(action) {
  if (!action) return [];
  const [last] = action.places.slice(-1), middle = last && middleOf(last);
  if (!middle) return [h("div", { class: "bubble key center bottom" }, sentence(action))];
  const said = action.entered || (action.name === "left click" ? "" : action.name);
  const low = last.box ? last.box[1] + last.box[3] - 2 : middle[1];
  const points = action.way.map((point) => ({ point }));
  return [...[...action.places, ...points].flatMap(placeMark), said && bubbleAt(middle[0], low, shorten(said, 160))].filter(Boolean);
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
