// Native pop-ups that no screenshot shows are drawn in the page instead: the list of a <select>, the suggestions of a
// <datalist>, and a field to type in for the pickers of dates and colours that a script opens.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.closeList) return;
  const {
    parentElement, localName, matches, closest, getBoundingClientRect, body, typeOf, make, querySelectorAll,
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
    .option[aria-disabled=true] { color: #999; }
    .beside { color: #666; margin-left: 16px; }
    .option[aria-selected=true] .beside { color: inherit; }
    label { display: block; padding: 6px 10px; }
    input { font: inherit; margin-left: 8px; }`;

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

  // Of a suggestion, which is taken for what it is, also what is written beside it.
  const row = (option, isSuggestion) => {
    const element = make(document, 'div');
    element.className = localName(parentElement(option)) === 'optgroup' ? 'option inner' : 'option';
    element.setAttribute('role', 'option');
    element.setAttribute('aria-selected', String(!isSuggestion && option.selected));
    if (!webgym.isOffered(option)) element.setAttribute('aria-disabled', 'true');
    element.textContent = webgym.shorten(isSuggestion ? option.value : option.label, 'name') || '\u00a0';
    if (isSuggestion && option.label !== option.value) {
      element.append(' ');
      const beside = element.appendChild(make(document, 'span'));
      beside.className = 'beside';
      beside.textContent = webgym.shorten(option.label, 'name');
    }
    return element;
  };

  const addTitle = (list, text) => {
    const title = make(document, 'div');
    title.className = 'group';
    title.textContent = text.slice(0, webgym.limits.name);
    list.append(title);
  };

  // What a field suggests for what stands in it, as Chromium has it: that is a part of the value or of the label.
  const suggestionsOf = (field) => {
    const typed = field.value.toLowerCase();
    const fits = ({ value, label }) => value && [value, label].some((text) => text.toLowerCase().includes(typed));
    return [...field.list.options].filter((option) => webgym.isOffered(option) && fits(option));
  };
  const optionsOf = (select) =>
    [...select.options].filter((option) => !option.hidden && getComputedStyle(option).display !== 'none');

  // {rows, isCut}: the option of each row. A list that is cut says so at its end.
  const fillList = (field, list) => {
    const rows = new Map();
    const isSuggestion = localName(field) === 'input';
    let group = null;
    for (const option of isSuggestion ? suggestionsOf(field) : optionsOf(field)) {
      if (rows.size >= webgym.limits.options) {
        addTitle(list, '…');
        return { rows, isCut: true };
      }
      const parent = parentElement(option);
      if (localName(parent) === 'optgroup' && parent !== group) {
        group = parent;
        addTitle(list, parent.label);
      }
      const element = row(option, isSuggestion);
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

  // A list below a field, for which `fill` gives {rows, isCut}; none if it has no rows.
  const openList = (field, fill = fillList) => {
    webgym.closeList();
    const { element, map } = standing(field); // drawn here: a small frame has no room for it
    const box = moved(getBoundingClientRect(field), map);
    let parent = element; // what lies outside of a modal dialog takes no clicks
    while (parent && !matches(parent, 'dialog[open]')) parent = parentOf(parent);
    const { host, root } = webgym.overlay(parent || body(document), LIST_STYLE);
    const list = make(document, 'div');
    list.className = 'list';
    const { rows, isCut } = fill(field, list);
    if (rows) list.setAttribute('role', 'listbox');
    root.append(list);
    placeList(box, list);
    const chosen = root.querySelector('[aria-selected=true]');
    if (chosen) chosen.scrollIntoView({ block: 'nearest' });
    state.list = { host, root, list, rows, field, isCut };
    changed();
  };

  // --- suggestions ----------------------------------------------------------------------------------

  const hasSuggestions = (field) =>
    localName(field) === 'input' && Boolean(field.list) && !PICKERS.includes(field.type) &&
    !matches(field, ':disabled, :read-only') && suggestionsOf(field).length > 0;
  const suggest = (field) => {
    if (matches(field, ':focus') && hasSuggestions(field)) openList(field);
    else if (state.list && state.list.field === field) webgym.closeList();
  };
  let isSuggesting = false; // when all keys of a text have come
  const onTyped = (event) => {
    const field = eventTarget(event);
    if (isSuggesting || !event.isTrusted || !field || localName(field) !== 'input' || !field.list) return;
    isSuggesting = true;
    scheduler.postTask(() => {
      isSuggesting = false;
      suggest(field);
    });
  };

  // --- pickers --------------------------------------------------------------------------------------

  // The native pickers of these fields are in no picture either; their values are typed.
  const PICKERS = ['date', 'time', 'month', 'week', 'datetime-local', 'color'];
  const fillPicker = (field, list) => {
    const label = list.appendChild(make(document, 'label'));
    label.textContent = webgym.nameOf(field) || field.type;
    const input = label.appendChild(make(document, 'input'));
    input.type = field.type;
    input.value = field.value;
    return { rows: null, isCut: false };
  };
  const onPicked = ({ list, field }) => {
    const { value } = list.querySelector('input');
    webgym.closeList();
    if (value === field.value) return;
    field.value = value;
    webgym.tellChoice(field);
  };

  // What a script opened, by `showPicker`, or a key.
  const drawOpened = () => {
    for (const root of [...webgym.views().map(({ document }) => document), ...webgym.shadows()])
      for (const field of querySelectorAll(root, 'select:open, input:open')) {
        const isList = isPopupSelect(field);
        if (!isList && !PICKERS.includes(field.type)) continue;
        field.blur(); // closes it
        openList(field, isList ? fillList : fillPicker);
      }
  };
  const OPENING = new Set([' ', 'Enter', 'ArrowDown', 'ArrowUp', 'F4']);
  const onMayOpen = (event) => {
    if (event.type === 'click' || OPENING.has(event.key)) scheduler.postTask(drawOpened);
  };

  // --- events ---------------------------------------------------------------------------------------

  const isInList = (event) => Boolean(state.list) && event.composedPath().includes(state.list.host);

  // The page hears nothing of what happens in a list: it might take it for a click beside its own menu.
  const onListEvent = (event) => {
    if (!isInList(event)) return;
    event.stopImmediatePropagation();
    const { root, rows, field } = state.list;
    if (!rows) {
      if (event.type === 'input') onPicked(state.list);
      return;
    }
    if (event.type === 'mousedown') event.preventDefault(); // the focus stays
    if (event.type !== 'click') return;
    const element = root.elementFromPoint(event.clientX, event.clientY);
    const option = rows.get(element && closest(element, '.option'));
    if (!option || !webgym.isOffered(option)) return;
    webgym.closeList();
    if (localName(field) === 'select') webgym.pick(field, option);
    else {
      field.value = option.value;
      webgym.tellChoice(field);
    }
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
    const isAnother = !open || open.field !== select;
    if (!select || !isPopupSelect(select)) {
      if (isAnother && hasSuggestions(target)) scheduler.postTask(() => suggest(target)); // it has the focus then
      return;
    }
    event.preventDefault(); // no native list
    if (matches(select, ':disabled')) return;
    select.focus({ preventScroll: true });
    if (isAnother) openList(select);
  };

  const onClick = (event) => {
    const target = eventTarget(event);
    if (target && localName(target) === 'input' && PICKERS.includes(target.type)) event.preventDefault();
  };

  const SHIELDED = ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click', 'dblclick', 'input'];
  const ON_CONTENT = [['mousedown', onMouseDown, true], ['click', onClick, true], ['input', onTyped, true]];
  const CLOSING = new Set(['Escape', 'Enter', 'Tab']);
  webgym.listen(
    ...SHIELDED.map((name) => [name, onListEvent, true]),
    ...ON_CONTENT,
    ['scroll', (event) => typeOf(event.target) === Node.DOCUMENT_NODE && webgym.closeList(), true],
    ['resize', webgym.closeList, false],
    ['keydown', (event) => CLOSING.has(event.key) && webgym.closeList(), true],
    ['blur', (event) => state.list && event.target === state.list.field && webgym.closeList(), true],
    ['click', onMayOpen, true], ['keydown', onMayOpen, true],
  );

  // A closed root tells what was clicked in it only to those who listen inside.
  webgym.listenIn = (root) => {
    for (const [name, handler, options] of ON_CONTENT) root.addEventListener(name, handler, options);
  };
})();
