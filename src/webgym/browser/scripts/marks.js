// Marks: a frame and a number over each element, drawn by the tab's own frame.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.mark) return;

  const COLOURS = ['#c62828', '#1565c0', '#2e7d32', '#6a1b9a', '#ad1457', '#00695c', '#4527a0', '#bf360c'];
  const BORDER = 2; // around the element, so that nothing of it is hidden
  const MARK_STYLE = `
    :host { all: initial; }
    .box { position: fixed; box-sizing: border-box; border: ${BORDER}px solid; border-radius: 3px; }
    .label { position: fixed; font: 700 12px/15px ui-sans-serif, system-ui, Arial, sans-serif; color: #fff;
      padding: 0 3px; border-radius: 2px; white-space: nowrap; box-shadow: 0 0 0 1px #fff; }`;
  const LABEL_HEIGHT = 15;
  let marks = null;

  const common = (a, b) =>
    Math.max(0, Math.min(a.right, b.right) - Math.max(a.left, b.left)) *
    Math.max(0, Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top));

  // Above the box where there is room, else at one of its corners: where it hides least of the other
  // elements, and no other label.
  const labelPlace = (box, width, labels, boxes) => {
    const [x, y, w, h] = box;
    const spots = [[x, y - LABEL_HEIGHT], [x + w - width, y - LABEL_HEIGHT], [x + w, y], [x - width, y],
      [x + w - width, y], [x, y], [x + w - width, y + h - LABEL_HEIGHT], [x, y + h]];
    let best = null;
    for (const [left, top] of spots) {
      const l = Math.max(0, Math.min(left, innerWidth - width));
      const t = Math.max(0, Math.min(top, innerHeight - LABEL_HEIGHT));
      const rect = { left: l, top: t, right: l + width, bottom: t + LABEL_HEIGHT };
      let cost = 0;
      for (const label of labels) cost += 10 * common(rect, label);
      for (const other of boxes) cost += common(rect, other);
      if (!best || cost < best.cost) best = { rect, cost };
      if (!cost) break;
    }
    labels.push(best.rect);
    return best.rect;
  };

  webgym.mark = (elements) => {
    webgym.unmark();
    const parent = document.querySelector('dialog[open]') || document.documentElement;
    const { host, root } = webgym.overlay(parent, MARK_STYLE);
    const labels = [];
    const boxes = elements.map(({ box: [x, y, w, h] }) => ({ left: x, top: y, right: x + w, bottom: y + h }));
    for (const { number, box } of elements) {
      const colour = COLOURS[number % COLOURS.length];
      const frame = webgym.make(document, 'div');
      frame.className = 'box';
      const [x, y, w, h] = [box[0] - BORDER, box[1] - BORDER, box[2] + 2 * BORDER, box[3] + 2 * BORDER];
      const [left, top] = [Math.max(0, x), Math.max(0, y)];
      const [right, bottom] = [Math.min(innerWidth, x + w), Math.min(innerHeight, y + h)];
      frame.style.cssText =
        `left:${left}px;top:${top}px;width:${right - left}px;height:${bottom - top}px;border-color:${colour}`;
      const label = webgym.make(document, 'div');
      label.className = 'label';
      label.textContent = number;
      const width = 6 + 7 * String(number).length;
      const place = labelPlace(box, width, labels, boxes);
      label.style.cssText = `left:${place.left}px;top:${place.top}px;background:${colour}`;
      root.append(frame, label);
    }
    marks = host;
  };

  webgym.unmark = () => {
    if (marks) marks.remove();
    marks = null;
  };
})();
