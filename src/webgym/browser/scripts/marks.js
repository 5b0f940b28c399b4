// Marks: a frame and a number over each element, drawn by the tab's own frame: in a layer of its own, so that nothing
// of the page is drawn again, and with as few elements as possible, which is what it costs.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.mark) return;
  const { documentElement, createElementNS, setAttribute } = webgym.dom;

  // Dark enough for white digits: a contrast of 4.5 at least.
  const COLOURS = ['#c62828', '#1565c0', '#2e7d32', '#6a1b9a', '#ad1457', '#00695c', '#4527a0', '#bf360c'];
  const BORDER = 2; // around the element, so that nothing of it is hidden
  const ROUND = 2; // radius of its corners, CSS pixels
  // Sizes of a label, CSS pixels: the smaller one where the larger has no room. Digits of a monospaced font
  // are 0.6 em wide everywhere.
  const SIZES = [{ font: 12, height: 14, pad: 4 }, { font: 9, height: 10, pad: 3 }];
  const FONT = 'ui-monospace, monospace';

  const SVG = 'http://www.w3.org/2000/svg';
  const MARK_STYLE = `
    :host { all: initial; }
    svg { position: fixed; will-change: transform; }
    .boxes { fill: none; stroke-width: ${BORDER}px; }
    text { fill: #fff; text-anchor: middle; dominant-baseline: central; }
    ${SIZES.map(({ font }) => `.of${font} { font: 700 ${font}px ${FONT}; }`).join('')}`;
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
    return { font: size.font, hidden: spot.hidden, ...spot.rect };
  };

  // Edges between two pixels are blurred.
  const whole = (rect) => Object.fromEntries(Object.entries(rect).map(([side, at]) => [side, Math.round(at)]));

  // What is drawn of one colour is one path.
  const boxPath = ({ left, top, right, bottom }) => {
    const inset = BORDER / 2;
    const [x, y] = [Math.max(inset, left - inset), Math.max(inset, top - inset)];
    const [w, h] = [Math.min(innerWidth, right + BORDER) - inset - x, Math.min(innerHeight, bottom + BORDER) - inset - y];
    const r = Math.max(0, Math.min(ROUND, w / 2, h / 2));
    const corner = (dx, dy) => `a${r} ${r} 0 0 1 ${dx} ${dy}`;
    return (
      `M${x + r} ${y}h${w - 2 * r}${corner(r, r)}v${h - 2 * r}${corner(-r, r)}` +
      `h${2 * r - w}${corner(-r, -r)}v${2 * r - h}${corner(r, -r)}z`
    );
  };
  const rectPath = ({ left, top, right, bottom }, edge) =>
    `M${left - edge} ${top - edge}H${right + edge}V${bottom + edge}H${left - edge}z`;

  const draw = (parent, name, attributes) => {
    const element = createElementNS(document, SVG, name);
    for (const [key, value] of Object.entries(attributes)) setAttribute(element, key, value);
    parent.append(element);
    return element;
  };
  // The layer is no larger than what is drawn on it.
  const placeOver = (rects) => {
    const far = (side, pick) => pick(...rects.map((rect) => rect[side]));
    const [left, top] = [far('left', Math.min), far('top', Math.min)].map((at) => Math.max(0, at - BORDER));
    const right = Math.min(innerWidth, far('right', Math.max) + BORDER);
    const bottom = Math.min(innerHeight, far('bottom', Math.max) + BORDER);
    const [width, height] = [right - left, bottom - top];
    return [{ width, height, viewBox: `${left} ${top} ${width} ${height}` }, `left: ${left}px; top: ${top}px`];
  };
  const byColour = (some, pathOf) => {
    const paths = new Map();
    for (const one of some) paths.set(one.colour, (paths.get(one.colour) || '') + pathOf(one));
    return paths;
  };
  // Labels that do not lie over each other.
  const drawLabels = (parent, labels) => {
    draw(parent, 'path', { fill: '#fff', d: labels.map((label) => rectPath(label, 1)).join('') });
    for (const [fill, d] of byColour(labels, (label) => rectPath(label, 0))) draw(parent, 'path', { fill, d });
    for (const { font } of SIZES) {
      const group = draw(parent, 'g', { class: `of${font}` });
      for (const { left, right, top, bottom, number } of labels.filter((label) => label.font === font))
        draw(group, 'text', { x: (left + right) / 2, y: (top + bottom) / 2 }).textContent = number;
    }
  };

  // Gives the labels, {number, colour, font, left, top, right, bottom}.
  webgym.mark = (elements) => {
    webgym.unmark();
    if (!elements.length) return [];
    const boxes = elements.map(({ box: [x, y, w, h] }) => whole({ left: x, top: y, right: x + w, bottom: y + h }));
    const rects = [];
    const labels = elements.map(({ number }, index) => ({
      number, colour: COLOURS[number % COLOURS.length], box: boxes[index], ...labelFor(number, boxes[index], rects, boxes),
    }));
    const { host, root } = webgym.overlay(documentElement(document), MARK_STYLE);
    const [attributes, place] = placeOver([...rects, ...boxes]);
    const svg = draw(root, 'svg', attributes);
    svg.style.cssText = place; // a style attribute may be forbidden by the page's policy
    for (const [stroke, d] of byColour(labels, ({ box }) => boxPath(box))) draw(svg, 'path', { class: 'boxes', stroke, d });
    let layer = []; // no frame is drawn over a label
    for (const label of labels) {
      if (label.hidden) drawLabels(svg, layer.splice(0));
      layer.push(label);
    }
    drawLabels(svg, layer);
    marks = host;
    return labels;
  };

  webgym.unmark = () => {
    if (marks) marks.remove();
    marks = null;
  };
})();
