// What an element is, what it is called, and what it holds.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.roles) return;
  const { fold, rootOf } = webgym;
  const MAX_NAME = 200;

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
    if (element.localName === 'textarea' || (element.localName === 'input' && (role !== 'button' || element.type === 'color')))
      return element.type === 'password' ? '•'.repeat(element.value.length) : element.value;
    return null;
  };

  webgym.roles = { roleOf, nameOf, valueOf };
})();
