// What the viewport shows: elements that can be used, and text that can be read.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.observe) return;
  const {
    nodeType, nodeName, parentNode, childNodes, firstChild, localName, nextElementSibling, firstElementChild, scrollHeight,
    getBoundingClientRect, closest, title, documentElement, scrollingElement, isContentEditable, querySelectorAll,
  } = webgym.dom;
  const { fold, rootOf, frameIn, isFrame, shorten } = webgym;
  const { roleOf, valueOf, writtenOn } = webgym.roles;
  const { sight } = webgym;
  const { near, rectOf, isFar } = webgym.boxes;
  const { MAX_PARTS, isShown, hasLabelIn, answersItsLabel, visibleParts, candidateOf, choose, describe } = webgym.targets;
  const { intersect, middle, moved, placeOf, hit, isOpenInPage } = webgym.geometry;

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

  const WORDLESS = new Set(['checkbox', 'radio', 'range', 'color']);
  const addControl = (element, place, sink) => {
    const box = intersect(moved(getBoundingClientRect(element), place.map), place.clip);
    if (!box || !isShown(element)) return;
    if (WORDLESS.has(element.type)) return;
    const role = roleOf(element);
    const isChosen = role !== 'button' || element.type === 'file'; // by whoever acts
    const isWritten = isChosen && localName(element) !== 'select' && element.value;
    const text = role === 'button' ? writtenOn(element) : valueOf(element, role) || element.placeholder;
    if (!text || !(visibleParts(element, place, 1).length || sight.isShownOf(element, place.map))) return;
    if (isWritten) sink.addValue(shorten(text, 'value'), [box]);
    else sink.addWords(shorten(text, 'value'), [box]);
  };

  // --- the walk -----------------------------------------------------------------------------------

  const SKIPPED = new Set(['script', 'style', 'noscript', 'template', 'head', 'title', 'meta', 'link']);
  const PICTURES = new Set(['svg', 'canvas', 'video', 'audio', 'embed']);
  const MAX_DEPTH = 1000; // a script can nest deeper than our stack reaches
  const MAX_SHAPES = 500; // of a drawing

  const walkText = (element, place, sink) => {
    sink.flush();
    for (const child of childNodes(element)) {
      const node = nodeType(child) === Node.TEXT_NODE ? child : firstChild(child);
      if (node && nodeType(node) === Node.TEXT_NODE) addText(node, place, sink);
    }
    sink.flush();
  };

  const walkShapes = (shape, place, sink) => {
    const outer = sink.around;
    for (let child = firstElementChild(shape); child; child = nextElementSibling(child)) {
      if (localName(child) === 'text' && sink.wantsText) walkText(child, place, sink);
      if (sink.wantsElements && sink.shapes++ < MAX_SHAPES) sink.consider(child, place, getComputedStyle(child));
      if (localName(child) === 'foreignObject') {
        sink.flush();
        walkNodes(childNodes(child), place, sink);
        sink.flush();
      } else walkShapes(child, place, sink);
      sink.around = outer;
    }
  };

  const walkPicture = (picture, place, sink) => {
    const outer = sink.around;
    if (sink.wantsElements) sink.consider(picture, place, getComputedStyle(picture));
    sink.shapes = 0;
    if (localName(picture) === 'svg') walkShapes(picture, place, sink);
    sink.around = outer;
  };

  const walkFrame = (frame, place, sink) => {
    const inner = frameIn(frame);
    const isForeign = !inner && Boolean(frame.contentWindow);
    const within = inner || isForeign ? placeOf(frame, place) : null;
    if (!within || !isShown(frame) || sight.sightOf(frame).alpha < sight.LEAST_ALPHA) return;
    sink.flush();
    if (inner) sink.considerScroller(scrollingElement(inner));
    if (isForeign) sink.addFrame(frame, within);
    else if (documentElement(inner)) walk(documentElement(inner), within, sink);
    sink.flush();
  };

  const walkNodes = (nodes, place, sink) => {
    for (const child of nodes)
      if (nodeType(child) === Node.ELEMENT_NODE) walkNear(child, place, sink);
      else if (sink.wantsText && nodeType(child) === Node.TEXT_NODE) addText(child, place, sink);
  };

  const walkElements = (parent, place, sink) => {
    for (let child = firstElementChild(parent); child; child = nextElementSibling(child)) walkNear(child, place, sink);
  };

  // What is far ends a line, at most.
  const walkNear = (element, place, sink) => {
    if (!place.isSurveyed || sink.hasOpenLine || !isFar(element)) walk(element, place, sink);
  };

  const walk = (element, place, sink) => {
    if (sink.depth >= MAX_DEPTH) return;
    sink.depth += 1;
    walkElement(element, place, sink);
    sink.depth -= 1;
  };

  const touches = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

  const IN_LINE = /^(inline|ruby|contents)|math$/; // also the parts of a formula, and what stands above words

  const isScreen = (element) => element === scrollingElement(document); // its place is told by each observation
  const SCROLLS = new Set(['auto', 'scroll']);

  // Most of a page is out of view: what can be told from its box alone costs no style.
  const walkElement = (element, place, sink) => {
    const name = localName(element);
    if (SKIPPED.has(name)) return;
    const outer = sink.around;
    if (name === 'area' && sink.wantsElements) sink.consider(element, place, null);
    const rect = rectOf(element);
    const hasBox = rect.width > 0 && rect.height > 0;
    const isInView = hasBox && touches(moved(rect, place.map), place.clip);
    let style = null;
    const styled = () => style || (style = getComputedStyle(element));
    if (!hasBox && styled().display === 'none') {
      if (sink.wantsElements && answersItsLabel(element)) sink.consider(element, place, null);
      sink.around = outer;
      return;
    }
    if (isInView && (name === 'embed' || name === 'object')) webgym.tellEmbedded(element);
    if (PICTURES.has(name)) {
      if (isInView) walkPicture(element, place, sink);
      return;
    }
    if (isInView && SCROLLS.has(styled().overflowY) && name !== 'textarea' && !isScreen(element)) sink.considerScroller(element);
    const hasStyle = isInView || (!hasBox && styled().display === 'contents');
    if (sink.wantsElements && (isInView || !hasBox || hasLabelIn(element, place)))
      sink.consider(element, place, hasStyle ? styled() : null);
    const isBlock = () => !IN_LINE.test(styled().display) || (name === 'math' && style.display === 'block math');
    if (sink.hasOpenLine && (name === 'br' || isBlock())) sink.flush();
    walkInside(element, name, place, sink, isInView, hasBox);
    if (sink.hasOpenLine && isBlock()) sink.flush();
    sink.around = outer;
  };

  const walkInside = (element, name, place, sink, isInView, hasBox) => {
    const hasText = sink.wantsText && (isInView || !hasBox);
    if (isFrame(element) && element.contentWindow) walkFrame(element, place, sink);
    else if (name === 'input' || name === 'textarea' || (name === 'select' && roleOf(element) === 'combobox')) {
      if (hasText) addControl(element, place, sink);
      if (isInView && sink.wantsText) Object.values(sight.writtenBy(element, place)).forEach((it) => addWritten(it, sink));
      if (isInView && isOpenInPage(element)) walkNodes(offersOf(element), place, sink);
    } else if (name === 'option' && !isOpenInPage(closest(element, 'select') || element)) {
      // Its text has no boxes of its own.
      if (hasText && visibleParts(element, place, 1).length)
        sink.addWords(shorten(element.label, 'value'), [moved(rectOf(element), place.map)]);
    } else if (name === 'slot' && element.assignedNodes().length) {
      walkNodes(element.assignedNodes(), place, sink);
    } else {
      const root = rootOf(element);
      if (root) enter(root, place);
      else if (isInView) webgym.wonderAtSize(element);
      const written = isInView && sink.wantsText ? sight.writtenBy(element, place) : {};
      addWritten(written['::before'], sink);
      if (hasText) walkNodes(childNodes(root || element), place, sink);
      else walkElements(root || element, place, sink);
      addWritten(written['::after'], sink);
    }
  };

  const addWritten = (written, sink) => written && sink.addWords(shorten(written.text, 'value'), written.rects);

  // What is in an open dropdown, but for the button that it is opened by, whose text is its value.
  const offersOf = (select) => [...childNodes(select)].filter((node) => nodeName(node) !== 'BUTTON');

  const enter = (root, place) => {
    webgym.watch(root);
    if (place.isSurveyed) near(root);
  };

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
  webgym.numbers = { elementOf, numberOf };

  const CANDIDATES = 4; // for each element that may be listed

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
      this.candidates = [];
      this.around = null; // the candidate that is being walked through
      this.frames = frames;
      this.count = 0; // of elements
      this.spare = webgym.limits.text; // for their values and addresses
      this.shown = []; // what tells the elements from each other: see aim.js
      this.missing = [];
      this.said = [];
      this.scrollers = [];
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
      if (!seen) return;
      if (isContentEditable(parent)) this.fields.add(seen.text, seen.rects);
      else this.lines.add(seen.isOdd ? sight.doubted(seen) : seen.text, seen.rects);
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
    // An element that may be one to use; all of them are compared when they are known.
    consider(element, place, style) {
      if (this.candidates.length >= CANDIDATES * webgym.limits.elements) return;
      const one = candidateOf(element, place, style, this.around && this.around.items.has(element));
      if (!one) return;
      this.candidates.push(one);
      if (this.around) this.around.kids.push(one);
      this.around = one;
    }
    considerScroller(box) {
      if (box && webgym.holdsMore(box)) this.scrollers.push(box);
    }
    finish() {
      this.flush();
      const chosen = choose(this.candidates, this.most);
      const most = webgym.limits.elements - this.count;
      if (chosen.length > most) webgym.noteShortened('elements');
      for (const one of chosen.slice(0, most)) one.described ??= { ...describe(one), element: one.element };
      webgym.distinguish(chosen.slice(0, most).filter(({ element }) => element).map(({ described }) => described));
      for (const { key, element, boxes, described } of chosen.slice(0, most)) {
        const { element: _, ...told } = described;
        this.addElement(key || element, boxes, told);
      }
      this.addBeside(chosen);
      webgym.tellMore(this.scrollers);
    }
    addBeside(chosen) {
      const found = webgym.beside(this.candidates, chosen);
      if (found) this.addElement(documentElement(document), [found.box], { role: 'button', name: found.name });
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
    addElement(key, [box], { around, ...described }) {
      const { left, top, right, bottom } = box;
      const at = [left, top, right - left, bottom - top];
      const number = numberOf(key);
      this.elements.push({ number, ...this.fitting(described), box: at });
      this.shown.push({ number, key, role: described.role, name: described.name, around, box });
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
        else if (kind === 'unknown') this.isUnknown = true;
        else if (kind === 'shortened') webgym.noteShortened(item[0]);
        else if (kind === 'said') this.said.push([`${gathered.world} ${item[0]}`, item[1]]);
        else if (kind === 'frame') this.replayWithin(item, place, isOpen);
        else if (kind === 'element') {
          const boxes = seen(item[1]);
          const key = `${gathered.world} ${item[0]}`;
          if (boxes.length) this.candidates.push({ key, boxes, described: item[2], isKept: true });
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
    addBeside() {}
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
    addBeside() {}
    addFrame() {}
    considerScroller() {}
  }

  const EVERYTHING = { left: -Infinity, top: -Infinity, right: Infinity, bottom: Infinity };

  const walkAll = (sink, isWhole = false) => {
    webgym.boxes.begin();
    webgym.geometry.begin(isWhole);
    sight.begin();
    webgym.targets.begin();
    const clip = isWhole ? EVERYTHING : { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    if (!isWhole) near(document);
    if (documentElement(document)) walk(documentElement(document), { map: null, clip, isSurveyed: !isWhole }, sink);
    sink.finish();
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
    const isReady = webgym.hideCaret();
    const gathering = new Gathering(wanted);
    gathering.considerScroller(scrollingElement(document));
    walkAll(gathering);
    if (!isReady) gathering.items.push(['unknown']);
    const said = webgym.said().map((one) => ['said', ...one]);
    return [...gathering.items, ...said, ...webgym.takeShortened().map((kind) => ['shortened', kind])];
  };

  const LOGIN = 'input[type=password], input[autocomplete~=username], input[autocomplete~=current-password]';

  // {text, cuts, elements}: what is wanted.
  webgym.observe = (wanted, frames) => {
    webgym.attach();
    webgym.hideCaret();
    const page = scrollingElement(document) || documentElement(document);
    const seen = {
      title: shorten(title(document), 'title'),
      scroll: [scrollY, page ? scrollHeight(page) : innerHeight],
    };
    const said = () => webgym.said().map(([number, text]) => [String(number), text]);
    if (!wanted.text && !wanted.elements && !wanted.cuts) {
      webgym.picture([]);
      return { ...seen, ...webgym.reach(), said: said(), shortened: webgym.takeShortened() };
    }
    const look = new Look(wanted, frames);
    walkAll(look);
    const reach = webgym.reach();
    if (wanted.aimed) return { missing: look.missing, aimed: webgym.aim(wanted.aimed, look.shown) };
    webgym.picture(look.shown);
    const read = look.wantsText
      ? {
          text: shorten(look.lines.lines.join('\n'), 'text'),
          fields: firstOf(look.fields.lines),
          login: [...querySelectorAll(document, LOGIN)].some(isShown),
          ...sight.open(),
        }
      : {};
    const cuts = wanted.cuts ? { cuts: firstOf(walkAll(new Cuts(), true).cut) } : {};
    return {
      ...seen,
      frames: reach.frames,
      missing: look.missing,
      unknown: reach.unknown || look.isUnknown,
      said: [...said(), ...look.said],
      ...read,
      ...cuts,
      ...(look.wantsElements ? { elements: look.elements } : {}),
      shortened: webgym.takeShortened(),
    };
  };
})();
