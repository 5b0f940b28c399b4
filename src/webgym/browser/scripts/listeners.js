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
  const { getOwnPropertyDescriptor, getOwnPropertyNames } = Object;
  const own = (thing, name) => (getOwnPropertyDescriptor(thing, name) || {}).value;

  const PRESSES = ['click', 'mousedown', 'pointerdown', 'mouseup', 'pointerup', 'dblclick', 'contextmenu'];
  const hears = (element) => {
    const listeners = listenersOf(element);
    for (let i = 0; i < PRESSES.length; i++) if (own(listeners, PRESSES[i])) return true;
    if (own(element, '__click') || own(element, '$$click')) return true; // Svelte, Solid: one listener for all
    return hearsByProps(element);
  };

  // React, too: what an element hears is kept with it.
  const PROPS = [
    'onClick', 'onMouseDown', 'onPointerDown', 'onMouseUp', 'onPointerUp', 'onDoubleClick', 'onContextMenu',
  ];
  const hearsByProps = (element) => {
    const names = getOwnPropertyNames(element);
    for (let i = 0; i < names.length; i++) {
      const props = startsWith(names[i], '__reactProps$') && own(element, names[i]);
      for (let k = 0; props && k < PROPS.length; k++) if (own(props, PROPS[k])) return true;
    }
    return false;
  };

  // jQuery listens at an element around, for those below it that match a selector.
  const isDelegated = (element) => {
    if (!own(window, 'jQuery')) return false;
    for (let around = parentOf(element); around; around = parentOf(around)) {
      const names = getOwnPropertyNames(around);
      for (let i = 0; i < names.length; i++) {
        const events = startsWith(names[i], 'jQuery') && own(own(around, names[i]) || {}, 'events');
        for (let k = 0; events && k < PRESSES.length; k++) {
          const handlers = own(events, PRESSES[k]) || [];
          for (let n = 0; n < handlers.length; n++)
            if (handlers[n].selector && matches(element, handlers[n].selector)) return true;
        }
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
