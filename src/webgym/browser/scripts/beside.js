// A place beside something that has opened over elements: where one clicks to close it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.beside) return;
  const { body, documentElement, getBoundingClientRect } = webgym.dom;
  const { isFrame } = webgym;
  const { isShown, isHeardAt } = webgym.targets;
  const { middle, parentOf, contains, hit } = webgym.geometry;

  const numberedAt = new WeakMap(); // element -> its corner when it was numbered last
  const isWhereItWas = (element, { left, top }) => {
    const known = numberedAt.get(element);
    return Boolean(known) && known.left === left && known.top === top;
  };

  // What lies over an element that was numbered at this place before: the outermost that does not hold it.
  const coverOf = (element) => {
    const box = getBoundingClientRect(element);
    if (!isWhereItWas(element, box) || !isShown(element)) return null;
    let cover = hit(...middle(box));
    if (!cover || contains(element, cover) || contains(cover, element)) return null;
    while (parentOf(cover) && !contains(parentOf(cover), element)) cover = parentOf(cover);
    return cover;
  };

  const GAP = 16; // pixels from what has opened to the place
  const placesBeside = (cover) => {
    const { left, top, right, bottom } = getBoundingClientRect(cover);
    const [x, y] = [(left + right) / 2, (top + bottom) / 2];
    const around = [[right + GAP, y], [x, bottom + GAP], [left - GAP, y], [x, top - GAP]];
    return around.filter(([x, y]) => x >= GAP && y >= GAP && x <= innerWidth - GAP && y <= innerHeight - GAP);
  };

  // `chosen`: the elements that are numbered now, of all `candidates`. Gives the box of such a place, or null: where
  // nothing has opened, the document does not listen for clicks, or there is an element.
  webgym.beside = (candidates, chosen) => {
    const kept = new Set(chosen);
    const own = candidates.filter(({ place }) => place && !place.map); // in no frame
    let cover = null;
    for (const one of own)
      if (kept.has(one)) numberedAt.set(one.element, getBoundingClientRect(one.element));
      else cover ||= coverOf(one.element);
    if (!cover) return null;
    if (![document, documentElement(document), body(document)].some((node) => node && isHeardAt(node))) return null;
    const isFree = (found) =>
      found && !contains(cover, found) && !isFrame(found) &&
      !chosen.some(({ element }) => element && contains(element, found));
    const place = placesBeside(cover).find(([x, y]) => isFree(hit(x, y)));
    if (!place) return null;
    const [x, y] = place;
    return { left: x - GAP / 2, top: y - GAP / 2, right: x + GAP / 2, bottom: y + GAP / 2 };
  };
})();
