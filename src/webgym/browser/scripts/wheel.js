// Where the wheel turns.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.wheel) return;
  const {
    ownerDocument, clientHeight, clientWidth, scrollHeight, scrollWidth, scrollTop, scrollLeft, getBoundingClientRect,
    body, documentElement, scrollingElement, defaultView, querySelectorAll,
  } = webgym.dom;
  const { state, rootOf, isFrame } = webgym;
  const { intersect, middle, parentOf, hit, begin } = webgym.geometry;

  const LEAST_SHARE = 0.005; // of the viewport: smaller boxes are not what one scrolls for

  // How a side is measured: its axis, and whether it leads to the beginning.
  const DOWN = { shown: clientHeight, extent: scrollHeight, at: scrollTop, overflow: 'overflowY', whole: () => innerHeight };
  const ACROSS = { shown: clientWidth, extent: scrollWidth, at: scrollLeft, overflow: 'overflowX', whole: () => innerWidth };
  const SIDES = {
    up: { ...DOWN, isBack: true }, down: { ...DOWN, isBack: false },
    left: { ...ACROSS, isBack: true }, right: { ...ACROSS, isBack: false },
  };

  const isScroller = (element, side) => {
    if (side.extent(element) - side.shown(element) <= 1) return false;
    const owner = ownerDocument(element);
    const overflow = getComputedStyle(element)[side.overflow];
    if (element !== scrollingElement(owner)) return overflow === 'auto' || overflow === 'scroll';
    const outer = overflow === 'visible' && body(owner) ? getComputedStyle(body(owner))[side.overflow] : overflow;
    return outer !== 'hidden' && outer !== 'clip';
  };

  // A page that is written from right to left begins at 0 and goes on below it.
  const hasRoom = (element, side) => {
    const room = side.extent(element) - side.shown(element) - 1;
    const at = side.at(element);
    const passed = at < 0 || getComputedStyle(element).direction === 'rtl' && side.overflow === 'overflowX' ? room + at : at;
    return side.isBack ? passed > 0 : passed < room;
  };

  // Whether something around an element scrolls, in its own frame and those above.
  const isInScroller = (element, side) => {
    for (let node = element; node; ) {
      if (isScroller(node, side)) return true;
      const owner = ownerDocument(node);
      const view = defaultView(owner);
      node = parentOf(node) || (view !== window && node === documentElement(owner) ? view.frameElement : null);
    }
    return false;
  };

  const scrollers = (root, side, found) => {
    for (const element of querySelectorAll(root, '*')) {
      if (isScroller(element, side) && hasRoom(element, side)) found.push(element);
      if (rootOf(element)) scrollers(rootOf(element), side, found);
    }
    return found;
  };

  const boxOf = (element, view) => {
    const box = intersect(getBoundingClientRect(element), view);
    const found = box && hit(...middle(box));
    for (let node = found; node; node = parentOf(node)) if (node === element) return box;
    return null;
  };

  // How much is shown of what the wheel scrolls here: of a box in the page less than of the page.
  const shownAt = (point, side) => {
    const whole = side.whole();
    for (let node = hit(...point); node; node = parentOf(node)) {
      if (node === scrollingElement(document)) return whole;
      if (isFrame(node) || (isScroller(node, side) && hasRoom(node, side))) return Math.min(side.shown(node), whole);
    }
    return whole;
  };

  const overList = ({ list }) => ({ point: middle(getBoundingClientRect(list)), extent: clientHeight(list) });

  // {wheel}: {point, extent} over an open list, or null.
  webgym.listWheel = () => ({ wheel: state.list && overList(state.list) });

  // {point, extent}: at `wanted`, if a point is; else over an open list; else over the middle of the viewport;
  // where nothing there scrolls at all, over the largest box that does. `extent`: of what a part of is to be
  // scrolled.
  webgym.wheel = (name, wanted) => {
    const side = SIDES[name];
    begin();
    if (wanted) return { point: wanted, extent: shownAt(wanted, side) };
    const view = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    if (state.list) return overList(state.list);
    const found = hit(...middle(view));
    let point = middle(view);
    if (found && !isFrame(found) && !isInScroller(found, side)) {
      const area = ({ left, top, right, bottom }) => (right - left) * (bottom - top);
      const boxes = scrollers(document, side, [])
        .map((element) => boxOf(element, view))
        .filter((box) => box && area(box) >= LEAST_SHARE * area(view))
        .sort((a, b) => area(b) - area(a));
      if (boxes.length) point = middle(boxes[0]);
    }
    return { point, extent: shownAt(point, side) };
  };

  // --- drags of the system --------------------------------------------------------------------------

  let begun = null;
  webgym.listen(
    ['mousedown', () => (begun = null), { capture: true, passive: true }],
    ['dragstart', (event) => (begun = event), { capture: true, passive: true }],
  );
  // Whether a drag of the system began since the button was pressed, and the page let it.
  webgym.hasDragBegun = () => Boolean(begun && !begun.defaultPrevented);
})();
