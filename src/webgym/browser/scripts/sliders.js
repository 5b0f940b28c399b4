// What a slider that takes keys holds: by its ARIA value, else by the number near it that follows it.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.readSlider) return;
  const {
    nodeType, childNodes, localName, getAttribute, getBoundingClientRect, matches, querySelector, querySelectorAll,
    tabIndex,
  } = webgym.dom;
  const { parentOf, contains } = webgym.geometry;

  const SLIDERS = ':is([role=slider],.ui-slider-handle)';
  webgym.isSlider = (element) => !['input', 'form'].includes(localName(element)) && matches(element, SLIDERS);
  // The slider that the mouse is on, if it takes keys and no field in it has the focus. It is given the focus, which
  // some pages leave elsewhere when a slider is clicked.
  webgym.pointedSlider = (focused) => {
    const slider = querySelector(document, `${SLIDERS}:hover`);
    if (!slider || !webgym.isSlider(slider)) return null;
    const taker = tabIndex(slider) < 0 ? querySelector(slider, '[tabindex="0"]') : slider; // of keys
    if (!taker) return null;
    if (taker === focused) return slider;
    if (focused && contains(slider, focused)) return null;
    taker.focus();
    return slider;
  };

  const NUMBER = /(?<![\w.])-?\d+(?:,\d{3})*(?:\.\d+)?/g;
  const numbersIn = (text) =>
    (text.replaceAll('\u2212', '-').match(NUMBER) || []).map((number) => Number(number.replaceAll(',', '')));
  // The one number in a text; NaN if there are none or several.
  webgym.numberIn = (text) => {
    const numbers = numbersIn(text);
    return numbers.length === 1 ? numbers[0] : NaN;
  };

  const LEVELS = 3; // ancestors among whose elements the number is looked for
  const MOST = 200; // elements of each
  const ownText = (element) => {
    if (['input', 'output'].includes(localName(element))) return element.value;
    const texts = [...childNodes(element)].filter((node) => nodeType(node) === Node.TEXT_NODE);
    return texts.map((node) => node.data).join(' ');
  };
  // The numbers near an element, by the element that shows them, the nearest first.
  const numbersNear = (element) => {
    const near = new Map();
    let around = parentOf(element);
    for (let level = 0; around && level < LEVELS; level++, around = parentOf(around))
      for (const one of [around, ...[...querySelectorAll(around, '*')].slice(0, MOST)])
        if (!near.has(one)) near.set(one, numbersIn(ownText(one)));
    return near;
  };

  // Where the middle of a handle lies on its track, in percent.
  const shareOf = (handle) => {
    const [own, track] = [getBoundingClientRect(handle), getBoundingClientRect(parentOf(handle))];
    const share =
      track.height > track.width
        ? (track.bottom - (own.top + own.bottom) / 2) / track.height
        : ((own.left + own.right) / 2 - track.left) / track.width;
    return Math.round(share * 1000) / 10;
  };

  let slider = null; // {element, near, shown, isShare}: `shown` says which number near it follows it
  const toldBy = (element) => parseFloat(getAttribute(element, 'aria-valuenow') ?? '');
  const read = () => {
    const { element, near, isShare } = slider;
    if (isShare) return shareOf(element);
    const told = toldBy(element);
    if (!Number.isNaN(told)) return told;
    for (const [one, before] of slider.shown ? [] : near) {
      const now = numbersIn(ownText(one));
      const changed = before.flatMap((number, index) => (number === now[index] ? [] : [index]));
      if (changed.length === 1 && now.length === before.length) {
        slider.shown = [one, changed[0]];
        break;
      }
    }
    return slider.shown ? numbersIn(ownText(slider.shown[0]))[slider.shown[1]] ?? null : null;
  };

  // What the slider is to be set to, and what it holds; null if that is not known before it moves.
  webgym.prepareSlider = (element, text) => {
    const wanted = webgym.numberIn(text);
    if (Number.isNaN(wanted)) return { kind: 'refused', why: `a slider does not take "${text}"; write a number` };
    const isShare = text.trim().endsWith('%') && Number.isNaN(toldBy(element));
    slider = { element, near: numbersNear(element), shown: null, isShare };
    return { kind: 'slider', wanted, value: read(), share: isShare };
  };

  const [LONGEST, BETWEEN] = [100, 10]; // ms
  // What the slider holds once that is not `before` any more, or does not change in time.
  webgym.readSlider = async (before) => {
    const end = performance.now() + LONGEST;
    let value = read();
    while ((value === null || value === before) && performance.now() < end) {
      await scheduler.postTask(() => {}, { delay: BETWEEN });
      value = read();
    }
    return { value };
  };
})();
