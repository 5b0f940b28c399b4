// Runs once per document, in an isolated world: the page cannot see it, and it reaches into all frames of
// the document's own origin below it. This file keeps when the page last changed; the others draw lists
// for <select>, fill fields, find out what can be seen, and number it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.state) return;
  const {
    ownerDocument, localName, shadowRoot, defaultView, textContent, styleSheets, adoptedStyleSheets, documentOf, make, typeOf,
    nodeType, querySelectorAll, children, isConnected, documentElement,
  } = webgym.dom;
  const state = {
    changedAt: 0, changes: 0, changedNode: null, reactions: 0, ours: new WeakSet(), roots: new WeakMap(), list: null,
    shadowedFrames: [], isAlone: false, // nobody acts, and the page is not waited for
    onChange: () => {},
  };
  webgym.state = state;

  const fold = (text) => (text || '').replace(/\u00ad/g, '').replace(/\s+/g, ' ').trim(); // soft hyphens show none
  webgym.fold = fold;
  // The shadow root below an element: an open one, one of ours, or a closed one that was opened to us.
  webgym.rootOf = (element) => shadowRoot(element) || state.roots.get(element) || null;

  // What is too long for an answer is cut in the page, and the answer says what was. `limits`: characters of a
  // `title`, an `address`, a `text`, a `name` and a `value`, and numbers of `elements` and `options`.
  webgym.limits = {};
  let shortened = new Set();
  webgym.noteShortened = (kind) => shortened.add(kind);
  webgym.shorten = (text, kind) => {
    const most = webgym.limits[kind];
    if (text.length > most) shortened.add(kind);
    return text.slice(0, most);
  };
  // Which kinds were cut since the last call, or are in the list that is open.
  webgym.takeShortened = () => {
    const kinds = [...shortened, ...(state.list && state.list.isCut ? ['options'] : [])];
    shortened = new Set();
    return kinds;
  };

  const FRAMES = new Set(['iframe', 'frame', 'object']);
  webgym.isFrame = (element) => FRAMES.has(localName(element));
  // The document in a frame; null for one of another origin.
  webgym.frameIn = (element) => (webgym.isFrame(element) && element.contentDocument) || null;

  // The windows that we may look into: this one and those of its origin below it.
  const views = () => {
    const found = [];
    const add = (view) => {
      found.push(view);
      for (let i = 0; i < view.length; i++) {
        try {
          if (documentOf(view[i])) add(view[i]);
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

  // What has changed for as long as anyone waits: a clock, a carousel. Its changes are no news any more.
  const restless = new WeakMap(); // node -> kinds of change
  let counts = null; // node -> kind -> [how often, in which batch last, how long its text is], while somebody counts
  let batch = 0;
  const replaced = new WeakSet(); // texts that changed often on a page that came to rest
  const OFTEN = 4;
  const TEXT = 'characterData';
  const lengthOf = (node, kind) => (kind === TEXT || kind === 'childList' ? textContent(node).length : Infinity);

  // Count what changes, from now on; or stop.
  webgym.census = (on) => (counts = on ? new Map() : null);
  // What has changed often since the count began is restless if the page never came to rest; but for a text that grows,
  // unless it did so from the first. If it did, a text is that is replaced again while nobody acts.
  webgym.settleRestless = (isBusy, isFirst) => {
    for (const [node, kinds] of counts || [])
      for (const [kind, [count, , length]] of kinds) {
        const isGrowing = count >= OFTEN && length < Infinity && lengthOf(node, kind) >= length + count - 2;
        if (count < OFTEN || (isGrowing && !isFirst)) continue;
        if (isBusy) ignore(node, kind);
        else if (kind === TEXT && !isGrowing) replaced.add(node);
      }
  };

  const ignore = (node, kind) => restless.set(node, (restless.get(node) || new Set()).add(kind));

  const isNews = (node, kind) => {
    if (state.isAlone && kind === TEXT && replaced.has(node)) ignore(node, kind);
    const kinds = restless.get(node);
    if (kinds && kinds.has(kind)) return false;
    if (counts) {
      if (!counts.has(node)) counts.set(node, new Map());
      const [before, last, length] = counts.get(node).get(kind) || [0, 0, Infinity];
      const count = last === batch ? before : before + 1;
      counts.get(node).set(kind, [count, batch, before === 1 && count === 2 ? lengthOf(node, kind) : length]);
    }
    return true;
  };
  // What the page makes of scrolls, sizes and what is in view comes with the next frame, which a busy machine draws
  // late: it is "due", "drawn", or "late" if nobody waits for it any longer. `isBegun`: the next may have begun before,
  // so the one after it is due, too.
  state.frame = 'drawn';
  let isOneMoreDue = false;
  const frames = new ResizeObserver(() => {
    frames.disconnect();
    state.frame = 'drawn';
    if (isOneMoreDue) webgym.askFrame();
    isOneMoreDue = false;
  });
  webgym.askFrame = (isBegun = false) => {
    const root = documentElement(document);
    isOneMoreDue ||= isBegun;
    if (!root || state.frame !== 'drawn') return;
    state.frame = 'due';
    scheduler.postTask(() => frames.observe(root)); // not from within a frame, for which it would be too late
  };
  // To scroll is a change, but it is the agent's own; what the page makes of it is a reaction.
  const changed = (isReaction = true, nodes = []) => {
    state.changedAt = performance.now();
    state.changes += 1;
    state.changedNode = nodes.at(-1) || null;
    webgym.askFrame();
    if (isReaction) state.reactions += 1;
    state.onChange(nodes);
  };
  const onEvent = (event) => {
    batch += 1;
    if (isNews(event.target, event.type)) changed(event.type !== 'scroll', event.type === 'scroll' ? [] : [event.target]);
  };
  const isOurs = (record) =>
    record.type === 'childList' &&
    [...record.addedNodes, ...record.removedNodes].every((node) => state.ours.has(node));
  const isText = (node) => nodeType(node) === Node.TEXT_NODE;
  const kindOf = ({ type, attributeName, addedNodes, removedNodes }) =>
    type === 'childList' && [...addedNodes, ...removedNodes].every(isText) ? TEXT : type + (attributeName || '');
  // Watch the shadow roots in and below an element.
  const enter = (top, seen = new Set()) => {
    if (nodeType(top) !== Node.ELEMENT_NODE || seen.has(top)) return;
    for (const element of [top, ...querySelectorAll(top, '*')]) {
      seen.add(element);
      const root = webgym.rootOf(element);
      if (root && !state.ours.has(element)) webgym.watch(root);
    }
  };
  // What a batch adds is gone through once, in however many pieces it was put together.
  const enterAdded = (records) => {
    const seen = new Set();
    for (const { addedNodes } of records) for (const node of addedNodes) enter(node, seen);
  };
  const observer = new MutationObserver((records) => {
    batch += 1;
    enterAdded(records);
    const news = records.filter((record) => !isOurs(record) && isNews(record.target, kindOf(record)));
    if (news.length) changed(true, news.map((record) => record.target));
  });
  webgym.watch = (root) => {
    observer.observe(root, { subtree: true, childList: true, attributes: true, characterData: true });
    if (isWatched.has(root)) return;
    isWatched.add(root);
    if (typeOf(root) !== Node.DOCUMENT_NODE) {
      for (const [name, handler] of inRoots) root.addEventListener(name, handler, { capture: true, passive: true });
      shadows.push(new WeakRef(root));
    }
    for (const child of children(root)) enter(child);
  };
  const inRoots = [['scroll', onEvent]]; // [event, handler]: what happens within a shadow root is heard in it alone
  webgym.listenInRoots = (...more) => inRoots.push(...more);
  // The shadow roots that are watched and in a document.
  const isWatched = new WeakSet();
  let shadows = [];
  webgym.shadows = () => {
    const alive = shadows.map((one) => one.deref());
    shadows = shadows.filter((_, index) => alive[index]);
    return alive.filter((root) => root && isConnected(root));
  };

  // What the fields hold: a script changes that without an event and without a change of the document.
  const holds = (field) => {
    if (field.selectedOptions) return [...field.selectedOptions].map(({ index }) => index).join();
    return field.type === 'checkbox' || field.type === 'radio' ? field.checked : field.value;
  };
  webgym.fieldValues = () =>
    [...views().map(({ document }) => document), ...webgym.shadows()]
      .flatMap((root) => [...querySelectorAll(root, 'input, select, textarea')])
      .map(holds);
  // How many rules its style sheets have: a script adds some without a change of the document.
  const rules = (sheet) => {
    try {
      return sheet.cssRules.length;
    } catch {
      return 0; // a sheet of another origin
    }
  };
  webgym.ruleCounts = () =>
    [...views().map(({ document }) => document), ...webgym.shadows()]
      .flatMap((root) => [...styleSheets(root), ...adoptedStyleSheets(root)])
      .map(rules);
  webgym.isEqual = (a, b) => a.length === b.length && a.every((one, index) => one === b[index]);

  const listeners = []; // [event, handler, options]: in every window
  for (const name of ['scroll', 'input', 'resize', 'transitionend', 'animationend', 'beginEvent', 'endEvent'])
    listeners.push([name, onEvent, { capture: true, passive: true }]);
  webgym.changed = changed;
  webgym.listen = (...more) => listeners.push(...more);

  // Listen in every window. What is there already is not added twice.
  webgym.attach = () => {
    for (const view of views()) {
      webgym.watch(view.document);
      for (const [name, handler, options] of listeners) view.addEventListener(name, handler, options);
    }
  };

  // For frames of other origins, which the tab's own `quiet` does not see: how often they changed, and how
  // many milliseconds ago. Asked from outside, for no timer runs in a frame without
  // scripts.
  webgym.still = () => {
    webgym.attach();
    return { changes: state.changes, ago: performance.now() - state.changedAt, timers: webgym.plans().timers };
  };

  // --- what we draw ---------------------------------------------------------------------------------

  // Everything of ours lies in the top layer, above modal dialogs, and in a root that the page cannot enter.
  webgym.overlay = (parent, style) => {
    const host = make(ownerDocument(parent), 'div');
    host.setAttribute('popover', 'manual');
    host.style.cssText =
      'all: initial; position: fixed; inset: 0; width: auto; height: auto; margin: 0; padding: 0;' +
      `border: 0; background: none; overflow: visible; display: block; pointer-events: none;` +
      `zoom: ${1 / (parent.currentCSSZoom || 1)};`;
    const root = host.attachShadow({ mode: 'closed' });
    if (style) {
      const { CSSStyleSheet } = defaultView(ownerDocument(parent));
      const sheet = new CSSStyleSheet();
      sheet.replaceSync(style);
      root.adoptedStyleSheets = [sheet];
    }
    state.ours.add(host);
    state.roots.set(host, root);
    parent.append(host);
    host.showPopover();
    return { host, root };
  };
})();
