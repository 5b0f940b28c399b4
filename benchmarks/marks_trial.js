// In the page of the second browser: what it is made of, and what changed. NOISE and LARGE are put in.
(() => {
  const CONTROLS = 'a[href],area[href],button,input,select,textarea,summary,option,[contenteditable=true]';
  const ROLES = new Set(('button link checkbox radio switch tab option menuitem menuitemcheckbox menuitemradio ' +
    'combobox textbox searchbox slider spinbutton treeitem gridcell').split(' '));
  const hold = window.__trial = {};
  const inside = (root, visit, path) => {
    let index = 0;
    for (const node of root.childNodes) {
      const own = `${path}/${index++}`;
      visit(node, own);
      inside(node, visit, own);
      if (node.shadowRoot) inside(node.shadowRoot, visit, own + '#');
      if (node.localName === 'iframe' && node.contentDocument) inside(node.contentDocument, visit, own + '@');
    }
  };
  const isLarge = (node) => {
    const { width, height } = node.getBoundingClientRect();
    return width * height > LARGE * innerWidth * innerHeight;
  };
  const facts = (node) => {
    if (node.nodeType === 3) return { text: node.data };
    if (node.nodeType !== 1) return {};
    const found = {};
    if (isLarge(node)) return {};
    const { width, height } = node.getBoundingClientRect();
    if (width && height) for (const { name, value } of node.attributes) if (name !== 'tabindex') found[name] = value;
    if (found.class) found.class = found.class.split(/\s+/).filter((word) => !/focus/i.test(word)).join(' ');
    if ('value' in node) found['.value'] = String(node.value);
    if ('checked' in node) found['.checked'] = String(node.checked);
    if (node.localName === 'details' || node.localName === 'dialog') found['.open'] = String(node.open);
    if (node.localName === 'canvas') found['.picture'] = node.toDataURL();
    if (node.scrollTop || node.scrollLeft) found['.scroll'] = `${node.scrollLeft} ${node.scrollTop}`;
    return found;
  };
  const deepest = () => {
    let active = document.activeElement;
    while (active && active.shadowRoot && active.shadowRoot.activeElement) active = active.shadowRoot.activeElement;
    return active;
  };
  const isControl = (node) => node && node.matches(CONTROLS + ',[contenteditable=""]') ||
    node && ROLES.has(node.getAttribute('role'));
  const said = ({ text }) => (text && text.length < 40 ? `=${text}` : '');
  let taken = new Map();
  const noise = new Set(NOISE);
  let hash = '';
  let isFileAsked = false;
  addEventListener('click', (event) => { isFileAsked ||= event.composedPath()[0].type === 'file'; }, true);
  hold.take = () => {
    isFileAsked = false;
    taken = new Map();
    hash = location.hash;
    inside(document, (node, path) => taken.set(node, [path, facts(node), node.parentNode, [...node.childNodes]]), '');
  };
  // What was in it before and still is, as it was and as it is now.
  const isReordered = (node, children) => {
    const before = children.filter((child) => child.parentNode === node);
    const now = [...node.childNodes].filter((child) => taken.has(child) && taken.get(child)[2] === node);
    return before.some((child, index) => child !== now[index]);
  };
  hold.changes = () => {
    const changes = new Set();
    const seen = new Set();
    inside(document, (node, path) => {
      seen.add(node);
      const before = taken.get(node);
      const now = facts(node);
      if (!before) return changes.add(`${path} new${said(now)}`);
      for (const name of new Set([...Object.keys(before[1]), ...Object.keys(now)]))
        if (name !== 'tabindex' && before[1][name] !== now[name]) changes.add(`${before[0]} ${name}${said(now)}`);
      if (before[2] !== node.parentNode) changes.add(`${before[0]} moved`);
      if (isReordered(node, before[3])) changes.add(`${before[0]} order`);
    }, '');
    if (isFileAsked) changes.add('/ file');
    if (location.hash !== hash) changes.add(`/ hash=${location.hash}`);
    for (const [node, [path]] of taken) if (!seen.has(node)) changes.add(`${path} gone`);
    return [...changes].filter((change) => !noise.has(change.split('=')[0])).sort();
  };
  const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
  hold.drawn = () => Promise.race([frame().then(frame), new Promise((resolve) => setTimeout(resolve, 500))]);
  hold.focused = () => {
    const active = deepest();
    const path = active && taken.get(active);
    return isControl(active) ? `${path ? path[0] : 'new'} focus` : '';
  };
  // The field that existed before and has the focus: where in it one clicks makes no difference, unless that
  // changed its value, as buttons beside it do.
  hold.field = () => {
    const active = deepest();
    const isField = active && (active.isContentEditable || active.localName === 'textarea' ||
      (active.localName === 'input' && active.selectionStart !== null && !active.readOnly));
    if (!isField || !taken.has(active)) return '';
    const [path, before] = taken.get(active);
    return active.localName === 'input' && active.value !== before['.value'] ? '' : `${path} field`;
  };
  hold.at = (x, y) => {
    let root = document;
    for (;;) {
      const found = root.elementFromPoint(x, y);
      const inner = found && found.shadowRoot;
      if (!inner || inner === root || !inner.elementFromPoint(x, y) || inner.elementFromPoint(x, y) === found)
        return found;
      root = inner;
    }
  };
  hold.isInFocus = (x, y) => contains(deepest(), hold.at(x, y));
  // Neither a whole container, nor the label of a control that is seen itself.
  const isTried = (element) => {
    if (above(element).some((node) => node.matches?.('[aria-disabled=true],[disabled]'))) return false;
    if (!element.matches('input,select') && !element.checkVisibility({ opacityProperty: true })) return false;
    if (isLarge(element) && !element.closest(CONTROLS)) return false;
    const label = element.closest('label') || (element.assignedSlot && element.assignedSlot.closest('label'));
    if (!label || label.contains(label.control)) return true;
    return Boolean(label.control) && (label.control.getBoundingClientRect().width < 3 ||
      !label.control.checkVisibility({ opacityProperty: true }));
  };
  const contains = (outer, inner) => {
    for (let node = inner; node; node = node.assignedSlot || node.parentNode || node.host)
      if (node === outer) return true;
    return false;
  };
  const above = (node) => {
    const found = [];
    for (let at = node; at; at = at.parentNode || at.host) found.push(at);
    return found;
  };
  // Which of these points hit what is of one kind with what lies at (x, y), as items of one list are, the nearest
  // list first: [index, the path of the item at (x, y), how far that is from what lies there].
  hold.kin = (x, y, points) => {
    const own = above(hold.at(x, y));
    const found = points.flatMap(([px, py], index) => {
      const other = above(hold.at(px, py));
      const depth = own.findIndex((node) => other.includes(node)) - 1;
      const [item, like] = [own[depth], other[depth]];
      const isAlike = item && like && other[depth + 1] === own[depth + 1] && item.localName === like.localName;
      return isAlike && taken.has(item) ? [[index, taken.get(item)[0], depth]] : [];
    });
    return found.sort((a, b) => a[2] - b[2]);
  };
  // The path of what lies so many levels above what is hit at a point.
  hold.pathAbove = (x, y, depth) => {
    const found = taken.get(above(hold.at(x, y))[depth]);
    return found ? found[0] : '';
  };
  // Does what lies at a point reach around what lies at one of these?
  hold.isRim = (x, y, points) => {
    const outer = hold.at(x, y);
    return points.some(([px, py]) => hold.at(px, py) !== outer && contains(outer, hold.at(px, py)));
  };
  hold.points = (grid) => {
    const cells = new Map();
    for (let y = grid / 2; y < innerHeight; y += grid)
      for (let x = grid / 2; x < innerWidth; x += grid) {
        const element = hold.at(x, y);
        if (!element || element === document.body || element === document.documentElement) continue;
        if (!cells.has(element)) cells.set(element, []);
        cells.get(element).push([x, y]);
      }
    return [...cells].filter(([element]) => isTried(element)).map(([, points]) => points[points.length >> 1]);
  };
})()
