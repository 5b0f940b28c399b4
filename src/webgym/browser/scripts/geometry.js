// Where things lie: rectangles, maps between viewports, clips, and what a click at a point hits.
//
// A rectangle is {left, top, right, bottom}. A map [a, b, c, d, e, f] takes a point (x, y) to
// (a x + c y + e, b x + d y + f); null is the map that changes nothing. A place is a document's {map, clip}:
// the map from its viewport to that of this world's frame, and what of that viewport can show it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.geometry) return;
  const {
    nodeType, parentNode, localName, ownerDocument, assignedSlot, clientLeft, clientTop, clientWidth, clientHeight, matches,
    getBoundingClientRect, body, documentElement, defaultView, elementFromPoint, offsetWidth, offsetHeight,
    querySelectorAll,
  } = webgym.dom;
  const { state, rootOf, frameIn } = webgym;

  const intersect = (a, b) => {
    const left = Math.max(a.left, b.left);
    const top = Math.max(a.top, b.top);
    const right = Math.min(a.right, b.right);
    const bottom = Math.min(a.bottom, b.bottom);
    return right - left >= 1 && bottom - top >= 1 ? { left, top, right, bottom } : null;
  };

  const middle = (box) => [(box.left + box.right) / 2, (box.top + box.bottom) / 2];

  // --- maps ---------------------------------------------------------------------------------------

  const apply = (map, x, y) =>
    map ? [map[0] * x + map[2] * y + map[4], map[1] * x + map[3] * y + map[5]] : [x, y];

  // The smallest upright rectangle around a mapped one.
  const moved = (rect, map) => {
    if (!map) return rect;
    const [x1, y1] = apply(map, rect.left, rect.top);
    const [x2, y2] = apply(map, rect.right, rect.bottom);
    const [x3, y3] = apply(map, rect.left, rect.bottom);
    const [x4, y4] = apply(map, rect.right, rect.top);
    return {
      left: Math.min(x1, x2, x3, x4),
      top: Math.min(y1, y2, y3, y4),
      right: Math.max(x1, x2, x3, x4),
      bottom: Math.max(y1, y2, y3, y4),
    };
  };

  const compose = (outer, inner) => {
    if (!outer) return inner;
    if (!inner) return outer;
    const [a, b, c, d] = outer;
    const [e, f] = apply(outer, inner[4], inner[5]);
    return [
      a * inner[0] + c * inner[1], b * inner[0] + d * inner[1],
      a * inner[2] + c * inner[3], b * inner[2] + d * inner[3], e, f,
    ];
  };

  const invert = (map) => {
    if (!map) return null;
    const [a, b, c, d, e, f] = map;
    const area = a * d - b * c;
    if (!area) return null;
    return [
      d / area, -b / area, -c / area, a / area, (c * f - d * e) / area, (b * e - a * f) / area,
    ];
  };

  // The slot that a child of `host` lies in. Where that has a closed root, only the slots themselves tell.
  let slots = new Map(); // by host with a closed root and by child, in this look
  const slotIn = (host, child) => {
    const root = state.roots.get(host);
    if (!root) return null;
    if (!slots.has(host)) {
      const filled = [...querySelectorAll(root, 'slot')].flatMap((slot) => slot.assignedNodes().map((node) => [node, slot]));
      slots.set(host, new Map(filled));
    }
    return slots.get(host).get(child) || null;
  };

  const parentOf = (element) => {
    const holder = parentNode(element);
    const parent = assignedSlot(element) || slotIn(holder, element) || holder;
    if (!parent || nodeType(parent) === Node.ELEMENT_NODE) return parent;
    return nodeType(parent) === Node.DOCUMENT_FRAGMENT_NODE ? parent.host || null : null;
  };

  const pixels = (text) => parseFloat(text) || 0;

  // What transforms of an element and its ancestors do to directions, as [a, b, c, d]; null for nothing.
  const turnOf = (element) => {
    let turn = null;
    for (let node = element; node; node = parentOf(node)) {
      const style = getComputedStyle(node);
      if (style.transform === 'none' && style.rotate === 'none' && style.scale === 'none') continue;
      const own = new DOMMatrix();
      if (style.rotate !== 'none') own.multiplySelf(new DOMMatrix(`rotate(${style.rotate.split(' ').pop()})`));
      if (style.scale !== 'none') own.multiplySelf(new DOMMatrix(`scale(${style.scale.split(' ').slice(0, 2)})`));
      if (style.transform !== 'none') own.multiplySelf(new DOMMatrix(style.transform));
      turn = compose([own.a, own.b, own.c, own.d, 0, 0], turn);
    }
    return turn;
  };

  // From the viewport of a frame to that of its document. Found from the middle of its box, which an
  // affine transform keeps in the middle of the upright rectangle that is all a script is told.
  const mapOf = (frame) => {
    const rect = getBoundingClientRect(frame);
    const style = getComputedStyle(frame);
    const [width, height] = [offsetWidth(frame), offsetHeight(frame)];
    if (!width || !height) return null;
    const x = clientLeft(frame) + pixels(style.paddingLeft);
    const y = clientTop(frame) + pixels(style.paddingTop);
    const isPlain = Math.abs(rect.width - width) < 1 && Math.abs(rect.height - height) < 1;
    const turn = turnOf(frame);
    if (!turn && isPlain) return [1, 0, 0, 1, rect.left + x, rect.top + y];
    let [a, b, c, d] = turn || [1, 0, 0, 1];
    const zoom = rect.width / (Math.abs(a) * width + Math.abs(c) * height);
    [a, b, c, d] = [a * zoom, b * zoom, c * zoom, d * zoom];
    if (!turn) [a, d] = [rect.width / width, rect.height / height];
    const [mx, my] = middle(rect);
    const [dx, dy] = apply([a, b, c, d, mx, my], x - width / 2, y - height / 2);
    return [a, b, c, d, dx, dy];
  };

  // The viewport of a frame, in its own coordinates.
  const viewOf = (frame) => {
    const style = getComputedStyle(frame);
    return {
      left: 0,
      top: 0,
      right: clientWidth(frame) - pixels(style.paddingLeft) - pixels(style.paddingRight),
      bottom: clientHeight(frame) - pixels(style.paddingTop) - pixels(style.paddingBottom),
    };
  };

  let maps = new Map(); // [map, inverse] by frame, for one look
  const mapsOf = (frame) => {
    if (!maps.has(frame)) {
      const map = mapOf(frame);
      maps.set(frame, [map, invert(map)]);
    }
    return maps.get(frame);
  };

  // The place of a frame's document within `place`; null where nothing of it can be seen.
  const placeOf = (frame, place) => {
    const [own, inverse] = mapsOf(frame);
    if (!inverse) return null;
    const map = compose(place.map, own);
    const around = clipAround(frame);
    const view = intersect(moved(viewOf(frame), own), around);
    const clip = view && intersect(moved(view, place.map), place.clip);
    return clip && { map, clip };
  };

  // --- what is hit --------------------------------------------------------------------------------

  const contains = (outer, inner) => {
    for (let node = inner; node; node = parentOf(node)) if (node === outer) return true;
    return false;
  };

  // The element on top at a point of this frame's viewport, through shadow roots and frames. A frame of
  // another origin stands for all that is in it.
  const findHit = (x, y) => {
    let root = document;
    for (;;) {
      const element = elementFromPoint(root, x, y);
      if (!element) return null;
      const inner = rootOf(element);
      if (inner && inner !== root) {
        const deeper = elementFromPoint(inner, x, y);
        if (deeper && deeper !== element) {
          root = inner;
          continue;
        }
        return element;
      }
      const frame = frameIn(element);
      if (!frame || !mapsOf(element)[1]) return element;
      [x, y] = apply(mapsOf(element)[1], x, y);
      root = frame;
    }
  };

  let hits = new Map(); // by point, for one look: the middle of a link is that of its text, too
  const hit = (x, y) => {
    const point = `${x} ${y}`;
    if (!hits.has(point)) hits.set(point, findHit(x, y));
    return hits.get(point);
  };

  // --- clips --------------------------------------------------------------------------------------

  const EVERYTHING = { left: -Infinity, top: -Infinity, right: Infinity, bottom: Infinity };
  let clips = new Map(); // by element, for one look: what its content is clipped to

  const holdsFixed = (style) =>
    style.transform !== 'none' || style.perspective !== 'none' || style.filter !== 'none' ||
    style.rotate !== 'none' || style.scale !== 'none' || style.translate !== 'none' ||
    style.backdropFilter !== 'none' || /transform|filter|perspective/.test(style.willChange) ||
    /paint|layout|strict|content/.test(style.contain);

  // What an element itself is clipped to by the boxes that it lies in.
  const clipAround = (element, style = getComputedStyle(element)) => {
    const { position } = style;
    let holder = parentOf(element);
    if (position === 'fixed' || position === 'absolute') {
      if (matches(element, ':modal, :popover-open')) return EVERYTHING;
      for (; holder; holder = parentOf(holder)) {
        const around = getComputedStyle(holder);
        if ((position === 'absolute' && around.position !== 'static') || holdsFixed(around)) break;
      }
    }
    return holder ? clipWithin(holder) : EVERYTHING;
  };

  const isBox = ({ display }) => display !== 'contents' && !display.startsWith('inline ') && display !== 'inline';

  // Is this a dropdown whose list is a part of the page, above all else, and open?
  const isOpenInPage = (element) =>
    localName(element) === 'select' && getComputedStyle(element).appearance === 'base-select' && matches(element, ':open');

  // What the content of an element is clipped to.
  const clipWithin = (element) => {
    if (clips.has(element)) return clips.get(element);
    const style = getComputedStyle(element);
    let clip = isOpenInPage(element) ? EVERYTHING : clipAround(element, style);
    const { overflowX, overflowY } = style;
    const owner = ownerDocument(element);
    const isContained = /paint|strict|content/.test(style.contain);
    const isReached = isScrolled && (overflowY === 'auto' || overflowY === 'scroll');
    const across = overflowX !== 'visible' || isContained;
    const down = (overflowY !== 'visible' && !isReached) || isContained;
    if ((across || down) && isBox(style) && element !== documentElement(owner) && element !== body(owner)) {
      const rect = getBoundingClientRect(element);
      const scale = offsetWidth(element) ? rect.width / offsetWidth(element) : 1;
      let { left, top, right, bottom } = clip;
      if (across) {
        left = Math.max(left, rect.left + clientLeft(element) * scale);
        right = Math.min(right, rect.right - pixels(style.borderRightWidth) * scale);
      }
      if (down) {
        top = Math.max(top, rect.top + clientTop(element) * scale);
        bottom = Math.min(bottom, rect.bottom - pixels(style.borderBottomWidth) * scale);
      }
      clip = { left, top, right, bottom };
    }
    clips.set(element, clip);
    return clip;
  };

  // The element of our own document that stands for one further down, and the map from its viewport.
  const standing = (element) => {
    let map = null;
    for (let view = defaultView(ownerDocument(element)); view !== window; view = view.parent) {
      element = view.frameElement;
      map = compose(mapOf(element), map);
    }
    return { element, map };
  };

  // A point of a frame's viewport, in our own.
  const outward = (frame, x, y) => apply(compose(standing(frame).map, mapOf(frame)), x, y);

  let isScrolled = false; // are boxes that scroll up and down taken to show all that is in them?

  // A new look: nothing lies where it lay.
  const begin = (whole = false) => {
    maps = new Map();
    clips = new Map();
    hits = new Map();
    slots = new Map();
    isScrolled = whole;
  };

  webgym.geometry = {
    intersect, middle, apply, moved, compose, invert, slotIn, parentOf, contains, mapOf, placeOf, hit, clipAround, clipWithin,
    isBox, isOpenInPage, standing, outward, begin,
  };
})();
