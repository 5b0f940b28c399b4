// Which elements label which, asked once for a whole document or shadow root: to ask for the labels of one control
// takes the browser through all of the page.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.labels) return;
  const { getRootNode, localName, getAttribute, querySelectorAll } = webgym.dom;

  const LABELLED = new Set(['button', 'input', 'meter', 'output', 'progress', 'select', 'textarea']);

  const add = (map, key, label) => {
    if (map.has(key)) map.get(key).push(label);
    else map.set(key, [label]);
  };

  // For one look, by document or shadow root: labels by control and by the id that they are for, in the order of the
  // document, and the ids of what `aria-labelledby` refers to.
  let indices = new Map();
  const indexOf = (root) => {
    const known = indices.get(root);
    if (known) return known;
    const index = { byControl: new Map(), byId: new Map(), naming: new Set() };
    for (const label of querySelectorAll(root, 'label')) {
      add(index.byControl, label.control, label);
      add(index.byId, getAttribute(label, 'for'), label);
    }
    for (const element of querySelectorAll(root, '[aria-labelledby]'))
      for (const id of getAttribute(element, 'aria-labelledby').split(/[ \t\n\f\r]+/)) index.naming.add(id);
    indices.set(root, index);
    return index;
  };

  const labelsOf = (element) =>
    (LABELLED.has(localName(element)) && indexOf(getRootNode(element)).byControl.get(element)) || [];

  // Those in the element's own tree that are for its id, whether or not it is a control.
  const labelsFor = (element) => indexOf(getRootNode(element)).byId.get(getAttribute(element, 'id') || '') || [];

  // Whether `aria-labelledby` of another element refers to this one.
  const isName = (element) => {
    const id = getAttribute(element, 'id');
    return Boolean(id) && indexOf(getRootNode(element)).naming.has(id);
  };

  // A new look: labels may have come and gone.
  const begin = () => {
    indices = new Map();
  };

  webgym.labels = { labelsOf, labelsFor, isName, begin };
})();
