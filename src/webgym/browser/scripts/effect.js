// Whether an action had an effect. What changes on the page all by itself says nothing about that.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.beginTrace) return;
  const {
    localName, getSelection, getBoundingClientRect, checkVisibility, documentElement, querySelectorAll,
    offsetWidth, offsetHeight, getRootNode, nodeType,
  } = webgym.dom;
  const { state, rootOf, focused } = webgym;
  const { begin, hit, parentOf } = webgym.geometry;

  const VISIBLE = { opacityProperty: true, visibilityProperty: true };
  const DRAWN = 'canvas, video, embed, object'; // what changes without a change of the document
  const AROUND = 200; // elements that are looked at around the point, at most

  const own = new WeakSet(); // what changes while nobody does anything, again and again
  const once = new WeakMap(); // when it was first seen to: it may have come late
  const APART = 50; // ms
  const plansAlone = new Set(); // counters that went on while nobody did anything
  let isActing = true; // a page that is being loaded is not one that changes by itself
  let trace = null;
  let planned = null; // when the last action was over

  const noteAlone = (node) => {
    if (!once.has(node)) once.set(node, performance.now());
    else if (performance.now() - once.get(node) > APART) own.add(node);
  };
  // Something changed: these nodes, or what no node stands for.
  state.onChange = (nodes) => {
    if (!isActing) nodes.forEach(noteAlone);
    else if (trace && !(nodes.length && nodes.every((node) => own.has(node)))) trace.hasChanged = true;
  };
  for (const name of ['play', 'pause', 'volumechange', 'seeking', 'fullscreenchange'])
    webgym.listen([name, () => trace && (trace.hasChanged = true), { capture: true, passive: true }]);

  // It may look different without any change of a document: it has states of its own.
  const isCustom = (element) => element && localName(element).includes('-');
  const hostOf = (root) => nodeType(root) === Node.DOCUMENT_FRAGMENT_NODE && root.host;
  // How far a list that is open has been scrolled: ours, or the page's own, in which an option has the focus.
  const listAt = () => {
    if (state.list) return state.list.list.scrollTop;
    const element = focused();
    return element && localName(element) === 'option' && getBoundingClientRect(element).top;
  };
  const hasSelection = () => !getSelection(document).isCollapsed;
  const plans = () => Object.entries(webgym.plans());

  // The largest part of the page around an element that is not too large to be looked at; null if it is itself.
  const around = (element) => {
    let part = null;
    for (let node = element; node && node !== documentElement(document); node = parentOf(node)) {
      if (querySelectorAll(node, '*').length > AROUND) break;
      part = node;
    }
    return part;
  };
  // What of it is visible, and how large: a menu that opens by a style alone changes that, a new colour and
  // what turns do not.
  const outline = (part) =>
    [part, ...querySelectorAll(part, '*')]
      .slice(0, AROUND)
      .map((element) => checkVisibility(element, VISIBLE) && `${offsetWidth(element)}x${offsetHeight(element)}`)
      .join();

  const isDrawn = (element) => {
    const { width, height, top, left } = getBoundingClientRect(element);
    return width >= 4 && height >= 4 && top < innerHeight && left < innerWidth;
  };
  // Whether there is something whose changes only a picture shows.
  webgym.hasDrawn = () => [...querySelectorAll(document, DRAWN)].some(isDrawn);

  // An action begins, at this point if it has one.
  webgym.beginTrace = (point) => {
    begin();
    const now = plans();
    if (planned) now.forEach(([name, count], index) => count !== planned[index][1] && plansAlone.add(name));
    const element = point && hit(...point);
    const part = element && around(element);
    for (let node = element; node; node = parentOf(node)) if (rootOf(node)) webgym.watch(rootOf(node));
    trace = {
      hasChanged: false, listAt: listAt(), plans: now, focus: focused(), hasSelection: hasSelection(), list: state.list,
      isDark: Boolean(element && (isCustom(element) || isCustom(hostOf(getRootNode(element))))), rules: webgym.ruleCounts(),
      part, outline: part && outline(part), fieldValues: webgym.fieldValues(),
    };
    isActing = true;
    state.plansAtRest = null;
    return true;
  };

  // Whether the action had the page plan anything for later.
  webgym.hasSetOff = () => !trace || plans().some(([, count], index) => count !== trace.plans[index][1]);

  // The action is over, and the page quiet.
  webgym.endTrace = () => {
    trace = null;
    isActing = state.hasMissed = false;
    state.isAlone = true;
    planned = Object.entries(state.plansAtRest || webgym.plans());
  };

  // "some" effect of the action so far, "none", or "unseen": only a picture could tell.
  webgym.effect = () => {
    const was = trace;
    if (!was || was.hasChanged || was.list !== state.list || was.listAt !== listAt()) return 'some';
    if (was.focus !== focused() || was.hasSelection !== hasSelection()) return 'some';
    if (plans().some(([name, count], index) => !plansAlone.has(name) && count !== was.plans[index][1])) return 'some';
    if (was.part && was.outline !== outline(was.part)) return 'some';
    if (!webgym.isEqual(was.rules, webgym.ruleCounts())) return 'some';
    if (!webgym.isEqual(was.fieldValues, webgym.fieldValues())) return 'some';
    return was.isDark || webgym.hasDrawn() ? 'unseen' : 'none';
  };
})();
