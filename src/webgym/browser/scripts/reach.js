// What this world cannot enter by itself: frames of other origins, and closed shadow roots. The other end of
// the protocol can; it is asked once for each.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.unknown) return;
  const {
    ownerDocument, textContent, isConnected, getRootNode, localName, clientWidth, clientHeight, matches,
    getBoundingClientRect, computedStyleMap, createTreeWalker, firstElementChild, offsetWidth, offsetHeight,
  } = webgym.dom;
  const { state, rootOf, isFrame } = webgym;

  const MAX_ASKED = 64; // at a time
  const MAX_BARREN = 20; // of one name: then it is not asked about any more
  const LEAST_SIDE = 5; // pixels: smaller frames are not for people

  const known = new WeakMap(); // frame → {id, view}; an empty id is a frame that nobody can enter
  const asked = new WeakSet(); // elements that may hold a closed root
  const barren = new Map(); // by name, how many of them held none
  let wondered = new Set();
  let probed = [];

  let foreign = []; // frames with an id
  let hidden = []; // frames too small to be entered yet
  const isShown = (frame) => offsetWidth(frame) >= LEAST_SIDE && offsetHeight(frame) >= LEAST_SIDE;
  const isForeign = (element) => Boolean(isFrame(element) && element.contentWindow && !element.contentDocument);

  // The id of a frame of another origin; null if it is not known yet, "" if it cannot be entered.
  webgym.frameId = (element) => {
    const entry = known.get(element);
    return entry && entry.view === element.contentWindow ? entry.id : null;
  };

  // Does this element have a closed root? It is found out by the next `unknown`.
  const HOSTS = new Set(
    'article aside blockquote body div footer h1 h2 h3 h4 h5 h6 header main nav p section span'.split(' '),
  );
  const isCustom = (element) => localName(element).includes('-');
  webgym.wonder = (element) => {
    if (asked.has(element) || !(isCustom(element) || HOSTS.has(localName(element)))) return false;
    if (barren.get(localName(element)) >= MAX_BARREN) return false;
    if (wondered.size < MAX_ASKED) wondered.add(element);
    return true;
  };

  // Whether it was not asked for already.
  webgym.askForRoot = (field) => {
    if (asked.has(field)) return false;
    wondered.add(field);
    return true;
  };

  // An element shows that it has a closed root by having a size that nothing else explains.
  webgym.wonderAtSize = (element) => {
    if (asked.has(element)) return false;
    if (!isCustom(element)) {
      if (!HOSTS.has(localName(element)) || firstElementChild(element) || textContent(element).trim()) return false;
      asked.add(element);
      const { height, 'aspect-ratio': ratio, 'min-height': least } = Object.fromEntries(
        ['height', 'aspect-ratio', 'min-height'].map((name) => [name, String(computedStyleMap(element).get(name))]),
      );
      const isSized = height !== 'auto' || ratio !== 'auto' || !/^(auto|0px)$/.test(least);
      if (isSized || clientHeight(element) < 8 || clientWidth(element) < 8) return false;
      if (['::before', '::after'].some((part) => getComputedStyle(element, part).content !== 'none')) return false;
      asked.delete(element);
    } else if (!matches(element, ':defined') && firstElementChild(element)) return false; // a framework's tag
    return webgym.wonder(element);
  };

  // Frames, those in open and opened shadow roots included.
  const scan = (root, frames) => {
    const walker = createTreeWalker(document, root, NodeFilter.SHOW_ELEMENT);
    for (let element = walker.nextNode(); element; element = walker.nextNode()) {
      if (isFrame(element)) frames.push(element);
      const inner = rootOf(element);
      if (inner) scan(inner, frames);
    }
    return frames;
  };

  // What is to be asked about, in an order that `learn` relies on; null if there is nothing.
  webgym.unknown = (withFrames) => {
    probed = [...wondered];
    wondered = new Set();
    if (withFrames) {
      const inShadow = [];
      hidden = [];
      for (const view of webgym.views())
        for (const frame of scan(view.document, [])) {
          if (isForeign(frame)) {
            if (webgym.frameId(frame) === null) (isShown(frame) ? probed : hidden).push(frame);
          } else if (getRootNode(frame) !== ownerDocument(frame)) inShadow.push(frame);
        }
      state.shadowedFrames = inShadow;
    }
    return probed.length ? probed : null;
  };

  // What `unknown` gave: an id for a frame, null otherwise.
  webgym.learn = (ids) => {
    probed.forEach((element, index) => {
      if (isFrame(element)) {
        known.set(element, { id: ids[index] || '', view: element.contentWindow });
        if (ids[index]) foreign.push(element);
        return;
      }
      asked.add(element);
      const name = localName(element);
      if (!state.roots.has(element)) barren.set(name, (barren.get(name) || 0) + 1);
    });
    probed = [];
  };

  // {frames, unknown}: which entered frames lie in the viewport, and whether there is more to ask about.
  webgym.reach = () => {
    if (!foreign.length && !hidden.length) return { frames: [], unknown: wondered.size > 0 };
    foreign = foreign.filter((frame) => isConnected(frame) && webgym.frameId(frame));
    const isInView = (frame) => {
      const { left, top, right, bottom } = getBoundingClientRect(frame);
      return right > 0 && bottom > 0 && left < innerWidth && top < innerHeight;
    };
    return {
      frames: foreign.filter(isInView).map(webgym.frameId),
      unknown: wondered.size > 0 || hidden.some((frame) => isForeign(frame) && isShown(frame)),
    };
  };

  // A point of the viewport of a frame of another origin, in our own.
  webgym.outward = (id, [x, y]) => {
    const frame = foreign.find((one) => webgym.frameId(one) === id);
    return frame ? webgym.geometry.outward(frame, x, y) : [x, y];
  };

  webgym.enterRoot = (host, root) => {
    if (webgym.enterField(host, root)) return;
    state.roots.set(host, root);
    webgym.watch(root);
    webgym.listenIn(root);
    webgym.changed();
  };
})();
