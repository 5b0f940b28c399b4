// What nodes are asked for. In every world, this one too, the fields of a form hide its own properties behind
// their names, and the forms, frames and pictures of a document do the same: `form.localName` may be an
// <input>. So nodes are read through the accessors of their interfaces, which no page can reach:
// `localName(form)`. What is no form and no document, say an option, a text or a window, is read as usual.
(() => {
  if (Object.hasOwn(globalThis, 'webgym')) return; // an element with this id is no own property
  const webgym = (globalThis.webgym = {});
  const dom = (webgym.dom = {});

  const HTML = 'http://www.w3.org/1999/xhtml';
  const TYPES = new Map([
    [Element, Node.ELEMENT_NODE],
    [Document, Node.DOCUMENT_NODE],
    [DocumentFragment, Node.DOCUMENT_FRAGMENT_NODE],
    [ShadowRoot, Node.DOCUMENT_FRAGMENT_NODE],
  ]);
  const { call } = Function.prototype;
  const accessor = (owner, name) => {
    const { get, value } = Object.getOwnPropertyDescriptor(owner, name);
    return call.bind(get || value);
  };
  const take = (type, names) => {
    for (const name of names.split(' ')) dom[name] = accessor(type.prototype, name);
  };
  // What several interfaces have, each its own.
  const takeOfEach = (types, names) => {
    for (const name of names.split(' ')) {
      const byType = [];
      for (const type of types) byType[TYPES.get(type)] = accessor(type.prototype, name);
      dom[name] = (node, ...more) => byType[dom.nodeType(node)](node, ...more);
    }
  };

  take(EventTarget, 'dispatchEvent');
  take(
    Node,
    'nodeType nodeName parentNode parentElement childNodes firstChild ownerDocument textContent isConnected baseURI ' +
      'getRootNode compareDocumentPosition',
  );
  take(
    Element,
    'localName namespaceURI shadowRoot assignedSlot previousElementSibling nextElementSibling ' +
      'clientLeft clientTop clientWidth clientHeight scrollWidth scrollHeight scrollTop scrollLeft ' +
      'getAttribute getAttributeNames hasAttribute setAttribute removeAttribute matches closest ' +
      'checkVisibility getBoundingClientRect getClientRects computedStyleMap scrollBy scrollIntoView replaceWith',
  );
  take(
    Document,
    'body title documentElement scrollingElement defaultView readyState createElementNS createRange createTreeWalker ' +
      'getSelection',
  );
  takeOfEach(
    [Element, Document, DocumentFragment],
    'children firstElementChild childElementCount querySelector querySelectorAll',
  );
  takeOfEach([Document, DocumentFragment], 'getElementById');
  takeOfEach(
    [Document, ShadowRoot],
    'activeElement styleSheets adoptedStyleSheets getAnimations elementFromPoint elementsFromPoint',
  );

  // What only HTML elements have, or others in their own way.
  for (const name of ['offsetWidth', 'offsetHeight', 'isContentEditable', 'tabIndex', 'innerText']) {
    const own = accessor(HTMLElement.prototype, name);
    dom[name] = (element) => (dom.namespaceURI(element) === HTML ? own(element) : element[name]);
  }
  // What only some kinds of elements have, no form among them: undefined for all others.
  dom.ofKind = (element, name) => (dom.localName(element) === 'form' ? undefined : element[name]);

  // A window of another origin gives a frame of that name where it is simply read.
  dom.documentOf = accessor(window, 'document');
  // The type of an event's target; 0 for a window.
  dom.typeOf = (target) => (target.window === target ? 0 : dom.nodeType(target));
  // An HTML element, in XML documents too.
  dom.make = (owner, name) => dom.createElementNS(owner, HTML, name);
})();
