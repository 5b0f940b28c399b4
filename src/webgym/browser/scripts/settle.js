// Runs in the same isolated world as page.js: is the page quiet, and what says that more is to come?
(() => {
  const webgym = globalThis.webgym;
  if (webgym.quiet) return;
  const {
    nodeName, nodeType, ownerDocument, checkVisibility, getBoundingClientRect, body, defaultView, createTreeWalker,
    getAnimations, querySelectorAll, offsetWidth, offsetHeight, textContent, typeOf,
  } = webgym.dom;
  const { state, views, fold } = webgym;
  const roots = () => [...views().map((view) => view.document), ...webgym.shadows()];

  // --- what the page has planned ------------------------------------------------------------------
  // Handles of timers, frames and idle moments count up per window, over all worlds. One taken now tells
  // how many the page has asked for, without a touch on its functions.

  const nothing = () => {};
  const known = new Map(); // counted once until the page has its turn again
  const remember = (kind, count) => {
    if (!known.size) queueMicrotask(() => known.clear());
    known.set(kind, count);
    return count;
  };
  const counter = (ask, cancel) => {
    const ours = new WeakMap(); // document -> handles that we took: a frame's next document counts anew, in the same window
    const take = (view, ...wanted) => {
      const handle = view[ask](...wanted);
      if (handle) ours.set(view.document, (ours.get(view.document) || 0) + 1);
      return handle;
    };
    const askedIn = (view) => {
      const handle = take(view, nothing);
      if (!handle) return 0; // no scripts in this frame
      view[cancel](handle);
      return handle - ours.get(view.document);
    };
    const count = () => views().reduce((sum, view) => sum + askedIn(view), 0);
    return { take, asked: () => known.get(ask) ?? remember(ask, count()) };
  };
  const timers = counter('setTimeout', 'clearTimeout');
  const frames = counter('requestAnimationFrame', 'cancelAnimationFrame');
  const idles = counter('requestIdleCallback', 'cancelIdleCallback');

  // To count frames asks for one, and from then on all that happens waits for the display. So they are counted once for an
  // action, when the page seems quiet; and everywhere if the page has asked for any since the action before.
  let [counted, isStill] = [0, false];
  const countFrames = () => {
    const now = frames.asked();
    isStill &&= now === counted;
    return (counted = now);
  };
  // How many of each the page has asked for.
  webgym.plans = () => ({ timers: timers.asked(), frames: isStill ? counted : countFrames(), idles: idles.asked() });

  // The first input event of an action comes before the page's own listeners.
  const A_FRAME = 50; // ms: the time of a frame, from which animations count, is that before its events
  const onInput = () => {
    state.isAlone = false;
    if (state.hasInput) return;
    state.hasInput = true;
    state.actedAt = performance.now() - A_FRAME;
    state.idles = idles.asked();
  };
  state.hasInput = false;
  state.actedAt = Infinity;
  state.idles = 0;
  state.asked = 0; // frames and idle moments
  state.settled = -1; // reactions when it was last quiet
  state.isTireless = false; // draws frame after frame, for ever
  for (const name of ['pointerout', 'pointerover', 'pointermove', 'pointerdown', 'keydown', 'wheel', 'input'])
    webgym.listen([name, onInput, { capture: true, passive: true }]);

  // --- what shows that it is loading --------------------------------------------------------------

  const SAID = '[aria-busy="true" i], [role="progressbar" i]:not([aria-valuenow]), progress:not([value])';
  // "Processing time" and "Searching tips" are headings: these words count alone, or with what they bring. "Checking"
  // is an account, and "Saving for later" a link: such words count with dots behind them.
  const TELLS = new RegExp(
    String.raw`^\s*(?:(?:loading|please wait|redirecting|one moment|just a moment)\b` +
      String.raw`|(?:searching|processing|fetching)(?:\W*$|.*(?:\.\.\.|…)\s*$|\s+(?:for|your|the|our)\b)` +
      '|(?:saving|sending|submitting|uploading|verifying|signing in|logging in|checking|calculating|generating|connecting)' +
      String.raw`\b[^.…]{0,25}(?:\.\.\.|…)\s*$)`,
    'i',
  );
  const TEXT_LENGTH = 60; // of one that only says so, at most
  const TEXTS = 3000; // that are looked at, at most
  const VISIBLE = { opacityProperty: true, visibilityProperty: true };
  const BLANK = 'blank'; // stands for a page that shows nothing
  const SKIPPED = new Set(['SCRIPT', 'STYLE', 'NOSCRIPT', 'TEMPLATE', 'TITLE']);
  const CONTENT = 'img, svg, canvas, video, iframe, frame, object, embed, input, button, select, textarea';

  const isSeen = (element) => {
    if (!checkVisibility(element, VISIBLE)) return false;
    const box = getBoundingClientRect(element);
    const { innerWidth, innerHeight } = defaultView(ownerDocument(element));
    return box.width >= 4 && box.height >= 4 && box.bottom > 0 && box.right > 0 && box.top < innerHeight && box.left < innerWidth;
  };
  // What has no box of its own, such as a slot, shows its text if what it lies in does.
  const showsText = (element) =>
    Boolean(element) &&
    (checkVisibility(element, VISIBLE) ||
      (getComputedStyle(element).display === 'contents' && showsText(webgym.geometry.parentOf(element))));

  // No document lists those in its shadow roots. A thousand take the browser half a second to put in order, so they
  // are asked for in a quarter of the time at most.
  const SHARE = 4;
  let listed = [];
  let listedUntil = -Infinity;
  const animations = () => {
    const start = performance.now();
    if (start < listedUntil) return listed;
    listed = roots().flatMap((root) => getAnimations(root));
    const end = performance.now();
    listedUntil = end + SHARE * (end - start);
    return listed;
  };
  const endOf = (animation) => (animation.effect ? animation.effect.getComputedTiming().endTime : 0);

  // Small things without words that turn or pulse for ever. A crowd of them is decoration.
  const CROWD = 100;
  const isSmall = (element) => offsetWidth(element) * offsetHeight(element) < (innerWidth * innerHeight) / 4;
  const turning = () => {
    const endless = animations().filter((animation) => animation.playState === 'running' && endOf(animation) === Infinity);
    const isWordless = ({ target, pseudoElement }) => target && (pseudoElement || !/\p{L}/u.test(textContent(target)));
    const effects = endless.length > CROWD ? [] : endless.map(({ effect }) => effect).filter(isWordless);
    return effects.map(({ target }) => target).filter(isSmall);
  };

  const textsIn = function* (root) {
    const isShadow = nodeType(root) !== Node.DOCUMENT_NODE;
    const walker = createTreeWalker(ownerDocument(root) || root, isShadow ? root : body(root), NodeFilter.SHOW_TEXT);
    for (let n = 0; n < TEXTS && walker.nextNode(); n++) {
      const { data, parentElement } = walker.currentNode;
      const parent = parentElement || root.host;
      if (/\S/.test(data) && !SKIPPED.has(nodeName(parent))) yield [data, parent];
    }
  };

  // All that shows that more is to come.
  const signs = (spinners = turning()) => {
    const found = [...spinners];
    let isBlank = Boolean(body(document));
    for (const root of roots()) {
      if (nodeType(root) === Node.DOCUMENT_NODE && !body(root)) continue;
      found.push(...querySelectorAll(root, SAID));
      const isMain = root === document || ownerDocument(root) === document;
      for (const [data, parent] of textsIn(root)) {
        if (data.length <= TEXT_LENGTH && TELLS.test(data)) found.push(parent);
        isBlank &&= !(isMain && showsText(parent));
      }
      isBlank &&= !(isMain && [...querySelectorAll(root, CONTENT)].some(isSeen));
    }
    return [...(isBlank ? [BLANK] : []), ...found.filter(isSeen)];
  };

  // What was shown when a wait ended is no news in the next one, unless it was gone in between.
  let [shown, latest] = [new Set(), []];
  webgym.overlook = () => (latest = signs());

  // --- when is it quiet ---------------------------------------------------------------------------

  const FRAME = 1000; // longest wait for a frame, ms: what is not drawn by then is not drawn at all
  const IDLE = 100; // the same for an idle moment
  const pause = (milliseconds) => new Promise((resolve) => timers.take(window, resolve, milliseconds));
  const frame = () =>
    new Promise((resolve) => {
      const limit = timers.take(window, resolve, FRAME);
      frames.take(window, () => (clearTimeout(limit), resolve()));
    });
  const idle = () => new Promise((resolve) => idles.take(window, resolve, { timeout: IDLE }));
  // Whether the page's scripts leave a moment to spare: a task that lets all others go first soon has its turn.
  const isFree = async (limit) => {
    const start = performance.now();
    await scheduler.postTask(nothing, { priority: 'background' });
    return performance.now() - start < limit;
  };

  // Animations that run and end within the time that is waited for it: half of it for those that may hide a message
  // again, and all of it for a transition that began after the action. What was moved anew for as long as anyone waits
  // is moved for ever.
  const movedForEver = new WeakSet();
  const moving = (limit) =>
    animations().filter((animation) => {
      if (animation.playState !== 'running' || movedForEver.has(animation.effect && animation.effect.target)) return false;
      const left = endOf(animation) - (animation.currentTime || 0);
      const isNew = animation.transitionProperty && !(animation.startTime < state.actedAt);
      return Number.isFinite(left) && left < (isNew ? limit : limit / 2);
    });

  // Whether anything moves that will come to rest.
  webgym.isMoving = () => moving(Infinity).length > 0;

  // Whether the page asked for a frame or an idle moment since this was asked last.
  const hasPlanned = () => {
    const before = state.asked;
    state.asked = countFrames() + idles.asked();
    return state.asked !== before;
  };

  // What a person would call what has changed: by its text, if that is short.
  const nameOf = (node) => {
    const text = node && typeOf(node) && fold((textContent(node) || '').slice(0, 2 * TEXT_LENGTH));
    return text && text.length <= TEXT_LENGTH ? text : '';
  };

  // Resolves once the page showed no change for a while. Times in milliseconds:
  //   since     number of changes before the action; a page that has not changed since is given
  //   reaction  to do so (and to react, if it has only been scrolled), and one that has must be still for
  //   quiet     and is not waited for any longer after
  //   busy;
  //   linger    how long what shows that the page is loading is waited for to vanish.
  // `isNew` says that a wait begins, `isFirst` that the document was never quiet before, `blank` that there is nothing
  // to come on a page that shows nothing; `wanted` is what `result` is to tell.
  // Time is counted in ticks of its own. A process that is stopped does not tick, so a clock that jumps
  // while timers that came due in the meantime fire one after the other makes nothing look still.
  webgym.quiet = async ({ since, tick, reaction, quiet, busy, linger, isNew, isFirst, blank, wanted }) => {
    if (isNew) shown = new Set(blank ? [...latest, BLANK] : latest);
    isStill ||= state.hasInput; // an action: from now on
    state.hasInput = state.isAlone = false;
    webgym.attach();
    webgym.askFrame();
    let [elapsed, still, known, needed, wasMoving, isCounting] = [0, 0, state.changes, quiet, false, isFirst];
    let hasSeenFrame = false;
    webgym.census(isFirst);
    let [found, patience, changing] = [null, 0, null]; // a new sign of loading, and what goes on and on
    const look = () => {
      const spinners = turning();
      latest = signs(spinners);
      found = latest.find((one) => !shown.has(one)) || null;
      patience = spinners.includes(found) ? linger / 2 : linger;
    };
    const verdict = (reason) => {
      webgym.settleRestless(reason === 'busy', isFirst);
      webgym.census(false);
      state.settled = state.reactions;
      const loading = found && (found === BLANK ? BLANK : 'sign');
      return { reason, ...webgym.result(wanted), loading, changing, timers: webgym.plans().timers };
    };
    // What a tick counts for towards the limits: on a busy machine it comes late. A clock may also have jumped.
    const LATE = 10;
    const counted = (began, ticks) => Math.min(LATE * ticks, Math.max(ticks, performance.now() - began));
    // Still, and nothing that was planned for a frame or an idle moment is left.
    const isDone = async () => {
      if (state.frame === 'due') {
        if (!(await webgym.frame(FRAME))) state.frame = 'late';
        elapsed += tick;
        return false;
      }
      if (!state.isTireless && hasPlanned()) {
        state.isTireless = elapsed >= busy / 2;
        if (state.isTireless && webgym.hasDrawn()) changing = '';
        const began = performance.now();
        await frame(); // comes after the page's own, which may be late
        elapsed += counted(began, tick);
        return false;
      }
      if (idles.asked() !== state.idles) {
        await idle(); // after the page's own
        state.idles = idles.asked();
        return state.isTireless;
      }
      if (state.isTireless && !hasSeenFrame) await frame(); // it may scroll with each
      hasSeenFrame = true;
      return ((await isFree(tick)) || (await isFree(tick))) && state.changes === known; // a frame takes as long
    };
    for (;;) {
      const pulse = Math.min(tick, Math.max(1, needed - still));
      const began = performance.now();
      await pause(pulse);
      elapsed += counted(began, pulse);
      const isMoving = moving(busy).length > 0;
      if (wasMoving && !isMoving) webgym.askFrame(); // with which the page is told that it has ended
      wasMoving = isMoving;
      if (isMoving) still = 0;
      else if (state.changes === known) still += pulse;
      else still = Math.min(pulse, performance.now() - state.changedAt);
      if (state.changes !== known) webgym.attach();
      known = state.changes;
      const isSame = state.changes === since;
      needed = isSame || (since >= 0 && state.reactions === state.settled) ? reaction : quiet;
      if (still >= needed) {
        if (await isDone()) {
          if (!isSame) look();
          if (!found || elapsed >= patience) return verdict(isSame ? 'unchanged' : 'quiet');
          still = 0; // looked for again in a while
        } else still = needed - tick;
      }
      if (elapsed >= Math.max(busy, found ? patience : 0)) {
        for (const { effect } of moving(busy)) if (effect.target) movedForEver.add(effect.target);
        changing = nameOf(state.changedNode);
        look();
        return verdict('busy');
      }
      if (elapsed >= busy / 3 && !isCounting) {
        isCounting = true;
        webgym.census(true);
        hasPlanned();
      }
    }
  };
})();
