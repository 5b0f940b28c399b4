// Which elements can be used, and where: a control, what listens to the mouse, what its cursor gives away.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.targets) return;
  const {
    dispatchEvent, nodeType, parentNode, childNodes, textContent, getRootNode, localName, baseURI, getAttribute,
    getAttributeNames, hasAttribute, matches, closest,
    checkVisibility, getBoundingClientRect, getClientRects, previousElementSibling, nextElementSibling, children, childElementCount, querySelector,
    querySelectorAll, createRange, documentElement,
    offsetWidth, offsetHeight, tabIndex, ofKind, styleSheets, adoptedStyleSheets,
  } = webgym.dom;
  const { fold, rootOf, shorten } = webgym;
  const { labelsOf, isName } = webgym.labels;
  const { widgetOf, roleOf, nameOf, valueOf, isStructure } = webgym.roles;
  const { intersect, middle, moved, slotIn, parentOf, contains, hit, clipAround, isOpenInPage } = webgym.geometry;

  const contents = createRange(document);

  const firstOf = (list, most) => Array.prototype.slice.call(list, 0, most);

  // --- boxes --------------------------------------------------------------------------------------

  // Parts of a box in the order in which a click on their middle is tried.
  const parts = (box) => {
    const [x, y] = middle(box);
    const { left, top, right, bottom } = box;
    const [w, h] = [(right - left) / 4, (bottom - top) / 4];
    return [
      box,
      { left, top, right, bottom: y }, { left, top: y, right, bottom },
      { left, top, right: x, bottom }, { left: x, top, right, bottom },
      { left, top, right: x, bottom: y }, { left: x, top, right, bottom: y },
      { left, top: y, right: x, bottom }, { left: x, top: y, right, bottom },
      { left, top, right, bottom: top + h }, { left, top: bottom - h, right, bottom },
      { left, top, right: left + w, bottom }, { left: right - w, top, right, bottom },
    ];
  };
  const MAX_PARTS = 13;
  const LEAST_SIDE = 2; // pixels of a part that is worth a click

  const isArea = (element) => localName(element) === 'area';

  // The picture that an area of an image map lies on.
  const pictureOf = (area) => {
    const map = closest(area, 'map');
    const name = map && getAttribute(map, 'name');
    return name ? querySelector(getRootNode(area), `img[usemap="#${CSS.escape(name)}"]`) : null;
  };

  // The box around an area, in pixels of its picture: all of it where no shape is given.
  const shapeOf = (area, picture) => {
    const at = area.coords.split(/[\s,]+/).map(Number);
    const [x, y, radius] = at;
    if (area.shape === 'default' || at.length < 3) return [0, 0, offsetWidth(picture), offsetHeight(picture)];
    if (area.shape.startsWith('circ')) return [x - radius, y - radius, x + radius, y + radius];
    const [across, down] = [0, 1].map((axis) => at.filter((_, index) => index % 2 === axis));
    return [Math.min(...across), Math.min(...down), Math.max(...across), Math.max(...down)];
  };

  const areaRects = (area) => {
    const picture = pictureOf(area);
    if (!picture || !offsetWidth(picture)) return [];
    const rect = getBoundingClientRect(picture);
    const scale = rect.width / offsetWidth(picture);
    const [left, top, right, bottom] = shapeOf(area, picture).map((at) => at * scale);
    const box = { left: rect.left + left, top: rect.top + top, right: rect.left + right, bottom: rect.top + bottom };
    return [intersect(box, rect)].filter(Boolean);
  };

  // The slot of a text that a component holds directly: a point on it hits the component, not what is in it.
  const slotAt = (host, x, y) => {
    if (!rootOf(host)) return null;
    for (const node of childNodes(host)) {
      const slot = nodeType(node) === Node.TEXT_NODE ? node.assignedSlot || slotIn(host, node) : null;
      if (!slot) continue;
      contents.selectNodeContents(node);
      if ([...contents.getClientRects()].some((rect) => isIn([x, y], rect))) return slot;
    }
    return null;
  };

  const isHit = (element, box) => {
    const found = hit(...middle(box));
    if (!found) return false;
    if (contains(element, found) || contains(element, slotAt(found, ...middle(box)))) return true;
    const label = closest(found, 'label');
    return Boolean(label && label.control === element) && !closest(found, OF_LABEL);
  };
  const OF_LABEL = 'a[href],button,input,select,textarea'; // in a label, it keeps the clicks on it to itself

  // Does something lie over it that lets the mouse through, and is no part of it?
  const isVeiled = (element, part) => webgym.sight.isVeiledAt(element, ...middle(part), (veil) => contains(element, veil));

  const isIn = ([x, y], box) => box.left <= x && x <= box.right && box.top <= y && y <= box.bottom;

  const areaOf = (rect) => (rect.right - rect.left) * (rect.bottom - rect.top);

  // Where a click plays or pauses: of a film all of it but its bar, which fills a small one; of a sound the button that
  // its bar begins with, as wide as the bar is high.
  const isPlayer = (element) => /^(video|audio)$/.test(localName(element)) && hasAttribute(element, 'controls');
  const BAR = 80; // CSS pixels
  const playerPartOf = (player) => {
    const { left, top, right, bottom } = getBoundingClientRect(player);
    const height = bottom - top;
    if (localName(player) === 'audio') return { left, top, right: Math.min(right, left + height), bottom };
    return { left, top, right, bottom: height < 2 * BAR ? top + Math.max(height / 4, height - BAR) : bottom };
  };

  // The boxes of an element; those of its children where it has none itself, as around a floated picture.
  const rectsOf = (element, depth = 0) => {
    if (isArea(element)) return areaRects(element);
    if (isPlayer(element)) return [playerPartOf(element)];
    const rects = [...getClientRects(element)].filter((rect) => areaOf(rect) >= 1);
    if (rects.length || depth > 3) return rects;
    const within = firstOf(children(rootOf(element) || element), 8).flatMap((child) => rectsOf(child, depth + 1));
    if (within.length || getComputedStyle(element).display !== 'contents') return within;
    contents.selectNodeContents(element);
    return [...contents.getClientRects()].filter((rect) => areaOf(rect) >= 1);
  };

  // The handle of a slider: where two sliders lie on each other, often nothing else of them takes the mouse.
  const HANDLE_WIDTH = 16; // CSS pixels
  const handleOf = (element, { left, top, right, bottom }, map) => {
    if (localName(element) !== 'input' || element.type !== 'range') return [];
    const [min, max] = [Number(element.min || 0), Number(element.max || 100)];
    const share = max > min ? (element.value - min) / (max - min) : 0;
    const at = left + (getComputedStyle(element).direction === 'rtl' ? 1 - share : share) * (right - left - HANDLE_WIDTH);
    return [moved({ left: at, top, right: at + HANDLE_WIDTH, bottom }, map)];
  };

  // The first parts of an element that a click reaches, `most` of them, seen from this frame.
  const visibleParts = (element, place, most) => {
    const found = [];
    let around = null;
    for (const rect of rectsOf(element).sort((a, b) => areaOf(b) - areaOf(a)).slice(0, 3)) {
      if (!intersect(moved(rect, place.map), place.clip)) continue;
      around = around || clipAround(isArea(element) ? pictureOf(element) : element);
      const own = intersect(rect, around);
      const box = own && intersect(moved(own, place.map), place.clip);
      for (const part of box ? [...parts(box), ...handleOf(element, rect, place.map)] : [])
        if (part.right - part.left >= LEAST_SIDE && part.bottom - part.top >= LEAST_SIDE && isHit(element, part) && (place.map || !isVeiled(element, part))) {
          found.push(part);
          if (found.length === most) return found;
        }
    }
    return found;
  };

  // Days and items that are not offered are named so, or the cursor says it. A native control is on unless it is
  // disabled, whatever its class.
  const isOff = (element) =>
    matches(element, ':disabled') || getAttribute(element, 'aria-disabled') === 'true' || isOfHostOff(element) ||
    (!matches(element, NATIVE) && (matches(element, OFF) || isNamedOff(element) || /not-allowed|no-drop/.test(getComputedStyle(element).cursor)));
  const OFF = '[disabled]:not([disabled=false]),[data-disabled]:not([data-disabled=false])'; // of components
  const NATIVE = 'a[href],area,button,input,select,textarea,option,summary';
  const isOfHostOff = (element) => {
    const { host } = getRootNode(element);
    return Boolean(host) && (matches(host, OFF) || isOfHostOff(host));
  };
  const isNamedOff = (element) =>
    (getAttribute(element, 'class') || '')
      .split(/\s+/)
      .some((name) => /(^|[_-])(disabled|unavailable)$/i.test(name) && !/(^|[_-])(not|non)[_-]/i.test(name));

  // What is written on an item that is named as not offered; its arrow may open what is below.
  const ITEM = '[role=treeitem],[role=option]';
  const isOfItemOff = (element) => {
    const item = closest(element, ITEM);
    return Boolean(item) && item !== element && isOff(item) && Boolean(nameOf(element, 'button')) && !querySelector(item, ITEM);
  };

  const isShown = (element) => checkVisibility(element, { visibilityProperty: true, opacityProperty: true });

  // Controls that pages hide to draw their own.
  const isTick = (element) =>
    localName(element) === 'input' && (element.type === 'checkbox' || element.type === 'radio');

  // Whether a label of one that is out of view is in view.
  const hasLabelIn = (element, place) => {
    const isInView = (rect) => intersect(moved(rect, place.map), place.clip);
    return isTick(element) && labelsOf(element).some((label) => rectsOf(label).some(isInView));
  };

  // Even where they are not displayed at all.
  const answersItsLabel = (element) => isTick(element) || (localName(element) === 'input' && element.type === 'file');

  // What takes the place of a field that is too small to be seen: the part of an editor that text is written in.
  const EDITOR_DEPTH = 6;
  const editorAround = (field, place, most) => {
    let around = parentOf(field);
    for (let depth = 0; around && depth < EDITOR_DEPTH; depth++, around = parentOf(around)) {
      const isWritten = (part) => {
        const found = hit(...middle(part));
        return found && !FIELDS.has(localName(found)) && getComputedStyle(found).cursor === 'text';
      };
      const found = visibleParts(around, place, MAX_PARTS).filter(isWritten);
      if (found.length) return found.slice(0, most);
    }
    return [];
  };
  const FIELDS = new Set(['input', 'textarea', 'select']);

  const hasPaint = (style) =>
    style.backgroundImage !== 'none' || !/^rgba\(.*, 0\)$/.test(style.backgroundColor) || style.borderTopWidth !== '0px';

  // What comes before and after it, but for spaces that only keep room free.
  const hasParts = (element) =>
    ['::before', '::after'].some((part) => {
      const style = getComputedStyle(element, part);
      return style.content !== 'none' && !(/^"\s+"$/.test(style.content) && !hasPaint(style));
    });

  const isOfLabelOf = (element) => (part) => {
    const found = hit(...middle(part));
    return Boolean(found) && [null, element].includes(closest(found, OF_LABEL));
  };

  // A field for a hint, or for what is sent, below the one that is typed into: neither keys nor the mouse get there.
  const isDecoy = (element) => tabIndex(element) < 0 && !answersItsLabel(element);

  // What is clicked instead of a control that is not seen itself: its label, what is drawn over it or around.
  const standIn = (element, place, most) => {
    if (localName(element) === 'textarea' && getClientRects(element).length) return editorAround(element, place, most);
    if (localName(element) !== 'input' && localName(element) !== 'select') return [];
    for (const label of isDecoy(element) ? [] : labelsOf(element)) {
      const found = isShown(label) ? visibleParts(label, place, MAX_PARTS).filter(isOfLabelOf(element)) : [];
      if (found.length) return found.slice(0, most);
    }
    let parent = parentOf(element);
    const isInComponent = (node) => node && getRootNode(node).host;
    while (isInComponent(element) && isInComponent(parent) && !isShown(parent)) parent = parentOf(parent);
    const isDrawn =
      parent && (rootOf(parent) || childElementCount(parent) > 1 || hasParts(parent)) && isShown(parent);
    return isDrawn ? visibleParts(element, place, most) : [];
  };

  // --- what can be used ---------------------------------------------------------------------------

  // Selectors of rules that show a pointer under the mouse alone, as if the mouse were everywhere.
  const hoverSelectors = (rules, outer) =>
    [...rules].flatMap((rule) => {
      if (rule.media && !matchMedia(rule.media.mediaText).matches) return [];
      const text = (rule.selectorText || outer).replaceAll('&', `:is(${outer})`);
      const own = rule.style?.cursor === 'pointer' && text.includes(':hover') ? [text.replaceAll(':hover', ':is(*)')] : [];
      return [...own.filter((one) => CSS.supports(`selector(${one})`)), ...hoverSelectors(rule.cssRules || [], text)];
    });

  const known = new WeakMap(); // by style sheet: how many rules it had, and their selectors
  const selectorsOf = (sheet) => {
    if (sheet.disabled || (sheet.media.length && !matchMedia(sheet.media.mediaText).matches)) return [];
    let rules;
    try {
      rules = sheet.cssRules;
    } catch {
      return []; // another origin's
    }
    if (known.get(sheet)?.count !== rules.length)
      known.set(sheet, { count: rules.length, selectors: hoverSelectors(rules, ':scope') });
    return known.get(sheet).selectors;
  };

  const AIMED = new Set(['pointer', 'cell']);
  let hovers = new Map(); // by document or shadow root: the selectors in this look, null if there are none
  const showsPointer = (element, style) => {
    if (AIMED.has(style.cursor)) return true;
    if (style.cursor === 'crosshair') return isAimedAt(element);
    const root = getRootNode(element);
    if (!hovers.has(root)) {
      const sheets = nodeType(root) === Node.ELEMENT_NODE ? [] : [...styleSheets(root), ...adoptedStyleSheets(root)];
      hovers.set(root, sheets.flatMap(selectorsOf).join(',') || null);
    }
    return hovers.get(root) !== null && matches(element, hovers.get(root));
  };

  // A crosshair is for drags, too, such as that of a line from one box to another.
  const isAimedAt = (element) => {
    const around = parentOf(element);
    if (around && getComputedStyle(around).cursor === 'crosshair') return isAimedAt(around);
    return hears(element) || Boolean(nameOf(element, 'button'));
  };

  // What only its script and its cursor make clickable is found by them.
  const UNMARKED = new Set(['label', 'html', 'body', 'slot']);
  const startsPointer = (element, style) => {
    if (UNMARKED.has(localName(element)) || !showsPointer(element, style)) return false;
    const around = parentOf(element);
    return !around || !showsPointer(around, getComputedStyle(around));
  };

  // Is a press of the mouse on this element, or document, heard by it? The page's own world answers (listeners.js).
  const isHeardAt = (node) => {
    if (!answers.has(node)) answers.set(node, ask(node, false));
    return answers.get(node);
  };
  const ask = (node, bubbles) =>
    !dispatchEvent(node, new Event(webgym.question, { cancelable: true, composed: true, bubbles }));
  let answers = new Map(); // by element or document, in this look
  const hears = (element) => {
    if (/\bclick\b/.test(getAttribute(element, 'jsaction') || '')) return true;
    return !UNMARKED.has(localName(element)) && getRootNode(element).mode !== 'closed' && isHeardAt(element);
  };

  // Is it only dragged? Its cursor says so, it hears no more than the button going down, and it is no small handle,
  // whose track would hear that, too.
  const GRIPS = /^(grab|grabbing|move|all-scroll|[a-z]+-resize)$/;
  const HANDLE = 24; // pixels of its shorter side
  const isGrip = (element, style) => {
    if (!GRIPS.test(style.cursor) || ask(element, true)) return false;
    const { width, height } = getBoundingClientRect(element);
    return Math.min(width, height) > HANDLE;
  };

  // A cell of a sheet: its text cannot be selected, the sheet or one of its cells takes the focus, and something around
  // listens, be it the document.
  const CELL = 'td,th,[role=gridcell],[role=cell]';
  const sheetOf = (element, style) => {
    const sheet = style.userSelect === 'none' && matches(element, CELL) && closest(element, '[tabindex]');
    if (sheet) return sheet;
    const grid = getAttribute(element, 'role') === 'gridcell' && closest(element, '[role=grid],[role=treegrid]');
    return grid && querySelectorAll(grid, '[role=gridcell][tabindex]').length === 1 ? grid : null;
  };
  const isCell = (element, style) => {
    const sheet = sheetOf(element, style);
    if (!sheet || sheet === element) return false;
    if (!sheets.has(sheet)) {
      let around = sheet;
      while (around && !isHeardAt(around)) around = parentNode(around);
      sheets.set(sheet, Boolean(around));
    }
    return sheets.get(sheet);
  };
  let sheets = new Map(); // what takes the focus, and whether it or something around it listens; in this look

  // A day of a calendar, say: made to take the focus, and a box close around it listens for all.
  const isHeardAround = (element) => {
    if (getAttribute(element, 'tabindex') !== '-1' || childElementCount(element) || isStructure(element)) return false;
    const parent = parentOf(element);
    if (!parent || isCarousel(parent)) return false;
    return hears(parent) || Boolean(parentOf(parent) && hears(parentOf(parent)));
  };

  const FILLS = 0.9; // of its parent's box: what it holds is what the parent holds
  const FILL_DEPTH = 5;
  const fillsOf = (element) => {
    const area = areaOf(getBoundingClientRect(element));
    const inner = firstOf(children(element), FILL_CHILDREN);
    return inner.filter((child) => areaOf(getBoundingClientRect(child)) >= FILLS * area);
  };
  const FILL_CHILDREN = 3;

  // What slides lie in listens, to be dragged, and is named so. What can be clicked on a slide, or is one, says so itself.
  const CAROUSEL = new RegExp(
    '^(slick-(list|track|slider)|swiper(-wrapper|-container)?|splide(__(track|list|slider))?|glide(__(track|slides))?|' +
    'flickity-(enabled|viewport|slider)|embla(__(viewport|container))?|keen-slider|siema|tns-(inner|ovh|slider|carousel)|' +
    'carousel(-(inner|track|viewport))?)$', 'i');
  const isCarousel = (element) => Boolean(classLike(element, CAROUSEL));

  const ITEMS = 3; // of one kind, and of one size: then not what is around them is meant
  const itemsOf = (element, depth = 0) => {
    if (isCarousel(element)) return [];
    const fills = depth < FILL_DEPTH ? fillsOf(element) : [];
    for (const fill of fills) {
      const found = itemsOf(fill, depth + 1);
      if (found.length) return found;
    }
    return fills.length ? [] : alikeIn([...children(element)]);
  };
  const alikeIn = (all) => {
    const inner = [...all];
    if (keepsRoom(inner[0], inner[1])) inner.shift();
    if (keepsRoom(inner.at(-1), inner.at(-2))) inner.pop();
    if (inner.length < ITEMS) return [];
    const [{ width, height }, name] = [getBoundingClientRect(inner[0]), localName(inner[0])];
    const isAlike = (child) => {
      const rect = getBoundingClientRect(child);
      const isTall = localName(child) === name && Math.abs(rect.height - height) <= 2 && !widgetOf(child);
      return isTall && (Math.abs(rect.width - width) <= 2 || isBar(child));
    };
    const isWhole = width >= 8 && height >= 8 && inner.every(isAlike);
    return isWhole && !GRIPS.test(getComputedStyle(inner[0]).cursor) ? inner : [];
  };

  // What a list that draws only what is in view puts before or after it: of another size, and nothing is to be seen.
  const keepsRoom = (element, beside) => {
    if (!beside || childElementCount(element) || textContent(element).trim()) return false;
    const isAsTall = Math.abs(getBoundingClientRect(element).height - getBoundingClientRect(beside).height) <= 2;
    return !isAsTall && !hasPaint(getComputedStyle(element)) && !hasParts(element);
  };

  // One of several things with a name that lie in a box by themselves, as long as each is: a bar of a plan.
  const isBar = (element) => {
    const style = getComputedStyle(element);
    const isPlaced = style.position === 'absolute' && style.userSelect === 'none';
    return isPlaced && hasPaint(style) && Boolean(textContent(element).trim());
  };

  // Is this text that the mouse would select, with nothing to say that it is clicked?
  const isPlainText = (element, style) =>
    style.cursor === 'auto' && style.userSelect !== 'none' && !ofKind(element, 'ownerSVGElement') &&
    Boolean(nameOf(element, 'button'));

  // Is there a pointer on others of its kind, as tall as it is? Then the page says by the cursor what is clicked.
  const CELLS = 'td,th,tr';
  const MOST_KINDRED = 200;
  let pointed = new Map(); // by parent or table: the kinds that have a pointer; in this look
  const hasPointedKin = (element) => {
    const table = matches(element, CELLS) && closest(element, 'table');
    const [around, kind] = table ? [table, CELLS] : [parentOf(element), kindOf(element)];
    if (!around) return false;
    if (!pointed.has(around)) {
      const kin = firstOf(table ? querySelectorAll(table, CELLS) : children(rootOf(around) || around), MOST_KINDRED);
      pointed.set(around, new Set(kin.filter(isPointed).map((one) => (table ? CELLS : kindOf(one)))));
    }
    return pointed.get(around).has(kind);
  };
  const kindOf = (element) => `${localName(element)} ${Math.round(getBoundingClientRect(element).height)}`;
  const isPointed = (element) => showsPointer(element, getComputedStyle(element));

  // Is this text that takes the pointer of what is around it away?
  const isUnpointed = (element, style) =>
    style.cursor === 'default' && Boolean(nameOf(element, 'button')) && isPointed(parentOf(element) || element);

  // Is this one of a list most of which have a part with a pointer, and has none: a day of the next month, say?
  const isLeftOut = (element) => {
    const around = parentOf(element);
    if (!partly.has(around)) {
      const all = firstOf(children(rootOf(around) || around), MOST_KINDRED);
      partly.set(around, 2 * all.filter(hasPointedPart).length > all.length);
    }
    return partly.get(around) && !hasPointedPart(element);
  };
  const hasPointedPart = (element) => firstOf(children(element), MOST_PARTS).some(isPointed);
  let partly = new Map(); // by what is around a list: whether most of its items have such a part; in this look

  // Is this drawn in one line with a part of the same thing that is written on? Both have the pointer, and neither
  // listens itself.
  const isDrawnBehind = (element) => {
    if (nameOf(element, 'button') || hears(element)) return false;
    const { left, right } = getBoundingClientRect(element);
    const isOver = (one) => {
      const rect = getBoundingClientRect(one);
      return Math.abs(rect.left + rect.right - left - right) <= rect.width;
    };
    const isSame = (one) => one !== element && isOver(one) && isPointed(one) && Boolean(nameOf(one, 'button')) && !hears(one);
    const around = parentOf(element);
    return Boolean(around) && firstOf(children(around), MOST_PARTS).some(isSame);
  };
  const MOST_PARTS = 5;

  // What shows what is drawn or listed beside it, and only listens, with no pointer: the labels of an axis of a
  // drawing, the names of days above a calendar, and its fields without a day.
  const isIdlePart = (element) => {
    let around = parentOf(element);
    for (let n = 0; around && n < WRAPPERS && childElementCount(around) === 1; n++) around = parentOf(around);
    if (!around || childElementCount(around) < LEAST_ROW) return false;
    if (!rows.has(around)) rows.set(around, kindOfRow([...children(around)].slice(0, MOST_KINDRED)));
    const row = rows.get(around);
    return row === 'days' ? !textContent(element).trim() : row !== null;
  };
  const [LEAST_ROW, WRAPPERS] = [5, 2];
  let rows = new Map(); // by what is around them; in this look
  const kindOfRow = (row) => {
    const texts = row.map((one) => textContent(one).trim());
    if (row.every((one) => localName(one) === 'text')) return isAligned(row) ? 'axis' : null;
    if (row.length <= 8 && texts.filter(isNamedDay).length >= LEAST_ROW && texts.every((text) => !text || isNamedDay(text)))
      return 'names';
    const days = texts.filter((text) => /^([1-9]|[12]\d|3[01])$/.test(text)).length;
    return days >= 28 && 3 * days >= row.length ? 'days' : null;
  };
  const isAligned = (row) => {
    const rects = row.map(getBoundingClientRect);
    return ['top', 'bottom', 'left', 'right'].some((side) => rects.every((rect) => Math.abs(rect[side] - rects[0][side]) <= 2));
  };
  // "Mon", "Monday 9", "Mo 3/9", in the language of the page or in English.
  const namesOfDays = new Map();
  const isNamedDay = (text) => {
    const language = getAttribute(documentElement(document), 'lang') || 'en';
    if (!namesOfDays.has(language)) namesOfDays.set(language, daysIn(language));
    const word = (/\p{L}+/u.exec(text.slice(0, LONGEST_DAY)) || [''])[0].toLowerCase();
    return text.length <= LONGEST_DAY && word.length > 1 && namesOfDays.get(language).some((name) => name.startsWith(word));
  };
  const LONGEST_DAY = 24; // characters, with a date
  const daysIn = (language) => {
    const of = (one) => {
      const { format } = new Intl.DateTimeFormat(one, { weekday: 'long', timeZone: 'UTC' });
      return [1, 2, 3, 4, 5, 6, 7].map((day) => format(new Date(Date.UTC(2024, 0, day))).toLowerCase());
    };
    try {
      return [...of('en'), ...of(language)];
    } catch {
      return of('en'); // no language that is known
    }
  };

  // A part of a label does what the field that it labels does, which is numbered itself.
  const isOfLabel = (element) => {
    const label = closest(element, 'label');
    const isOfField = label && label !== element && label.control && FIELDS.has(localName(label.control));
    return Boolean(isOfField) && !hears(element);
  };
  // Nor is the label of a box that the focus stops at, such as a button that stays down.
  const isLabelOfTick = (element) =>
    localName(element) === 'label' && !hasAttribute(element, 'role') && Boolean(element.control) && isTick(element.control);

  // Nor is a component that is the label of another element.
  const isLabelFor = (element) => localName(element).includes('-') && Boolean(getAttribute(element, 'for'));

  // The class or part of an element that fits `pattern`, one of several such words in a name: `listArrow`, `tree-arrow`.
  const classLike = (element, pattern) =>
    `${getAttribute(element, 'class') || ''} ${getAttribute(element, 'part') || ''}`
      .split(/\s+/)
      .find((name) => pattern.test(name.replace(/([a-z])(?=[A-Z])/g, '$1-')));

  // Does the next element around it that listens do so for several of this selector?
  const AROUND = 12; // elements
  const isHeardFor = (element, kind) => {
    let around = parentOf(element);
    for (let n = 0; around && n < AROUND; n++, around = parentOf(around)) if (hears(around)) return hasSeveral(around, kind);
    return false;
  };
  let several = new Map(); // by element and selector, in this look
  const hasSeveral = (around, kind) => {
    if (!several.has(around)) several.set(around, {});
    return (several.get(around)[kind] ??= querySelectorAll(around, kind).length > 1);
  };

  // A heading that says that its column is sorted by it.
  const HEADING = 'th,[role=columnheader]';
  const SORTABLE = /(?<![a-z]|(^|[_-])(no|not|non)[_-])sortable$/i;
  const isSorter = (element) =>
    matches(element, HEADING) && (hasAttribute(element, 'aria-sort') || Boolean(classLike(element, SORTABLE))) &&
    Boolean(nameOf(element, 'button')) && !hasPointedKin(element) && isHeardFor(element, HEADING);

  // An icon by which a part of a row is used: its box to tick, its arrow, or that of a cell.
  const ICON = /(?<![a-z])(checkbox|expander|expand|toggle|toggler|twisty|collapse|remove|close|delete|trash)(?![a-z])/i;
  const ARROW = /(?<![a-z])arrow(?![a-z])/i;
  const WHOLE_ROLES = 'button link tab option combobox checkbox radio switch menuitem menuitemcheckbox menuitemradio';
  const UNDIVIDED = ['a,button,summary,label', ...WHOLE_ROLES.split(' ').map((role) => `[role=${role}]`)].join(',');
  const isIcon = (element) => {
    if (childElementCount(element)) return false;
    const name = classLike(element, ICON) || (closest(element, CELL) && classLike(element, ARROW));
    if (!name || /[\p{L}\p{N}]/u.test(textContent(element)) || closest(element, UNDIVIDED)) return false;
    return isHeardFor(element, `.${CSS.escape(name)}`);
  };

  // One of several of a kind that bear data by which the script around them tells which one was clicked.
  const TELLING = /^data-(.*-)?(node|row|col|item)?(id|key|code|index|value|date|time|day|month|year)$/;
  const isToldByData = (element, style) => {
    const isOfColumn = (name) => name.includes('col') && matches(element, HEADING); // a name for all that is below it
    const isTelling = (name) => TELLING.test(name) && getAttribute(element, name) && !isOfColumn(name);
    const names = getAttributeNames(element).filter(isTelling);
    if (!names.length || style.cursor === 'text' || isPlainText(element, style) || closest(element, `${UNDIVIDED},[contenteditable]`)) return false;
    if (!ofKind(element, 'ownerSVGElement') && !nameOf(element, 'button')) return false; // a background
    let around = parentOf(element);
    for (let n = 0; around && n < AROUND && !hearsClicks(around); n++) around = parentOf(around);
    if (!around || !hearsClicks(around) || isCarousel(around)) return false;
    const scope = getRootNode(around) === getRootNode(element) ? around : getRootNode(element);
    const [first] = (getAttribute(element, 'class') || '').trim().split(/\s+/);
    const kind = CSS.escape(localName(element)) + (first && `.${CSS.escape(first)}`);
    return names.some((name) => areApart(scope, `${kind}[${CSS.escape(name)}]`, name));
  };
  const areApart = (scope, kind, name) => {
    if (!told.has(scope)) told.set(scope, {});
    const values = () => firstOf(querySelectorAll(scope, kind), MOST_KINDRED).map((one) => getAttribute(one, name));
    const isOfEach = (all) => all.length >= ITEMS && new Set(all).size === all.length;
    return (told.get(scope)[kind] ??= isOfEach(values()));
  };
  let told = new Map(); // by scope and selector: does each have a value of its own? In this look
  const hearsClicks = (element) => {
    if (!clicks.has(element)) clicks.set(element, hears(element) && ask(element, true));
    return clicks.get(element);
  };
  let clicks = new Map(); // by element, in this look

  // A shape of a chart that hears clicks for all that it shows, and has no pointer on any of it.
  const SHAPES = 'path,rect,circle,ellipse,polygon';
  const [LEAST_CHART, LEAST_SHAPE, MOST_SHAPES, CHART_DEPTH] = [100, 6, 60, 3]; // CSS pixels, pixels, shapes, elements
  const isShape = (element) => {
    let chart = ofKind(element, 'ownerSVGElement');
    if (!chart || !matches(element, SHAPES)) return false;
    for (let outer = chart; outer; outer = ofKind(outer, 'ownerSVGElement')) chart = outer;
    if (!charts.has(chart)) charts.set(chart, isChart(chart) ? shapesIn(chart) : new Set());
    return charts.get(chart).has(element);
  };
  let charts = new Map(); // by drawing: its shapes; in this look
  const isChart = (svg) => {
    const { width, height } = getBoundingClientRect(svg);
    if (Math.min(width, height) < LEAST_CHART || !querySelector(svg, 'text') || closest(svg, UNDIVIDED)) return false;
    let around = svg;
    for (let n = 0; around && n < CHART_DEPTH && !hearsClicks(around); n++) around = parentOf(around);
    return Boolean(around) && hearsClicks(around);
  };
  const shapesIn = (svg) => {
    const all = [...querySelectorAll(svg, SHAPES)];
    const most = LARGE * areaOf(getBoundingClientRect(svg));
    const isFilled = (shape) => {
      const { fill, fillOpacity } = getComputedStyle(shape);
      const rect = getBoundingClientRect(shape);
      return fill !== 'none' && fillOpacity !== '0' && !/, 0\)$/.test(fill) &&
        Math.min(rect.width, rect.height) >= LEAST_SHAPE && areaOf(rect) <= most;
    };
    const isHeardIn = (shape) => {
      let around = shape;
      while (around !== svg && !hears(around)) around = parentOf(around);
      return around !== svg;
    };
    const found = all.length <= MOST_CHART ? all.filter(isFilled) : [];
    if (found.length > MOST_SHAPES || found.some((one) => isPointed(one) || isHeardIn(one))) return new Set();
    return new Set(found);
  };
  const MOST_CHART = 500; // shapes of any kind

  // A field of a month whose days are written over it: blank, one of seven in a row, and its presses are heard by the
  // document.
  const isDayField = (element, style) => {
    const week = parentNode(element);
    if (childElementCount(week) !== 7 || !isBlankIn(element) || style.userSelect !== 'none') return false;
    if (!weeks.has(week)) weeks.set(week, isWeek(week));
    return weeks.get(week);
  };
  const isBlankIn = (element) => !childElementCount(element) && !textContent(element).trim();
  let weeks = new Map(); // by what may be a week of fields; in this look
  const LEAST_WEEKS = 4;
  const isWeek = (week) => {
    const month = nodeType(week) === Node.ELEMENT_NODE && parentOf(parentOf(week) || week);
    if (!month || childElementCount(month) < LEAST_WEEKS || !isHeardAt(document)) return false;
    const fields = [...children(week)];
    return alikeIn(fields).length === 7 && fields.every(isBlankIn);
  };

  // What is drawn for a box to tick right beside it, which its page hides: the label beside it is clicked.
  const isBoxOfTick = (element, place) => {
    const tick = [previousElementSibling(element), nextElementSibling(element)].find((one) => one && isTick(one));
    if (!tick || nameOf(element, 'button') || visibleParts(tick, place, 1).length) return false;
    return labelsOf(tick).some((label) => isShown(label) && visibleParts(label, place, 1).length > 0);
  };

  // The native field that a component keeps for forms, beside what takes its place.
  const TWINS = '[role=checkbox],[role=radio],[role=switch]';
  const isTwin = (element) => {
    const isHidden = () => getAttribute(element, 'aria-hidden') === 'true' && tabIndex(element) < 0;
    if (!isTick(element) || (getClientRects(element).length && !isHidden())) return false;
    const isOther = (one) => one && (matches(one, TWINS) || (childElementCount(one) === 1 && isOther(children(one)[0])));
    return [previousElementSibling(element), nextElementSibling(element)].some(isOther);
  };

  // {element, place, role, isControl, isPointer, isText, isPart, isTold, items, kids, boxes}: `isText` if nothing is seen
  // of what listens, `isPart` if something around listens for this part of a row, `isTold` if for what bears such data,
  // `kids` are the candidates in it, `items` those of its children that are candidates because of it.
  const candidateOf = (element, place, style, isItem) => {
    const role = roleOf(element);
    const isControl = Boolean(role && widgetOf(element));
    const isPointer = Boolean(style && startsPointer(element, style));
    const isPart = Boolean(style) && !role && !isItem && (isIcon(element) || isSorter(element));
    const isTold =
      Boolean(style) && !role && !isPointer &&
      (isToldByData(element, style) || isShape(element) || isDayField(element, style));
    const isUsed = () => isItem || isPart || isTold || hears(element) || isHeardAround(element) || isCell(element, style);
    if (!role && !isPointer && !(style && isUsed())) return null;
    if (isOff(element) || (!isControl && isOfItemOff(element)) || (!isControl && isOfLabel(element)) || isLabelOfTick(element)) return null;
    if (!role && (isLabelFor(element) || (!isPointer && isName(element)))) return null;
    if (isTwin(element) || (!role && isBoxOfTick(element, place))) return null;
    const isText = !role && !isPointer && isPlainText(element, style);
    if (isText && hasPointedKin(element)) return null;
    if (!role && isUnpointed(element, style)) return null;
    if (isItem && !role && !isPointer && !hears(element) && isLeftOut(element)) return null;
    if (isPointer && !role && isDrawnBehind(element)) return null;
    const isPlain = !role && !isPointer && !isPart && !isCell(element, style);
    if (isPlain && (isGrip(element, style) || isIdlePart(element) || isCarousel(element))) return null;
    const isList = role === 'listbox' && localName(element) !== 'select';
    if (isList && !hasAttribute(element, 'aria-expanded')) return null; // its options are what one clicks
    const list = role === 'option' && localName(element) === 'option' ? closest(element, 'select') : null;
    if (list && roleOf(list) !== 'listbox' && !isOpenInPage(list)) return null;
    const items = new Set(isControl ? [] : itemsOf(element));
    const heard = isPart || isTold || undefined;
    return {
      element, place, role: isList ? 'combobox' : role || 'button', isControl, isPointer, isText, isPart, isTold, heard, items, kids: [],
      boxes: [],
    };
  };

  const locate = (one, most) => {
    const { element, place } = one;
    one.boxes = isShown(element) || !getClientRects(element).length ? visibleParts(element, place, most) : [];
    if (!one.boxes.length) one.boxes = standIn(element, place, most);
    return one.boxes.length > 0;
  };

  const rectOf = ({ element, place }) => {
    const rect = moved(getBoundingClientRect(element), place.map);
    return intersect(rect, place.clip) || rect;
  };
  // What the boxes that it lies in leave of it.
  const areaLeft = ({ element, place }, box) => {
    const left = intersect(getBoundingClientRect(element), clipAround(element));
    return areaOf((left && intersect(moved(left, place.map), place.clip)) || box);
  };
  // What is clicked of one that has others in it lies beside them.
  const placeBeside = (one, kids) => {
    const isFree = (box) => !kids.some((kid) => isIn(middle(box), kid.boxes[0]));
    if (isFree(one.boxes[0])) return true;
    one.boxes = visibleParts(one.element, one.place, MAX_PARTS).filter(isFree);
    return one.boxes.length > 0;
  };

  const NOTHING = { left: 0, top: 0, right: 0, bottom: 0 };
  const COVER = 0.5; // of its box: what covers that much of an element is the element
  const [SMALL, LARGE] = [0.03, 0.25]; // of the viewport
  const GIVES_WAY = new Set(['gridcell', 'treeitem', 'combobox', 'option', 'tab', 'menuitem']);
  const TEXTS = new Set(['textbox', 'searchbox', 'combobox', 'spinbutton']);
  const TICKS = new Set(['checkbox', 'radio', 'switch']);
  const WHOLE = new Set(['canvas', 'svg', 'video']);
  const PAINTED = new Set([...WHOLE, 'img']);

  const hasOwnText = (element) =>
    [...childNodes(rootOf(element) || element)].some((node) => nodeType(node) === Node.TEXT_NODE && node.data.trim());

  // Edges that a size is changed by, bars that scroll, what covers others: there is nothing to be seen of them.
  const isBlank = (element, depth = 0) => {
    if (PAINTED.has(localName(element)) || ofKind(element, 'ownerSVGElement')) return false;
    const style = getComputedStyle(element);
    const isPainted = hasPaint(style) || style.content !== 'normal' || hasParts(element);
    if (isPainted || hasOwnText(element) || childElementCount(element) > 3 || depth > 3) return false;
    return [...children(rootOf(element) || element)].every((child) => isBlank(child, depth + 1));
  };
  const isNothing = ({ element, role, boxes, isTold }) =>
    isResized(element) || isResized(hit(...middle(boxes[0]))) || (!isTold && isBlank(element) && !nameOf(element, role));
  const isResized = (element) => Boolean(element) && getComputedStyle(element).cursor.endsWith('-resize');

  // Is more written in it than on what lies in it?
  const hasOtherText = (one, kids) =>
    nameOf(one.element, one.role).length > kids.reduce((sum, kid) => sum + lengthOf(kid) + 1, 0);
  const lengthOf = ({ element, role }) =>
    nameOf(element, role).length + (role === 'combobox' ? (valueOf(element, role) || '').length + 1 : 0);

  const NAMED = new Set(['button', 'menuitem', 'menuitemcheckbox', 'menuitemradio']); // by all that is written on them
  const isValueOf = ({ element, role }, kid) => {
    const name = nameOf(kid.element, kid.role);
    return role === 'combobox' && /[\p{L}\p{N}]/u.test(name) && (valueOf(element, role) || '').startsWith(name);
  };
  const isNameOf = (one, kid) => nameOf(kid.element, kid.role) === nameOf(one.element, one.role);

  // Is this the component whose only control or icon, of the same name, has no box of its own size?
  const isComponentOf = (one, [kid, ...more]) =>
    Boolean(rootOf(one.element)) && !more.length && isNameOf(one, kid);

  // Is this what a slider moves in, and the slider a thin line as long as it, not a handle?
  const isSliderOf = (box, [kid, ...more]) => {
    if (more.length || kid.role !== 'slider') return false;
    const [own, isWide] = [rectOf(kid), box.right - box.left > box.bottom - box.top];
    const [from, to] = isWide ? ['left', 'right'] : ['top', 'bottom'];
    return own[to] - own[from] >= COVER * (box[to] - box[from]);
  };

  // What lies in these is a part of them, as ARIA has it; in a button, what no key reaches.
  const WITHOUT_PARTS = new Set(['slider', 'checkbox', 'radio', 'switch']);
  const isPartOf = (one, { element }) =>
    WITHOUT_PARTS.has(one.role) || (one.role === 'button' && localName(element) === 'button' && tabIndex(element) < 0);

  // Has a component that is a label no other text than the name of what it labels, with or without that one's own?
  const isLabelOf = (text, name) => name !== '' && (text === name || text === `${name} ${name}`);

  // Is this only drawn around its one field, or around a control of about its size that is called the same?
  const isWrapperOf = (one, kid, share) => {
    if (!kid.isControl) return false;
    if (TICKS.has(kid.role) && isLabelOf(nameOf(one.element, one.role), nameOf(kid.element, kid.role))) return true;
    if (hasOtherText(one, [kid])) return false;
    return TEXTS.has(kid.role) || (share >= COVER / 2 && Boolean(nameOf(kid.element, kid.role)));
  };

  // Is this a component of one field, drawn in line, or what is drawn for a box to tick whose label is numbered?
  const isAroundField = (one, kid) =>
    (getRootNode(kid.element).host === one.element && isWrapperOf(one, kid, 0)) ||
    (isTick(kid.element) && !nameOf(one.element, one.role));

  // Does a part of this item, by a script of its own, do what the item itself does not?
  const isItemOf = (one, kid) => {
    const isPart = kid.role === one.role || Boolean(classLike(kid.element, ICON)); // its arrow
    const name = !isPart && ((kid.isPointer && !one.isPointer) || kid.isHeard()) && nameOf(kid.element, kid.role);
    return Boolean(name) && nameOf(one.element, one.role).includes(name);
  };

  // Does it take the focus, and hear clicks for itself, not for parts: a card that leads to what is shown on it?
  const isCard = ({ element }, within) =>
    hasAttribute(element, 'tabindex') && tabIndex(element) >= 0 && !isStructure(element) && hearsClicks(element) &&
    within.every(({ isControl }) => isControl);

  // Is this a cell of nothing but the button in it, of the same name? Beside a box to tick one chooses the cell.
  const isCellOf = (one, [kid, ...more]) =>
    (one.role === 'gridcell' || matches(one.element, CELL)) && kid?.role === 'button' && kid.isControl && !more.length && isNameOf(one, kid);

  // Is this only what ARIA once had around the field of a list that opens?
  const isHolderOf = ({ element, role }, within) =>
    role === 'combobox' && !hasAttribute(element, 'tabindex') && localName(element) !== 'button' && within.some(isTyped);
  const isTyped = ({ element, role }) => TEXTS.has(role) && FIELDS.has(localName(element));

  // Are these, with all that is written on the button, the parts of it that a component listens for? The one part of
  // one that is called otherwise is all that it shows.
  const arePartsOf = (one, within) => {
    if (one.role !== 'button' || !within.length || within.some(({ isControl }) => isControl)) return false;
    const name = fold(within.map(({ element, role }) => nameOf(element, role)).join(' '));
    if (within.length === 1 && hasAttribute(one.element, 'aria-label') && name === fold(textContent(one.element))) return true;
    return within.every(({ isPointer }) => !isPointer) && name === nameOf(one.element, one.role);
  };

  // What is drawn as a whole, such as a board to play on. A drawing with texts is a chart: what it shows is in it.
  const isBoard = (element) =>
    WHOLE.has(localName(element)) && !(localName(element) === 'svg' && querySelector(element, 'text'));

  // A field that is no wider than its caret: a click on what is around it gets there.
  const isThinField = ({ isControl, role, boxes: [box] }) => isControl && TEXTS.has(role) && box.right - box.left <= THIN;
  const THIN = 8; // pixels

  // The first of the fields in it that are transparent until they have the focus: a click gets there.
  const blindFieldOf = (one) => {
    const isBlind = ({ element, place, isControl, role }) =>
      isControl && TEXTS.has(role) && isTransparent(element) && visibleParts(element, place, 1).length > 0;
    for (const kid of one.kids.filter(({ boxes }) => !boxes.length)) {
      const found = isBlind(kid) ? kid : blindFieldOf(kid);
      if (found) return found;
    }
    return null;
  };
  // The slider that is hidden in its handle, for keys, or the box to tick in what is drawn for it.
  const hiddenFieldOf = (one) => {
    const [kid, ...more] = one.kids;
    if (!kid?.isControl || more.length || !one.isHeard() || !checkVisibility(kid.element, { visibilityProperty: true })) return null;
    const { width, height } = getBoundingClientRect(kid.element);
    return kid.role === 'slider' || (isTick(kid.element) && Math.min(width, height) <= 1) ? kid : null;
  };
  const isTransparent = (element) => !isShown(element) && checkVisibility(element, { visibilityProperty: true });

  // The arrow in a list or a button that opens: it does the same.
  const OPENS = new Set(['button', 'combobox', 'listbox', 'tab']);
  const OPENER = /(?<![a-z])(dropdown|caret|chevron|angle|arrow)(?![a-z])/i;
  const isNamedOpener = (element, depth = 0) =>
    Boolean(classLike(element, OPENER)) ||
    (depth < 2 && childElementCount(element) === 1 && isNamedOpener(children(element)[0], depth + 1));
  const openerOf = (one, within) => {
    const isOpener = ({ element, role, isControl }) =>
      isControl ? one.role === 'combobox' && role === 'button' && hasAttribute(element, 'aria-expanded') :
        !nameOf(element, 'button') && isNamedOpener(element);
    const found = OPENS.has(one.role) ? within.filter(isOpener) : [];
    if (found.length) return found.length === 1 ? found[0] : null; // two sort by what is above them
    const isHidden = ({ element, isControl }) =>
      !isControl && !nameOf(element, 'button') && getAttribute(element, 'aria-hidden') === 'true';
    const hidden = one.role === 'combobox' ? within.filter(isHidden) : [];
    return hidden.length > 1 ? hidden.at(-1) : null; // what clears the field comes before it
  };

  // Which of `kids`, the candidates that lie in `one`, are kept beside it; null where they are kept in its stead.
  const keptBeside = (one, kids) => {
    const box = rectOf(one);
    const area = areaOf(box);
    const within = kids.filter((kid) => isIn(middle(kid.boxes[0]), box));
    const left = within.length ? areaLeft(one, box) : area;
    const share = ({ boxes }) => areaOf(intersect(boxes[0], box) || NOTHING) / left;
    if (!one.isControl) {
      const isHeading = ({ element, isPart }) => isPart && matches(element, HEADING);
      if (!one.isPointer && (isNothing(one) || within.some(isHeading))) return null;
      const blind = within.some(({ role }) => TEXTS.has(role)) ? null : blindFieldOf(one);
      const hidden = within.length ? null : hiddenFieldOf(one);
      if (hidden) Object.assign(one, { role: hidden.role, field: hidden.element });
      if (blind && one.isHeard()) {
        Object.assign(one, { role: blind.role, field: blind.element });
        return kids;
      }
      const isSorted = matches(one.element, HEADING) && hasAttribute(one.element, 'aria-sort') && hearsClicks(one.element);
      const isUnmarked = !one.isTold && !isSorted && (one.isText || (!one.isPointer && within.length && hasOtherText(one, within)));
      const isPointed = ({ isPointer, role }) => isPointer && !(role === 'link' && isCard(one, within)); // all links have one
      if (isUnmarked && within.some((kid) => [kid, ...kid.kids].some(isPointed))) return null;
      if (!within.length) {
        if (kids.length === 1 && isAroundField(one, kids[0])) return null;
        const isLarge = area > LARGE * innerWidth * innerHeight && !isBoard(one.element);
        return isLarge && !one.isPointer ? null : kids;
      }
      const isCovered = within.reduce((sum, kid) => sum + share(kid), 0) >= COVER;
      const isWrapper = within.length === 1 && isWrapperOf(one, within[0], share(within[0]));
      if (isCovered || isWrapper || isCellOf(one, within) || !(one.isHeard() || within.every(({ isPart }) => isPart))) return null;
      const isComponent = isComponentOf(one, within);
      if (isComponent && !within[0].isControl && !classLike(within[0].element, ICON)) return kids.filter((kid) => kid !== within[0]);
      if (isComponent || isSliderOf(box, within)) {
        if (within[0].isControl) within[0].boxes = one.boxes; // an icon in it has a box of its own
        return null;
      }
      const isHandle = (kid) =>
        kid.role === 'slider' ||
        !(kid.isControl || nameOf(kid.element, kid.role) || (kid.isHeard() && !kid.isPart));
      const isLarge = area > LARGE * innerWidth * innerHeight;
      const isTrack = !isLarge && within.every(isHandle);
      const isSmall = area < SMALL * innerWidth * innerHeight;
      const isWritten = (isSmall || (!isLarge && isCard(one, within))) && hasOtherText(one, within);
      if (!(one.isPointer || isTrack || isWritten)) return null;
      const thin = within.find(isThinField);
      if (thin) Object.assign(one, { role: thin.role, field: thin.element });
      const opener = openerOf(one, within);
      const isDouble = (kid) =>
        kid === opener && (hasAttribute(one.element, 'tabindex') || getAttribute(kid.element, 'aria-hidden') === 'true');
      return kids.filter((kid) => kid !== thin && !isDouble(kid));
    }
    const isInert = one.role === 'treeitem' && !one.isHeard();
    if (isInert && within.some((kid) => isItemOf(one, kid))) return null;
    if (isCellOf(one, within) || isHolderOf(one, within)) return null;
    const tick = TICKS.has(one.role) && rootOf(one.element) && within.find(({ element }) => isTick(element));
    if (tick) one.boxes = tick.boxes; // beside it a component may be blank
    if (arePartsOf(one, within)) return kids.filter((kid) => !within.includes(kid));
    const isBelow = (kid) => kid.role === 'treeitem' && one.role === 'treeitem';
    const same = within.filter((kid) => share(kid) >= COVER && !isBelow(kid));
    const isField = (kid) => kid.isControl && (GIVES_WAY.has(one.role) || FIELDS.has(localName(kid.element)));
    if (same.some(isField) && !WITHOUT_PARTS.has(one.role)) return null;
    const isNamesake = (kid) => !kid.isControl && Boolean(nameOf(kid.element, kid.role)) && isOfName(kid);
    const isOfName = (kid) => (NAMED.has(one.role) && isNameOf(one, kid)) || isValueOf(one, kid);
    const opener = openerOf(one, within);
    const isOwn = (kid) => same.includes(kid) || isPartOf(one, kid) || isNamesake(kid) || kid === opener;
    const isArrow = (kid) => one.role === 'treeitem' && kid.isPointer && Boolean(classLike(kid.element, ICON));
    const isOther = (kid) => kid.isControl || !within.includes(kid) || kid.isHeard() || isArrow(kid);
    return kids.filter((kid) => !isOwn(kid) && isOther(kid));
  };

  // The candidates that are elements of their own, in the order of the document.
  const choose = (candidates, most) => {
    for (const one of [...candidates].reverse()) {
      if (one.isKept) continue; // it lies in a frame of another origin, and was chosen there
      one.isHeard = () => (one.heard ??= hears(one.element));
      const kids = one.kids.flatMap((kid) => (kid.isKept ? [kid] : kid.rest.filter(({ isKept }) => isKept)));
      one.rest = kids;
      if (!locate(one, most)) continue;
      const kept = keptBeside(one, kids);
      one.isKept = Boolean(kept) && (localName(one.element) === 'select' || placeBeside(one, kept));
      if (!one.isKept) continue;
      dropOthers(one, kids, kept);
    }
    return candidates.filter(({ isKept }) => isKept);
  };
  // What lies in those that are not kept was kept beside them, not beside `one`.
  const dropOthers = (one, kids, kept) => {
    const others = kids.filter((kid) => !kept.includes(kid));
    for (const kid of others) kid.isKept = false;
    const below = others.flatMap(({ rest }) => rest.filter(({ isKept }) => isKept));
    if (below.length) dropOthers(one, below, keptBeside(one, below) || below);
  };

  const hrefOf = (element) => {
    const href = ofKind(element, 'href');
    if (!href) return undefined;
    return shorten(typeof href === 'string' ? href : new URL(href.baseVal, baseURI(element)).href, 'address');
  };

  const describe = ({ element, role, field }) => ({
    role,
    name: shorten(nameOf(element, role) || (field && (nameOf(field, role) || nameOf(element, 'button'))) || '', 'name'),
    value: valueOf(field || element, role) ?? undefined,
    href: role === 'link' ? hrefOf(element) : undefined,
  });

  // A new look: style sheets may have come and gone.
  const begin = () => {
    webgym.roles.begin();
    hovers = new Map();
    pointed = new Map();
    sheets = new Map();
    answers = new Map();
    several = new Map();
    rows = new Map();
    told = new Map();
    clicks = new Map();
    partly = new Map();
    charts = new Map();
    weeks = new Map();
  };

  webgym.targets = {
    MAX_PARTS, isShown, isOff, hasLabelIn, answersItsLabel, startsPointer, visibleParts, standIn, candidateOf, choose,
    describe, isHeardAt, begin,
  };
})();
