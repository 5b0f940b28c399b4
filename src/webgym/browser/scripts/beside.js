// A place beside something that has opened over elements: where one clicks to close it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.beside) return;
  const { body, documentElement, closest, getBoundingClientRect } = webgym.dom;
  const { isFrame } = webgym;
  const { isShown, isHeardAt } = webgym.targets;
  const { middle, parentOf, contains, hit } = webgym.geometry;

  const numberedAt = new WeakMap(); // element -> its corner when it was numbered last
  const isWhereItWas = (element, { left, top }) => {
    const known = numberedAt.get(element);
    return Boolean(known) && known.left === left && known.top === top;
  };

  const isPage = (element) => element === body(document) || element === documentElement(document);
  const isWide = (element) => {
    const { width, height } = getBoundingClientRect(element);
    return isPage(element) || (width >= LEAST * innerWidth && height >= LEAST * innerHeight);
  };
  const LEAST = 0.9; // of the viewport
  const isBlocked = (element) =>
    Boolean(closest(element, '[inert]')) || getComputedStyle(body(document) || element).pointerEvents === 'none';

  // What lies over an element that was numbered at this place before: the outermost that does not hold it. The page
  // itself where it keeps the mouse from all but what has opened.
  const coverOf = (element) => {
    const box = getBoundingClientRect(element);
    if (!isWhereItWas(element, box) || !isShown(element)) return null;
    let cover = hit(...middle(box));
    if (isPage(cover) && isBlocked(element)) return cover;
    if (!cover || contains(element, cover) || contains(cover, element)) return null;
    while (parentOf(cover) && !contains(parentOf(cover), element)) cover = parentOf(cover);
    return cover;
  };

  // Of what lies over all of the viewport, is this what hears a click beside what has opened?
  const isVeil = (found, cover) =>
    isPage(found) ? isPage(cover) && isHeardByPage() : isWide(found) && isHeardAt(found);
  const isHeardByPage = () =>
    [document, documentElement(document), body(document)].some((node) => node && isHeardAt(node));

  const GAP = 16; // pixels from what has opened to the place
  const around = (boxes) => ({
    left: Math.min(...boxes.map(({ left }) => left)), top: Math.min(...boxes.map(({ top }) => top)),
    right: Math.max(...boxes.map(({ right }) => right)), bottom: Math.max(...boxes.map(({ bottom }) => bottom)),
  });
  const placesBeside = ({ left, top, right, bottom }) => {
    const [x, y] = [(left + right) / 2, (top + bottom) / 2];
    const places = [[right + GAP, y], [x, bottom + GAP], [left - GAP, y], [x, top - GAP]];
    return places.filter(([x, y]) => x >= GAP && y >= GAP && x <= innerWidth - GAP && y <= innerHeight - GAP);
  };

  // A layer that takes all clicks from the start, such as one that is gone after the first: a place on it.
  const overAll = (covered) => {
    const [x, y] = [innerWidth / 2, innerHeight / 2];
    const found = covered.length ? hit(x, y) : null;
    return found && !isPage(found) && isWide(found) && isHeardAt(found) ? boxAt(x, y, 'over the whole page') : null;
  };
  const boxAt = (x, y, name) => {
    const box = { left: x - GAP / 2, top: y - GAP / 2, right: x + GAP / 2, bottom: y + GAP / 2 };
    return { box, name };
  };

  // `chosen`: the elements that are numbered now, of all `candidates`. Gives {box, name} of such a place, or null: where
  // nothing has opened, nothing there listens for clicks, or there is an element.
  webgym.beside = (candidates, chosen) => {
    const kept = new Set(chosen);
    const own = candidates.filter(({ place }) => place && !place.map); // in no frame
    let cover = null;
    for (const one of own)
      if (kept.has(one)) numberedAt.set(one.element, getBoundingClientRect(one.element));
      else if (!cover || !isWide(cover)) cover = coverOf(one.element) || cover;
    if (!chosen.length) return overAll(own);
    if (!cover) return null;
    const isOverAll = isWide(cover);
    if (!isOverAll && !isHeardByPage()) return null;
    const isFree = (found) =>
      found && (isOverAll ? isVeil(found, cover) : !contains(cover, found)) && !isFrame(found) &&
      !chosen.some(({ element }) => element && contains(element, found));
    const opened = isOverAll ? around(chosen.map(({ boxes }) => boxes[0])) : getBoundingClientRect(cover);
    const place = placesBeside(opened).find(([x, y]) => isFree(hit(x, y)));
    if (!place) return null;
    return boxAt(...place, 'beside what has opened');
  };
})();
