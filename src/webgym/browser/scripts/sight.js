// What of a text can be seen: not cut off, faded, covered, too small, or of the colour of what it lies on.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.sight) return;
  const {
    ownerDocument, getRootNode, compareDocumentPosition, localName, clientLeft, clientTop, clientWidth, clientHeight,
    scrollWidth, scrollHeight, matches, checkVisibility, getBoundingClientRect, documentElement, defaultView,
    createRange, elementsFromPoint, offsetWidth, ofKind, querySelectorAll, getClientRects,
  } = webgym.dom;
  const { fold, rootOf } = webgym;
  const { near, emptyIn } = webgym.boxes;
  const { intersect, middle, moved, slotIn, parentOf, contains, hit, clipAround, clipWithin, isBox } = webgym.geometry;

  const LEAST_ALPHA = 0.1; // of text on a ground whose colour is not known
  const LEAST_CONTRAST = 1.2; // of a text and its ground, by WCAG's ratio; #eee on white has 1.16
  const LEAST_AREA = 12; // CSS pixels a character: of a font of 5 px
  const MOST_BLUR = 0.2; // of the font's size
  const isTop = window === window.top; // where what is left open is filled in: see text.py
  const VEIL = 0.6; // what is at least this opaque hides what lies under it

  // --- colours ------------------------------------------------------------------------------------

  const canvas = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
  const colours = new Map(); // by how CSS writes them
  // [red, green, blue, alpha], from 0 to 255 and to 1.
  const colourOf = (text) => {
    if (!colours.has(text)) {
      const plain = /^rgba?\(([\d.]+), ([\d.]+), ([\d.]+)(?:, ([\d.]+))?\)$/.exec(text);
      if (plain) colours.set(text, [plain[1], plain[2], plain[3], plain[4] === undefined ? 1 : plain[4]].map(Number));
      else {
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = text;
        canvas.fillRect(0, 0, 1, 1);
        const [red, green, blue, alpha] = canvas.getImageData(0, 0, 1, 1).data;
        colours.set(text, [red, green, blue, alpha / 255]);
      }
    }
    return colours.get(text);
  };

  const over = ([red, green, blue], alpha, ground) =>
    [red, green, blue].map((one, index) => one * alpha + ground[index] * (1 - alpha));

  const luminance = (rgb) => {
    const [red, green, blue] = rgb.map((one) => (one <= 10.31 ? one / 3294.6 : ((one / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };
  const contrast = (one, other) => {
    const [a, b] = [luminance(one), luminance(other)];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  };

  // --- what becomes of the text in an element -----------------------------------------------------

  // For one look, by element: {style, alpha, blur, cut, sunk, line, isOdd}. `cut`: the innermost element around that is
  // cut to a shape, or not seen from behind; `sunk`: that lies behind its parents; `line`: that breaks the text in lines.
  // `isOdd`: something around changes what is painted so that only the picture tells what can be seen.
  let sights = new Map();
  let pseudos = new Map();
  let grounds = new Map();
  let fits = new Map();

  const filtered = (filter, name) => {
    const found = new RegExp(`${name}\\(([\\d.]+)`).exec(filter);
    return found ? Number(found[1]) : null;
  };

  // Does only the picture tell what becomes of what is in it?
  const isChanged = ({ maskImage, webkitMaskBoxImageSource, backgroundClip, clipPath, mixBlendMode, filter }) =>
    maskImage !== 'none' || webkitMaskBoxImageSource !== 'none' || mixBlendMode !== 'normal' ||
    backgroundClip.includes('text') || /url|shape|path/.test(clipPath) || /url|brightness|contrast/.test(filter);

  const OUTSIDE = { alpha: 1, blur: 0, cut: null, sunk: null, line: null, isOdd: false };
  const sightOf = (element) => {
    const known = sights.get(element);
    if (known) return known;
    const parent = parentOf(element);
    const around = parent ? sightOf(parent) : OUTSIDE;
    const style = getComputedStyle(element);
    let { alpha, blur, cut, sunk } = around;
    if (style.opacity !== '1') alpha *= Number(style.opacity);
    if (style.filter !== 'none') {
      alpha *= filtered(style.filter, 'opacity') ?? 1;
      blur = Math.max(blur, filtered(style.filter, 'blur') ?? 0);
    }
    if (style.contentVisibility === 'hidden') alpha = 0;
    if (style.clipPath !== 'none' || style.clip !== 'auto' || style.backfaceVisibility === 'hidden') cut = element;
    if (style.zIndex < 0) sunk = element;
    const isOdd = around.isOdd || isChanged(style);
    const sight = { style, alpha, blur, cut, sunk, line: isBox(style) ? element : around.line, isOdd };
    sights.set(element, sight);
    return sight;
  };

  // --- what it lies on ----------------------------------------------------------------------------

  const PICTURES = new Set(['img', 'video', 'canvas', 'svg', 'iframe', 'frame', 'embed', 'object']);
  const DRAWN = new Set(['checkbox', 'radio', 'range', 'color', 'image', 'file']);
  const isPicture = (element) =>
    PICTURES.has(localName(element)) || (localName(element) === 'input' && DRAWN.has(element.type) && !isUndrawn(element));
  const isUndrawn = (input) => input.type !== 'image' && sightOf(input).style.appearance === 'none';

  // Does a part of a drawing hide what lies below? What only holds others does not.
  const THIN = 3; // CSS pixels: a line that hides no text
  const SHAPES = new Set(['rect', 'circle', 'ellipse', 'path', 'line', 'polyline', 'polygon']);
  const HOLDERS = new Set(['g', 'a', 'svg', 'switch']);
  const isFilled = (shape) => {
    if (HOLDERS.has(localName(shape))) return false;
    if (!SHAPES.has(localName(shape))) return true;
    const { style, alpha } = sightOf(shape);
    const isOpaque = (paint, opacity) =>
      paint !== 'none' && (/^(url|context)/.test(paint) ? 1 : colourOf(paint)[3]) * opacity * alpha >= VEIL;
    const isInked = localName(shape) !== 'line' && isOpaque(style.fill, style.fillOpacity);
    const isDrawn = parseFloat(style.strokeWidth) >= THIN && isOpaque(style.stroke, style.strokeOpacity);
    return style.visibility === 'visible' && (isInked || isDrawn);
  };

  // What an element paints below its content: {colour, alpha}; null for a picture, or what one cannot tell. `isHit`:
  // of a drawing what it paints itself, as its parts would be hit before it.
  const paintOf = (element, isHit = false) => {
    const { style, alpha } = sightOf(element);
    const colour = colourOf(style.backgroundColor);
    if (alpha < LEAST_ALPHA) return { colour, alpha: 0 }; // a box to tick, say, over what is drawn for it
    if (style.backgroundClip === 'text') return { colour, alpha: 0 };
    if (style.backgroundImage !== 'none' || style.mixBlendMode !== 'normal') return null;
    if (isPicture(element) && !(isHit && localName(element) === 'svg')) return null;
    if (style.backdropFilter !== 'none') return null;
    if (ofKind(element, 'ownerSVGElement') && localName(element) !== 'foreignObject')
      return isFilled(element) ? null : { colour, alpha: 0 };
    return { colour, alpha: colour[3] * alpha };
  };

  // The pseudo-elements that style sheets make before and after the content of an element: {name, style}.
  const pseudosOf = (element) => {
    if (!pseudos.has(element)) {
      const found = ['::before', '::after'].map((name) => ({ name, style: getComputedStyle(element, name) }));
      pseudos.set(element, found.filter(({ style }) => style.content !== 'none' && style.display !== 'none'));
    }
    return pseudos.get(element);
  };
  const isLoose = ({ position }) => position === 'absolute' || position === 'fixed';

  // What pseudo-elements of an element paint, where they lie over or under its box.
  const hasPaintedParts = (element) => {
    const parts = pseudosOf(element).map(({ style }) => style).filter(({ position }) => position !== 'static');
    if (matches(element, ':modal')) parts.push(getComputedStyle(element, '::backdrop'));
    return parts.some(
      (style) =>
        style.backgroundImage !== 'none' || style.backdropFilter !== 'none' ||
        colourOf(style.backgroundColor)[3] * style.opacity >= VEIL,
    );
  };

  // The colour below all: of the page itself; null if the browser may choose a dark one, or in a frame.
  const canvasOf = (owner) => {
    const { colorScheme } = getComputedStyle(documentElement(owner));
    return defaultView(owner) === window.top && !colorScheme.includes('dark') ? [255, 255, 255] : null;
  };

  // The colour of layers, the uppermost first; null where it cannot be told.
  const blend = (layers, owner) => {
    const seen = [];
    let isOpaque = false;
    for (const element of layers) {
      const paint = paintOf(element);
      if (!paint || hasPaintedParts(element)) return null;
      if (paint.alpha > 0) seen.unshift(paint);
      isOpaque = paint.alpha >= 0.99;
      if (isOpaque) break;
    }
    const start = isOpaque ? seen.shift().colour : canvasOf(owner);
    return start && seen.reduce((ground, { colour, alpha }) => over(colour, alpha, ground), start);
  };

  // {colour, isSure}: what lies behind the content of an element, by the elements that it is in.
  const groundOf = (element) => {
    const known = grounds.get(element);
    if (known !== undefined) return known;
    const { style } = sightOf(element);
    const paint = paintOf(element);
    const parent = parentOf(element);
    let ground = null;
    if (paint && paint.alpha >= 0.99) ground = { colour: paint.colour, isSure: true };
    else if (paint) {
      const below = parent ? groundOf(parent) : { colour: canvasOf(ownerDocument(element)), isSure: true };
      const colour = below && below.colour;
      ground = colour && { colour: over(paint.colour, paint.alpha, colour), isSure: below.isSure && !isLoose(style) };
    }
    grounds.set(element, ground);
    return ground;
  };

  const pathOf = (element) => {
    const path = [];
    for (let node = element; node; node = parentOf(node)) path.push(node);
    return path;
  };

  // The elements at a point that text in `element` lies on, the uppermost first.
  const layersBelow = (element, x, y) => {
    const layers = elementsFromPoint(getRootNode(element), x, y);
    if (layers[0] && modalOver(layers[0], element)) return paintedAt(element, x, y).length ? null : pathOf(element);
    const first = layers.findIndex((layer) => contains(layer, element));
    if (first < 0) return null;
    const path = pathOf(element);
    const isPassedThrough = (node) =>
      sightOf(node).style.pointerEvents === 'none' && isAt(getBoundingClientRect(node), x, y);
    return [...path.slice(0, path.indexOf(layers[first])).filter(isPassedThrough), ...layers.slice(first)];
  };

  // --- whether it can be told from its ground -----------------------------------------------------

  const isWritten = (style) =>
    style.textShadow !== 'none' || style.webkitTextStrokeWidth !== '0px';

  const standsOut = (element, rect) => {
    const { style, alpha, blur, isOdd } = sightOf(element);
    if (blur > MOST_BLUR * parseFloat(style.fontSize) || style.webkitTextSecurity !== 'none') return false;
    if (ofKind(element, 'ownerSVGElement')) return alpha >= LEAST_ALPHA;
    if (isOdd || isWritten(style)) return alpha >= LEAST_ALPHA;
    const colour = colourOf(style.webkitTextFillColor);
    const opacity = colour[3] * alpha;
    const isClear = (ground) => contrast(over(colour, opacity, ground), ground) >= LEAST_CONTRAST;
    const ground = groundOf(element);
    if (ground && ground.isSure && isClear(ground.colour)) return true;
    const layers = layersBelow(element, ...middle(rect));
    const below = layers && blend(layers, ownerDocument(element));
    if (below && isClear(below)) return true;
    if (below) sightOf(element).isOdd = true; // it may lie on what takes no clicks, and so is in no list of layers
    return opacity >= LEAST_ALPHA && (!below || isTop);
  };

  // The innermost element around a text that has a box: a slot, say, has none.
  const boxedOf = (element) => {
    let boxed = element;
    while (boxed && sightOf(boxed).style.display === 'contents') boxed = parentOf(boxed);
    return boxed;
  };

  const isVisible = (element) => {
    const { style } = sightOf(element);
    if (style.visibility !== 'visible') return false;
    const boxed = boxedOf(element);
    return !boxed || (checkVisibility(boxed) && !(localName(boxed) === 'details' && !boxed.open));
  };

  // What does not depend on where a piece of text lies.
  const isReadable = (element, rect) => {
    if (!fits.has(element)) fits.set(element, isVisible(element) && standsOut(element, rect));
    return fits.get(element);
  };

  // --- whether it is covered ----------------------------------------------------------------------

  // Does any element from `inner` up to `outer`, that one left out, hide what lies below?
  const hides = (inner, outer) => {
    for (let node = inner; node && node !== outer; node = parentOf(node)) {
      const paint = paintOf(node, true);
      if (!paint || paint.alpha >= VEIL || hasPaintedParts(node)) return true;
    }
    return false;
  };

  const isPage = (element) => localName(element) === 'body' || localName(element) === 'html';

  // The outermost level that an element is put on below what it has in common with another.
  const levelOf = (element, other) => {
    let level = 0;
    for (let node = element; node && !contains(node, other); node = parentOf(node))
      level = Number(sightOf(node).style.zIndex) || level;
    return level;
  };
  const commonOf = (one, other) => {
    let node = one;
    while (node && !contains(node, other)) node = parentOf(node);
    return node;
  };

  // Is `other`, which takes clicks where text in `element` takes none, drawn over it?
  const isOver = (other, element) => {
    const [above, below] = [levelOf(other, element), levelOf(element, other)];
    if (above !== below) return above > below;
    return Boolean(compareDocumentPosition(element, other) & Node.DOCUMENT_POSITION_FOLLOWING);
  };

  // Does something lift an element over text that has the place which the page's flow gives it?
  const isLifted = (element, other) =>
    pathOf(element).some((node) => !contains(node, other) && sightOf(node).style.position !== 'static');

  // The modal dialog that is hit instead of an element behind it; null for none.
  const modalOver = (found, element) => {
    if (ownerDocument(found) !== ownerDocument(element)) return null;
    const modal = pathOf(found).find((node) => matches(node, ':modal'));
    return modal && !contains(modal, element) ? modal : null;
  };

  // What is there behind a dialog is not hit: its box tells where it lies.
  const isAt = ({ left, top, right, bottom }, x, y) => x >= left && x <= right && y >= top && y <= bottom;
  const paintedAt = (element, x, y) => {
    const isPainted = ([other, box]) => {
      if (!isAt(box, x, y) || contains(other, element) || ofKind(other, 'ownerSVGElement')) return false;
      const { visibility, pointerEvents } = sightOf(other).style;
      const isShown = visibility === 'visible' && pointerEvents !== 'none' && isAt(clipAround(other), x, y);
      return isShown && hides(other, parentOf(other));
    };
    return [...new Set([getRootNode(element), ownerDocument(element)])].flatMap((root) => near(root).filter(isPainted));
  };
  const isBuried = (element, at) => paintedAt(element, ...at).some(([other]) => isDrawnOver(other, element));
  const isDrawnOver = (other, element) => {
    if (!isLifted(other, element)) return false;
    return isOver(other, element) || (!isLifted(element, other) && levelOf(other, element) >= 0);
  };

  // --- what no hit test finds: layers that let the mouse through, and those that style sheets make -----

  let veils = new Map(); // by root: {element, box, isOver, hides}

  const isClearCanvas = (element, x, y) => {
    const { left, top, width, height } = getBoundingClientRect(element);
    try {
      canvas.clearRect(0, 0, 1, 1);
      canvas.drawImage(element, ((x - left) / width) * element.width, ((y - top) / height) * element.height, 1, 1, 0, 0, 1, 1);
      return canvas.getImageData(0, 0, 1, 1).data[3] < VEIL * 255;
    } catch {
      return false; // a picture of another origin was drawn on it
    } finally {
      canvas.reset();
    }
  };
  const MOST_SHAPES = 200; // of a drawing that are looked at
  const isClearDrawing = (element, x, y) =>
    ![...querySelectorAll(element, '*')].slice(0, MOST_SHAPES).some(
      (shape) => isFilled(shape) && isAt(getBoundingClientRect(shape), x, y),
    );

  const THROUGH = new Set(['iframe', 'frame']); // what is in them is not known
  const layerOf = (element, box) => {
    const { style } = sightOf(element);
    if (style.pointerEvents !== 'none' || style.visibility !== 'visible' || THROUGH.has(localName(element))) return null;
    if (ofKind(element, 'ownerSVGElement') || !checkVisibility(element)) return null;
    if ((paintOf(element)?.alpha ?? 1) < VEIL) return null;
    const isClear = { canvas: isClearCanvas, svg: isClearDrawing }[localName(element)];
    return {
      element, box,
      isOver: (text) => !contains(element, text) && isDrawnOver(element, text),
      hides: (x, y) => isAt(clipAround(element), x, y) && !(isClear && isClear(element, x, y)),
    };
  };

  // The box of a pseudo-element that is placed by itself; null if it is not known.
  const boxOfPseudo = (element, { left, top, width, height, position }) => {
    const [x, y, w, h] = [left, top, width, height].map(parseFloat);
    if ([x, y, w, h].some(Number.isNaN)) return null;
    let holder = element;
    while (holder && (position === 'fixed' || sightOf(holder).style.position === 'static')) holder = parentOf(holder);
    const around = holder ? getBoundingClientRect(holder) : { left: 0, top: 0 };
    const [startX, startY] = holder ? [around.left + clientLeft(holder), around.top + clientTop(holder)] : [0, 0];
    return { left: startX + x, top: startY + y, right: startX + x + w, bottom: startY + y + h };
  };
  const isOpaque = (element, style) =>
    style.backdropFilter.includes('blur') || /url\(/.test(style.backgroundImage) ||
    colourOf(style.backgroundColor)[3] * style.opacity * sightOf(element).alpha >= VEIL;
  const pseudoLayers = (element) =>
    pseudosOf(element)
      .filter(({ style }) => isLoose(style) && style.visibility === 'visible' && isOpaque(element, style))
      .map(({ name, style }) => ({
        element,
        box: boxOfPseudo(element, style) || { left: 0, top: 0, right: 0, bottom: 0 },
        isOver: (text) => isPseudoOver(element, name, Number(style.zIndex) || 0, text),
        hides: () => true,
      }));
  const isPseudoOver = (element, name, level, text) => {
    if (!contains(element, text)) {
      const [above, below] = [levelOf(element, text) || level, levelOf(text, element)];
      if (above !== below) return above > below;
      const follows = compareDocumentPosition(text, element) & Node.DOCUMENT_POSITION_FOLLOWING;
      return Boolean(follows) || !isLifted(text, element);
    }
    const lifted = pathOf(text).slice(0, pathOf(text).indexOf(element)).filter((node) => sightOf(node).style.position !== 'static');
    const own = Number(lifted.length && sightOf(lifted.at(-1)).style.zIndex) || 0;
    return lifted.length ? level > own || (level === own && name === '::after') : level >= 0;
  };

  const veilsIn = (root) => {
    if (!veils.has(root)) {
      const layers = near(root).flatMap(([element, box]) => [layerOf(element, box), ...pseudoLayers(element)]);
      veils.set(root, [...layers.filter(Boolean), ...emptyIn(root).flatMap(pseudoLayers)]);
    }
    return veils.get(root);
  };

  // Whether such a layer hides the text in `element`, or the element, at a point of its own viewport.
  const isVeiledAt = (element, x, y, isOwn = () => false) =>
    [...new Set([getRootNode(element), ownerDocument(element)])].some((root) =>
      veilsIn(root).some(
        (veil) => isAt(veil.box, x, y) && !isOwn(veil.element) && veil.isOver(element) && veil.hides(x, y),
      ));

  // A point on a text that is slotted hits the component that it lies in: what is around its slot is asked for by itself.
  const isWithinCut = (cut, found, at) =>
    contains(cut, found) ||
    (getRootNode(cut) !== getRootNode(found) &&
      elementsFromPoint(getRootNode(cut), ...at).some((layer) => contains(cut, layer)));

  // Whether the text in `element` shows at a point of this world's viewport, which is `at` in its own.
  const showsAt = (element, x, y, at) => {
    const found = hit(x, y);
    if (!found || isVeiledAt(element, ...at)) return false;
    if (found === element) return true;
    const modal = modalOver(found, element);
    if (modal) {
      const isBeside = found === modal && !isAt(getBoundingClientRect(modal), ...at);
      const isVeiled = isBeside ? hasPaintedParts(modal) : hides(found, parentOf(modal));
      return !isVeiled && !isBuried(element, at);
    }
    const { cut, sunk, style } = sightOf(element);
    if (contains(element, found)) return !hides(found, element);
    if (contains(found, element)) {
      const isCut = cut && !isWithinCut(cut, found, at) && style.pointerEvents !== 'none';
      const isBehind = sunk && !contains(sunk, found) && !isPage(found) && hides(found, parentOf(found));
      return !isCut && !isBehind;
    }
    if (getRootNode(found) !== getRootNode(element) && hides(found, commonOf(found, element))) return false;
    if (style.pointerEvents === 'none') return !isOver(found, element) || !hides(found, commonOf(found, element));
    const layers = elementsFromPoint(getRootNode(element), ...at);
    const own = layers.findIndex((layer) => contains(element, layer));
    const isClear = (layer) => contains(layer, element) || !hides(layer, parentOf(layer));
    return own > 0 && layers.slice(0, own).every(isClear);
  };

  const EDGE = 3; // CSS pixels from the ends of a piece
  const STEP = 24; // CSS pixels between the points that are tried where something may lie over a piece

  // The boxes of a root's elements that may lie over others: [element, rectangle]. Those out of view lie over nothing
  // that is read: of a line that is, a third at most lies there, too.
  let loose = new Map();
  const looseIn = (root) => {
    if (loose.has(root)) return loose.get(root);
    const isLoose = ([element]) => {
      const { position, zIndex } = getComputedStyle(element);
      return position !== 'static' && !(position === 'relative' && zIndex === 'auto');
    };
    loose.set(root, near(root).filter(isLoose));
    return loose.get(root);
  };

  // Where a piece is tried: to try a point costs the most, so one will do where nothing else lies.
  const triedAt = (element, rect) => {
    const roots = new Set([getRootNode(element), ownerDocument(element)]);
    const points = [(rect.left + rect.right) / 2];
    for (const root of roots)
      for (const [other, box] of looseIn(root)) {
        const [left, right] = [Math.max(rect.left, box.left), Math.min(rect.right, box.right)];
        if (left >= right || box.top >= rect.bottom || box.bottom <= rect.top) continue;
        if (right - left >= rect.right - rect.left || contains(other, element)) continue; // the middle tells
        if (right <= rect.left + EDGE) continue;
        for (let x = Math.max(left, rect.left + EDGE); x < right; x += STEP) points.push(x);
        points.push(Math.min(right, rect.right) - EDGE);
      }
    return points;
  };

  const isBare = (holder, rect, map) => {
    const element = boxedOf(holder) || holder;
    const y = (rect.top + rect.bottom) / 2;
    return triedAt(element, rect).every((x) => {
      const point = moved({ left: x, right: x, top: y, bottom: y }, map);
      return showsAt(element, point.left, point.top, [x, y]);
    });
  };

  // The same for the words in a control, which the mouse may be kept from.
  const isShownOf = (element, map) => {
    const rect = intersect(getBoundingClientRect(element), clipAround(element));
    return Boolean(rect) && sightOf(element).alpha >= LEAST_ALPHA && isBare(element, rect, map);
  };

  // --- whether it is cut --------------------------------------------------------------------------

  const SLACK = 1.5; // CSS pixels that a piece may lack at its ends
  const LEAST_SHARE = 0.7; // of a line's height
  const isWithin = (rect, clip, isDown) => {
    const across = [rect.left, rect.right, clip.left, clip.right];
    const down = [rect.top, rect.bottom, clip.top, clip.bottom];
    const [along, beside] = isDown ? [down, across] : [across, down];
    const shown = Math.min(beside[1], beside[3]) - Math.max(beside[0], beside[2]);
    return (
      along[0] >= along[2] - SLACK && along[1] <= along[3] + SLACK && shown >= LEAST_SHARE * (beside[1] - beside[0])
    );
  };

  // Where an ellipsis takes the place of what follows: {left, right, below}; null where there is none.
  // It holds for lines that end below `below`.
  const ellipsisOf = (block) => {
    const { style } = sightOf(block);
    const isShort = scrollWidth(block) > clientWidth(block);
    const isLine = style.textOverflow !== 'clip' && style.overflowX !== 'visible' && isShort;
    const isClamped = style.webkitLineClamp !== 'none' && scrollHeight(block) > clientHeight(block) + 1;
    if (!isLine && !isClamped) return null;
    const rect = getBoundingClientRect(block);
    const scale = offsetWidth(block) ? rect.width / offsetWidth(block) : 1;
    const size = parseFloat(style.fontSize);
    const before = (clientLeft(block) + parseFloat(style.paddingLeft)) * scale;
    const width = (clientWidth(block) - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight)) * scale;
    const [left, right] = [rect.left + before, rect.left + before + width];
    return {
      left: style.direction === 'rtl' ? left + size * scale : -Infinity,
      right: style.direction === 'rtl' ? Infinity : right - size * scale,
      below: isLine ? -Infinity : rect.top + (clientTop(block) + clientHeight(block) - size) * scale,
    };
  };
  let ellipses = new Map();
  const ellipsisIn = (block) => {
    if (!block) return null;
    if (!ellipses.has(block)) ellipses.set(block, ellipsisOf(block));
    return ellipses.get(block);
  };

  const isKept = (rect, ellipsis) =>
    !ellipsis || rect.bottom <= ellipsis.below || (rect.left >= ellipsis.left && rect.right <= ellipsis.right);

  // --- a text -------------------------------------------------------------------------------------

  // A script that writes no spaces between words can be read by its characters.
  const SCRIPTS = ['Han', 'Hiragana', 'Katakana', 'Thai', 'Lao', 'Khmer', 'Myanmar'];
  const UNSPACED = SCRIPTS.map((name) => `\\p{sc=${name}}`).join('');
  const PIECES = new RegExp(`\\s+|[${UNSPACED}]|[^\\s${UNSPACED}]+`, 'gu');
  const range = createRange(document);

  const rectsOf = (node, start, end) => {
    range.setStart(node, start);
    range.setEnd(node, end);
    return [...range.getClientRects()].filter(({ width, height }) => width > 0 && height > 0);
  };

  // Most of a very long text is out of view: the part of it, from which to which character, that may be seen.
  const LONG = 5000;
  const STRIDE = 500; // characters; some of them have a rectangle
  const WIDE = 1e7; // CSS pixels of one line: to measure a piece of it takes the browser a tenth of a second and more
  const windowOf = (node, { top, bottom }) => {
    const { length } = node.data;
    const isTooWide = (rect) => rect.width > WIDE && rect.bottom > top && rect.top < bottom;
    range.selectNodeContents(node);
    if (range.getBoundingClientRect().width > WIDE && rectsOf(node, 0, length).some(isTooWide)) {
      webgym.noteShortened('text');
      return [0, 0];
    }
    const first = (isBeyond) => {
      let [low, high] = [0, Math.ceil(length / STRIDE)];
      while (low < high) {
        const tried = (low + high) >> 1;
        const rects = rectsOf(node, tried * STRIDE, Math.min(length, (tried + 1) * STRIDE));
        if (rects.length && !isBeyond(rects)) low = tried + 1;
        else high = tried;
      }
      return Math.min(length, low * STRIDE);
    };
    return [
      Math.max(0, first((rects) => rects.some((rect) => rect.bottom > top)) - STRIDE),
      first((rects) => rects.every((rect) => rect.top > bottom)),
    ];
  };

  const plain = ({ left, top, right, bottom }) => ({ left, top, right, bottom });

  // {text, rects, isSpace, isSeen}, piece by piece: rectangles in this world's viewport.
  const piecesOf = (node, [start, end], isSeen, map, pattern = PIECES) => {
    const pieces = [];
    for (const match of node.data.slice(start, end).matchAll(pattern)) {
      const [text] = match;
      const isSpace = !/\S/.test(text);
      const at = start + match.index;
      const own = isSpace ? [] : rectsOf(node, at, at + text.length);
      const rects = own.map((rect) => plain(moved(rect, map)));
      pieces.push({ text: isSpace ? ' ' : text, isSpace, rects, isSeen: isSpace || isSeen(own, text) });
    }
    return pieces;
  };

  // The same for a very long text, in halves of halves until all of one is seen, or nothing: each piece that is measured,
  // and each point that is tried, has the browser go through the whole text.
  const FEW = 50; // characters
  const BREAK = new RegExp(`[\\s${UNSPACED}]`, 'u');
  const halvesOf = (node, [start, end], isSeen, clip) => {
    const [whole] = piecesOf(node, [start, end], isSeen, null, /[^]+/g);
    if (!whole || whole.isSeen || !whole.rects.some((rect) => intersect(rect, clip))) return whole ? [whole] : [];
    const middle = start + Math.ceil((end - start) / 2);
    const cut = end - start > FEW ? node.data.slice(middle, end).search(BREAK) : -1;
    if (cut < 0) return piecesOf(node, [start, end], isSeen, null);
    return [[start, middle + cut], [middle + cut, end]].flatMap((half) => halvesOf(node, half, isSeen, clip));
  };

  const GAP = ' … ';
  // What is seen of pieces: {text, rects}; null if nothing is. A gap stands for what is not.
  const join = (pieces) => {
    if (!pieces.some(({ isSeen, isSpace }) => isSeen && !isSpace)) return null;
    let text = '';
    for (const piece of pieces)
      if (piece.isSeen) text += piece.text;
      else if (!text.trimEnd().endsWith('…')) text += GAP;
    return { text, rects: pieces.flatMap(({ rects, isSeen }) => (isSeen ? rects : [])) };
  };

  const isLarge = (rects, length) =>
    rects.reduce((sum, { width, height }) => sum + width * height, 0) >= LEAST_AREA * length;

  const isTurned = (style) => !style.writingMode.startsWith('horizontal');

  // {text, rects, isOdd}: what of a text node can be seen from `place`; null for nothing. As `pieces` for those who
  // have to ask for more.
  const read = (node, holder, place, wantsPieces = false) => {
    const element = (rootOf(holder) && (node.assignedSlot || slotIn(holder, node))) || holder;
    const seen = readIn(element, node, place, wantsPieces);
    return seen && sightOf(element).isOdd && isTop ? { ...seen, isOdd: true } : seen;
  };
  const readIn = (element, node, place, wantsPieces) => {
    const isLong = !place.map && node.data.length >= LONG && !isTurned(sightOf(element).style);
    const part = isLong ? windowOf(node, place.clip) : [0, node.data.length];
    const lines = part[0] < part[1] ? rectsOf(node, ...part) : [];
    if (!lines.some((line) => intersect(moved(line, place.map), place.clip))) return null;
    const clip = clipWithin(element);
    if (!isReadable(element, lines.find((line) => intersect(line, clip)) || lines[0])) return null;
    const { line, style } = sightOf(element);
    const [ellipsis, isDown] = [ellipsisIn(line), isTurned(style)];
    const isUncut = (rects) =>
      rects.length > 0 &&
      rects.every((rect) =>
        isWithin(rect, clip, isDown) && isWithin(moved(rect, place.map), place.clip, isDown) && isKept(rect, ellipsis));
    const isSeen = (rects, text) =>
      isUncut(rects) && isLarge(rects, text.length) &&
      (place.isFlat || rects.every((rect) => isBare(element, rect, place.map)));
    const isWhole = part[1] - part[0] === node.data.length;
    if (isWhole && !wantsPieces && isUncut(lines) && isSeen(lines, fold(node.data)))
      return { text: node.data, rects: lines.map((rect) => moved(rect, place.map)) };
    if (wantsPieces) return piecesOf(node, part, isSeen, place.map);
    return join(isWhole ? piecesOf(node, part, isSeen, place.map) : halvesOf(node, part, isSeen, place.clip));
  };

  // --- what style sheets write ----------------------------------------------------------------------

  // The texts that style sheets put before and after the content of an element, where one can see them. {text, rects} by
  // '::before' and '::after'.
  const QUOTED = /"((?:[^"\\]|\\.)*)"/g;
  const ICONS = /\p{Co}/gu; // of fonts that are drawn as pictures
  const contentOf = ({ content }) => {
    const parts = [...content.matchAll(QUOTED)].map(([, text]) => text.replace(/\\(.)/g, '$1').replace(ICONS, ''));
    return fold(parts.join(''));
  };
  // Words between marks, if only the picture tells whether they can be seen: see text.py.
  let doubts = [];
  const doubted = ({ text, rects }) => {
    const boxes = rects.map(({ left, top, right, bottom }) => [left, top, right - left, bottom - top]);
    return `\ufdd2${doubts.push(boxes) - 1}\ufdd3${text}\ufdd4`;
  };

  // A placeholder for what contains a number that the style sheet counts, which the browser is asked for: see text.py.
  let counted = [];
  const numberIn = (element, name) => {
    const { left, top, width, height } = getBoundingClientRect(element);
    return `\ufdd0${counted.push([localName(element), name, [left, top, width, height]]) - 1}\ufdd1`;
  };
  const counts = (element, { content }) =>
    /\bcounters?\(/.test(content) && ownerDocument(element) === document && isTop;
  const writtenBy = (element, place) => {
    const written = {};
    for (const { name, style } of pseudosOf(element)) {
      const text = counts(element, style) ? numberIn(element, name) : contentOf(style);
      const rect = text && (isLoose(style) ? boxOfPseudo(element, style) : endOf(element, name));
      if (rect && isPseudoSeen(element, style, rect, place)) written[name] = { text, rects: [plain(moved(rect, place.map))] };
    }
    return written;
  };
  // A piece at the start or the end of an element, where such a text lies.
  const endOf = (element, name) => {
    const rects = [...getClientRects(element)].filter(({ width, height }) => width > 0 && height > 0);
    const rect = name === '::before' ? rects[0] : rects.at(-1);
    if (!rect) return null;
    const { left, top, right, bottom } = rect;
    const width = Math.min(right - left, 2 * EDGE);
    return name === '::before' ? { left, top, right: left + width, bottom } : { left: right - width, top, right, bottom };
  };
  const isPseudoSeen = (element, style, rect, place) => {
    const alpha = style.opacity * sightOf(element).alpha;
    const colour = colourOf(style.color);
    const isSmall = parseFloat(style.fontSize) < 5;
    if (alpha * colour[3] < LEAST_ALPHA || style.visibility !== 'visible' || isSmall || !isVisible(element)) return false;
    const ground = groundOf(element);
    const isFaint = ground && ground.isSure && style.backgroundColor === 'rgba(0, 0, 0, 0)' &&
      contrast(over(colour, colour[3] * alpha, ground.colour), ground.colour) < LEAST_CONTRAST;
    return !isFaint && isWithin(rect, clipWithin(element)) && isWithin(moved(rect, place.map), place.clip) &&
      (isLoose(style) || isBare(element, rect, place.map));
  };

  const begin = () => {
    sights = new Map();
    pseudos = new Map();
    veils = new Map();
    grounds = new Map();
    fits = new Map();
    ellipses = new Map();
    loose = new Map();
    counted = [];
    doubts = [];
  };

  const open = () => ({ counted, doubts }); // what text.py is to fill in
  webgym.sight = {
    begin, read, writtenBy, doubted, open, join, isWithin, isVisible, isVeiledAt, isShownOf, sightOf, LEAST_ALPHA,
  };
})();
