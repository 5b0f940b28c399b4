// Runs in the same isolated world as page.js: what the viewport shows, and marks over it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.observe) return;
  const { fold, rootOf } = webgym;
  const MAX_NAME = 200;

  const numbers = new WeakMap();
  let lastNumber = 0;
  const numberOf = (element) => {
    if (!numbers.has(element)) numbers.set(element, ++lastNumber);
    return numbers.get(element);
  };

  // --- geometry -----------------------------------------------------------------------------------
  // A place is a document together with where its viewport lies in the tab's: {document, x, y, clip}.

  const intersect = (a, b) => {
    const left = Math.max(a.left, b.left);
    const top = Math.max(a.top, b.top);
    const right = Math.min(a.right, b.right);
    const bottom = Math.min(a.bottom, b.bottom);
    return right - left >= 1 && bottom - top >= 1 ? { left, top, right, bottom } : null;
  };

  const moved = (rect, place) => ({
    left: rect.left + place.x,
    top: rect.top + place.y,
    right: rect.right + place.x,
    bottom: rect.bottom + place.y,
  });

  const isRoot = (node) => node.nodeType === Node.DOCUMENT_FRAGMENT_NODE;
  const parentOf = (node) => node.parentNode || (isRoot(node) ? node.host : null);
  const contains = (outer, inner) => {
    for (let node = inner; node; node = node.assignedSlot || parentOf(node)) if (node === outer) return true;
    return false;
  };

  // The element on top at a point of the tab, through shadow roots and frames.
  const hit = (x, y) => {
    let left = 0;
    let top = 0;
    let root = document;
    for (;;) {
      const element = root.elementFromPoint(x - left, y - top);
      if (!element) return null;
      const inner = rootOf(element);
      if (inner && inner !== root) {
        const deeper = inner.elementFromPoint(x - left, y - top);
        if (deeper && deeper !== element) {
          root = inner;
          continue;
        }
        return element;
      }
      const frame = element.localName === 'iframe' ? element.contentDocument : null;
      if (!frame) return element;
      const origin = frameOrigin(element);
      left += origin.x;
      top += origin.y;
      root = frame;
    }
  };

  const frameOrigin = (frame) => {
    const box = frame.getBoundingClientRect();
    return { x: box.left + frame.clientLeft, y: box.top + frame.clientTop };
  };

  const middle = (box) => [(box.left + box.right) / 2, (box.top + box.bottom) / 2];

  // Parts of a box in the order in which a click on their middle is tried.
  const parts = (box) => {
    const [x, y] = middle(box);
    const { left, top, right, bottom } = box;
    return [
      box,
      { left, top, right, bottom: y }, { left, top: y, right, bottom },
      { left, top, right: x, bottom }, { left: x, top, right, bottom },
      { left, top, right: x, bottom: y }, { left: x, top, right, bottom: y },
      { left, top: y, right: x, bottom }, { left: x, top: y, right, bottom },
    ];
  };

  const isHit = (element, box) => {
    const found = hit(...middle(box));
    if (!found) return false;
    if (contains(element, found)) return true;
    const label = found.closest ? found.closest('label') : null;
    return Boolean(label && label.control === element);
  };

  const visibleBox = (element, place) => {
    const rects = [...element.getClientRects()]
      .map((rect) => intersect(moved(rect, place), place.clip))
      .filter(Boolean)
      .sort((a, b) => (b.right - b.left) * (b.bottom - b.top) - (a.right - a.left) * (a.bottom - a.top));
    for (const rect of rects.slice(0, 3))
      for (const part of parts(rect))
        if (part.right - part.left >= 2 && part.bottom - part.top >= 2 && isHit(element, part)) return part;
    return null;
  };

  // --- roles and names ----------------------------------------------------------------------------

  const INPUT_ROLES = {
    button: 'button', submit: 'button', reset: 'button', image: 'button', checkbox: 'checkbox',
    radio: 'radio', range: 'slider', number: 'spinbutton', search: 'searchbox', file: 'button',
    color: 'button',
  };
  const WIDGET_ROLES = new Set(
    ('button link checkbox radio switch tab option menuitem menuitemcheckbox menuitemradio combobox ' +
      'textbox searchbox slider spinbutton treeitem gridcell listbox').split(' '),
  );

  const roleOf = (element) => {
    const explicit = (element.getAttribute('role') || '').trim().split(/\s+/)[0];
    if (WIDGET_ROLES.has(explicit)) return explicit;
    switch (element.localName) {
      case 'a':
      case 'area':
        return element.hasAttribute('href') ? 'link' : '';
      case 'button':
      case 'summary':
        return 'button';
      case 'select':
        return element.multiple || element.size > 1 ? 'listbox' : 'combobox';
      case 'option':
        return 'option';
      case 'textarea':
        return 'textbox';
      case 'input':
        if (element.type === 'hidden') return '';
        if (INPUT_ROLES[element.type]) return INPUT_ROLES[element.type];
        return element.list ? 'combobox' : 'textbox';
      default:
        break;
    }
    if (element.isContentEditable && !(element.parentElement && element.parentElement.isContentEditable))
      return 'textbox';
    if (element.hasAttribute('onclick') || (element.hasAttribute('tabindex') && element.tabIndex >= 0))
      return 'button';
    return '';
  };

  // Something that only its cursor and its script make clickable.
  const looksClickable = (element, style) =>
    style.cursor === 'pointer' &&
    (!element.parentElement || getComputedStyle(element.parentElement).cursor !== 'pointer') &&
    element.localName !== 'label' &&
    element.localName !== 'html' &&
    element.localName !== 'body';

  const contentName = (node, depth = 0) => {
    if (node.nodeType === Node.TEXT_NODE) return node.data;
    if (node.nodeType !== Node.ELEMENT_NODE || depth > 12) return '';
    if (node.getAttribute('aria-hidden') === 'true') return '';
    if (node.localName === 'style' || node.localName === 'script' || node.localName === 'select') return '';
    if (depth && !node.checkVisibility({ visibilityProperty: true })) return '';
    const label = depth ? node.getAttribute('aria-label') : null;
    if (label) return label;
    if (node.localName === 'img') return node.alt;
    if (node.localName === 'svg') return (node.querySelector('title') || {}).textContent || '';
    const children = node.localName === 'slot' ? node.assignedNodes({ flatten: true }) : [];
    const inner = children.length ? children : (rootOf(node) || node).childNodes;
    const isInline = depth && getComputedStyle(node).display.startsWith('inline');
    const text = [...inner].map((child) => contentName(child, depth + 1)).join('');
    return isInline || !depth ? text : ` ${text} `;
  };

  const byIds = (element, ids) => {
    const root = element.getRootNode();
    return ids.split(/\s+/).map((id) => root.getElementById && root.getElementById(id)).filter(Boolean);
  };

  const nameOf = (element, role) => {
    const labelled = element.getAttribute('aria-labelledby');
    const candidates = [
      () => (labelled ? byIds(element, labelled).map((label) => contentName(label)).join(' ') : ''),
      () => element.getAttribute('aria-label'),
      () => (element.labels ? [...element.labels].map((label) => contentName(label)).join(' ') : ''),
      () => (element.localName === 'input' && role === 'button' ? element.value || element.alt : ''),
      () => (['textbox', 'searchbox', 'combobox', 'listbox', 'spinbutton'].includes(role) ? '' : contentName(element)),
      () => element.getAttribute('placeholder'),
      () => element.getAttribute('title'),
      () => element.getAttribute('alt'),
      () => (element.localName === 'option' ? element.label : ''),
    ];
    for (const candidate of candidates) {
      const name = fold(candidate());
      if (name) return name.slice(0, MAX_NAME);
    }
    return '';
  };

  const valueOf = (element, role) => {
    if (role === 'checkbox' || role === 'radio' || role === 'switch')
      return String('checked' in element ? element.checked : element.getAttribute('aria-checked') === 'true');
    if (element.localName === 'select')
      return [...element.selectedOptions].map((option) => fold(option.label)).join(', ');
    if (role === 'option') return String(element.selected || element.getAttribute('aria-selected') === 'true');
    if (element.localName === 'textarea' || (element.localName === 'input' && role !== 'button'))
      return element.type === 'password' ? '•'.repeat(element.value.length) : element.value;
    return null;
  };

  const isOff = (element) =>
    element.matches(':disabled') || element.getAttribute('aria-disabled') === 'true' || Boolean(element.closest('[inert]'));

  // A box that shows nothing of a control whose label is what people click.
  const standIn = (element, place) => {
    for (const label of element.labels || []) {
      const box = visibleBox(label, place);
      if (box) return box;
    }
    return null;
  };

  const describe = (element, place, style, found) => {
    const role = roleOf(element) || (looksClickable(element, style) ? 'button' : '');
    if (!role || isOff(element)) return;
    if (role === 'listbox' && element.localName !== 'select') return; // its options are what one clicks
    if (role === 'option' && element.localName === 'option' && roleOf(element.closest('select')) !== 'listbox') return;
    const isShown = element.checkVisibility({ visibilityProperty: true, opacityProperty: true });
    const box = (isShown && visibleBox(element, place)) || standIn(element, place);
    if (!box) return;
    const value = valueOf(element, role);
    found.elements.push({
      number: numberOf(element),
      role,
      name: nameOf(element, role),
      box: [box.left, box.top, box.right - box.left, box.bottom - box.top],
      ...(value === null ? {} : { value }),
      ...(role === 'link' && element.href ? { href: String(element.href) } : {}),
    });
  };

  // --- text ---------------------------------------------------------------------------------------

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

  const isCovered = (parent, rect) => {
    const found = hit(...middle(rect));
    return !found || !(contains(found, parent) || contains(parent, found));
  };

  const range = document.createRange();
  const addText = (node, place, lines) => {
    if (!node.data.trim()) {
      if (node.data && lines.text) lines.text += ' ';
      return;
    }
    range.selectNodeContents(node);
    const rects = [...range.getClientRects()]
      .map((rect) => intersect(moved(rect, place), place.clip))
      .filter(Boolean);
    if (!rects.length) return;
    const parent = isRoot(node.parentNode) ? node.parentNode.host : node.parentNode;
    if (!parent.checkVisibility({ visibilityProperty: true, opacityProperty: true })) return;
    const shown = rects.filter((rect) => !isCovered(parent, rect));
    if (shown.length) lines.add(node.data, shown);
  };

  const addControl = (element, place, lines) => {
    const box = intersect(moved(element.getBoundingClientRect(), place), place.clip);
    if (!box || !element.checkVisibility({ visibilityProperty: true, opacityProperty: true })) return;
    if (isCovered(element, box) && !visibleBox(element, place)) return;
    const role = roleOf(element);
    if (role === 'checkbox' || role === 'radio' || element.type === 'range' || element.type === 'color') return;
    const text = role === 'button' ? element.value : valueOf(element, role) || element.placeholder || '';
    if (text) lines.add(` ${text} `, [box]);
  };

  // --- the walk -----------------------------------------------------------------------------------

  const SKIPPED = new Set(['script', 'style', 'noscript', 'template', 'head', 'svg', 'canvas', 'video', 'audio', 'object']);

  const walkFrame = (frame, place, found) => {
    const inner = frame.contentDocument; // null for a frame of another origin
    if (!inner || !inner.documentElement) return;
    const origin = frameOrigin(frame);
    const x = place.x + origin.x;
    const y = place.y + origin.y;
    const own = { left: x, top: y, right: x + frame.clientWidth, bottom: y + frame.clientHeight };
    const clip = intersect(own, place.clip);
    if (clip) walk(inner.documentElement, { x, y, clip }, found);
  };

  const walkChildren = (node, place, found) => {
    for (const child of node.childNodes) {
      if (child.nodeType === Node.ELEMENT_NODE) walk(child, place, found);
      else if (child.nodeType === Node.TEXT_NODE && found.lines) addText(child, place, found.lines);
    }
  };

  const MAX_DEPTH = 1000; // a script can nest deeper than our stack reaches

  const walk = (element, place, found) => {
    if (found.depth >= MAX_DEPTH) return;
    found.depth += 1;
    walkElement(element, place, found);
    found.depth -= 1;
  };

  const walkElement = (element, place, found) => {
    const name = element.localName;
    if (name === 'svg' && found.elements && roleOf(element)) describe(element, place, getComputedStyle(element), found);
    if (SKIPPED.has(name)) return;
    const style = getComputedStyle(element);
    if (style.display === 'none') return;
    if (found.elements) describe(element, place, style, found);
    const isInline = style.display.startsWith('inline') || style.display === 'contents';
    if (found.lines && (!isInline || name === 'br')) found.lines.flush();
    if (name === 'iframe' || name === 'frame') walkFrame(element, place, found);
    else if (name === 'input' || name === 'textarea' || (name === 'select' && roleOf(element) === 'combobox')) {
      if (found.lines) addControl(element, place, found.lines);
    } else if (name === 'slot' && element.assignedNodes().length) {
      for (const child of element.assignedNodes())
        if (child.nodeType === Node.ELEMENT_NODE) walk(child, place, found);
        else if (child.nodeType === Node.TEXT_NODE && found.lines) addText(child, place, found.lines);
    } else {
      const root = rootOf(element);
      if (root) webgym.watch(root);
      walkChildren(root || element, place, found);
    }
    if (found.lines && !isInline) found.lines.flush();
  };

  // {text, elements, marks}: what is wanted; marks are drawn over the elements until `unmark`.
  webgym.observe = ({ text, elements, marks: isMarked }) => {
    webgym.attach();
    const page = document.scrollingElement || document.documentElement;
    const look = {
      title: document.title,
      scroll: [scrollY, page ? page.scrollHeight : innerHeight],
      viewport: [innerWidth, innerHeight],
    };
    if (!text && !elements) return look;
    const clip = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    const found = { elements: elements ? [] : null, lines: text ? new Lines() : null, depth: 0 };
    if (document.documentElement) walk(document.documentElement, { x: 0, y: 0, clip }, found);
    if (found.lines) found.lines.flush();
    if (isMarked && document.documentElement) webgym.mark(found.elements);
    return {
      ...look,
      ...(found.lines ? { text: found.lines.lines.join('\n') } : {}),
      ...(found.elements ? { elements: found.elements } : {}),
    };
  };

  // --- marks --------------------------------------------------------------------------------------

  const COLOURS = ['#c62828', '#1565c0', '#2e7d32', '#6a1b9a', '#ad1457', '#00695c', '#4527a0', '#bf360c'];
  const BORDER = 2; // around the element, so that nothing of it is hidden
  const MARK_STYLE = `
    :host { all: initial; }
    .box { position: fixed; box-sizing: border-box; border: ${BORDER}px solid; border-radius: 3px; }
    .label { position: fixed; font: 700 12px/15px ui-sans-serif, system-ui, Arial, sans-serif; color: #fff;
      padding: 0 3px; border-radius: 2px; white-space: nowrap; box-shadow: 0 0 0 1px #fff; }`;
  const LABEL_HEIGHT = 15;
  let marks = null;

  const common = (a, b) =>
    Math.max(0, Math.min(a.right, b.right) - Math.max(a.left, b.left)) *
    Math.max(0, Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top));

  // Above the box where there is room, else at one of its corners: where it hides least of the other
  // elements, and no other label.
  const labelPlace = (box, width, labels, boxes) => {
    const [x, y, w, h] = box;
    const spots = [[x, y - LABEL_HEIGHT], [x + w - width, y - LABEL_HEIGHT], [x + w, y], [x - width, y],
      [x + w - width, y], [x, y], [x + w - width, y + h - LABEL_HEIGHT], [x, y + h]];
    let best = null;
    for (const [left, top] of spots) {
      const l = Math.max(0, Math.min(left, innerWidth - width));
      const t = Math.max(0, Math.min(top, innerHeight - LABEL_HEIGHT));
      const rect = { left: l, top: t, right: l + width, bottom: t + LABEL_HEIGHT };
      let cost = 0;
      for (const label of labels) cost += 10 * common(rect, label);
      for (const other of boxes) cost += common(rect, other);
      if (!best || cost < best.cost) best = { rect, cost };
      if (!cost) break;
    }
    labels.push(best.rect);
    return best.rect;
  };

  webgym.mark = (elements) => {
    webgym.unmark();
    const parent = document.querySelector('dialog[open]') || document.documentElement;
    const { host, root } = webgym.overlay(parent, MARK_STYLE);
    const labels = [];
    const boxes = elements.map(({ box: [x, y, w, h] }) => ({ left: x, top: y, right: x + w, bottom: y + h }));
    for (const { number, box } of elements) {
      const colour = COLOURS[number % COLOURS.length];
      const frame = webgym.make(document, 'div');
      frame.className = 'box';
      const [x, y, w, h] = [box[0] - BORDER, box[1] - BORDER, box[2] + 2 * BORDER, box[3] + 2 * BORDER];
      const [left, top] = [Math.max(0, x), Math.max(0, y)];
      const [right, bottom] = [Math.min(innerWidth, x + w), Math.min(innerHeight, y + h)];
      frame.style.cssText =
        `left:${left}px;top:${top}px;width:${right - left}px;height:${bottom - top}px;border-color:${colour}`;
      const label = webgym.make(document, 'div');
      label.className = 'label';
      label.textContent = number;
      const width = 6 + 7 * String(number).length;
      const place = labelPlace(box, width, labels, boxes);
      label.style.cssText = `left:${place.left}px;top:${place.top}px;background:${colour}`;
      root.append(frame, label);
    }
    marks = host;
  };

  webgym.unmark = () => {
    if (marks) marks.remove();
    marks = null;
  };
})();
