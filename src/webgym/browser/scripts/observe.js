// What the viewport shows: elements that can be used, and text that can be read.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.observe) return;
  const {
    nodeType, parentNode, parentElement, childNodes, firstChild, baseURI, getRootNode, localName, nextElementSibling,
    scrollHeight, getAttribute, matches, closest, checkVisibility, getBoundingClientRect, getClientRects, body, title,
    documentElement, scrollingElement, readyState, children, firstElementChild, childElementCount, querySelector,
    querySelectorAll, offsetWidth, offsetHeight, isContentEditable, ofKind,
  } = webgym.dom;
  const { fold, rootOf, frameIn, isFrame, shorten } = webgym;
  const { roleOf, nameOf, valueOf } = webgym.roles;
  const { sight } = webgym;
  const { intersect, middle, moved, contains, placeOf, hit, clipAround } = webgym.geometry;

  // --- boxes --------------------------------------------------------------------------------------

  // Parts of a box in the order in which a click on their middle is tried.
  const parts = (box) => {
    const [x, y] = middle(box);
    const { left, top, right, bottom } = box;
    const [w, h] = [(right - left) / 4, (bottom - top) / 4];
    return [
      box,
      { left, top, right, bottom: y }, { left, top: y, right, bottom },
      { left, top, right: x, bottom }, { left: x, top, right, bottom },
      { left, top, right: x, bottom: y }, { left: x, top, right, bottom: y },
      { left, top: y, right: x, bottom }, { left: x, top: y, right, bottom },
      { left, top, right, bottom: top + h }, { left, top: bottom - h, right, bottom },
      { left, top, right: left + w, bottom }, { left: right - w, top, right, bottom },
    ];
  };
  const MAX_PARTS = 13;
  const LEAST_SIDE = 2; // pixels of a part that is worth a click

  const isArea = (element) => localName(element) === 'area';

  // The picture that an area of an image map lies on.
  const pictureOf = (area) => {
    const map = closest(area, 'map');
    const name = map && getAttribute(map, 'name');
    return name ? querySelector(getRootNode(area), `img[usemap="#${CSS.escape(name)}"]`) : null;
  };

  // The box around an area, in pixels of its picture: all of it where no shape is given.
  const shapeOf = (area, picture) => {
    const at = area.coords.split(/[\s,]+/).map(Number);
    const [x, y, radius] = at;
    if (area.shape === 'default' || at.length < 3) return [0, 0, offsetWidth(picture), offsetHeight(picture)];
    if (area.shape.startsWith('circ')) return [x - radius, y - radius, x + radius, y + radius];
    const [across, down] = [0, 1].map((axis) => at.filter((_, index) => index % 2 === axis));
    return [Math.min(...across), Math.min(...down), Math.max(...across), Math.max(...down)];
  };

  const areaRects = (area) => {
    const picture = pictureOf(area);
    if (!picture || !offsetWidth(picture)) return [];
    const rect = getBoundingClientRect(picture);
    const scale = rect.width / offsetWidth(picture);
    const [left, top, right, bottom] = shapeOf(area, picture).map((at) => at * scale);
    return [{ left: rect.left + left, top: rect.top + top, right: rect.left + right, bottom: rect.top + bottom }];
  };

  const isHit = (element, box) => {
    const found = hit(...middle(box));
    if (!found) return false;
    if (contains(element, found)) return true;
    const label = closest(found, 'label');
    return Boolean(label && label.control === element);
  };

  const areaOf = (rect) => (rect.right - rect.left) * (rect.bottom - rect.top);

  // The boxes of an element; those of its children where it has none itself, as around a floated picture.
  const rectsOf = (element, depth = 0) => {
    if (isArea(element)) return areaRects(element);
    const rects = [...getClientRects(element)].filter((rect) => areaOf(rect) >= 1);
    if (rects.length || depth > 3) return rects;
    return [...children(rootOf(element) || element)].slice(0, 8).flatMap((child) => rectsOf(child, depth + 1));
  };

  // The first parts of an element that a click reaches, `most` of them, seen from this frame.
  const visibleParts = (element, place, most) => {
    const found = [];
    let around = null;
    for (const rect of rectsOf(element).sort((a, b) => areaOf(b) - areaOf(a)).slice(0, 3)) {
      if (!intersect(moved(rect, place.map), place.clip)) continue;
      around = around || clipAround(isArea(element) ? pictureOf(element) : element);
      const own = intersect(rect, around);
      const box = own && intersect(moved(own, place.map), place.clip);
      for (const part of box ? parts(box) : [])
        if (part.right - part.left >= LEAST_SIDE && part.bottom - part.top >= LEAST_SIDE && isHit(element, part)) {
          found.push(part);
          if (found.length === most) return found;
        }
    }
    return found;
  };

  const isOff = (element) => matches(element, ':disabled') || getAttribute(element, 'aria-disabled') === 'true';

  const isShown = (element) => checkVisibility(element, { visibilityProperty: true, opacityProperty: true });

  // Controls that pages hide to draw their own.
  const isTick = (element) =>
    localName(element) === 'input' && (element.type === 'checkbox' || element.type === 'radio');

  // Even where they are not displayed at all.
  const answersItsLabel = (element) => isTick(element) || (localName(element) === 'input' && element.type === 'file');

  // What is clicked instead of a control that is not seen itself: its label, or what is drawn over a box
  // to tick.
  const standIn = (element, place, most) => {
    if (localName(element) !== 'input') return [];
    for (const label of element.labels || []) {
      const found = isShown(label) ? visibleParts(label, place, most) : [];
      if (found.length) return found;
    }
    const parent = parentElement(element);
    const isDrawn = isTick(element) && parent && childElementCount(parent) > 1 && isShown(parent);
    return isDrawn ? visibleParts(element, place, most) : [];
  };

  // Something that only its cursor and its script make clickable.
  const looksClickable = (element, style) =>
    style.cursor === 'pointer' &&
    (!parentElement(element) || getComputedStyle(parentElement(element)).cursor !== 'pointer') &&
    !['label', 'html', 'body'].includes(localName(element));

  const describe = (element, place, style, sink) => {
    const role = roleOf(element) || (style && looksClickable(element, style) ? 'button' : '');
    if (!role || isOff(element)) return;
    if (role === 'listbox' && localName(element) !== 'select') return; // its options are what one clicks
    const list = role === 'option' && localName(element) === 'option' ? closest(element, 'select') : null;
    if (list && roleOf(list) !== 'listbox') return;
    if (!sink.hasRoom()) return;
    let boxes = isShown(element) || !getClientRects(element).length ? visibleParts(element, place, sink.most) : [];
    if (!boxes.length) boxes = standIn(element, place, sink.most);
    if (!boxes.length) return;
    sink.addElement(element, boxes, {
      role,
      name: nameOf(element, role),
      value: valueOf(element, role) ?? undefined,
      href: role === 'link' ? hrefOf(element) : undefined,
    });
  };

  const hrefOf = (element) => {
    const href = ofKind(element, 'href');
    if (!href) return undefined;
    return shorten(typeof href === 'string' ? href : new URL(href.baseVal, baseURI(element)).href, 'address');
  };

  // --- text ---------------------------------------------------------------------------------------

  const isRoot = (node) => nodeType(node) === Node.DOCUMENT_FRAGMENT_NODE;

  const addText = (node, place, sink) => {
    if (!node.data.trim()) {
      if (node.data) sink.addSpace();
      return;
    }
    const parent = parentNode(node);
    sink.addText(node, isRoot(parent) ? parent.host : parent, place);
  };

  const addControl = (element, place, sink) => {
    const box = intersect(moved(getBoundingClientRect(element), place.map), place.clip);
    if (!box || !isShown(element)) return;
    const role = roleOf(element);
    if (role === 'checkbox' || role === 'radio' || element.type === 'range' || element.type === 'color') return;
    const isWritten = role !== 'button' && localName(element) !== 'select' && element.value;
    const text = role === 'button' ? element.value : valueOf(element, role) || element.placeholder;
    if (!text || !visibleParts(element, place, 1).length) return;
    if (isWritten) sink.addValue(shorten(text, 'value'), [box]);
    else sink.addWords(shorten(text, 'value'), [box]);
  };

  // --- the walk -----------------------------------------------------------------------------------

  const SKIPPED = new Set(['script', 'style', 'noscript', 'template', 'head', 'title', 'meta', 'link']);
  const PICTURES = new Set(['svg', 'canvas', 'video', 'audio', 'embed']);
  const IN_PICTURES = 'a, text, [role], [tabindex], [onclick]';
  const MAX_DEPTH = 1000; // a script can nest deeper than our stack reaches

  const walkPicture = (picture, place, sink) => {
    if (sink.wantsElements) describe(picture, place, getComputedStyle(picture), sink);
    if (localName(picture) !== 'svg') return;
    for (const element of querySelectorAll(picture, IN_PICTURES))
      if (localName(element) !== 'text') {
        if (sink.wantsElements) describe(element, place, null, sink);
      } else if (sink.wantsText) {
        sink.flush();
        for (const child of childNodes(element)) {
          const node = nodeType(child) === Node.TEXT_NODE ? child : firstChild(child);
          if (node && nodeType(node) === Node.TEXT_NODE) addText(node, place, sink);
        }
        sink.flush();
      }
  };

  const walkFrame = (frame, place, sink) => {
    const inner = frameIn(frame);
    const isForeign = !inner && Boolean(frame.contentWindow);
    const within = inner || isForeign ? placeOf(frame, place) : null;
    if (!within || !isShown(frame) || sight.sightOf(frame).alpha < sight.LEAST_ALPHA) return;
    sink.flush();
    if (isForeign) sink.addFrame(frame, within);
    else if (documentElement(inner)) walk(documentElement(inner), within, sink);
    sink.flush();
  };

  const walkNodes = (nodes, place, sink) => {
    for (const child of nodes)
      if (nodeType(child) === Node.ELEMENT_NODE) walk(child, place, sink);
      else if (sink.wantsText && nodeType(child) === Node.TEXT_NODE) addText(child, place, sink);
  };

  const walkElements = (parent, place, sink) => {
    for (let child = firstElementChild(parent); child; child = nextElementSibling(child)) walk(child, place, sink);
  };

  const walk = (element, place, sink) => {
    if (sink.depth >= MAX_DEPTH) return;
    sink.depth += 1;
    walkElement(element, place, sink);
    sink.depth -= 1;
  };

  const touches = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

  // Most of a page is out of view: what can be told from its box alone costs no style.
  const walkElement = (element, place, sink) => {
    const name = localName(element);
    if (SKIPPED.has(name)) return;
    if (name === 'area' && sink.wantsElements) describe(element, place, null, sink);
    const rect = getBoundingClientRect(element);
    const hasBox = rect.width > 0 && rect.height > 0;
    const isInView = hasBox && touches(moved(rect, place.map), place.clip);
    let style = null;
    const styled = () => style || (style = getComputedStyle(element));
    if (!hasBox && styled().display === 'none') {
      if (sink.wantsElements && answersItsLabel(element)) describe(element, place, null, sink);
      return;
    }
    if (PICTURES.has(name)) {
      if (isInView) walkPicture(element, place, sink);
      return;
    }
    if (sink.wantsElements && (isInView || !hasBox || isTick(element)))
      describe(element, place, isInView ? styled() : null, sink);
    const isBlock = () => !(styled().display.startsWith('inline') || style.display === 'contents');
    if (sink.hasOpenLine && (name === 'br' || isBlock())) sink.flush();
    walkInside(element, name, place, sink, isInView, hasBox);
    if (sink.hasOpenLine && isBlock()) sink.flush();
  };

  const walkInside = (element, name, place, sink, isInView, hasBox) => {
    const hasText = sink.wantsText && (isInView || !hasBox);
    if (isFrame(element) && element.contentWindow) walkFrame(element, place, sink);
    else if (name === 'input' || name === 'textarea' || (name === 'select' && roleOf(element) === 'combobox')) {
      if (hasText) addControl(element, place, sink);
    } else if (name === 'slot' && element.assignedNodes().length) {
      walkNodes(element.assignedNodes(), place, sink);
    } else {
      const root = rootOf(element);
      if (root) webgym.watch(root);
      else if (isInView) webgym.wonderAtSize(element);
      if (hasText) walkNodes(childNodes(root || element), place, sink);
      else walkElements(root || element, place, sink);
    }
  };

  webgym.isCutOff = () => readyState(document) === 'complete' && !body(document);

  // --- what a walk finds --------------------------------------------------------------------------

  const GAP = 1; // CSS pixels between two pieces that a reader takes for a space

  class Lines {
    constructor() {
      this.lines = [];
      this.text = '';
      this.edge = null;
    }
    add(text, rects) {
      const first = rects[0];
      const touches =
        !this.edge || (Math.abs(first.left - this.edge.right) <= GAP && first.top < this.edge.bottom);
      this.text += touches || /\s$/.test(this.text) || /^\s/.test(text) ? text : ` ${text}`;
      this.edge = rects[rects.length - 1];
    }
    flush() {
      const line = fold(this.text);
      if (line) this.lines.push(line);
      this.text = '';
      this.edge = null;
    }
  }

  const numbers = new WeakMap();
  const byNumber = new Map(); // elements of this world, held weakly
  const foreignNumbers = new Map(); // by world and key, of elements in frames of other origins
  let lastNumber = 0;
  const numberOf = (key) => {
    const known = typeof key === 'string' ? foreignNumbers : numbers;
    if (!known.has(key)) {
      known.set(key, ++lastNumber);
      if (known === numbers) byNumber.set(lastNumber, new WeakRef(key));
    }
    return known.get(key);
  };
  // The element that has a number: undefined for one of another world, null if it is gone.
  const elementOf = (number) => {
    const element = byNumber.get(number);
    return element && (element.deref() || null);
  };
  webgym.elements = { elementOf, numberOf, isShown, isOff, looksClickable, visibleParts, standIn };

  // In the tab's own frame: what is seen is numbered and read. `frames`: what was gathered in frames of
  // other origins, {world, items} by id; the names of those that are missing are kept.
  class Look {
    constructor({ text, elements }, frames) {
      this.wantsText = Boolean(text);
      this.wantsElements = Boolean(elements);
      this.most = 1;
      this.depth = 0;
      this.lines = new Lines();
      this.fields = new Lines();
      this.elements = [];
      this.frames = frames;
      this.count = 0; // of elements
      this.spare = webgym.limits.text; // for their values and addresses
      this.missing = [];
      this.isUnknown = false;
    }
    get hasOpenLine() {
      return this.lines.text !== '' || this.fields.text !== '';
    }
    addSpace() {
      if (this.lines.text) this.lines.text += ' ';
      if (this.fields.text) this.fields.text += ' ';
    }
    addText(node, parent, place) {
      const seen = sight.read(node, parent, place);
      if (seen) (isContentEditable(parent) ? this.fields : this.lines).add(seen.text, seen.rects);
    }
    addWords(text, rects) {
      this.lines.add(` ${text} `, rects);
    }
    addValue(text, rects) {
      this.addSpace();
      this.fields.flush();
      this.fields.add(text, rects);
      this.fields.flush();
    }
    flush() {
      this.lines.flush();
      this.fields.flush();
    }
    hasRoom() {
      if (this.count < webgym.limits.elements) return true;
      webgym.noteShortened('elements');
      return false;
    }
    // Counts an element. Values and addresses are left out where there is no room for them.
    fitting({ value, href, ...described }) {
      this.count += 1;
      this.spare -= (value || '').length + (href || '').length;
      if (this.spare >= 0) return { ...described, value, href };
      if (value) webgym.noteShortened('value');
      if (href) webgym.noteShortened('address');
      return described;
    }
    addElement(key, [box], described) {
      const { left, top, right, bottom } = box;
      const at = [left, top, right - left, bottom - top];
      this.elements.push({ number: numberOf(key), ...this.fitting(described), box: at });
    }
    addFrame(frame, place) {
      const id = webgym.frameId(frame);
      if (id === null) this.isUnknown = true;
      else if (id) this.replay(id, place, (x, y) => hit(x, y) === frame);
    }
    // What a frame of another origin shows, as far as what lies around it lets it.
    replay(id, place, isOpen) {
      const gathered = this.frames[id];
      if (!gathered) {
        this.missing.push(id);
        return;
      }
      const seen = (rects) =>
        rects
          .map((rect) => intersect(moved(rect, place.map), place.clip))
          .filter((rect) => rect && isOpen(...middle(rect)));
      for (const [kind, ...item] of gathered.items) {
        if (kind === 'space') this.addSpace();
        else if (kind === 'flush') this.flush();
        else if (kind === 'shortened') webgym.noteShortened(item[0]);
        else if (kind === 'frame') this.replayWithin(item, place, isOpen);
        else if (kind === 'element') {
          const boxes = seen(item[1]);
          if (boxes.length && this.hasRoom()) this.addElement(`${gathered.world} ${item[0]}`, boxes, item[2]);
        } else this.replayText(kind, item[0], place, isOpen);
      }
    }
    replayText(kind, pieces, place, isOpen) {
      const shown = sight.join(
        pieces.map((piece) => {
          const rects = piece.rects.map((rect) => moved(rect, place.map));
          const isSeen = (rect) => sight.isWithin(rect, place.clip) && isOpen(...middle(rect));
          return { ...piece, rects, isSeen: piece.isSeen && rects.every(isSeen) };
        }),
      );
      if (!shown) return;
      if (kind === 'value') this.addValue(shown.text, shown.rects);
      else (kind === 'field' ? this.fields : this.lines).add(shown.text, shown.rects);
    }
    replayWithin([id, map, clip, covered], place, isOpen) {
      const inner = { map: webgym.geometry.compose(place.map, map), clip: intersect(moved(clip, place.map), place.clip) };
      if (id === null) this.isUnknown = true;
      else if (id && inner.clip) {
        const inverse = webgym.geometry.invert(place.map);
        const isBare = (x, y) => {
          const [ownX, ownY] = webgym.geometry.apply(inverse, x, y);
          return !covered.includes(cellOf(clip, ownX, ownY));
        };
        this.replay(id, inner, (x, y) => isOpen(x, y) && isBare(x, y));
      }
    }
  }

  // A frame within a frame of another origin: which cells of a grid over it lie under something. The frame
  // above cannot ask for single points there.
  const GRID = 12;
  const cellOf = ({ left, top, right, bottom }, x, y) => {
    const column = Math.floor(((x - left) / (right - left)) * GRID);
    const row = Math.floor(((y - top) / (bottom - top)) * GRID);
    return row * GRID + column;
  };
  const coveredCells = (frame, { left, top, right, bottom }) => {
    const covered = [];
    for (let cell = 0; cell < GRID * GRID; cell++) {
      const x = left + (((cell % GRID) + 0.5) / GRID) * (right - left);
      const y = top + ((Math.floor(cell / GRID) + 0.5) / GRID) * (bottom - top);
      if (hit(x, y) !== frame) covered.push(cell);
    }
    return covered;
  };

  // In a frame of another origin: what is seen is written down, for the tab's own frame to go over.
  class Gathering extends Look {
    constructor(wanted) {
      super(wanted, {});
      this.items = [];
      this.most = MAX_PARTS;
      this.hasText = false;
      this.room = webgym.limits.text;
    }
    get hasOpenLine() {
      return this.hasText;
    }
    addSpace() {
      if (this.hasText) this.items.push(['space']);
    }
    addText(node, parent, place) {
      const pieces = sight.read(node, parent, place, true);
      if (pieces) this.addPieces(isContentEditable(parent) ? 'field' : 'text', pieces);
    }
    addWords(text, rects) {
      this.addPieces('text', [{ text: ` ${text} `, rects, isSeen: true }]);
    }
    addValue(text, rects) {
      this.addPieces('value', [{ text, rects, isSeen: true }]);
    }
    addPieces(kind, pieces) {
      this.room -= pieces.reduce((sum, { text }) => sum + text.length, 0);
      if (this.room < 0) {
        webgym.noteShortened('text');
        return;
      }
      this.items.push([kind, pieces]);
      this.hasText = true;
    }
    flush() {
      if (this.hasText) this.items.push(['flush']);
      this.hasText = false;
    }
    addElement(element, boxes, described) {
      this.items.push(['element', numberOf(element), boxes, this.fitting(described)]);
    }
    addFrame(frame, { map, clip }) {
      this.items.push(['frame', webgym.frameId(frame), map, clip, coveredCells(frame, clip)]);
    }
  }

  // The lines of a document that show less than they hold, wherever one scrolls: [whole, shown].
  class Cuts extends Look {
    constructor() {
      super({ text: true }, {});
      this.cut = [];
    }
    addText(node, parent, place) {
      if (!sight.isVisible(parent) || !sight.sightOf(parent).alpha) return; // closed, not cut
      this.fields.text += node.data;
      const clip = { ...place.clip, left: 0, right: innerWidth };
      const seen = sight.read(node, parent, { map: place.map, clip, isFlat: true });
      this.lines.text += seen ? seen.text : ' … ';
    }
    flush() {
      const [whole, shown] = [this.fields, this.lines].map(({ text }) => fold(text));
      if (whole !== shown) this.cut.push([whole, shown]);
      this.fields.text = this.lines.text = '';
    }
    addWords() {}
    addValue() {}
    addFrame() {}
  }

  const EVERYTHING = { left: -Infinity, top: -Infinity, right: Infinity, bottom: Infinity };

  const walkAll = (sink, isWhole = false) => {
    webgym.geometry.begin(isWhole);
    sight.begin();
    const clip = isWhole ? EVERYTHING : { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    if (documentElement(document)) walk(documentElement(document), { map: null, clip }, sink);
    sink.flush();
    return sink;
  };

  // As many of these texts, or lists of texts, as are as long as a text may be.
  const firstOf = (texts) => {
    let left = webgym.limits.text;
    const found = texts.filter((text) => (left -= [text].flat().join('').length) >= 0);
    if (found.length < texts.length) webgym.noteShortened('text');
    return found;
  };

  // {text, elements}: what is wanted. Gives what a `Look` of the frame above can go over.
  webgym.gather = (wanted) => {
    webgym.attach();
    const gathering = new Gathering(wanted);
    walkAll(gathering);
    return [...gathering.items, ...webgym.takeShortened().map((kind) => ['shortened', kind])];
  };

  // {text, cuts, elements, marks}: what is wanted; marks are drawn over the elements until `unmark`.
  webgym.observe = (wanted, frames) => {
    webgym.attach();
    const page = scrollingElement(document) || documentElement(document);
    const seen = {
      title: shorten(title(document), 'title'),
      scroll: [scrollY, page ? scrollHeight(page) : innerHeight],
    };
    if (!wanted.text && !wanted.elements && !wanted.cuts)
      return { ...seen, ...webgym.reach(), shortened: webgym.takeShortened() };
    const look = new Look(wanted, frames);
    walkAll(look);
    const reach = webgym.reach();
    if (wanted.marks && documentElement(document)) webgym.mark(look.elements);
    const read = look.wantsText
      ? { text: shorten(look.lines.lines.join('\n'), 'text'), fields: firstOf(look.fields.lines) }
      : {};
    const cuts = wanted.cuts ? { cuts: firstOf(walkAll(new Cuts(), true).cut) } : {};
    return {
      ...seen,
      frames: reach.frames,
      missing: look.missing,
      unknown: reach.unknown || look.isUnknown,
      ...read,
      ...cuts,
      ...(look.wantsElements ? { elements: look.elements } : {}),
      shortened: webgym.takeShortened(),
    };
  };
})();
