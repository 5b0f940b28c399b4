// Runs once per document, in an isolated world: the page cannot see it, and it reaches into all frames of
// the document's own origin below it. This file keeps when the page last changed; the others draw lists
// for <select>, fill fields, find out what can be seen, and number it.
(() => {
  if (globalThis.webgym) return;
  const state = {
    changedAt: 0, changes: 0, ours: new WeakSet(), roots: new WeakMap(), list: null, shadowedFrames: [],
  };
  const webgym = (globalThis.webgym = { state });

  const fold = (text) => (text || '').replace(/\s+/g, ' ').trim();
  webgym.fold = fold;
  // An HTML element, in XML documents too.
  webgym.make = (owner, name) => owner.createElementNS('http://www.w3.org/1999/xhtml', name);
  // The shadow root below an element: an open one, one of ours, or a closed one that was opened to us.
  webgym.rootOf = (element) => element.shadowRoot || state.roots.get(element) || null;

  const FRAMES = new Set(['iframe', 'frame', 'object']);
  webgym.isFrame = (element) => FRAMES.has(element.localName);
  // The document in a frame; null for one of another origin.
  webgym.frameIn = (element) => (webgym.isFrame(element) && element.contentDocument) || null;

  // The windows that we may look into: this one and those of its origin below it.
  const views = () => {
    const found = [];
    const add = (view) => {
      found.push(view);
      for (let i = 0; i < view.length; i++) {
        try {
          if (view[i].document) add(view[i]);
        } catch (error) {
          if (error.name !== 'SecurityError') throw error; // a frame of another origin
        }
      }
    };
    add(window);
    for (const frame of state.shadowedFrames)
      if (webgym.frameIn(frame)) add(frame.contentWindow); // no window counts the frames in its shadow roots
    return found;
  };
  webgym.views = views;

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
  webgym.changed = changed;
  webgym.listen = (...more) => listeners.push(...more);

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

  // For frames of other origins, which the tab's own `quiet` does not see: how often they changed, and how
  // many milliseconds ago. Asked from outside, for no timer runs in a frame without scripts.
  webgym.still = () => {
    webgym.attach();
    return { changes: state.changes, ago: Date.now() - state.changedAt };
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

  // --- what we draw ---------------------------------------------------------------------------------

  // Everything of ours lies in the top layer, above modal dialogs, and in a root that the page cannot enter.
  webgym.overlay = (parent, style) => {
    const host = webgym.make(parent.ownerDocument, 'div');
    host.setAttribute('popover', 'manual');
    host.style.cssText =
      'all: initial; position: fixed; inset: 0; width: auto; height: auto; margin: 0; padding: 0;' +
      `border: 0; background: none; overflow: visible; display: block; pointer-events: none;` +
      `zoom: ${1 / (parent.currentCSSZoom || 1)};`;
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
})();
