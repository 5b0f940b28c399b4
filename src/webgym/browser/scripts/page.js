// Runs once per document of the main frame, in an isolated world: the page cannot see it, and it
// reaches into all frames of the page's own origin. What it keeps: when the page last changed, in-page
// lists for <select>, and how to fill a field.
(() => {
  if (globalThis.webgym) return;
  const state = { changedAt: 0, changes: 0, ours: new WeakSet(), roots: new WeakMap(), list: null };
  const webgym = (globalThis.webgym = { state });

  const fold = (text) => (text || '').replace(/\s+/g, ' ').trim();
  webgym.fold = fold;
  // An HTML element, in XML documents too.
  webgym.make = (owner, name) => owner.createElementNS('http://www.w3.org/1999/xhtml', name);
  // The shadow root below an element, our own closed ones included.
  webgym.rootOf = (element) => element.shadowRoot || state.roots.get(element) || null;

  // The windows that we may look into: the main frame's and those of its origin below it.
  const views = (view = window, found = []) => {
    found.push(view);
    for (let i = 0; i < view.length; i++) {
      try {
        if (view[i].document) views(view[i], found);
      } catch (error) {
        if (error.name !== 'SecurityError') throw error; // a frame of another origin
      }
    }
    return found;
  };

  // --- what changes -----------------------------------------------------------------------------

  const changed = () => {
    state.changedAt = Date.now();
    state.changes += 1;
  };
  const isOurs = (record) =>
    record.type === 'childList' &&
    [...record.addedNodes, ...record.removedNodes].every((node) => state.ours.has(node));
  const observer = new MutationObserver((records) => {
    if (!records.every(isOurs)) changed();
  });
  webgym.watch = (root) =>
    observer.observe(root, { subtree: true, childList: true, attributes: true, characterData: true });

  const listeners = []; // [event, handler, options]: in every window
  for (const name of ['scroll', 'input', 'resize', 'transitionend', 'animationend'])
    listeners.push([name, changed, { capture: true, passive: true }]);

  // Listen in every window. What is there already is not added twice.
  webgym.attach = () => {
    for (const view of views()) {
      webgym.watch(view.document);
      for (const [name, handler, options] of listeners) view.addEventListener(name, handler, options);
      hold(view);
    }
  };

  const isMoving = () =>
    document.getAnimations().some((animation) => {
      const end = animation.effect && animation.effect.getComputedTiming().endTime;
      return animation.playState === 'running' && Number.isFinite(end);
    });

  const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));
  const frame = () =>
    Promise.race([new Promise((resolve) => requestAnimationFrame(() => resolve())), pause(50)]);

  // Resolves once the page showed no change for a while: {reason, changes}. `since` is the number of
  // changes before the action; a page that has not changed since gets the shorter `reaction` time.
  webgym.quiet = async (since, reaction, quiet, limit) => {
    const start = Date.now();
    webgym.attach();
    await frame();
    for (;;) {
      const isSame = state.changes === since;
      const now = Date.now();
      const left = isSame ? start + reaction - now : Math.max(start, state.changedAt) + quiet - now;
      if (left <= 0 && !isMoving()) return { reason: isSame ? 'unchanged' : 'quiet', changes: state.changes };
      if (now - start >= limit) return { reason: 'busy', changes: state.changes };
      await pause(Math.max(1, Math.min(left > 0 ? left : 16, start + limit - now)));
      webgym.attach();
    }
  };

  // --- the same picture for the same page ---------------------------------------------------------

  const sheets = new WeakMap();
  const hold = (view) => {
    if (!sheets.has(view.document)) {
      const sheet = new view.CSSStyleSheet();
      sheet.replaceSync('*, *::before, *::after { caret-color: transparent !important; }');
      sheets.set(view.document, sheet);
    }
    const sheet = sheets.get(view.document);
    if (!view.document.adoptedStyleSheets.includes(sheet)) view.document.adoptedStyleSheets.push(sheet);
  };

  // --- native pop-ups that no screenshot shows ----------------------------------------------------

  const LIST_STYLE = `
    :host { all: initial; }
    .list { position: fixed; box-sizing: border-box; overflow-y: auto; background: #fff; color: #111;
      border: 1px solid #767676; border-radius: 4px; box-shadow: 0 4px 14px rgba(0,0,0,.3);
      font: 14px/20px system-ui, sans-serif; padding: 2px 0; }
    .group { padding: 3px 10px; font-weight: 600; }
    .option { padding: 3px 10px; min-height: 20px; white-space: nowrap; overflow: hidden;
      text-overflow: ellipsis; cursor: default; }
    .group ~ .option.inner { padding-left: 22px; }
    .option:hover { background: #e8f0fe; }
    .option[aria-selected=true] { background: #1a66d9; color: #fff; }
    .option[aria-disabled=true] { color: #999; }`;

  const isPopupSelect = (element) =>
    element && element.localName === 'select' && !element.multiple && element.size <= 1;

  const closeList = () => {
    if (!state.list) return;
    state.list.host.remove();
    state.list = null;
  };

  const pick = (select, option) => {
    const differs = !option.selected;
    option.selected = true;
    if (differs) {
      select.dispatchEvent(new Event('input', { bubbles: true, composed: true }));
      select.dispatchEvent(new Event('change', { bubbles: true }));
    }
  };

  const row = (select, option) => {
    const element = webgym.make(select.ownerDocument, 'div');
    const off = option.disabled || (option.parentElement.localName === 'optgroup' && option.parentElement.disabled);
    element.className = option.parentElement.localName === 'optgroup' ? 'option inner' : 'option';
    element.setAttribute('role', 'option');
    element.setAttribute('aria-selected', String(option.selected));
    if (off) element.setAttribute('aria-disabled', 'true');
    element.textContent = option.label || '\u00a0';
    element.addEventListener('mousedown', (event) => event.preventDefault());
    element.addEventListener('click', () => {
      if (off) return;
      closeList();
      pick(select, option);
    });
    return element;
  };

  const fillList = (select, list) => {
    let group = null;
    for (const option of select.options) {
      if (option.hidden || getComputedStyle(option).display === 'none') continue;
      const parent = option.parentElement;
      if (parent.localName === 'optgroup' && parent !== group) {
        group = parent;
        const title = webgym.make(select.ownerDocument, 'div');
        title.className = 'group';
        title.textContent = parent.label;
        list.append(title);
      }
      list.append(row(select, option));
    }
  };

  const placeList = (select, list) => {
    const box = select.getBoundingClientRect();
    const { innerWidth, innerHeight } = select.ownerDocument.defaultView;
    const margin = 4;
    const below = innerHeight - box.bottom - margin;
    const above = box.top - margin;
    const wanted = list.scrollHeight + 4;
    const isBelow = wanted <= below || below >= above;
    const whole = wanted > Math.max(below, above);
    const height = Math.min(wanted, whole ? innerHeight - 2 * margin : isBelow ? below : above);
    list.style.maxHeight = `${height}px`;
    list.style.minWidth = `${box.width}px`;
    list.style.maxWidth = `${innerWidth - 2 * margin}px`;
    const top = whole ? margin : isBelow ? box.bottom : box.top - height;
    list.style.top = `${Math.max(margin, top)}px`;
    list.style.left = `${Math.max(margin, Math.min(box.left, innerWidth - margin - list.offsetWidth))}px`;
  };

  // Everything of ours lies in the top layer, above modal dialogs, and in a root that the page cannot enter.
  webgym.overlay = (parent, style) => {
    const host = webgym.make(parent.ownerDocument, 'div');
    host.setAttribute('popover', 'manual');
    host.style.cssText =
      'all: initial; position: fixed; inset: 0; width: auto; height: auto; margin: 0; padding: 0;' +
      'border: 0; background: none; overflow: visible; display: block; pointer-events: none;';
    const root = host.attachShadow({ mode: 'closed' });
    const sheet = new parent.ownerDocument.defaultView.CSSStyleSheet();
    sheet.replaceSync(style);
    root.adoptedStyleSheets = [sheet];
    state.ours.add(host);
    state.roots.set(host, root);
    parent.append(host);
    host.showPopover();
    return { host, root };
  };

  const openList = (select) => {
    const parent = select.closest('dialog[open]') || select.ownerDocument.body;
    const { host, root } = webgym.overlay(parent, LIST_STYLE);
    const list = webgym.make(select.ownerDocument, 'div');
    list.className = 'list';
    list.style.pointerEvents = 'auto';
    list.setAttribute('role', 'listbox');
    fillList(select, list);
    root.append(list);
    placeList(select, list);
    const chosen = root.querySelector('[aria-selected=true]');
    if (chosen) chosen.scrollIntoView({ block: 'nearest' });
    state.list = { host, list, select };
    changed();
  };

  const eventTarget = (event) => event.composedPath()[0];

  const onMouseDown = (event) => {
    const target = eventTarget(event);
    const open = state.list;
    if (open && event.composedPath().includes(open.host)) return;
    closeList();
    const select = target.localName === 'option' ? target.closest('select') : target;
    if (!isPopupSelect(select)) return;
    event.preventDefault(); // no native list
    if (select.disabled) return;
    select.focus({ preventScroll: true });
    if (!open || open.select !== select) openList(select);
  };

  // The native pickers of these fields are in no picture either; their values are typed.
  const PICKERS = ['date', 'time', 'month', 'week', 'datetime-local', 'color'];
  const onClick = (event) => {
    const target = eventTarget(event);
    if (target.localName === 'input' && PICKERS.includes(target.type)) event.preventDefault();
  };

  // A form that wants a new window keeps its method and body if it is sent in this one.
  const onSubmit = (event) => {
    const form = event.target;
    const target = (event.submitter && event.submitter.getAttribute('formtarget')) || form.target;
    if (!target || (target.startsWith('_') ? target !== '_blank' : target in form.ownerDocument.defaultView)) return;
    form.target = '_self';
    if (event.submitter) event.submitter.removeAttribute('formtarget');
  };

  listeners.push(
    ['mousedown', onMouseDown, true],
    ['click', onClick, true],
    ['submit', onSubmit, true],
    ['scroll', (event) => event.target.nodeType === Node.DOCUMENT_NODE && closeList(), true],
    ['resize', closeList, false],
    ['keydown', (event) => event.key === 'Escape' && closeList(), true],
  );

  const frameOf = (element) => element.ownerDocument.defaultView.frameElement;

  // Where the wheel turns: over an open list, else the middle of the viewport.
  webgym.scrollPoint = () => {
    if (!state.list) return { point: null };
    const box = state.list.list.getBoundingClientRect();
    let [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
    for (let frame = frameOf(state.list.host); frame; frame = frameOf(frame)) {
      const { left, top } = frame.getBoundingClientRect();
      [x, y] = [x + left + frame.clientLeft, y + top + frame.clientTop];
    }
    return { point: [x, y] };
  };

  // --- typing -------------------------------------------------------------------------------------

  // What has the focus, through shadow roots and frames.
  const focused = () => {
    let element = document.activeElement;
    for (;;) {
      if (!element) return null;
      const inner = webgym.rootOf(element) || (element.localName === 'iframe' && element.contentDocument);
      if (!inner || !inner.activeElement) return element;
      element = inner.activeElement;
    }
  };

  const VALUE_TYPES = ['date', 'time', 'month', 'week', 'datetime-local', 'color', 'range'];
  const NO_TEXT = ['button', 'submit', 'reset', 'image', 'checkbox', 'radio', 'file', 'hidden'];
  const SHAPES = {
    date: 'YYYY-MM-DD', time: 'HH:MM', month: 'YYYY-MM', week: 'YYYY-Www',
    'datetime-local': 'YYYY-MM-DDTHH:MM', color: '#rrggbb', range: 'a number',
  };

  const pad = (number, width = 2) => String(number).padStart(width, '0');
  const asValue = (type, text) => {
    const plain = text.trim();
    if (type === 'datetime-local') return plain.replace(/\s+/, 'T');
    if (type === 'time') {
      const match = plain.match(/^(\d{1,2}):(\d{2})(:\d{2})?\s*([ap])?\.?m?\.?$/i);
      if (!match) return plain;
      const half = (match[4] || '').toLowerCase();
      const hour = half ? (Number(match[1]) % 12) + (half === 'p' ? 12 : 0) : Number(match[1]);
      return `${pad(hour)}:${match[2]}`;
    }
    if ((type !== 'date' && type !== 'month') || /^\d{4}-\d{2}(-\d{2})?$/.test(plain)) return plain;
    const day = new Date(plain);
    if (Number.isNaN(day.getTime())) return plain;
    const month = `${pad(day.getFullYear(), 4)}-${pad(day.getMonth() + 1)}`;
    return type === 'month' ? month : `${month}-${pad(day.getDate())}`;
  };

  const setValue = (input, text) => {
    const before = input.value;
    input.value = asValue(input.type, text);
    if (text.trim() && !input.value) {
      input.value = before;
      return { kind: 'refused', why: `a ${input.type} field does not take "${text}"; write ${SHAPES[input.type]}` };
    }
    input.dispatchEvent(new Event('input', { bubbles: true, composed: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
    return { kind: 'set' };
  };

  const choose = (select, text) => {
    closeList();
    const options = [...select.options].filter((option) => !option.disabled);
    const wanted = fold(text).toLowerCase();
    const label = (option) => fold(option.label).toLowerCase();
    const found =
      options.find((option) => label(option) === wanted) ||
      options.find((option) => option.value.toLowerCase() === wanted) ||
      (wanted && options.find((option) => label(option).startsWith(wanted))) ||
      (wanted && options.find((option) => label(option).includes(wanted)));
    if (!found) {
      const names = options.slice(0, 12).map((option) => `"${fold(option.label)}"`).join(', ');
      return { kind: 'refused', why: `the dropdown has no option "${text}"; it has ${names}` };
    }
    pick(select, found);
    return { kind: 'chosen' };
  };

  const selectAll = (element) => {
    if (element.isContentEditable) {
      const range = element.ownerDocument.createRange();
      range.selectNodeContents(element);
      const selection = element.ownerDocument.getSelection();
      selection.removeAllRanges();
      selection.addRange(range);
      return element.textContent !== '';
    }
    element.select();
    return element.value !== '';
  };

  // Readies the focused field for `text`. {kind}: "text" (its content is selected; `filled` says whether
  // there is any), "set" and "chosen" (done here), "refused" (why), "none" (no field has the focus).
  webgym.prepareTyping = (text) => {
    const element = focused();
    if (!element) return { kind: 'none' };
    if (element.disabled || element.readOnly) return { kind: 'refused', why: 'the field cannot be changed' };
    if (element.localName === 'select') return choose(element, text);
    if (element.localName === 'input' && element.type === 'file')
      return { kind: 'refused', why: 'files cannot be uploaded' };
    if (element.localName === 'input' && VALUE_TYPES.includes(element.type)) return setValue(element, text);
    const isField =
      element.isContentEditable ||
      element.localName === 'textarea' ||
      (element.localName === 'input' && !NO_TEXT.includes(element.type));
    return isField ? { kind: 'text', filled: selectAll(element) } : { kind: 'none' };
  };
})();
