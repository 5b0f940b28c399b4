// Documents that Chromium does not draw: it draws none before its body, nor before the style sheets of its head have
// loaded, however long that takes, and answers no request for a picture meanwhile.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.drawn) return;
  const { localName, documentElement, body, readyState, firstElementChild, nextElementSibling, make, replaceWith } = webgym.dom;

  const PATIENCE = 500; // longest wait for a frame of a document that is drawn, ms
  const isDrawn = () =>
    performance.getEntriesByName('first-paint').length > 0 ||
    new Promise((resolve) => {
      requestAnimationFrame(() => resolve(true));
      setTimeout(() => resolve(false), PATIENCE);
    });

  const headOf = (root) => {
    let child = root && firstElementChild(root);
    while (child && localName(child) !== 'head') child = nextElementSibling(child);
    return child;
  };

  const white = (type, quality) => {
    const canvas = make(document, 'canvas');
    canvas.width = innerWidth;
    canvas.height = innerHeight;
    const context = canvas.getContext('2d');
    context.fillStyle = 'white';
    context.fillRect(0, 0, canvas.width, canvas.height);
    return canvas.toDataURL(type, quality);
  };

  // Have the document drawn. Gives 'cut off' if it has no body and `hasEnded`, so that it never gets one, or else
  // the picture of a document without a body, as a data URL: nothing but white. Empty if there is something to draw.
  // Of a window that nobody has written into (`isNew`), Chromium draws nothing either.
  webgym.drawn = async ({ hasEnded, type, quality, isNew }) => {
    const root = documentElement(document);
    if (root && localName(root) !== 'html') return '';
    if (!body(document)) return hasEnded || readyState(document) === 'complete' ? 'cut off' : white(type, quality);
    const head = headOf(root);
    if (isNew && !(await isDrawn())) return white(type, quality);
    if (head && !(await isDrawn())) {
      // What was put there by a script is not waited for. It is applied as soon as it has loaded.
      const place = make(document, 'head');
      replaceWith(head, place);
      replaceWith(place, head);
    }
    return '';
  };
})();
