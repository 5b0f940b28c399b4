// What an element is, what it is called, and what it holds.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.roles) return;
  const {
    nodeType, parentElement, childNodes, getRootNode, localName, getAttribute, hasAttribute, checkVisibility,
    closest, querySelector, querySelectorAll, getElementById, isContentEditable, tabIndex, ofKind,
  } = webgym.dom;
  const { fold, rootOf, shorten } = webgym;
  const { labelsOf, labelsFor } = webgym.labels;
  const SPARE = 20; // characters that are looked at for one of a name: most may be white space
  const first = (text) => (text || '').slice(0, SPARE * webgym.limits.name);

  const INPUT_ROLES = {
    button: 'button', submit: 'button', reset: 'button', image: 'button', checkbox: 'checkbox',
    radio: 'radio', range: 'slider', number: 'spinbutton', search: 'searchbox', file: 'button',
    color: 'button',
  };
  const WIDGET_ROLES = new Set(
    ('button link checkbox radio switch tab option menuitem menuitemcheckbox menuitemradio combobox ' +
      'textbox searchbox slider spinbutton treeitem gridcell listbox').split(' '),
  );

  // What takes the focus so that keys scroll it, or move about in it: a click on it does nothing.
  const STRUCTURES = new Set(
    ('tabpanel region group document article main complementary dialog alertdialog status alert log tooltip list ' +
      'table grid treegrid tree menu menubar tablist toolbar radiogroup figure progressbar scrollbar').split(' '),
  );

  const explicitRole = (element) => (getAttribute(element, 'role') || '').trim().split(/\s+/)[0];
  const isStructure = (element) => STRUCTURES.has(explicitRole(element));

  // The role of a control.
  const widgetOf = (element) => {
    const explicit = explicitRole(element);
    const isShown = // cells and texts that only show something
      (explicit === 'gridcell' && !hasAttribute(element, 'tabindex')) ||
      (explicit === 'textbox' && getAttribute(element, 'aria-readonly') === 'true' && !isContentEditable(element));
    if (WIDGET_ROLES.has(explicit) && !isShown) return explicit;
    switch (localName(element)) {
      case 'a':
      case 'area':
        return hasAttribute(element, 'href') || hasAttribute(element, 'xlink:href') ? 'link' : '';
      case 'button':
      case 'summary':
        return 'button';
      case 'select':
        return element.multiple || element.size > 1 ? 'listbox' : 'combobox';
      case 'option':
        return 'option';
      case 'textarea':
        return 'textbox';
      case 'video':
      case 'audio':
        return hasAttribute(element, 'controls') ? 'button' : ''; // a click plays or pauses it
      case 'input':
        if (element.type === 'hidden') return '';
        if (INPUT_ROLES[element.type]) return INPUT_ROLES[element.type];
        return element.list ? 'combobox' : 'textbox';
      default:
        break;
    }
    if (isContentEditable(element) && !(parentElement(element) && isContentEditable(parentElement(element))))
      return 'textbox';
    return '';
  };

  // The same; "button" for what only its attributes make one, unless they say that a click does nothing.
  const IDLE = /^(javascript:|void|return|true|false|0|[\s();])*$/;
  const roleOf = (element) => {
    const role = widgetOf(element);
    if (role) return role;
    const isFocused = hasAttribute(element, 'tabindex') && tabIndex(element) >= 0;
    const isButton = !IDLE.test(getAttribute(element, 'onclick') || '') || (isFocused && !isStructure(element));
    return isButton ? 'button' : '';
  };

  const contentName = (node, depth = 0) => {
    if (nodeType(node) === Node.TEXT_NODE) return first(node.data);
    if (nodeType(node) !== Node.ELEMENT_NODE || depth > 12) return '';
    if (depth && getAttribute(node, 'aria-hidden') === 'true') return ''; // what has a number has a name, too
    const tag = localName(node);
    if (tag === 'style' || tag === 'script' || tag === 'select') return '';
    const hasNoBox = depth && getComputedStyle(node).display === 'contents'; // never visible by `checkVisibility`
    if (depth && !hasNoBox && !checkVisibility(node, { visibilityProperty: true })) return '';
    const label = depth ? getAttribute(node, 'aria-label') : null;
    if (label) return first(label);
    if (tag === 'img') return first(node.alt);
    if (tag === 'svg') return first((querySelector(node, 'title') || {}).textContent);
    const assigned = tag === 'slot' ? node.assignedNodes({ flatten: true }) : [];
    const inner = assigned.length ? assigned : childNodes(rootOf(node) || node);
    const isInline = depth && (hasNoBox || getComputedStyle(node).display.startsWith('inline'));
    let text = '';
    for (const child of inner) {
      if (text.length >= SPARE * webgym.limits.name) break;
      text += contentName(child, depth + 1);
    }
    return isInline || !depth ? text : ` ${text} `;
  };

  const byIds = (element, ids) => {
    const root = getRootNode(element);
    return ids.split(/\s+/).map((id) => getElementById(root, id)).filter(Boolean);
  };

  const nameOfLabel = (label) => getAttribute(label, 'aria-label') || contentName(label);

  // What a component calls itself, in whose shadow root a control without a name lies: by what is in it, too, if it
  // has no more than a field and its two buttons.
  const CONTROLS = 'a[href],button,input,select,textarea';
  const nameOfHost = (element) => {
    const { host } = getRootNode(element);
    if (!host) return '';
    const around = closest(host, 'label');
    const own = localName(element).includes('-') ? `,${localName(element)}` : ''; // a component in the component
    const like = querySelectorAll(getRootNode(element), CONTROLS + own);
    const ofContent = () => (like.length > 3 ? '' : contentName(host));
    const named = [
      getAttribute(host, 'aria-label'), getAttribute(host, 'label'),
      ...labelsFor(host).map((label) => contentName(label)), ofContent(), around && contentName(around),
      getAttribute(host, 'placeholder'), getAttribute(host, 'title'),
    ];
    return named.find((name) => fold(name || '')) || nameOfHost(host);
  };

  // What the browser writes on a button that is an `input`.
  const UNNAMED = { submit: 'Submit', reset: 'Reset' };
  const captionOf = (element) => {
    const { type } = element;
    if (type === 'file') return element.multiple ? 'Choose Files' : 'Choose File';
    return element.value || (hasAttribute(element, 'value') ? '' : UNNAMED[type] || '');
  };
  // The same, and what it says beside it.
  const writtenOn = (element) => {
    if (element.type !== 'file') return captionOf(element);
    const { length } = element.files;
    const chosen = length > 1 ? `${length} files` : length ? element.files[0].name : 'No file chosen';
    return `${captionOf(element)} ${chosen}`;
  };

  const FIELD_ROLES = new Set(['textbox', 'searchbox', 'combobox', 'listbox', 'spinbutton']);
  const TICKS = new Set(['checkbox', 'radio', 'switch']);
  const findName = (element, role) => {
    const labelled = getAttribute(element, 'aria-labelledby');
    const isField = FIELD_ROLES.has(role);
    const around = (isField || TICKS.has(role)) && closest(element, 'label'); // which labels the first one in it alone
    const ofLabel = () => (around ? contentName(around) : '');
    const candidates = [
      () => (labelled ? byIds(element, labelled).map(nameOfLabel).join(' ') : ''),
      () => getAttribute(element, 'aria-label'),
      () => labelsOf(element).map((label) => contentName(label)).join(' '),
      () => (localName(element) === 'input' && role === 'button' ? captionOf(element) || element.alt : ''),
      () => (TICKS.has(role) ? ofLabel() : ''),
      () => (isField || isMedia(element) ? '' : contentName(element)),
      () => getAttribute(element, 'placeholder'),
      () => getAttribute(element, 'title'),
      () => getAttribute(element, 'alt'),
      () => (localName(element) === 'option' ? element.label : ''),
      () => nameOfHost(element),
      () => (isMedia(element) ? localName(element) : ''),
      ofLabel,
    ];
    for (const candidate of candidates) {
      const name = fold(first(candidate()));
      if (name) return name.slice(0, webgym.limits.name + 1); // one more than is told, so that a cut is seen
    }
    return '';
  };

  let names = new Map(); // by element and role, for one look: what lies around an element asks for its name, too
  const nameOf = (element, role) => {
    if (!names.has(element)) names.set(element, {});
    return (names.get(element)[role] ??= findName(element, role));
  };

  const isMedia = (element) => localName(element) === 'video' || localName(element) === 'audio';

  // What components of roles of their own hold.
  const VALUED = new Set(['slider', 'textbox', 'searchbox', 'combobox', 'spinbutton']);
  const valueOf = (element, role) => {
    const tag = localName(element);
    if (role === 'checkbox' || role === 'radio' || role === 'switch')
      return String(ofKind(element, 'checked') ?? getAttribute(element, 'aria-checked') === 'true');
    if (tag === 'select') {
      let text = '';
      for (const option of element.selectedOptions) {
        text += (text && ', ') + fold(shorten(option.label, 'value'));
        if (text.length > webgym.limits.value) break;
      }
      return shorten(text, 'value');
    }
    if (role === 'option')
      return String(ofKind(element, 'selected') || getAttribute(element, 'aria-selected') === 'true');
    if (tag === 'textarea' || (tag === 'input' && (role !== 'button' || element.type === 'color'))) {
      const value = shorten(element.value, 'value');
      return element.type === 'password' ? '•'.repeat(value.length) : value;
    }
    if (isMedia(element)) return element.paused ? 'paused' : 'playing';
    if (!VALUED.has(role)) return null;
    const told = getAttribute(element, 'aria-valuetext') ?? getAttribute(element, 'aria-valuenow');
    if (told === null && role === 'slider') return null;
    const [text, name] = [fold(first(told ?? contentName(element))), nameOf(element, role)];
    return shorten(name && text.startsWith(`${name} `) ? text.slice(name.length + 1) : text, 'value'); // its own label
  };

  // A new look: what is called otherwise now.
  const begin = () => {
    names = new Map();
    webgym.labels.begin();
  };

  webgym.roles = { isStructure, widgetOf, roleOf, nameOf, valueOf, writtenOn, begin };
})();
