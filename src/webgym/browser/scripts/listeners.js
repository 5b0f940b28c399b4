// Runs in the page's own world before its scripts, with the command line's `getEventListeners`: our isolated worlds
// cannot see what listens there. They ask by an event of a secret name, which is cancelled where a press of the mouse
// would be heard; one that bubbles asks whether more is heard than the button going down, as by what is only dragged. Another
// asks for the wheel. No page can see these listeners; what it changes in its own world can only make answers "no".
((question) => {
  const listenersOf = getEventListeners;
  const { call } = Function.prototype;
  const { getOwnPropertyDescriptor, getOwnPropertyNames, getOwnPropertySymbols } = Object;
  const { composedPath, preventDefault } = Event.prototype;
  const [pathOf, cancel, matches, startsWith, textOf, find, bubbles] = [
    composedPath, preventDefault, Element.prototype.matches, String.prototype.startsWith,
    Function.prototype.toString, RegExp.prototype.exec,
    getOwnPropertyDescriptor(Event.prototype, 'bubbles').get,
  ].map((method) => call.bind(method));
  const parentOf = call.bind(getOwnPropertyDescriptor(Node.prototype, 'parentNode').get);
  const { max } = Math;
  const page = document;
  const own = (thing, name) => (isThing(thing) && getOwnPropertyDescriptor(thing, name) || {}).value;
  const isThing = (value) => value !== null && (typeof value === 'object' || typeof value === 'function');

  const PRESSES = ['click', 'mouseup', 'pointerup', 'dblclick', 'contextmenu', 'mousedown', 'pointerdown'];
  const PROPS = [
    'onClick', 'onMouseUp', 'onPointerUp', 'onDoubleClick', 'onContextMenu', 'onMouseDown', 'onPointerDown',
  ];
  const WHEELS = ['wheel', 'mousewheel'];
  const FIRST_DOWN = 5; // the two above in which the button goes down
  const [DOWN, CLICK] = [1, 2]; // what is heard at most

  // A handler that keeps the event from having an effect, and has none itself: no menu of the browser, say. Of a
  // button that goes down, that is what buttons do whose clicks are heard around them: they keep the focus.
  const LONGEST = 200; // characters
  const IDLE = (() => {
    const head = /(?:async\s+)?(?:function\b[^(]*|[\w$]+(?=\())?(?:\([\w$,\s]*\)|[\w$]+)\s*(?:=>)?[\s{(]*/.source;
    const stops = /[\w$]+\.(?:(?:preventDefault|stopPropagation|stopImmediatePropagation)\(\)|(?:cancelBubble|returnValue)\s*=)/;
    const part = `(?:return\\b|(?:javascript:)?void ?\\(?0\\)?|undefined|null|true|false|![01]|${stops.source})`;
    return new RegExp(`^${head}${part}(?:[\\s;,]|&&|${part})*[})\\s]*$`);
  })();
  const isIdle = (handler) => {
    if (typeof handler !== 'function') return false;
    const text = textOf(handler);
    return text.length <= LONGEST && find(IDLE, text) !== null;
  };
  // Of listeners, or of a handler itself, is there one that may do something?
  const isAnswered = (heard, isReact) => {
    const count = typeof heard === 'object' ? own(heard, 'length') : 0;
    for (let i = 0; i < count; i++) {
      const listener = own(own(heard, i), 'listener');
      if (!isIdle(listener) && !(isReact && isBound(listener))) return true;
    }
    return !count && Boolean(heard) && !isIdle(heard);
  };
  const isBound = (handler) => typeof handler === 'function' && find(BOUND, textOf(handler)) !== null;
  const BOUND = /^function [^{]*\{\s*\[native code\]\s*\}$/; // as all of React's own
  // `isReact`: React listens there, too, even where only for a change of the selection, as at every document.
  const most = (thing, names, isReact) => {
    for (let i = 0; thing && i < names.length; i++) {
      const heard = own(thing, names[i]);
      if (heard && ((i >= FIRST_DOWN && !isReact) || isAnswered(heard, isReact))) return i < FIRST_DOWN ? CLICK : DOWN;
    }
    return 0;
  };
  // Svelte, Solid, Inferno and React have one listener at the root for all: what an element hears is kept with it.
  const heardBy = (element) => {
    if (own(element, '__click') || own(element, '$$click')) return CLICK;
    let found = most(own(element, '$EV'), PROPS);
    const names = getOwnPropertyNames(element);
    let isRoot = false;
    for (let i = 0; found < CLICK && i < names.length; i++) {
      const isProps = startsWith(names[i], '__reactProps$') || startsWith(names[i], '__reactEventHandlers$');
      if (isProps) found = max(found, most(own(element, names[i]), PROPS));
      isRoot ||= startsWith(names[i], '_reactListen');
    }
    const symbols = found < CLICK ? getOwnPropertySymbols(element) : [];
    for (let i = 0; i < symbols.length; i++) found = max(found, most(own(element, symbols[i]), PRESSES));
    if (element === page) return max(found, most(listenersOf(element), PRESSES, isRoot));
    return found === CLICK || isRoot ? found : max(found, most(listenersOf(element), PRESSES));
  };

  // jQuery, be it bundled, listens at an element around, for those below it that match a selector.
  const eventsOf = (node) => {
    const names = getOwnPropertyNames(node);
    for (let i = 0; i < names.length; i++) {
      const events = startsWith(names[i], 'jQuery') && own(own(node, names[i]), 'events');
      if (events) return events;
    }
    return null;
  };
  const delegatedFor = (element) => {
    let found = 0;
    for (let around = parentOf(element); around; around = parentOf(around)) {
      const events = eventsOf(around);
      for (let k = 0; events && k < PRESSES.length; k++) {
        const handlers = own(events, PRESSES[k]) || [];
        for (let n = 0; n < handlers.length; n++) {
          const { selector } = handlers[n];
          if (!selector || startsWith(selector, '*') || !matches(element, selector)) continue; // "*": of anything
          if (k < FIRST_DOWN) return CLICK;
          found = DOWN;
        }
      }
    }
    return found;
  };

  const answer = (event) => {
    try {
      const element = pathOf(event)[0];
      let heard = heardBy(element);
      if (heard < CLICK) heard = max(heard, delegatedFor(element));
      if (heard === CLICK || (heard === DOWN && !bubbles(event))) cancel(event);
    } catch {
      // of what the page has put there: nothing can be told
    }
  };
  addEventListener(question, answer, true);

  const answerWheel = (event) => {
    try {
      if (most(listenersOf(pathOf(event)[0]), WHEELS)) cancel(event);
    } catch {
      // nothing can be told
    }
  };
  addEventListener(`${question}-wheel`, answerWheel, true);
})
