// What the page makes of the mouse, between one event and the next.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.expect) return;
  const { isConnected, getBoundingClientRect, documentElement, nodeType } = webgym.dom;
  const { state } = webgym;
  const { hit, begin, contains } = webgym.geometry;

  const LONGEST = 100; // ms: a page that is not drawn has no frames
  const asked = () => Object.values(webgym.plans()).reduce((sum, count) => sum + count, state.changes);
  const later = (delay) => scheduler.postTask(() => {}, { delay });

  // The next frame, after what the page itself had planned for it: true if it came within `longest` milliseconds.
  // Nothing is asked for by number, so that who counts what the page asks for sees nothing of it.
  webgym.frame = (longest) => {
    const frame = new Promise((resolve) => {
      const observer = new ResizeObserver(() => (observer.disconnect(), resolve(true)));
      observer.observe(documentElement(document));
    });
    return Promise.race([frame, later(longest)]);
  };

  let before = -1; // what was asked for and changed
  let aimed = null; // what lies at the point, and where that was
  let over = null; // what the mouse was over when the page had reacted to its last move
  state.hasMissed = false; // whether the button went down or up on something else in this action
  const areRelated = (one, other) => contains(one, other) || contains(other, one);
  // The browser's own events tell what is hit: the page may have changed a moment before.
  const onButton = (event) => {
    const [target] = event.composedPath();
    if (event.isTrusted && over && nodeType(target) === Node.ELEMENT_NODE) state.hasMissed ||= !areRelated(over, target);
    over = over && event.type === 'mousedown' ? target : null; // a drag ends elsewhere
  };
  for (const name of ['mousedown', 'mouseup']) webgym.listen([name, onButton, { capture: true, passive: true }]);

  let next = null; // what the next event is meant for

  // The next event is meant for what lies at this point now.
  webgym.aimAt = (x, y) => {
    const element = hit(x, y);
    next = element && { element, box: getBoundingClientRect(element) };
  };

  // An event comes, at this point.
  webgym.expect = (x, y) => {
    begin();
    before = asked();
    if (!next) webgym.aimAt(x, y);
    [aimed, next] = [next, null];
    return true;
  };

  // Give the page a frame and a task, if it changed or planned anything since, or may have done so where we do
  // not see it (`isBlind`). Gives how far what lay at the point has moved away from under it. Where it has not after a
  // move, the next event is expected there.
  webgym.reacted = async (x, y, isBlind, isMove) => {
    if (asked() !== before || isBlind) {
      await webgym.frame(LONGEST);
      await later(0);
    }
    begin();
    const found = hit(x, y);
    if (isMove) over = found;
    const by = movedBy(found);
    if (isMove && !by.some(Boolean)) webgym.expect(x, y);
    return by;
  };
  const movedBy = (found) => {
    if (!aimed || !isConnected(aimed.element) || (found && areRelated(aimed.element, found))) return [0, 0];
    const { left, top, width } = getBoundingClientRect(aimed.element);
    return width ? [left - aimed.box.left, top - aimed.box.top] : [0, 0];
  };

  // --- drags of the system --------------------------------------------------------------------------

  let begun = null;
  let dropped = null;
  webgym.listen(
    ['mousedown', () => (begun = dropped = null), { capture: true, passive: true }],
    ['dragover', (event) => event.isTrusted && (dropped = event), { capture: true, passive: true }],
    ['dragstart', (event) => event.isTrusted && (begun = event), { capture: true, passive: true }],
    ['dragend', (event) => event.isTrusted && (begun = null), { capture: true, passive: true }],
  );
  // Whether a drag of the system began since the button was pressed, and the page let it. An event that the page
  // made itself is no drag, and one that Chromium gives up ends at once.
  webgym.hasDragBegun = () => Boolean(begun && !begun.defaultPrevented);
  // Whether the page takes what was dragged over it; else Chromium would open it.
  webgym.takesDrop = () => Boolean(dropped && dropped.defaultPrevented);
})();
