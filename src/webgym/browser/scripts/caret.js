// Carets blink: they are hidden, so that the same page gives the same picture.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.hideCaret) return;
  const { activeElement, adoptedStyleSheets, defaultView, getRootNode, localName, matches, ownerDocument } =
    webgym.dom;
  const { rootOf, frameIn } = webgym;

  // What has the focus, through shadow roots and frames.
  webgym.focused = () => {
    let element = activeElement(document);
    for (;;) {
      if (!element) return null;
      const inner = rootOf(element) || frameIn(element);
      if (!inner || !activeElement(inner)) return element;
      element = activeElement(inner);
    }
  };

  const FIELDS = new Set(['input', 'textarea']);
  const roots = new WeakMap(); // of the parts of a field, which no page can see
  const sheets = new WeakMap(); // by document
  const sheetFor = (document) => {
    if (!sheets.has(document)) {
      const sheet = new (defaultView(document).CSSStyleSheet)();
      sheet.replaceSync(':host, *, *::before, *::after { caret-color: transparent !important; }');
      sheets.set(document, sheet);
    }
    return sheets.get(document);
  };

  // In the field with the focus, or in the editor, which has no such parts: a page can see the sheet then. False if the
  // field's are not known yet: `unknown` asks for them.
  webgym.hideCaret = () => {
    const element = webgym.focused();
    if (!element || !matches(element, ':read-write')) return true;
    const root = FIELDS.has(localName(element)) ? roots.get(element) : getRootNode(element);
    if (!root) return !webgym.askForRoot(element);
    const [sheet, adopted] = [sheetFor(ownerDocument(element)), adoptedStyleSheets(root)];
    if (!adopted.includes(sheet)) adopted.push(sheet);
    return true;
  };

  // Whether this is a field, whose parts were not known.
  webgym.enterField = (field, root) => {
    if (!FIELDS.has(localName(field))) return false;
    roots.set(field, root);
    webgym.hideCaret();
    return true;
  };
})();
