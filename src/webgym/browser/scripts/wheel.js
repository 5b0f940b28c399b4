// Where the wheel turns.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.wheel) return;
  const {
    ownerDocument, clientHeight, clientWidth, scrollHeight, scrollWidth, scrollTop, scrollLeft, getBoundingClientRect,
    scrollBy, body, documentElement, scrollingElement, defaultView, querySelectorAll, isConnected, activeElement,
    dispatchEvent, getAnimations,
  } = webgym.dom;
  const { state, rootOf, isFrame } = webgym;
  const { intersect, middle, parentOf, contains, hit, begin, clipWithin } = webgym.geometry;

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

  // What is written from right to left, or put in reverse order, begins at 0 and goes on below it.
  const isReverse = (element, side) => {
    const { direction, display, flexDirection, flexWrap, writingMode } = getComputedStyle(element);
    const isInline = (side.overflow === 'overflowX') === writingMode.startsWith('horizontal');
    const isBackwards = isInline ? direction === 'rtl' : writingMode.endsWith('-rl');
    if (!display.includes('flex')) return isBackwards;
    const isMain = flexDirection.startsWith(isInline ? 'row' : 'column');
    return isBackwards !== (isMain ? flexDirection.endsWith('reverse') : flexWrap === 'wrap-reverse');
  };
  const hasRoom = (element, side) => {
    const room = side.extent(element) - side.shown(element) - 1;
    const at = side.at(element);
    const passed = at < 0 || isReverse(element, side) ? room + at : at;
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

  // Does a script scroll what an element cuts off? The page's own world tells whether it listens (listeners.js).
  const isScripted = (element, side) =>
    side.extent(element) - side.shown(element) > 1 && /hidden|clip/.test(getComputedStyle(element)[side.overflow]) &&
    !dispatchEvent(element, new Event(`${webgym.question}-wheel`, { cancelable: true, composed: true }));

  // How much is shown of what the wheel scrolls here: of a box in the page less than of the page.
  const shownAt = (point, side) => {
    const whole = side.whole();
    for (let node = hit(...point); node; node = parentOf(node)) {
      if (node === scrollingElement(document)) return whole;
      if (isFrame(node) || (isScroller(node, side) && hasRoom(node, side)) || isScripted(node, side))
        return Math.min(side.shown(node), whole);
    }
    return whole;
  };

  const overList = ({ list }) => ({ point: middle(getBoundingClientRect(list)), extent: clientHeight(list) });

  // {wheel}: {point, extent} over an open list, or null.
  webgym.listWheel = () => ({ wheel: state.list && overList(state.list) });

  // {point, extent}: at `wanted`, if a point is; else over an open list; else over the middle of the viewport;
  // where nothing there scrolls at all, over the largest box that does, or over what has the focus. `extent`:
  // of what a part of is to be scrolled.
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
      const focus = activeElement(document); // what scrolls by a script of its own shows no sign of that
      const box = boxes[0] || (focus && focus !== body(document) && intersect(getBoundingClientRect(focus), view));
      if (box) point = middle(box);
    }
    return { point, extent: shownAt(point, side) };
  };

  // --- what scrolls by a script of its own ----------------------------------------------------------
  // It draws what it wants to of each turn of the wheel, often a few lines whatever was asked for. How far it
  // went is seen in what lies there.

  const SAMPLES = 8; // places that are looked at, from one end of the box to the other

  // The box that cuts off what lies here; the viewport where none does.
  const boxAround = (point, view) => {
    const found = hit(...point);
    return (found && intersect(clipWithin(found), view)) || view;
  };

  let turned = null; // before the wheel was turned: what lies where, and how far each box around was scrolled
  let wheel = null; // the wheel's last event
  webgym.listen(['wheel', (event) => (wheel = event), { capture: true, passive: true }]);

  webgym.expectTurn = (name, point) => {
    begin();
    const side = SIDES[name];
    const box = boxAround(point, { left: 0, top: 0, right: innerWidth, bottom: innerHeight });
    const step = (share) => [
      side.overflow === 'overflowY' ? point[0] : box.left + (box.right - box.left) * share,
      side.overflow === 'overflowY' ? box.top + (box.bottom - box.top) * share : point[1],
    ];
    const found = new Set(Array.from({ length: SAMPLES }, (_, n) => hit(...step((n + 0.5) / SAMPLES))));
    const around = [];
    for (let node = hit(...point); node; node = parentOf(node)) around.push([node, side.at(node)]);
    const page = scrollingElement(document);
    if (page) around.push([page, side.at(page)]);
    const places = [...found].filter((element) => element && !isFrame(element));
    turned = { side, box, around, page, places: places.map((element) => [element, getBoundingClientRect(element)]) };
    wheel = null;
    return webgym.expect(...point);
  };

  // What a transition moves has not yet gone as far as it will.
  const MOVES = /^(transform|translate|top|left|margin)/;
  const isGliding = (elements) => {
    const gliding = [...new Set(elements.map((element) => ownerDocument(element)))]
      .flatMap((document) => getAnimations(document))
      .filter(({ transitionProperty, playState }) => MOVES.test(transitionProperty) && playState === 'running')
      .map(({ effect }) => effect.target);
    return gliding.some((mover) => elements.some((element) => contains(mover, element)));
  };

  // {by, extent, taken}: how far a script moved what lies there, and how long the box is. 0 where the browser
  // itself scrolled, where a transition moves them still, and where things did not all move the same way: a map that is
  // drawn larger, say. `taken`: nothing was scrolled, as a listener of the page prevented it, but the page could be.
  webgym.turned = () => {
    const { side, box, around, page, places } = turned;
    const isAcross = side.overflow === 'overflowX';
    const extent = isAcross ? box.right - box.left : box.bottom - box.top;
    if (around.some(([node, at]) => side.at(node) !== at)) return { by: 0, extent };
    const mayScroll = (node) => isScroller(node, side) && hasRoom(node, side);
    const isPrevented = Boolean(wheel && wheel.defaultPrevented && !state.list);
    const taken = Boolean(isPrevented && page && mayScroll(page));
    // The compositor scrolls with its next frame, after it has told that the wheel was turned.
    if (!isPrevented && around.some(([node]) => isFrame(node) || mayScroll(node))) webgym.askFrame(true);
    const left = places.filter(([element]) => isConnected(element));
    if (isGliding(left.map(([element]) => element))) return { by: 0, extent, taken };
    const moves = [];
    for (const [element, was] of left) {
      const is = getBoundingClientRect(element);
      const [along, aside] = isAcross ? [was.left - is.left, was.top - is.top] : [was.top - is.top, was.left - is.left];
      if (Math.abs(aside) >= 1 || Math.abs(is.width - was.width) + Math.abs(is.height - was.height) >= 1)
        return { by: 0, extent, taken };
      if (Math.abs(along) >= 1) moves.push(along);
    }
    const isOne = moves.length > 0 && moves.every((move) => Math.abs(move - moves[0]) < 1);
    return { by: isOne && moves.length > 1 ? Math.abs(moves[0]) : 0, extent, taken: taken && !isOne };
  };

  // Scroll the page itself, if the last turn was and still is `taken`.
  webgym.scrollPage = (distance) => {
    const { side, page } = turned;
    const key = side.overflow === 'overflowX' ? 'left' : 'top';
    if (webgym.turned().taken) scrollBy(page, { [key]: distance, behavior: 'instant' });
    return true;
  };
})();
