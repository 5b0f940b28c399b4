// Runs in the page's own world before its scripts, with the command line's `getEventListeners`: our isolated worlds
// cannot see what listens there. They ask by an event of a secret name, which is cancelled where a press of the mouse
// would be heard. No page can see this listener; what it changes in its own world can only make answers "no".
((question) => {
  const listenersOf = getEventListeners;
  const { call } = Function.prototype;
  const { composedPath, preventDefault } = Event.prototype;
  const [pathOf, cancel, matches, startsWith] = [
    composedPath, preventDefault, Element.prototype.matches, String.prototype.startsWith,
  ].map((method) => call.bind(method));
  const parentOf = call.bind(Object.getOwnPropertyDescriptor(Node.prototype, 'parentNode').get);
  const { getOwnPropertyDescriptor, getOwnPropertyNames, getOwnPropertySymbols } = Object;
  const own = (thing, name) => (isThing(thing) && getOwnPropertyDescriptor(thing, name) || {}).value;
  const isThing = (value) => value !== null && (typeof value === 'object' || typeof value === 'function');

  const PRESSES = ['click', 'mousedown', 'pointerdown', 'mouseup', 'pointerup', 'dblclick', 'contextmenu'];
  const hasAny = (thing, names) => {
    for (let i = 0; thing && i < names.length; i++) if (own(thing, names[i])) return true;
    return false;
  };
  // Svelte, Solid, Inferno and React have one listener at the root for all: what an element hears is kept with it.
  const hears = (element) => {
    if (own(element, '__click') || own(element, '$$click') || hasAny(own(element, '$EV'), PROPS)) return true;
    const names = getOwnPropertyNames(element);
    let isRoot = false;
    for (let i = 0; i < names.length; i++) {
      const isProps = startsWith(names[i], '__reactProps$') || startsWith(names[i], '__reactEventHandlers$');
      if (isProps && hasAny(own(element, names[i]), PROPS)) return true;
      isRoot ||= startsWith(names[i], '_reactListen');
    }
    const symbols = getOwnPropertySymbols(element);
    for (let i = 0; i < symbols.length; i++) if (hasAny(own(element, symbols[i]), PRESSES)) return true;
    return !isRoot && hasAny(listenersOf(element), PRESSES);
  };
  const PROPS = [
    'onClick', 'onMouseDown', 'onPointerDown', 'onMouseUp', 'onPointerUp', 'onDoubleClick', 'onContextMenu',
  ];

  // jQuery, be it bundled, listens at an element around, for those below it that match a selector.
  const eventsOf = (node) => {
    const names = getOwnPropertyNames(node);
    for (let i = 0; i < names.length; i++) {
      const events = startsWith(names[i], 'jQuery') && own(own(node, names[i]), 'events');
      if (events) return events;
    }
    return null;
  };
  const isDelegated = (element) => {
    for (let around = parentOf(element); around; around = parentOf(around)) {
      const events = eventsOf(around);
      for (let k = 0; events && k < PRESSES.length; k++) {
        const handlers = own(events, PRESSES[k]) || [];
        for (let n = 0; n < handlers.length; n++)
          if (handlers[n].selector && matches(element, handlers[n].selector)) return true;
      }
    }
    return false;
  };

  const answer = (event) => {
    try {
      const element = pathOf(event)[0];
      if (hears(element) || isDelegated(element)) cancel(event);
    } catch {
      // of what the page has put there: nothing can be told
    }
  };
  addEventListener(question, answer, true);
})
