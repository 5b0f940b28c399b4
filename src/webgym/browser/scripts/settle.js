// Runs in the same isolated world as page.js: is the page quiet, and what says that more is to come?
(() => {
  const webgym = globalThis.webgym;
  if (webgym.quiet) return;
  const {
    nodeName, nodeType, ownerDocument, getAttribute, checkVisibility, getBoundingClientRect, body, defaultView,
    createTreeWalker, getAnimations, querySelector, querySelectorAll, offsetWidth, offsetHeight, matches, closest, isConnected,
    parentNode, textContent, childElementCount, elementsFromPoint, getRootNode,
  } = webgym.dom;
  const { state, views } = webgym;

  // --- what the page has planned ------------------------------------------------------------------
  // Handles of timers, frames and idle moments count up per window, over all worlds. One taken now tells
  // how many the page has asked for, without a touch on its functions.

  const nothing = () => {};
  const counter = (ask, cancel) => {
    const ours = new WeakMap(); // document -> handles that we took: a frame's next document counts anew, in the same window
    const take = (view, ...wanted) => {
      const handle = view[ask](...wanted);
      if (handle) ours.set(view.document, (ours.get(view.document) || 0) + 1);
      return handle;
    };
    const last = () =>
      views().map((view) => {
        const handle = take(view, nothing);
        if (!handle) return [0, 0]; // no scripts in this frame
        view[cancel](handle);
        return [handle, handle - ours.get(view.document)];
      });
    const sum = (index) => last().reduce((total, counts) => total + counts[index], 0);
    return { take, given: () => sum(0), asked: () => sum(1) };
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

  const A_FRAME = 50; // ms: the time of a frame, from which animations count, is that before its events

  // The first input event of an action comes before the page's own listeners. A mouse leaves one element and enters
  // another before it moves there; it does so too when the page moves under it, which says nothing of a target.
  const BEFORE_MOVING = ['pointerout', 'pointerover'];
  const onInput = (event) => {
    state.hasTyped ||= event.type === 'input';
    if (state.target === 0 && !BEFORE_MOVING.includes(event.type)) state.target = numberOf(event.target);
    if (state.planned !== null) return;
    state.actedAt = performance.now() - A_FRAME;
    state.planned = timers.asked();
    state.idles = idles.asked();
    remember();
  };
  // Elements by number, in the order in which they are first acted on.
  const numbers = new WeakMap();
  let lastNumber = 0;
  const numberOf = (target) => {
    if (!numbers.has(target)) numbers.set(target, ++lastNumber);
    return numbers.get(target);
  };
  state.planned = null;
  state.actedAt = Infinity;
  state.target = 0;
  state.hasTyped = false;
  state.idles = 0;
  state.asked = 0; // frames and idle moments
  state.settled = -1; // reactions when it was last quiet
  state.isTireless = false; // draws frame after frame, for ever
  for (const name of [...BEFORE_MOVING, 'pointermove', 'pointerdown', 'keydown', 'wheel', 'input'])
    webgym.listen([name, onInput, { capture: true, passive: true }]);

  // --- what shows that it is loading --------------------------------------------------------------

  const WORDS = ['skeleton', 'shimmer', 'loading', 'loader', 'preloader'];
  const NAMED = ['skeleton', 'spin', 'shimmer', 'load'].map((word) => `[class*="${word}" i]`).join();
  const word = (...words) => new RegExp(`(^|[\\s_-])(${words.join('|')})([\\s_-]|$)`, 'i');
  const isNamed = word(...WORDS);
  const isNamedSpinner = word('spinner');
  // "lazy-loading", "ant-spin-nested-loading" and "loader-hidden" are names of what does not load now.
  const ONE = `(?:${WORDS.join('|')})`;
  const UNMEANT = new RegExp(
    `(?<![^\\s_-])(?:(?:no|not|lazy|nested|infinite)[_-]+${ONE}|${ONE}[_-]+(?:lazy|done|hidden))(?![^\\s_-])`,
    'gi',
  );
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

  const overlooked = new Map(); // what showed it for as long as anyone would wait -> whether it still would
  let isBlankKnown = false; // a page that shows nothing is to show nothing

  const isSeen = (element) => {
    if (!checkVisibility(element, VISIBLE)) return false;
    const box = getBoundingClientRect(element);
    const { innerWidth, innerHeight } = defaultView(ownerDocument(element));
    return box.width >= 4 && box.height >= 4 && box.bottom > 0 && box.right > 0 && box.top < innerHeight && box.left < innerWidth;
  };
  const isSign = (element) => element && !overlooked.has(element) && isSeen(element);

  // No document lists those in its shadow roots. A thousand take the browser half a second to put in order, so they
  // are asked for in a quarter of the time at most.
  const SHARE = 4;
  let listed = [];
  let listedUntil = -Infinity;
  const animations = () => {
    const start = performance.now();
    if (start < listedUntil) return listed;
    listed = [...views().map((view) => view.document), ...webgym.shadows()].flatMap((root) => getAnimations(root));
    const end = performance.now();
    listedUntil = end + SHARE * (end - start);
    return listed;
  };
  const endOf = (animation) => (animation.effect ? animation.effect.getComputedTiming().endTime : 0);

  // A small thing that turns or pulses for ever. A crowd of them is decoration.
  const CROWD = 100;
  const isSmall = (element) => {
    const { innerWidth, innerHeight } = defaultView(ownerDocument(element));
    return offsetWidth(element) * offsetHeight(element) < (innerWidth * innerHeight) / 4;
  };
  // A text that runs through for ever, such as news in one line, says nothing of what is to come.
  const MOVES = ['left', 'marginLeft', 'textIndent', 'translate'];
  const isMoved = (frame) =>
    MOVES.some((name) => name in frame) || (/translate/.test(frame.transform) && !/rotate|scale/.test(frame.transform));
  const isTicker = ({ effect }) =>
    Boolean(effect.target) && !effect.pseudoElement && effect.getKeyframes().some(isMoved) &&
    /\p{L}{2}/u.test(textContent(effect.target));
  const endless = () => {
    const found = animations().filter((animation) => animation.playState === 'running' && endOf(animation) === Infinity);
    const few = found.length > CROWD ? [] : found.filter((animation) => !isTicker(animation));
    const elements = few.map((animation) => animation.effect.target);
    return elements.filter((element) => element && isSmall(element));
  };
  let turning = null; // what was found in this pass
  const allTurning = () => (turning ??= new Set(endless()));

  const isShadow = (root) => nodeType(root) !== Node.DOCUMENT_NODE;
  const SKIPPED = new Set(['SCRIPT', 'STYLE', 'NOSCRIPT', 'TEMPLATE', 'TITLE']);
  const CONTENT = 'img, svg, canvas, video, iframe, frame, object, embed, input, button, select, textarea';

  // What has no box of its own, such as a slot, shows its text if what it lies in does.
  const showsText = (element) =>
    Boolean(element) &&
    (checkVisibility(element, VISIBLE) ||
      (getComputedStyle(element).display === 'contents' && showsText(webgym.geometry.parentOf(element))));

  // Yields what holds a text that says so; returns whether nothing at all is to be read or seen.
  function* told(root) {
    const host = isShadow(root) ? root.host : null;
    const document = ownerDocument(root) || root;
    const walker = createTreeWalker(document, host ? root : body(root), NodeFilter.SHOW_TEXT);
    let isBlank = true;
    for (let n = 0; n < TEXTS && walker.nextNode(); n++) {
      const { data } = walker.currentNode;
      const parentElement = walker.currentNode.parentElement || host;
      const tells = data.length <= TEXT_LENGTH && TELLS.test(data);
      if (!tells && !(isBlank && /\S/.test(data))) continue;
      if (SKIPPED.has(nodeName(parentElement))) continue;
      if (tells && isSign(parentElement)) yield parentElement;
      isBlank &&= !showsText(parentElement);
    }
    return isBlank && ![...querySelectorAll(root, CONTENT)].some(isSeen);
  }

  // A box to enter a number in is named like what turns: it holds a field or buttons, and nothing in it turns.
  const CONTROLS = 'input, select, textarea, button, [role="button" i], [role="spinbutton" i]';
  const isIn = (element, box) => element === box || (element && isIn(parentNode(element), box));
  const isNumberBox = (element) => {
    const box = closest(element, `[class*="spinner" i]:has(${CONTROLS})`) || element;
    if (!matches(box, CONTROLS) && !querySelector(box, CONTROLS)) return false;
    return ![...allTurning()].some((element) => isIn(element, box));
  };
  // What is named a skeleton may be the frame of what is there: several texts show in it, with nothing over them.
  const isFilled = (element, name) => {
    const shows = (one) => {
      const { left, top, width, height } = getBoundingClientRect(one);
      const isText = !childElementCount(one) && textContent(one).trim();
      const layers = isText ? elementsFromPoint(getRootNode(one), left + width / 2, top + height / 2) : [];
      return isText && layers.find((layer) => isIn(layer, element)) === one;
    };
    const isOther = isNamed.test(name.replace(/skeleton|shimmer/gi, ''));
    return !isOther && [...querySelectorAll(element, '*')].slice(0, PARTS).filter(shows).length >= TEXTS_SHOWN;
  };
  const [PARTS, TEXTS_SHOWN] = [100, 3];
  const isSaid = (element) => matches(element, SAID);
  const isCalled = (element) => {
    const name = (getAttribute(element, 'class') || '').replace(UNMEANT, '');
    if (getAttribute(element, 'aria-busy') === 'false') return false;
    return (isNamed.test(name) && !isFilled(element, name)) || (isNamedSpinner.test(name) && !isNumberBox(element));
  };
  const isTold = (element) => TELLS.test(textContent(element).slice(0, TEXT_LENGTH));
  const isTurning = (element) => allTurning().has(element);

  // All that shows that more is to come: elements and the tests that found them, `true` for a page that shows nothing.
  function* signs() {
    turning = null;
    const shadows = webgym.shadows();
    let isBlank = Boolean(body(document)) && !isBlankKnown;
    for (const root of [...views().map((view) => view.document), ...shadows]) {
      if (!isShadow(root) && !body(root)) continue;
      for (const element of querySelectorAll(root, SAID)) if (isSign(element)) yield [element, isSaid];
      for (const element of querySelectorAll(root, NAMED))
        if (isCalled(element) && isSign(element)) yield [element, isCalled];
      let next;
      for (const texts = told(root); !(next = texts.next()).done; ) yield [next.value, isTold];
      if (root === document || ownerDocument(root) === document) isBlank &&= next.value;
    }
    if (isBlank) yield true;
    for (const element of allTurning()) if (isSign(element)) yield [element, isTurning];
  }
  const sign = () => signs().next().value || null;

  // Take what is shown now for decoration: it is no sign any more in this document, unless it goes and comes again.
  webgym.overlook = () => {
    for (const found of signs()) {
      if (found === true) isBlankKnown = true;
      else overlooked.set(...found);
    }
  };
  const remember = () => {
    turning = null;
    for (const [element, holds] of overlooked)
      if (!isConnected(element) || !checkVisibility(element) || !holds(element)) overlooked.delete(element);
  };

  // --- what a timer brings ------------------------------------------------------------------------

  // Count events of these names, but for our own elements: what changes without a change of the document.
  webgym.countEvents = (names) => {
    let count = 0;
    const onEvent = ({ target }) => state.ours.has(target) || (count += 1);
    for (const name of names) webgym.listen([name, onEvent, { capture: true, passive: true }]);
    return () => count;
  };
  const stirs = webgym.countEvents(['toggle', 'focusin', 'focusout']);
  const aspect = (webgym.aspect = () => [stirs(), ...webgym.ruleCounts(), ...webgym.fieldValues()]);
  let before = null;

  // A timer is about to fire.
  webgym.beginTimer = () => (before = aspect());
  // "some" effect besides changes, "none", or "unseen": only a picture could tell.
  const timerEffect = () => {
    if (!before) return 'none';
    if (!webgym.isEqual(before, aspect())) return 'some';
    return webgym.hasDrawn() ? 'unseen' : 'none';
  };

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

  // Animations that run and end within the time that is waited for it. What was moved anew for as long as anyone
  // waits is moved for ever.
  const movedForEver = new WeakSet();
  // A transition that began after the action is waited for longer, for it never hides a message after a while, as
  // other animations do.
  const moving = (limit, longLimit = limit) =>
    animations().filter((animation) => {
      if (animation.playState !== 'running' || movedForEver.has(animation.effect && animation.effect.target)) return false;
      const end = endOf(animation);
      const isNew = animation.transitionProperty && !(animation.startTime < state.actedAt);
      return Number.isFinite(end) && end - (animation.currentTime || 0) < (isNew ? longLimit : limit);
    });

  // Whether anything moves that will come to rest.
  webgym.isMoving = () => moving(Infinity).length > 0;

  // Whether the page asked for a frame or an idle moment since this was asked last.
  const hasPlanned = () => {
    const before = state.asked;
    state.asked = countFrames() + idles.asked();
    return state.asked !== before;
  };

  // Resolves once the page showed no change for a while. Times in milliseconds:
  //   since     number of changes before the action; a page that has not changed since is given
  //   reaction  to do so (and to react, if it has only been scrolled), and one that has must be still for
  //   quiet     and is not waited for any longer after
  //   stir;
  //   busy      how long an animation may take that is waited for, and what a script moves on and on;
  //   linger    how long what shows that the page is loading is waited for to vanish.
  // `blank` says that there is nothing to come on a page that shows nothing, `timed` that a timer was waited for;
  // `wanted` is what `result` is to tell.
  // Time is counted in ticks of its own. A process that is stopped does not tick, so a clock that jumps
  // while timers that came due in the meantime fire one after the other makes nothing look still.
  webgym.quiet = async ({ since, tick, reaction, quiet, busy, stir, linger, blank, timed, wanted }) => {
    isBlankKnown ||= blank;
    const { planned, target, hasTyped } = state;
    isStill ||= planned !== null; // an action: from now on
    state.planned = null;
    state.target = 0;
    state.hasTyped = false;
    webgym.attach();
    webgym.askFrame();
    const early = timers.asked();
    let [elapsed, still, known, needed] = [0, 0, state.changes, quiet];
    let wasMoving = false;
    const census = [busy / 3, Math.max(busy, stir / 3)]; // when changes are counted anew
    let isMarked = false; // have things been looked at that move on and on?
    let found = null;
    const patience = () => (found === true || found[1] === isTurning ? linger / 2 : linger);
    const verdict = (reason) => {
      webgym.census(false);
      const hasReacted = state.reactions !== state.settled;
      state.settled = state.reactions;
      return {
        reason, ...webgym.result(wanted), loading: Boolean(found), blank: found === true,
        planned, target, typed: hasTyped, early, timers: timers.asked(), handles: timers.given(),
        timer_effect: timed ? timerEffect() : 'none', reacted: hasReacted,
      };
    };
    // Still, and nothing that was planned for a frame or an idle moment is left.
    const isDone = async () => {
      if (state.frame === 'due') {
        if (!(await webgym.frame(FRAME))) state.frame = 'late';
        elapsed += tick;
        return false;
      }
      if (hasPlanned() && !state.isTireless) {
        await frame(); // comes after the page's own, which may be late
        elapsed += tick;
        return false;
      }
      if (idles.asked() !== state.idles) {
        await idle(); // after the page's own
        state.idles = idles.asked();
        return state.isTireless;
      }
      return ((await isFree(tick)) || (await isFree(tick))) && state.changes === known; // a frame takes as long
    };
    for (;;) {
      const pulse = Math.min(tick, Math.max(1, needed - still));
      await pause(pulse);
      elapsed += pulse;
      const isMoving = moving(busy, stir).length > 0;
      if (wasMoving && !isMoving) webgym.askFrame(); // with which the page is told that it has ended
      wasMoving = isMoving;
      if (isMoving) still = 0;
      else if (state.changes === known) still += pulse;
      else still = Math.min(pulse, performance.now() - state.changedAt);
      if (state.changes !== known) webgym.attach();
      known = state.changes;
      const isSame = state.changes === since;
      const isCalm = isSame || (since >= 0 && state.reactions === state.settled);
      needed = isCalm ? reaction : quiet;
      if (still >= needed) {
        if (await isDone()) {
          found = isSame ? null : sign();
          if (!found || elapsed >= patience()) return verdict(isSame ? 'unchanged' : 'quiet');
          still = 0; // looked for again in a while
        } else still = needed - tick;
      }
      if (elapsed >= Math.max(stir, found ? patience() : 0)) {
        webgym.settleSwarm();
        webgym.settleRestless();
        for (const { effect } of moving(busy, stir)) if (effect.target) movedForEver.add(effect.target);
        state.isTireless ||= hasPlanned();
        found ||= sign(); // it was to be seen for as long as anyone waits
        return verdict('busy');
      }
      if (elapsed >= busy && !isMarked) {
        isMarked = true;
        if (webgym.settleSwarm()) {
          state.isTireless ||= hasPlanned();
          found = sign();
          if (!found) return verdict('busy');
        }
      }
      if (elapsed >= census[0]) {
        census.shift();
        webgym.census(false);
        webgym.census(true);
        hasPlanned();
      }
    }
  };
})();
