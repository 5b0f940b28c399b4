// What a number of the last picture stands for, and where that is when the agent acts on it: a number means an element,
// not a place of the past.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.aim) return;
  const { isConnected, textContent, getBoundingClientRect, createRange, ownerDocument, scrollIntoView } = webgym.dom;
  const { state, fold } = webgym;
  const { elementOf } = webgym.numbers;
  const { contains, hit, middle, parentOf } = webgym.geometry;

  let pictured = new Map(); // by number: {key, role, name, around, at, hit}
  let changes = -1; // of the document when the picture was taken

  // --- what tells elements of one name from each other ----------------------------------------------

  const LONGEST = 300; // characters of a text that are compared
  const nameOf = ({ role, name }) => `${role} ${name}`;

  // Of several that are called the same: the text of the largest part of the page around each that holds no other of
  // them, such as the row that a button belongs to. Where no part does, what is written between the one before
  // and the one after.
  const textsAround = (elements) => {
    const holding = new Map(); // ancestor -> how many of them it holds
    for (const element of elements)
      for (let node = element; node; node = parentOf(node)) holding.set(node, (holding.get(node) || 0) + 1);
    return elements.map((element, index) => {
      let part = element;
      while (holding.get(parentOf(part)) === 1) part = parentOf(part);
      const text = part === element ? textBetween(elements[index - 1], element, elements[index + 1]) : textContent(part);
      return fold(text.slice(0, 4 * LONGEST)).slice(0, LONGEST);
    });
  };
  const textBetween = (previous, element, next) => {
    const parent = parentOf(element);
    if (!parent) return '';
    const [before, after] = [createRange(ownerDocument(element)), createRange(ownerDocument(element))];
    for (const range of [before, after]) range.selectNodeContents(parent);
    if (previous && parentOf(previous) === parent) before.setStartAfter(previous);
    before.setEndBefore(element);
    after.setStartAfter(element);
    if (next && parentOf(next) === parent) after.setEndBefore(next);
    return `${before} | ${after}`;
  };

  // Writes down in each of these `{element, role, name}` what tells it from others of its name: `around`.
  webgym.distinguish = (described) => {
    const byName = new Map();
    for (const one of described) byName.set(nameOf(one), [...(byName.get(nameOf(one)) || []), one]);
    for (const some of byName.values()) {
      if (some.length < 2) continue;
      const texts = textsAround(some.map(({ element }) => element));
      some.forEach((one, index) => (one.around = texts[index]));
    }
  };

  // --- the picture and now --------------------------------------------------------------------------

  // A picture shows these elements: {number, key, role, name, around, box}.
  webgym.picture = (shown) => {
    pictured = new Map(shown.map((one) => [one.number, { ...one, hit: hit(...middle(one.box)) }]));
    changes = state.changes;
  };

  // What was due while the page stood still has its turn first.
  const PATIENCE = 30; // ms
  const catchUp = () =>
    Promise.race([
      scheduler.postTask(() => {}, { priority: 'background' }),
      scheduler.postTask(() => {}, { priority: 'user-blocking', delay: PATIENCE }),
    ]);

  // Is all as the picture shows it? Of an element, if its number is given: does a click at this point still hit it?
  // The event that is to come is expected at this point.
  webgym.isAsPictured = async (number, point) => {
    await catchUp();
    webgym.expect(...point);
    if (changes !== state.changes) return false;
    if (!number) return true;
    const was = pictured.get(number);
    if (!was || typeof was.key === 'string') return false; // changes of other worlds are not counted here
    const found = hit(...middle(was.box));
    return Boolean(found) && (found === was.hit || contains(was.key, found));
  };

  // Where the element of a number is, of those that are `shown` now: {point, was, is} with its texts where these
  // changed, or {why} it cannot be acted on: "gone", "hidden" (out of view) or "covered".
  webgym.aim = (number, shown) => {
    const was = pictured.get(number);
    const now = shown.find((one) => one.number === number);
    if (now) return { ...aimAt(now), ...difference(was, now) };
    const isOurs = typeof was.key !== 'string';
    if (isOurs && isConnected(was.key)) return { why: isInView(was.key) ? 'covered' : 'hidden' };
    // The page may have put an equal one in its place.
    const isEqual = (one) => nameOf(one) === nameOf(was) && (one.around || '') === (was.around || '');
    const equal = shown.filter((one) => !pictured.has(one.number) && isEqual(one));
    const isOnly = [...pictured.values()].filter(isEqual).length === 1;
    return equal.length === 1 && isOnly ? aimAt(equal[0]) : { why: 'gone' };
  };
  const aimAt = ({ box }) => {
    webgym.aimAt(...middle(box));
    return { point: middle(box) };
  };
  const isInView = (element) => {
    const { left, top, right, bottom } = getBoundingClientRect(element);
    return right > 0 && bottom > 0 && left < innerWidth && top < innerHeight;
  };
  const difference = (was, now) => {
    if (nameOf(was) !== nameOf(now)) return { was: was.name, is: now.name };
    // With a name of its own it needs no text around it, whatever others there were.
    const isTold = was.around !== undefined && now.around !== undefined && was.around !== now.around;
    return isTold ? { was: was.around, is: now.around } : {};
  };

  webgym.showNumber = (number) => {
    const element = elementOf(number);
    if (element) scrollIntoView(element, { block: 'center', inline: 'nearest', behavior: 'instant' });
    return Boolean(element);
  };
})();
