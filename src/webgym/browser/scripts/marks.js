// Marks: a frame and a number over each element, drawn by the tab's own frame.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.mark) return;
  const { documentElement, make } = webgym.dom;

  // Dark enough for white digits: a contrast of 4.5 at least.
  const COLOURS = ['#c62828', '#1565c0', '#2e7d32', '#6a1b9a', '#ad1457', '#00695c', '#4527a0', '#bf360c'];
  const BORDER = 2; // around the element, so that nothing of it is hidden
  const MARK_STYLE = `
    :host { all: initial; }
    .box { position: fixed; box-sizing: border-box; border: ${BORDER}px solid; border-radius: 3px; }
    .label { position: fixed; box-sizing: border-box; text-align: center; color: #fff; border-radius: 2px;
      white-space: nowrap; overflow: hidden; box-shadow: 0 0 0 1px #fff; }`;

  // Sizes of a label, CSS pixels: the smaller one where the larger has no room. Digits of a monospaced font
  // are 0.6 em wide everywhere.
  const SIZES = [{ font: 12, height: 14, pad: 4 }, { font: 9, height: 10, pad: 3 }];
  const FONT = 'ui-monospace, monospace';
  let marks = null;

  const common = (a, b) =>
    Math.max(0, Math.min(a.right, b.right) - Math.max(a.left, b.left)) *
    Math.max(0, Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top));
  const sum = (rect, others) => others.reduce((area, other) => area + common(rect, other), 0);

  // Where a label goes: above the box if there is room, else where it hides least of other labels, then of
  // elements. {rect, hidden}: `hidden` is what it hides of other labels.
  const spotFor = (box, width, height, labels, boxes) => {
    const { left: x, top: y, right, bottom } = box;
    const spots = [
      [x, y - height], [right - width, y - height], [right, y], [x - width, y], [x, bottom], [right - width, bottom],
      [right - width, y], [x, y], [right - width, bottom - height], [x, bottom - height],
    ];
    let best = null;
    for (const [wantedX, wantedY] of spots) {
      const left = Math.max(0, Math.min(wantedX, innerWidth - width));
      const top = Math.max(0, Math.min(wantedY, innerHeight - height));
      const rect = { left, top, right: left + width, bottom: top + height };
      const hidden = sum(rect, labels);
      const cost = 10 * hidden + sum(rect, boxes) - common(rect, box) / 2; // rather its own than others
      if (!best || cost < best.cost) best = { rect, hidden, cost };
      if (!cost) break;
    }
    return best;
  };

  const REACH = 40; // pixels around a box, within which its label lies
  const CROWD = 12; // elements within reach, among which there is room for small labels only
  const labelFor = (number, box, labels, boxes) => {
    const around = {
      left: box.left - REACH, top: box.top - REACH, right: box.right + REACH, bottom: box.bottom + REACH,
    };
    const isNear = (other) => common(around, other) > 0;
    const [nearLabels, nearBoxes] = [labels.filter(isNear), boxes.filter(isNear)];
    let spot = null;
    let size = null;
    for (size of nearBoxes.length > CROWD ? SIZES.slice(1) : SIZES) {
      const width = Math.ceil(size.pad + size.font * 0.61 * String(number).length);
      spot = spotFor(box, width, size.height, nearLabels, nearBoxes);
      if (!spot.hidden) break;
    }
    labels.push(spot.rect);
    return { ...size, ...spot.rect };
  };

  webgym.mark = (elements) => {
    webgym.unmark();
    const { host, root } = webgym.overlay(documentElement(document), MARK_STYLE);
    const above = []; // no frame is drawn over a label
    const labels = [];
    const boxes = elements.map(({ box: [x, y, w, h] }) => ({ left: x, top: y, right: x + w, bottom: y + h }));
    elements.forEach(({ number }, index) => {
      const colour = COLOURS[number % COLOURS.length];
      const frame = make(document, 'div');
      frame.className = 'box';
      const { left, top, right, bottom } = boxes[index];
      const [x, y] = [Math.max(0, left - BORDER), Math.max(0, top - BORDER)];
      const [w, h] = [Math.min(innerWidth, right + BORDER) - x, Math.min(innerHeight, bottom + BORDER) - y];
      frame.style.cssText = `left:${x}px;top:${y}px;width:${w}px;height:${h}px;border-color:${colour}`;
      const label = make(document, 'div');
      label.className = 'label';
      label.textContent = number;
      const spot = labelFor(number, boxes[index], labels, boxes);
      label.style.cssText =
        `left:${spot.left}px;top:${spot.top}px;width:${spot.right - spot.left}px;height:${spot.height}px;` +
        `font:700 ${spot.font}px/${spot.height}px ${FONT};background:${colour}`;
      root.append(frame);
      above.push(label);
    });
    root.append(...above);
    marks = host;
  };

  webgym.unmark = () => {
    if (marks) marks.remove();
    marks = null;
  };
})();
