// What goes on beside an application: timers that bring nothing, by one helper that all share, reports whose answers
// nobody reads, a clock, and something that turns for ever. Both stand in corners that the comparison leaves out.
{
  const debounce = (ms, act) => {
    let timer;
    return () => (clearTimeout(timer), (timer = setTimeout(act, ms)));
  };
  let seen = 0;
  const count = () => {
    seen += 1;
  };
  for (const name of ['click', 'keyup', 'input', 'scroll', 'pointermove']) addEventListener(name, debounce(300, count), true);
  addEventListener('click', debounce(150, () => sessionStorage.setItem('clicks', seen)), true);
  addEventListener('click', () => fetch('/remote/text?report'), true);
  setInterval(() => fetch('/remote/text?heartbeat'), 5000);
  new MutationObserver(debounce(250, count)).observe(document, { childList: true, subtree: true });

  const corner = (style) => {
    const element = document.createElement('div');
    element.style.cssText = `position: fixed; right: 0; pointer-events: none; font: 12px sans-serif; ${style}`;
    document.body.append(element);
    return element;
  };
  const clock = corner('top: 0; width: 90px; height: 20px; overflow: hidden');
  setInterval(() => {
    clock.textContent = new Date().toLocaleTimeString();
  }, 1000);
  const turning = corner('bottom: 8px; right: 8px; width: 16px; height: 16px; border: 2px solid; border-radius: 8px 0');
  turning.animate({ rotate: ['0deg', '360deg'] }, { duration: 1000, iterations: Infinity });
}
