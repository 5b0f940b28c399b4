// Runs in the same isolated world as observe.js: the whole document, not only what the viewport shows of it,
// and where an element is when it is wanted.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.reveal) return;
  const {
    nodeType, ownerDocument, textContent, isConnected, localName, clientWidth, clientHeight, scrollWidth, scrollHeight,
    getAttribute, hasAttribute, matches, closest, getBoundingClientRect, getClientRects, scrollBy, scrollIntoView, body,
    title, scrollingElement, defaultView, children, querySelectorAll, innerText, ofKind,
  } = webgym.dom;
  const { fold, rootOf, frameIn } = webgym;
  const { labelsOf } = webgym.labels;
  const { roleOf, nameOf } = webgym.roles;
  const { elementOf, numberOf } = webgym.numbers;
  const { isShown, isOff, startsPointer, visibleParts, standIn } = webgym.targets;
  const { begin, hit, middle, parentOf, intersect, moved, mapOf, compose, placeOf } = webgym.geometry;

  // --- where an element is --------------------------------------------------------------------------

  // The place of an element's document; null where nothing of it is in view.
  const placeAround = (element) => {
    const frames = [];
    for (let view = defaultView(ownerDocument(element)); view !== window; view = view.parent)
      frames.unshift(view.frameElement);
    const clip = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    return frames.reduce((place, frame) => place && placeOf(frame, place), { map: null, clip });
  };

  // What of an element a click reaches; else what of it is in view, where `isRough` is enough.
  const boxOf = (element, isRough) => {
    begin();
    webgym.labels.begin();
    const place = placeAround(element);
    if (!place) return null;
    const [box] = [...(isShown(element) ? visibleParts(element, place, 1) : []), ...standIn(element, place, 1)];
    const rough = isRough && isShown(element) ? moved(getBoundingClientRect(element), place.map) : null;
    return box || (rough && intersect(rough, place.clip));
  };

  // The dropdown that an option belongs to, if nothing of its options is drawn in the page.
  const dropdownOf = (element) => {
    const select = localName(element) === 'option' ? closest(element, 'select') : null;
    const isShut = select && !select.multiple && select.size <= 1;
    return isShut && getComputedStyle(select).appearance !== 'base-select' ? select : null;
  };

  // {kind, point}: "shown", scrolled into view if it was not, with the point to click; "option" of a
  // closed dropdown; "hidden"; "gone"; "elsewhere" for a number that was given in no document of ours.
  webgym.reveal = (number) => {
    const element = elementOf(number);
    if (element === undefined) return { kind: 'elsewhere' };
    if (!element || !isConnected(element)) return { kind: 'gone' };
    if (dropdownOf(element)) return { kind: 'option' };
    let box = boxOf(element, false);
    if (!box) {
      scrollIntoView(element, { block: 'center', inline: 'nearest', behavior: 'instant' });
      box = boxOf(element, true);
    }
    return box ? { kind: 'shown', point: middle(box) } : { kind: 'hidden' };
  };

  webgym.chooseOption = (number) => {
    const option = elementOf(number);
    const select = dropdownOf(option);
    if (matches(select, ':disabled') || !webgym.isOffered(option)) return { why: 'it is disabled' };
    webgym.closeList();
    webgym.pick(select, option);
    return {};
  };

  // --- what scrolls ---------------------------------------------------------------------------------

  const scrolls = (element, isAcross) => {
    const style = getComputedStyle(element);
    const [overflow, extent, shown] = isAcross
      ? [style.overflowX, scrollWidth(element), clientWidth(element)]
      : [style.overflowY, scrollHeight(element), clientHeight(element)];
    return extent > shown && (overflow === 'auto' || overflow === 'scroll') && style.pointerEvents !== 'none';
  };

  const isScroller = (node, isAcross) =>
    nodeType(node) === Node.ELEMENT_NODE && node !== scrollingElement(ownerDocument(node)) && scrolls(node, isAcross);

  const LITTLE = 100; // CSS pixels: the wheel's way where nothing of its own scrolls
  const SHARE = 0.8; // of what a scroller shows: some of it stays in view

  const scrollerAround = (element, isAcross) => {
    let node = element;
    while (node && !isScroller(node, isAcross)) node = parentOf(node);
    return node;
  };

  webgym.scrollDistance = (x, y) => {
    begin();
    const scroller = scrollerAround(hit(x, y), false);
    return { distance: scroller ? Math.floor(clientHeight(scroller) * SHARE) : LITTLE };
  };

  const EDGE = 10; // CSS pixels from the viewport's

  // {point}: where the wheel turns the page itself, and nothing in it. Null where there is no such place, or
  // the page does not scroll.
  webgym.wheelPoint = () => {
    begin();
    const [right, bottom] = [innerWidth - EDGE, innerHeight - EDGE];
    const page = scrollingElement(document);
    if (webgym.state.list || !page || scrollHeight(page) <= innerHeight) return { point: null };
    const corners = [[EDGE, EDGE], [right, EDGE], [EDGE, bottom], [right, bottom]];
    return { point: corners.find(([x, y]) => !scrollerAround(hit(x, y), false)) || null };
  };

  webgym.scrollElement = (number, side) => {
    const element = elementOf(number);
    if (!element || !isConnected(element)) return { kind: 'gone' };
    const isAcross = side === 'left' || side === 'right';
    const scroller = scrollerAround(element, isAcross) || scrollingElement(ownerDocument(element));
    const [extent, shown] = isAcross
      ? [scrollWidth(scroller), clientWidth(scroller)]
      : [scrollHeight(scroller), clientHeight(scroller)];
    if (extent <= shown) return { kind: 'fixed' };
    const by = side === 'up' || side === 'left' ? -shown : shown;
    scrollBy(scroller, { [isAcross ? 'left' : 'top']: by, behavior: 'instant' });
    return { kind: 'scrolled' };
  };

  // --- the whole document ---------------------------------------------------------------------------

  const boxesOf = (element, map) =>
    [...getClientRects(element)]
      .filter((rect) => rect.width > 0 && rect.height > 0)
      .map((rect) => moved(rect, map))
      .map(({ left, top, right, bottom }) => [left, top, right - left, bottom - top]);

  const describe = (element, map) => {
    const role = roleOf(element) || (startsPointer(element, getComputedStyle(element)) ? 'button' : '');
    if (!role || isOff(element)) return null;
    if (role === 'listbox' && localName(element) !== 'select') return null; // its options are what one clicks
    const dropdown = dropdownOf(element);
    const stands = [dropdown || element, ...labelsOf(element)];
    const boxes = stands.map((one) => (isShown(one) ? boxesOf(one, map) : [])).find((some) => some.length);
    if (!boxes) return null;
    return {
      number: numberOf(element),
      tag: localName(element),
      ...(localName(element) === 'input' ? { type: element.type } : {}),
      role,
      name: nameOf(element, role).slice(0, webgym.limits.name),
      scrolls: scrollHeight(element) - clientHeight(element) >= 1,
      boxes: dropdown ? [] : boxes,
    };
  };

  const collect = (root, map, most, found) => {
    for (const element of querySelectorAll(root, '*')) {
      if (found.length >= most) return;
      const one = describe(element, map);
      if (one) found.push(one);
      const inner = rootOf(element);
      if (inner) collect(inner, map, most, found);
      const frame = frameIn(element); // null for a frame of another origin
      const own = frame && isShown(element) ? mapOf(element) : null;
      if (own) collect(frame, compose(map, own), most, found);
    }
  };

  const propertyOf = (element) => {
    for (const name of ['content', 'href', 'src', 'datetime', 'value'])
      if (hasAttribute(element, name))
        return name === 'href' || name === 'src' ? ofKind(element, name) : getAttribute(element, name);
    return fold(textContent(element));
  };

  const MAX_NESTING = 8;
  const itemOf = (root, take, depth = 0) => {
    const item = Object.assign(Object.create(null), { itemType: take(getAttribute(root, 'itemtype') || '') });
    const add = (element) => {
      for (const child of children(element)) {
        const name = getAttribute(child, 'itemprop');
        const isItem = hasAttribute(child, 'itemscope');
        if (name && (!isItem || depth < MAX_NESTING)) {
          const value = isItem ? itemOf(child, take, depth + 1) : take(propertyOf(child));
          item[name] = name in item ? [item[name], value].flat() : value;
        }
        if (!isItem) add(child);
      }
    };
    add(root);
    return item;
  };

  const metaOf = (take) => {
    const meta = Object.create(null);
    for (const element of querySelectorAll(document, 'meta[content]')) {
      const name = getAttribute(element, 'name') || getAttribute(element, 'property');
      if (name) meta[take(name)] = take(element.content);
    }
    const data = [...querySelectorAll(document, 'script[type="application/ld+json"]')];
    return {
      meta,
      linked: data.map((script) => take(textContent(script).trim())),
      items: [...querySelectorAll(document, '[itemscope]:not([itemprop])')].map((root) => itemOf(root, take)),
    };
  };

  const textOf = (lines, take) => {
    const whole = body(document) ? innerText(body(document)) : '';
    const first = (whole || '').split('\n').slice(0, lines);
    return take(first.filter((line) => line.trim()).join('\n'));
  };

  // {lines, elements, meta}: what is wanted; `characters` and `most` are the limits of the answer.
  webgym.readDocument = ({ lines, elements, meta, characters, most }) => {
    let left = characters;
    const take = (text) => {
      const part = String(text).slice(0, left);
      left -= part.length;
      return part;
    };
    const found = [];
    webgym.targets.begin();
    if (elements) collect(document, null, most, found);
    return {
      title: title(document).slice(0, webgym.limits.title),
      ...(lines ? { text: textOf(lines, take) } : {}),
      ...(elements ? { elements: found } : {}),
      ...(meta ? metaOf(take) : {}),
    };
  };
})();
