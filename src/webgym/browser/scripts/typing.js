// How a field is readied for text.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.prepareTyping) return;
  const {
    ownerDocument, textContent, localName, getAttribute, hasAttribute, matches, createRange, getSelection,
    isContentEditable, ofKind,
  } = webgym.dom;
  const { fold, isFrame, focused } = webgym;

  const VALUE_TYPES = ['date', 'time', 'month', 'week', 'datetime-local', 'color', 'range'];
  const NEVER_EMPTY = ['color', 'range'];
  const NO_TEXT = ['button', 'submit', 'reset', 'image', 'checkbox', 'radio', 'file', 'hidden'];
  const SHAPES = {
    date: 'YYYY-MM-DD', time: 'HH:MM', month: 'YYYY-MM', week: 'YYYY-Www',
    'datetime-local': 'YYYY-MM-DDTHH:MM', color: '#rrggbb', range: 'a number',
  };

  const pad = (number, width = 2) => String(number).padStart(width, '0');
  const isTime = (text) => /^\d{1,2}(:\d{2}){0,2}(\s*[ap]\.?m\.?)?$/i.test(text) && /[:m]/i.test(text);

  const asTime = (text) => {
    const match = text.match(/^(\d{1,2})(?::(\d{2}))?(:\d{2})?\s*(?:([ap])\.?m\.?)?$/i);
    if (!match || !isTime(text)) return text;
    const half = (match[4] || '').toLowerCase();
    const hour = half ? (Number(match[1]) % 12) + (half === 'p' ? 12 : 0) : Number(match[1]);
    return `${pad(hour)}:${match[2] || '00'}${match[3] || ''}`;
  };

  const pointOf = (text) => {
    const day = new Date(text);
    if (Number.isNaN(day.getTime())) return text;
    return `${pad(day.getFullYear(), 4)}-${pad(day.getMonth() + 1)}-${pad(day.getDate())}`;
  };
  // Has a text the three parts of a day? JavaScript takes any year for one that is missing.
  const isWhole = (text) => (text.match(/\d+/g) || []).length >= (/[a-z]{3}/i.test(text) ? 2 : 3);

  // Days in the ways that people write them; day before month where dots or the numbers say so.
  const asDay = (text) => {
    if (/^\d{4}-\d{2}-\d{2}$/.test(text)) return text;
    const match = text.match(/^(\d{1,2})([./-])(\d{1,2})\2(\d{4})$/);
    if (match && (match[2] === '.' || Number(match[1]) > 12)) return `${match[4]}-${pad(match[3])}-${pad(match[1])}`;
    return isWhole(text) ? pointOf(text) : text;
  };
  const asMonth = (text) => (/\d{4}/.test(text) ? pointOf(text).slice(0, 7) : text);

  const asMoment = (text) => {
    const match = text.match(/^(.+?)(?:T|,?\s+(?:at\s+)?)(\d{1,2}(?::\d{2}){0,2}(?:\s*[ap]\.?m\.?)?)$/i);
    return match && isTime(match[2]) ? `${asDay(match[1])}T${asTime(match[2])}` : text;
  };

  // Any CSS colour without transparency as #rrggbb; empty for what is none.
  const asColour = (text) => {
    const context = new OffscreenCanvas(1, 1).getContext('2d');
    const [one, other] = ['#000000', '#ffffff'].map((before) => {
      context.fillStyle = before; // stays where the text is no colour
      context.fillStyle = /^[\da-f]{3}([\da-f]{3})?$/i.test(text) ? `#${text}` : text;
      return context.fillStyle;
    });
    return one === other && one.startsWith('#') ? one : '';
  };

  const asValue = (type, text) => {
    const plain = text.trim();
    if (type === 'range') return String(webgym.numberIn(plain)).replace('NaN', '');
    if (type === 'color') return asColour(plain);
    if (type === 'time') return asTime(plain);
    if (type === 'date') return asDay(plain);
    if (type === 'datetime-local') return asMoment(plain);
    if (type === 'month' && !/^\d{4}-\d{2}$/.test(plain)) return asMonth(plain);
    return plain;
  };

  const setValue = (input, text) => {
    const [before, value] = [input.value, asValue(input.type, text)];
    const isEmptied = !text.trim() && !NEVER_EMPTY.includes(input.type);
    input.value = value;
    if (!isEmptied && !(value && input.value)) {
      input.value = before;
      return { kind: 'refused', why: `a ${input.type} field does not take "${text}"; write ${SHAPES[input.type]}` };
    }
    input.dispatchEvent(new Event('input', { bubbles: true, composed: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
    const isOff = input.type === 'range' && Number(input.value) !== Number(value);
    return { kind: 'set', why: isOff ? `the slider is at ${input.value} now, not at ${value}` : '' };
  };

  // --- dropdowns and lists ------------------------------------------------------------------------

  const find = (options, text) => {
    const wanted = fold(text).toLowerCase();
    const label = (option) => fold(option.label).toLowerCase();
    return (
      options.find((option) => label(option) === wanted) ||
      options.find((option) => option.value.toLowerCase() === wanted) ||
      (wanted && options.find((option) => label(option).startsWith(wanted))) ||
      (wanted && options.find((option) => label(option).includes(wanted)))
    );
  };

  const refuseChoice = (options, text) => {
    const nameOf = (option) => fold(option.label.slice(0, webgym.limits.name));
    const names = options.slice(0, 12).map((option) => `"${nameOf(option)}"`).join(', ');
    return { kind: 'refused', why: `the list has no option "${text}"; it has ${names}` };
  };

  // Several may be chosen: their names, one by one, between commas or on lines of their own.
  const chooseSeveral = (select, options, text) => {
    const whole = find(options, text);
    const wanted = whole ? [text] : text.split(/[,;\n]/).filter((part) => part.trim());
    const found = [];
    for (const part of wanted) {
      const option = find(options, part);
      if (!option) return refuseChoice(options, part.trim());
      found.push(option);
    }
    if (options.some((option) => option.selected !== found.includes(option))) {
      for (const option of options) option.selected = found.includes(option);
      webgym.tellChoice(select);
    }
    return { kind: 'chosen' };
  };

  const choose = (select, text) => {
    webgym.closeList();
    const options = [...select.options].filter(webgym.isOffered);
    if (select.multiple) return chooseSeveral(select, options, text);
    const found = find(options, text);
    if (!found) return refuseChoice(options, text);
    webgym.pick(select, found);
    return { kind: 'chosen' };
  };

  // --- text ---------------------------------------------------------------------------------------

  const selectAll = (element) => {
    if (isContentEditable(element)) {
      const range = createRange(ownerDocument(element));
      range.selectNodeContents(element);
      const selection = getSelection(ownerDocument(element));
      selection.removeAllRanges();
      selection.addRange(range);
      return textContent(element) !== '';
    }
    element.select();
    return element.value !== '';
  };

  // The Enter that ends the typing is a key press that a page may act on; the line break that the browser
  // itself would make of it in a field of several lines is no part of the text.
  let unbroken = null;
  const onBeforeInput = (event) => {
    if (event.composedPath()[0] !== unbroken && event.target !== unbroken) return;
    if (event.inputType === 'insertLineBreak' || event.inputType === 'insertParagraph') event.preventDefault();
  };
  const onKeyUp = (event) => {
    if (event.key === 'Enter') unbroken = null;
  };
  webgym.listen(['beforeinput', onBeforeInput, true], ['keyup', onKeyUp, true]);

  const UNCHANGEABLE = { kind: 'refused', why: 'the field cannot be changed' };

  // What takes keys although it is no field: a board, a terminal, a canvas.
  const PRESSED = new Set(['a', 'button', 'input', 'summary', 'video', 'audio', 'area', 'body', 'html']);
  const WIDGETS = /^(button|link|checkbox|radio|switch|tab|option|menuitem.*|treeitem)$/;
  const takesKeys = (element) =>
    !PRESSED.has(localName(element)) && !isFrame(element) && hasAttribute(element, 'tabindex') &&
    !WIDGETS.test(getAttribute(element, 'role') || '');

  // Why a text that was typed is not in its field; empty if it is, if the page made another text of it, or if the focus
  // went on from there, as in fields for one digit each.
  let typed = null; // {element, before}
  const plain = (text) => text.replace(/\s+/g, '');
  webgym.refusal = (text) => {
    if (!typed || !matches(typed.element, ':focus')) return '';
    const { element, before } = typed;
    const [is, was, wanted] = [element.value, before, text].map(plain);
    if (is === wanted || !(is === was || wanted.startsWith(is))) return '';
    const held = element.type === 'password' ? `${is.length} characters` : `"${element.value}"`;
    return `the field did not take all that was typed; it holds ${is ? held : 'nothing'}`;
  };

  // Readies the focused field for `text`. {kind}: "text" (its content is selected; `filled` says whether there is
  // any, and `stands` whether it lies elsewhere than where was clicked, as that of an editor does), "slider" (keys
  // move it from `value` to `wanted`), "set" and "chosen" (done here; `why` says what else came of it), "keys" (no
  // field, but it listens), "frame" (the focus is in this frame of another origin), "refused" and "read_only" (why),
  // "none".
  // `isEnded`: by Enter.
  webgym.prepareTyping = (text, isEnded) => {
    const element = webgym.pointedSlider(focused()) || focused();
    if (!element) return { kind: 'none' };
    if (isFrame(element)) return { kind: 'frame', frame: webgym.frameId(element) };
    if (localName(element) === 'select')
      return matches(element, ':disabled') ? { kind: 'none' } : choose(element, text);
    if (webgym.isSlider(element))
      return getAttribute(element, 'aria-disabled') === 'true' ? UNCHANGEABLE : webgym.prepareSlider(element, text);
    const isInput = localName(element) === 'input';
    if (isInput && element.type === 'file') return { kind: 'refused', why: 'files cannot be uploaded' };
    if (ofKind(element, 'disabled')) return UNCHANGEABLE;
    if (ofKind(element, 'readOnly')) return { ...UNCHANGEABLE, kind: 'read_only' };
    if (isInput && VALUE_TYPES.includes(element.type)) return setValue(element, text);
    const lines = isContentEditable(element) || localName(element) === 'textarea';
    if (lines || (isInput && !NO_TEXT.includes(element.type))) {
      if (lines && isEnded) unbroken = element;
      const stands = !matches(element, ':hover');
      typed = isContentEditable(element) || stands ? null : { element, before: element.value };
      return { kind: 'text', filled: selectAll(element), stands };
    }
    return { kind: takesKeys(element) ? 'keys' : 'none', wondered: webgym.wonder(element) };
  };
})();
