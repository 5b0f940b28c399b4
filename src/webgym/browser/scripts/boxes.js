// Where elements lie, measured once for a look. Most of a large page is far from the viewport, and whole branches of it
// are passed over.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.boxes) return;
  const { ownerDocument, localName, getBoundingClientRect, defaultView, querySelectorAll, checkVisibility } = webgym.dom;
  const { rootOf } = webgym;
  const { parentOf } = webgym.geometry;

  // What counts wherever it lies: an area for its picture, a frame for what is in it.
  const KEPT = new Set(['area', 'iframe', 'frame', 'object']);

  // By document or shadow root: [element, rectangle] of those that have a box in or near the viewport.
  let surveys = new Map();
  let empties = new Map(); // the same of those without a box that are drawn: style sheets may draw beside them
  let rects = new Map(); // by element
  let paths = new Set(); // elements that may count, and all that they lie in

  const keep = (element) => {
    for (let node = element; node && !paths.has(node); node = parentOf(node)) paths.add(node);
  };

  // Near is what is no farther from the viewport than the viewport is large.
  const near = (root) => {
    if (surveys.has(root)) return surveys.get(root);
    const found = [];
    const without = [];
    surveys.set(root, found);
    empties.set(root, without);
    const { innerWidth, innerHeight } = defaultView(ownerDocument(root) || root);
    for (const element of querySelectorAll(root, '*')) {
      const rect = getBoundingClientRect(element);
      const hasBox = rect.width > 0 && rect.height > 0;
      const isNear =
        hasBox && rect.top < 2 * innerHeight && rect.bottom > -innerHeight &&
        rect.left < 2 * innerWidth && rect.right > -innerWidth;
      if (isNear) found.push([element, rect]);
      else if (hasBox && !KEPT.has(localName(element)) && !rootOf(element)) continue;
      if (!hasBox && checkVisibility(element)) without.push(element);
      rects.set(element, rect);
      keep(element);
      if (localName(element) === 'label') keep(element.control);
    }
    return found;
  };

  const rectOf = (element) => rects.get(element) || getBoundingClientRect(element);

  // Whether neither an element nor anything in it can count, nor be seen, if its root was surveyed.
  const isFar = (element) => !paths.has(element);

  // A new look: nothing lies where it lay.
  const begin = () => {
    surveys = new Map();
    empties = new Map();
    rects = new Map();
    paths = new Set();
  };

  const emptyIn = (root) => near(root) && empties.get(root);

  webgym.boxes = { near, emptyIn, rectOf, isFar, begin };
})();
