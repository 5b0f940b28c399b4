// The words of a page and where they stand, and two other ways to draw it: see text.py.
(() => {
  const CALM = '*, *::before, *::after { transition: none !important; animation-play-state: paused !important }';
  const PAINTED = '::highlight(even) { background: rgb(255 0 255) } ::highlight(odd) { background: rgb(0 255 0) }';
  const TRANSPARENT = `
    *, *::before, *::after, *::placeholder {
      -webkit-text-fill-color: transparent !important; -webkit-text-stroke-color: transparent !important;
      text-shadow: none !important; text-decoration-color: transparent !important }
    svg text, svg tspan, svg textPath { fill: transparent !important; stroke: transparent !important }`;
  const WORDLESS = /^(script|style|noscript|textarea|title|option|template|desc|metadata)$/;

  const words = []; // [text, boxes, whether it goes on a word before, whether a highlight paints it]
  const fields = []; // [text, box, whether all of it has room]
  const sheets = []; // that make text transparent
  const lettered = []; // elements that paint their background in their letters alone, and their styles
  const highlights = [];

  const add = (root, text) => {
    const sheet = new (root.defaultView || root.ownerDocument.defaultView).CSSStyleSheet();
    sheet.replaceSync(text);
    root.adoptedStyleSheets.push(sheet);
    return sheet;
  };

  const addText = (node, view, highlight, [dx, dy], state) => {
    const parent = node.parentElement || node.parentNode.host;
    if (!node.data.trim()) state.goesOn = false;
    if (!parent || WORDLESS.test(parent.localName)) return;
    if (view.getComputedStyle(parent).webkitTextSecurity !== 'none') return;
    for (const match of node.data.matchAll(/\S+/g)) {
      const end = match.index + match[0].length;
      const range = view.document.createRange();
      range.setStart(node, match.index);
      range.setEnd(node, end);
      const rects = [...range.getClientRects()].filter(({ width, height }) => width && height);
      const boxes = rects.map(({ left, top, right, bottom }) => [left + dx, top + dy, right + dx, bottom + dy]);
      const goesOn = state.goesOn && match.index === 0;
      if (boxes.length) highlight[words.length % 2].add(range);
      if (boxes.length) words.push([match[0].replaceAll('\u00ad', ''), boxes, goesOn, !parent.ownerSVGElement]);
      state.goesOn = end === node.length;
    }
  };

  const addField = (field, [dx, dy]) => {
    const chosen = [...(field.selectedOptions || [])].map(({ label }) => label).join(' ');
    const isBare = /^(checkbox|radio|range|color|password|hidden|image)$/.test(field.type);
    const text = chosen || (field.type === 'file' ? 'Choose File No file chosen' : field.value || field.placeholder);
    if (!text || isBare || field.multiple || (field.localName === 'select' && field.size > 1)) return;
    const { left, top, right, bottom } = field.getBoundingClientRect();
    const hasRoom = field.scrollWidth <= field.clientWidth && field.scrollHeight <= field.clientHeight;
    fields.push([text, [left + dx, top + dy, right + dx, bottom + dy], hasRoom]);
  };

  // A line of a list that is open in the page: its text has no boxes of its own.
  const addOffer = (option, [dx, dy]) => {
    const { left, top, right, bottom, height } = option.getBoundingClientRect();
    const isOpen = option.closest('select')?.clientHeight > height;
    if (height && isOpen) fields.push([option.label, [left + dx, top + dy, right + dx, bottom + dy], true]);
  };

  const visit = (root, view, highlight, start, state) => {
    add(root, CALM);
    add(root, PAINTED);
    const sheet = add(root, TRANSPARENT);
    sheet.disabled = true;
    sheets.push(sheet);
    const walker = view.document.createTreeWalker(root, NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      if (node.nodeType === Node.TEXT_NODE) {
        addText(node, view, highlight, start, state);
        continue;
      }
      if (/^(input|textarea|select)$/.test(node.localName)) addField(node, start);
      if (node.localName === 'option') addOffer(node, start);
      if (node.shadowRoot) visit(node.shadowRoot, view, highlight, start, state);
      if (view.getComputedStyle(node).webkitBackgroundClip.includes('text')) lettered.push([node, node.getAttribute('style')]);
      if (/^i?frame$/.test(node.localName) && node.contentDocument) visitFrame(node, view, start);
    }
  };

  const visitFrame = (frame, view, [dx, dy]) => {
    const { left, top } = frame.getBoundingClientRect();
    const { paddingLeft, paddingTop } = view.getComputedStyle(frame);
    const [x, y] = [frame.clientLeft + parseFloat(paddingLeft), frame.clientTop + parseFloat(paddingTop)];
    visitDocument(frame.contentDocument, [dx + left + x, dy + top + y]);
  };

  const visitDocument = (inner, start) => {
    const view = inner.defaultView;
    const highlight = [new view.Highlight(), new view.Highlight()];
    highlights.push([view, highlight]);
    visit(inner, view, highlight, start, { goesOn: false });
  };

  visitDocument(document, [0, 0]);
  window.textTruth = {
    transparent(isOn) {
      for (const sheet of sheets) sheet.disabled = !isOn;
      for (const [node, style] of lettered) {
        if (style === null) node.removeAttribute('style');
        else node.setAttribute('style', style);
        if (isOn) node.style.setProperty('background', 'none', 'important');
      }
    },
    painted() {
      for (const [view, [even, odd]] of highlights) view.CSS.highlights.set('even', even).set('odd', odd);
    },
  };
  return [words, fields];
})()
