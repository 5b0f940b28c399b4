// What the page makes of the mouse, between one event and the next.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.expect) return;
  const { isConnected, getBoundingClientRect, documentElement } = webgym.dom;
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

  // An event comes, at this point.
  webgym.expect = (x, y) => {
    begin();
    before = asked();
    const element = hit(x, y);
    aimed = element && { element, box: getBoundingClientRect(element) };
    return true;
  };

  // Give the page a frame and a task, if it changed or planned anything since, or may have done so where we do
  // not see it (`isBlind`). Gives how far what lay at the point has moved away from under it.
  webgym.reacted = async (x, y, isBlind) => {
    if (asked() !== before || isBlind) {
      await webgym.frame(LONGEST);
      await later(0);
    }
    if (!aimed || !isConnected(aimed.element)) return [0, 0];
    begin();
    const found = hit(x, y);
    if (found && (contains(aimed.element, found) || contains(found, aimed.element))) return [0, 0];
    const { left, top } = getBoundingClientRect(aimed.element);
    return [left - aimed.box.left, top - aimed.box.top];
  };

  // --- drags of the system --------------------------------------------------------------------------

  let begun = null;
  let over = null;
  webgym.listen(
    ['mousedown', () => (begun = over = null), { capture: true, passive: true }],
    ['dragover', (event) => event.isTrusted && (over = event), { capture: true, passive: true }],
    ['dragstart', (event) => event.isTrusted && (begun = event), { capture: true, passive: true }],
    ['dragend', (event) => event.isTrusted && (begun = null), { capture: true, passive: true }],
  );
  // Whether a drag of the system began since the button was pressed, and the page let it. An event that the page
  // made itself is no drag, and one that Chromium gives up ends at once.
  webgym.hasDragBegun = () => Boolean(begun && !begun.defaultPrevented);
  // Whether the page takes what was dragged over it; else Chromium would open it.
  webgym.takesDrop = () => Boolean(over && over.defaultPrevented);
})();
