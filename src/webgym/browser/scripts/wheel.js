// Where the wheel turns.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.wheel) return;
  const {
    ownerDocument, clientHeight, scrollHeight, scrollTop, getBoundingClientRect, body, documentElement,
    scrollingElement, defaultView, querySelectorAll,
  } = webgym.dom;
  const { state, rootOf } = webgym;
  const { intersect, middle, parentOf, hit, begin } = webgym.geometry;

  const LEAST_SHARE = 0.005; // of the viewport: smaller boxes are not what one scrolls for

  const isScroller = (element) => {
    if (scrollHeight(element) - clientHeight(element) <= 1) return false;
    const owner = ownerDocument(element);
    const { overflowY } = getComputedStyle(element);
    if (element !== scrollingElement(owner)) return overflowY === 'auto' || overflowY === 'scroll';
    const outer = overflowY === 'visible' && body(owner) ? getComputedStyle(body(owner)).overflowY : overflowY;
    return outer !== 'hidden' && outer !== 'clip';
  };

  const hasRoom = (element, direction) =>
    direction < 0 ? scrollTop(element) > 0 : scrollTop(element) + clientHeight(element) < scrollHeight(element) - 1;

  // Whether something around an element scrolls, in its own frame and those above.
  const isInScroller = (element) => {
    for (let node = element; node; ) {
      if (isScroller(node)) return true;
      const owner = ownerDocument(node);
      const view = defaultView(owner);
      node = parentOf(node) || (view !== window && node === documentElement(owner) ? view.frameElement : null);
    }
    return false;
  };

  const scrollers = (root, direction, found) => {
    for (const element of querySelectorAll(root, '*')) {
      if (isScroller(element) && hasRoom(element, direction)) found.push(element);
      if (rootOf(element)) scrollers(rootOf(element), direction, found);
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
  const shownAt = (point, direction) => {
    for (let node = hit(...point); node; node = parentOf(node))
      if (isScroller(node) && hasRoom(node, direction))
        return node === scrollingElement(document) ? innerHeight : Math.min(clientHeight(node), innerHeight);
    return innerHeight;
  };

  const overList = ({ list }) => ({ point: middle(getBoundingClientRect(list)), height: clientHeight(list) });

  // {wheel}: {point, height} over an open list, or null.
  webgym.listWheel = () => ({ wheel: state.list && overList(state.list) });

  // {point, height}: over an open list; else over the middle of the viewport; where nothing there scrolls
  // at all, over the largest box that does. `height`: of what a part of is to be scrolled.
  webgym.wheel = (direction) => {
    const view = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    if (state.list) return overList(state.list);
    begin();
    const found = hit(...middle(view));
    let point = middle(view);
    if (found && !webgym.isFrame(found) && !isInScroller(found)) {
      const area = ({ left, top, right, bottom }) => (right - left) * (bottom - top);
      const boxes = scrollers(document, direction, [])
        .map((element) => boxOf(element, view))
        .filter((box) => box && area(box) >= LEAST_SHARE * area(view))
        .sort((a, b) => area(b) - area(a));
      if (boxes.length) point = middle(boxes[0]);
    }
    return { point, height: shownAt(point, direction) };
  };
})();
