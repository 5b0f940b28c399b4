// Marks: a frame and a number over each element, drawn by the tab's own frame: in a layer of its own, so that nothing
// of the page is drawn again, and with as few elements as possible, which is what it costs.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.mark) return;
  const { documentElement, createElementNS, setAttribute } = webgym.dom;

  // Dark enough for white digits: a contrast of 4.5 at least.
  const COLOURS = ['#c62828', '#1565c0', '#2e7d32', '#6a1b9a', '#ad1457', '#00695c', '#4527a0', '#bf360c'];
  const BORDER = 2; // around the element, so that nothing of it is hidden
  // Sizes of a label, CSS pixels: the smaller one where the larger has no room. `advance`: from one digit to the next;
  // `scale`: of the digits below.
  const SIZES = [
    { height: 14, pad: 4, advance: 7.3, scale: 1.1 },
    { height: 10, pad: 3, advance: 5.5, scale: 0.8 },
  ];

  // Digits as lines, which cost far less than text: their width and height without that of the line, and paths from
  // their upper left corner.
  const DIGIT = [4, 7];
  const ROUND = {
    fill: 'none', stroke: '#fff', 'stroke-width': 1.6, 'stroke-linecap': 'round', 'stroke-linejoin': 'round',
  };
  const DIGITS = [
    'm0 2a2 2 0 0 1 4 0v3a2 2 0 0 1-4 0z',
    'm.8 1.6l1.7-1.6v7',
    'm0 2a2 2 0 0 1 4 0q0 1.2-1 2.3l-3 2.7h4',
    'm.2 1.2q.5-1.2 1.8-1.2a1.7 1.7 0 0 1 0 3.4h-.6h.6a1.9 1.8 0 0 1 0 3.6q-1.5 0-2-1.3',
    'm3.1 7v-7l-3.1 4.9h4.2',
    'm3.6 0h-3l-.4 3.2q.8-.6 1.8-.6a2.1 2.2 0 0 1 0 4.4q-1.4 0-2-1.2',
    'm3.6.5q-.6-.5-1.3-.5q-2.3 0-2.3 4.7a2 2.3 0 1 0 4 0a2 2.3 0 1 0-4 0',
    'm0 0h4l-2.6 7',
    'm.3 1.7a1.7 1.7 0 1 1 3.4 0a1.7 1.7 0 1 1-3.4 0zm-.3 3.5a2 1.8 0 1 1 4 0a2 1.8 0 1 1-4 0z',
    'm.4 6.5q.6.5 1.3.5q2.3 0 2.3-4.7a2 2.3 0 1 0-4 0a2 2.3 0 1 0 4 0',
  ];

  // Edges lie between pixels, where nothing is to be smoothed.
  const CRISP = { 'shape-rendering': 'crispEdges' };
  const SVG = 'http://www.w3.org/2000/svg';
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
      const width = Math.ceil(size.pad + size.advance * String(number).length);
      spot = spotFor(box, width, size.height, nearLabels, nearBoxes);
      if (!spot.hidden) break;
    }
    labels.push(spot.rect);
    return { size, hidden: spot.hidden, ...spot.rect };
  };

  // Edges between two pixels are blurred.
  const whole = (rect) => Object.fromEntries(Object.entries(rect).map(([side, at]) => [side, Math.round(at)]));

  // What is drawn of one colour is one path.
  const rectPath = ({ left, top, right, bottom }, edge) =>
    `M${left - edge} ${top - edge}H${right + edge}V${bottom + edge}H${left - edge}z`;
  // A frame around a box, at the edge of the viewport within it: what is walked around both ways is left out.
  const framePath = (box) => {
    const [x, y] = [Math.max(0, box.left - BORDER), Math.max(0, box.top - BORDER)];
    const w = Math.min(innerWidth, box.right + BORDER) - x;
    const h = Math.min(innerHeight, box.bottom + BORDER) - y;
    const [innerW, innerH] = [Math.max(0, w - 2 * BORDER), Math.max(0, h - 2 * BORDER)];
    return `M${x} ${y}h${w}v${h}h${-w}zm${BORDER} ${BORDER}v${innerH}h${innerW}v${-innerH}z`;
  };

  // In the units that the digits are given in.
  const digitPath = ({ left, right, top, bottom, number, size: { advance, scale } }) => {
    const digits = String(number);
    const start = (left + right - advance * (digits.length - 1)) / 2 / scale - DIGIT[0] / 2;
    const y = (top + bottom) / 2 / scale - DIGIT[1] / 2;
    return [...digits].map((digit, index) => `M${start + (index * advance) / scale} ${y}${DIGITS[digit]}`).join('');
  };

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
    draw(parent, 'path', { ...CRISP, fill: '#fff', d: labels.map((label) => rectPath(label, 1)).join('') });
    for (const [fill, d] of byColour(labels, (label) => rectPath(label, 0))) draw(parent, 'path', { ...CRISP, fill, d });
    for (const size of SIZES) {
      const d = labels.filter((label) => label.size === size).map(digitPath).join('');
      if (d) draw(parent, 'path', { ...ROUND, transform: `scale(${size.scale})`, d });
    }
  };

  // Gives the labels, {number, colour, size, left, top, right, bottom}.
  webgym.mark = (elements) => {
    webgym.unmark();
    if (!elements.length) return [];
    const boxes = elements.map(({ box: [x, y, w, h] }) => whole({ left: x, top: y, right: x + w, bottom: y + h }));
    const rects = [];
    const labels = elements.map(({ number }, index) => ({
      number, colour: COLOURS[number % COLOURS.length], box: boxes[index], ...labelFor(number, boxes[index], rects, boxes),
    }));
    const { host, root } = webgym.overlay(documentElement(document));
    const [attributes, place] = placeOver([...rects, ...boxes]);
    const svg = draw(root, 'svg', attributes);
    // A style attribute may be forbidden by the page's policy.
    svg.style.cssText = `position: fixed; will-change: transform; ${place}`;
    for (const [fill, d] of byColour(labels, ({ box }) => framePath(box))) draw(svg, 'path', { ...CRISP, fill, d });
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
