// Native pop-ups that no screenshot shows: the list of a <select> is drawn in the page instead, and pickers
// stay shut.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.closeList) return;
  const {
    parentElement, localName, matches, closest, getBoundingClientRect, body, typeOf, make,
  } = webgym.dom;
  const { state, changed } = webgym;
  const { parentOf, moved, standing } = webgym.geometry;

  const LIST_STYLE = `
    :host { all: initial; }
    .list { position: fixed; box-sizing: border-box; overflow-y: auto; background: #fff; color: #111;
      border: 1px solid #767676; border-radius: 4px; box-shadow: 0 4px 14px rgba(0,0,0,.3);
      font: 14px/20px system-ui, sans-serif; padding: 2px 0; pointer-events: auto; }
    .group { padding: 3px 10px; font-weight: 600; }
    .option { padding: 3px 10px; min-height: 20px; white-space: nowrap; overflow: hidden;
      text-overflow: ellipsis; cursor: default; }
    .group ~ .option.inner { padding-left: 22px; }
    .option:hover { background: #e8f0fe; }
    .option[aria-selected=true] { background: #1a66d9; color: #fff; }
    .option[aria-disabled=true] { color: #999; }`;

  // A list that only the system draws; `base-select` lists are part of the page.
  const isPopupSelect = (element) =>
    localName(element) === 'select' && !element.multiple && element.size <= 1 &&
    getComputedStyle(element).appearance !== 'base-select';

  webgym.closeList = () => {
    if (!state.list) return;
    state.list.host.remove();
    state.list = null;
  };

  webgym.isOffered = (option) => {
    const parent = parentElement(option);
    return !option.disabled && !(localName(parent) === 'optgroup' && parent.disabled);
  };

  webgym.tellChoice = (select) => {
    select.dispatchEvent(new Event('input', { bubbles: true, composed: true }));
    select.dispatchEvent(new Event('change', { bubbles: true }));
  };

  webgym.pick = (select, option) => {
    if (option.selected) return;
    option.selected = true;
    webgym.tellChoice(select);
  };

  const row = (option) => {
    const element = make(document, 'div');
    element.className = localName(parentElement(option)) === 'optgroup' ? 'option inner' : 'option';
    element.setAttribute('role', 'option');
    element.setAttribute('aria-selected', String(option.selected));
    if (!webgym.isOffered(option)) element.setAttribute('aria-disabled', 'true');
    element.textContent = webgym.shorten(option.label, 'name') || '\u00a0';
    return element;
  };

  const addTitle = (list, text) => {
    const title = make(document, 'div');
    title.className = 'group';
    title.textContent = text.slice(0, webgym.limits.name);
    list.append(title);
  };

  // {rows, isCut}: the option of each row. A list that is cut says so at its end.
  const fillList = (select, list) => {
    const rows = new Map();
    let group = null;
    for (const option of select.options) {
      if (option.hidden || getComputedStyle(option).display === 'none') continue;
      if (rows.size >= webgym.limits.options) {
        addTitle(list, '…');
        return { rows, isCut: true };
      }
      const parent = parentElement(option);
      if (localName(parent) === 'optgroup' && parent !== group) {
        group = parent;
        addTitle(list, parent.label);
      }
      const element = row(option);
      rows.set(element, option);
      list.append(element);
    }
    return { rows, isCut: false };
  };

  const placeList = (box, list) => {
    const margin = 4;
    const below = innerHeight - box.bottom - margin;
    const above = box.top - margin;
    const wanted = list.scrollHeight + 4;
    const isBelow = wanted <= below || below >= above;
    const whole = wanted > Math.max(below, above);
    const height = Math.min(wanted, whole ? innerHeight - 2 * margin : isBelow ? below : above);
    list.style.maxHeight = `${height}px`;
    list.style.minWidth = `${Math.min(box.right - box.left, innerWidth - 2 * margin)}px`;
    list.style.maxWidth = `${innerWidth - 2 * margin}px`;
    const top = whole ? margin : isBelow ? box.bottom : box.top - height;
    list.style.top = `${Math.max(margin, top)}px`;
    list.style.left = `${Math.max(margin, Math.min(box.left, innerWidth - margin - list.offsetWidth))}px`;
  };

  const openList = (select) => {
    const { element, map } = standing(select); // drawn here: a small frame has no room for it
    const box = moved(getBoundingClientRect(select), map);
    let parent = element; // what lies outside of a modal dialog takes no clicks
    while (parent && !matches(parent, 'dialog[open]')) parent = parentOf(parent);
    const { host, root } = webgym.overlay(parent || body(document), LIST_STYLE);
    const list = make(document, 'div');
    list.className = 'list';
    list.setAttribute('role', 'listbox');
    const { rows, isCut } = fillList(select, list);
    root.append(list);
    placeList(box, list);
    const chosen = root.querySelector('[aria-selected=true]');
    if (chosen) chosen.scrollIntoView({ block: 'nearest' });
    state.list = { host, root, list, rows, select, isCut };
    changed();
  };

  const isInList = (event) => Boolean(state.list) && event.composedPath().includes(state.list.host);

  // The page hears nothing of what happens in a list: it might take it for a click beside its own menu.
  const onListEvent = (event) => {
    if (!isInList(event)) return;
    event.stopImmediatePropagation();
    if (event.type === 'mousedown') event.preventDefault(); // the focus stays
    if (event.type !== 'click') return;
    const { root, rows, select } = state.list;
    const option = rows.get(root.elementFromPoint(event.clientX, event.clientY));
    if (!option || !webgym.isOffered(option)) return;
    webgym.closeList();
    webgym.pick(select, option);
  };

  // The element that an event is for; null for a document or a window.
  const eventTarget = (event) => {
    const [target] = event.composedPath();
    return typeOf(target) === Node.ELEMENT_NODE ? target : null;
  };

  const onMouseDown = (event) => {
    const target = eventTarget(event);
    if (!target || state.roots.has(target)) return; // a closed root, which listens for itself
    const { list: open } = state;
    webgym.closeList();
    const select = localName(target) === 'option' ? closest(target, 'select') : target;
    if (!select || !isPopupSelect(select)) return;
    event.preventDefault(); // no native list
    if (matches(select, ':disabled')) return;
    select.focus({ preventScroll: true });
    if (!open || open.select !== select) openList(select);
  };

  // The native pickers of these fields are in no picture either; their values are typed.
  const PICKERS = ['date', 'time', 'month', 'week', 'datetime-local', 'color'];
  const onClick = (event) => {
    const target = eventTarget(event);
    if (target && localName(target) === 'input' && PICKERS.includes(target.type)) event.preventDefault();
  };

  const SHIELDED = ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click', 'dblclick'];
  const ON_CONTENT = [['mousedown', onMouseDown, true], ['click', onClick, true]];
  webgym.listen(
    ...SHIELDED.map((name) => [name, onListEvent, true]),
    ...ON_CONTENT,
    ['scroll', (event) => typeOf(event.target) === Node.DOCUMENT_NODE && webgym.closeList(), true],
    ['resize', webgym.closeList, false],
    ['keydown', (event) => event.key === 'Escape' && webgym.closeList(), true],
  );

  // A closed root tells what was clicked in it only to those who listen inside.
  webgym.listenIn = (root) => {
    for (const [name, handler, options] of ON_CONTENT) root.addEventListener(name, handler, options);
  };
})();
