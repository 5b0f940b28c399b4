// A picture that is taken while the page is still waited for: is it one of the page as it is after the wait?
(() => {
  const webgym = globalThis.webgym;
  if (webgym.beginEarly) return;
  const { documentElement, getSelection, getAnimations, querySelector, querySelectorAll } = webgym.dom;
  const { state } = webgym;

  // What changes the picture and is neither a change of the document nor one of its aspect.
  const STIRS = [
    'pointerover', 'pointerout', 'load', 'error', 'loadeddata', 'play', 'pause', 'seeked', 'transitionrun', 'animationstart',
    'fullscreenchange', 'toggle', 'focusin', 'focusout',
  ];
  let stirs = 0;
  const onStir = ({ target }) => state.ours.has(target) || (stirs += 1);
  for (const name of STIRS) webgym.listen([name, onStir, { capture: true, passive: true }]);

  // What is selected; a caret is not drawn.
  const selected = () => {
    const { isCollapsed, anchorNode, anchorOffset, focusNode, focusOffset } = getSelection(document);
    return isCollapsed ? [] : [anchorNode, anchorOffset, focusNode, focusOffset];
  };
  // Two are the same if nothing changed in between, nor was planned.
  const moment = () => [
    state.changes, stirs, ...Object.values(webgym.plans()), ...selected(), ...webgym.ruleCounts(), ...webgym.fieldValues(),
  ];

  // Whether no task is left to do: one that lets all others go first has its turn.
  const PATIENCE = 30; // ms: the frame that an input event causes takes longer than 10
  const isIdle = () =>
    Promise.race([
      scheduler.postTask(() => true, { priority: 'background' }),
      scheduler.postTask(() => false, { priority: 'user-blocking', delay: PATIENCE }),
    ]);

  let early = null; // {moment}: that of the first frame after `beginEarly`

  // A picture is about to be asked for. Gives whether it is worth it: whether the action set nothing off that is yet
  // to come. `isCalm`: not to wait until nothing is left to do; it is found in the end whether anything was.
  //
  // A picture shows the next frame or a later one, so all that comes up to the next frame is in it. Resizes are told
  // after everything else that a frame lets scripts do, and what is drawn then is in the same frame.
  webgym.beginEarly = async (isCalm) => {
    early = null;
    if (!webgym.hideCaret() || !(isCalm || (await isIdle())) || webgym.hasSetOff() || webgym.isMoving() || webgym.hasDrawn()) return false;
    const mine = (early = { moment: null });
    const observer = new ResizeObserver(() => {
      observer.disconnect();
      if (early === mine) mine.moment = moment();
    });
    observer.observe(documentElement(document));
    return true;
  };

  // What came of the action by now: [what `observe` tells of the page] if it looks as it did in that frame, [] if it
  // does not or nothing is `wanted`; and its effect.
  webgym.result = (wanted) => {
    const isSame = wanted && early && early.moment && webgym.isEqual(early.moment, moment()) && !webgym.isMoving();
    const contents = isSame ? [webgym.observe(wanted, {})] : [];
    state.plansAtRest = webgym.plans();
    return { changes: state.changes, contents, effect: webgym.effect(), missed: state.hasMissed };
  };

  // What may move although the page's own thread paints nothing.
  const MOVES = 'canvas, video, audio, embed, object, marquee, progress:not([value])';
  const isForeign = (frame) => !webgym.frameIn(frame);
  const mayMove = (root) =>
    Boolean(querySelector(root, MOVES)) || getAnimations(root).some(({ playState }) => playState === 'running') ||
    [...querySelectorAll(root, 'iframe, frame')].some(isForeign);

  // [what `observe` tells of the page, null if nothing is `wanted`] if nothing moves, [] if something may. What the page
  // had still to paint is painted by then.
  const LONGEST = 1000; // ms until a frame comes
  webgym.rest = async (wanted) => {
    const roots = [...webgym.views().map(({ document }) => document), ...webgym.shadows()];
    if (!webgym.hideCaret() || roots.some(mayMove) || !(await webgym.frame(LONGEST))) return [];
    await scheduler.postTask(() => {});
    return [wanted && webgym.observe(wanted, {})];
  };

  // No picture is asked for after all.
  webgym.dropEarly = () => {
    early = null;
  };
})();
