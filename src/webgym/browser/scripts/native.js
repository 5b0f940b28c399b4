// What the browser itself says beside the page, in no document and often in no picture: the bubble of a field that is
// not valid, a tooltip, the print preview. It is told with the next observation.
(() => {
  const webgym = globalThis.webgym;
  if (webgym.said) return;
  const { localName, matches, getAttribute, children, textContent, clientHeight, scrollHeight, scrollTop } = webgym.dom;
  const { fold } = webgym;

  // [number, text]: whoever observes knows up to which number was told already. An observation may be thrown away.
  const MOST = 10;
  let said = [];
  let count = 0;
  const say = (text) => (said = [...said, [++count, text]].slice(-MOST));
  webgym.said = () => said;

  // What a field is called; empty for nothing.
  webgym.nameOf = (field) => {
    webgym.roles.begin();
    return webgym.roles.nameOf(field, webgym.roles.roleOf(field)).slice(0, webgym.limits.name);
  };

  // --- fields that are not valid --------------------------------------------------------------------

  // The bubble is shown at the first invalid field that the page does not speak of itself, which then has the focus. A
  // script that only asks whether a field is valid shows none; some do so at each key.
  let invalid = [];
  let isTyping = false;
  const tellInvalid = () => {
    const event = invalid.find(([, one]) => !one.defaultPrevented);
    invalid = [];
    if (!event) return;
    const [field] = event;
    if (!matches(field, ':focus')) return;
    const name = webgym.nameOf(field);
    say(`${name ? `the field "${name}"` : 'a field without a name'}: ${field.validationMessage}`);
    webgym.changed(); // a picture that was taken before shows no bubble
  };
  const onInvalid = (event) => {
    if (!event.isTrusted || isTyping) return;
    if (!invalid.length) scheduler.postTask(tellInvalid);
    invalid.push([event.composedPath()[0], event]);
  };
  const onInput = () => {
    isTyping = true;
    scheduler.postTask(() => (isTyping = false), { priority: 'user-blocking' });
  };

  // --- tooltips -------------------------------------------------------------------------------------

  const titleOf = (element) => {
    const shape = 'ownerSVGElement' in element && [...children(element)].find((child) => localName(child) === 'title');
    return shape ? textContent(shape) : getAttribute(element, 'title');
  };
  // What the browser shows where the mouse rests; empty for nothing. An empty title hides the one around it.
  webgym.tooltip = (x, y) => {
    webgym.geometry.begin();
    let element = webgym.geometry.hit(x, y);
    while (element && titleOf(element) === null) element = webgym.geometry.parentOf(element);
    return element ? fold(titleOf(element)).slice(0, webgym.limits.name) : '';
  };

  // --- boxes that scroll ----------------------------------------------------------------------------

  // No picture has scrollbars. That a box in view holds more below is told once, of each; of the page the observation
  // tells it.
  const known = new WeakSet();
  const [LEAST_BOX, LEAST_MORE, MOST_BOXES, NAME] = [40, 10, 5, 40]; // CSS pixels, CSS pixels, boxes, characters
  webgym.holdsMore = (box) =>
    !known.has(box) && clientHeight(box) >= LEAST_BOX && scrollHeight(box) - clientHeight(box) - scrollTop(box) >= LEAST_MORE;
  webgym.tellMore = (boxes) => {
    if (!boxes.length) return;
    for (const box of boxes) known.add(box);
    const names = boxes.slice(0, MOST_BOXES).map((box) => `"${webgym.roles.nameOf(box, '').slice(0, NAME)}…"`);
    say(`a box has more below than it shows, and can be scrolled: ${names.join(', ')}`);
  };

  // --- PDFs in a page -------------------------------------------------------------------------------

  // A frame shows a PDF; what stands for a plug-in shows nothing.
  const PLUGINS = { embed: 'src', object: 'data' };
  webgym.tellEmbedded = (element) => {
    const name = PLUGINS[localName(element)];
    const address = name ? element[name] : '';
    const isPdf = /^application\/pdf/i.test(element.type) || /\.pdf([?#]|$)/i.test(address);
    if (!isPdf || !address || known.has(element)) return;
    known.add(element);
    say(`the page has a PDF in it that is not shown there, but at its own address: ${webgym.shorten(address, 'address')}`);
  };

  webgym.listenInRoots(['invalid', onInvalid]);
  webgym.listen(
    ['invalid', onInvalid, true],
    ['input', onInput, true],
    ['beforeprint', () => say('the page opened the print preview; it was closed'), false],
  );
})();
