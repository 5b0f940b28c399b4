"""Pages like applications: each does one thing that applications do, with their noise.

The noise shows whether a way of waiting works on real pages: timers without effect, with the delays and
helper functions of those with an effect; a spinning decoration; a heartbeat whose response is ignored; a
clock. For the functions that scripts may use see :mod:`~benchmarks.settle.hardweb.pages`.
"""

from __future__ import annotations

from benchmarks.settle.hardweb.page import HardPage, Kind

_NOISE = """
<p id=clock style='position: fixed; right: 8px; top: 0'></p>
<div class=round style='position: fixed; right: 8px; bottom: 8px'></div>
{{const wait = (ms) => new Promise((resolve) => later(ms, resolve));
const debounce = (ms, f) => { let t; return (...a) => { clearTimeout(t); t = later(ms, () => f(...a)); }; };
const tween = (ms, f) => new Promise((done) => { const start = performance.now(); const turn = () => {
  const at = Math.min(1, (performance.now() - start) / (ms * pace)); f(at);
  at < 1 ? requestAnimationFrame(turn) : done(); }; requestAnimationFrame(turn); });
for (const name of ['click', 'keyup', 'scroll']) addEventListener(name, debounce(300, () => {}), true);
addEventListener('click', debounce(150, () => sessionStorage.setItem('clicks', performance.now())), true);
setInterval(() => { clock.textContent = new Date().toLocaleTimeString(); }, 1000);
setInterval(() => fetch('/data?ms=20&text=heartbeat'), 5000)}}
"""


def _app(name: str, says: str, body: str, action: Kind = "click") -> HardPage:
    return HardPage(f"app-{name}", "apps", says, _NOISE + body, action)


def _click(script: str) -> str:
    return f"{{{{go.onclick = async () => {{ {script} }}}}}}"


_SKELETONS = "out.innerHTML = '<div class=\"skeleton grey\"></div>'.repeat(3);"
_FAR = "<div style='height: 1000px'></div>"

APPS = [
    _app("typeahead", "suggestions of a field: a debounce, a request, a list",
         "<input id=go>{{go.oninput = debounce(300, async () => {"
         " if (go.value.length > 2) show(await get(180)); })}}", "type"),
    _app("autocomplete", "suggestions that fade in by script, asked for on the last key up",
         "<input id=go>{{const search = debounce(300, async () => { const text = await get(120);"
         " out.style.opacity = 0; out.textContent = text;"
         " await tween(150, (at) => { out.style.opacity = at; }); final(); });"
         " go.onkeydown = () => search()}}", "type"),
    _app("validation", "a field that is checked by the server",
         "<input id=go>{{go.oninput = debounce(500, async () => { out.textContent = 'checking';"
         " show(await get(250)); })}}", "type"),
    _app("submenu", "a submenu that opens after 300 ms and slides down",
         "<ul id=m style='display: none; overflow: hidden'><li>Sub</ul>"
         + _click("later(300, async () => { m.style.display = 'block';"
                  " await tween(200, (at) => { m.style.height = at * 90 + 'px'; }); final(); })")),
    _app("search", "a search in two stages: an index, then a summary for each result",
         _click("out.textContent = 'Searching'; await get(700); out.innerHTML = '<p>Searching</p><ol></ol>';"
                " for (let n = 0; n < 6; n++) { await wait(5);"
                " out.lastChild.append(document.createElement('li')); }"
                " await Promise.all([...out.lastChild.children].map(async (li) =>"
                " li.append(await get(300))));"
                " out.firstChild.textContent = '6 results'; final()")),
    _app("search-worker", "a search whose index a worker builds for 1.3 s",
         "{{const w = new Worker('/worker.js'); w.onmessage = (e) => show(e.data)}}"
         + _click("out.textContent = 'Searching…'; await get(200); w.postMessage({ compute: 1300 * pace })")),
    _app("search-hidden", "a search that shows it is busy while a worker waits for 1.6 s",
         "{{const w = new Worker('/worker.js'); w.onmessage = (e) => { out.ariaBusy = null; show(e.data); }}}"
         + _click("out.ariaBusy = 'true'; out.textContent = '…'; w.postMessage({ timer: 1600 * pace })")),
    _app("chain", "four requests with timers in between",
         _click("for (let n = 0; n < 4; n++) { out.append(await get(150)); await wait(80); } final()")),
    _app("skeletons", "eight skeletons that are filled one by one",
         _click("out.innerHTML = '<div class=\"skeleton grey\"></div>'.repeat(8);"
                " await Promise.all([...out.children].map(async (one, n) => {"
                " const text = await get(200 + 90 * n); one.className = ''; one.textContent = text; }));"
                " final()")),
    _app("lazy-pictures", "pictures that are loaded in view and fade in",
         f"{_FAR}<img id=i width=160 height=90 style='opacity: 0; transition: opacity .3s'>"
         "{{new IntersectionObserver(([e], o) => { if (!e.isIntersecting) return; o.disconnect();"
         " i.ontransitionend = final; i.onload = () => { i.style.opacity = 1; };"
         " i.src = '/image?ms=' + 350 * pace; }).observe(i)}}", "scroll"),
    _app("virtual-list", "rows that are fetched once scrolling has ended",
         "<div id=list style='height: 9000px; position: relative'></div>"
         "{{onscroll = debounce(120, async () => { const text = await get(200); const top = scrollY + 90;"
         " list.innerHTML = [...Array(20).keys()].map((n) =>"
         " `<div style='position: absolute; top: ${top + n * 30}px'>${text} ${n}</div>`).join('');"
         " final(); })}}", "scroll"),
    _app("endless-list", "more of a list when its end comes into view, with pictures",
         f"{_FAR}<ul id=out><li>more</ul>"
         "{{new IntersectionObserver(async ([e], o) => { if (!e.isIntersecting) return; o.disconnect();"
         " out.insertAdjacentHTML('beforeend', '<li class=loading>Loading more…</li>'); await get(600);"
         " out.lastChild.remove(); out.insertAdjacentHTML('beforeend',"
         " `<li><img src='/image?ms=${200 * pace}' onload=final()></li>`); }).observe(out)}}", "scroll"),
    _app("accordion", "a panel that opens, and is filled when it is open",
         "<div id=d style='height: 0; overflow: hidden; transition: height .3s'><p id=out></p></div>"
         + _click("d.ontransitionend = async () => show(await get(200)); d.style.height = '120px'")),
    _app("modal", "a dialog that fades in and is filled",
         "<dialog id=d style='opacity: 0; transition: opacity .25s'><p id=out>…</p></dialog>"
         + _click("d.showModal(); requestAnimationFrame(() => requestAnimationFrame(() => {"
                  " d.style.opacity = 1; })); const text = await get(150); await wait(120); show(text);"
                  " unfinal(); await Promise.all(d.getAnimations().map((one) => one.finished)); final()")),
    _app("drawer", "a drawer that a script moves for 600 ms",
         "<nav id=m style='position: fixed; left: -300px; top: 100px'>Menu</nav>"
         + _click("await tween(600, (at) => { m.style.left = -300 + 340 * (1 - (1 - at) ** 3) + 'px'; });"
                  " final()")),
    _app("carousel", "a carousel that moves on by itself, and on request",
         "<div style='overflow: hidden; width: 300px'><div id=t style='transition: translate .5s'>slide</div>"
         "</div>{{let n = 0, timer; const move = () => { t.style.translate = (++n % 3) * 60 + 'px 0'; };"
         " const start = () => { timer = setInterval(move, 3000); }; start()}}"
         + _click("clearInterval(timer); t.addEventListener('transitionend', final); move(); start()")),
    _app("optimistic", "an answer at once that the server confirms",
         _click("out.textContent = 'saved?'; show(await get(700, 'saved'))")),
    _app("toast", "a request, a confirmation, and the list again",
         _click("out.textContent = await get(300, 'stored'); await wait(400); show(await get(200))")),
    _app("chat", "an answer that is written letter by letter for 2 s",
         _click("const text = (await get(300, 'answer')).repeat(10); out.textContent = '';"
                " for (const letter of text) { out.append(letter); await wait(30); } final()")),
    _app("stream", "an answer in twenty pieces, each rendered with the next frame",
         _click("const r = (await fetch('/chunks?count=20&ms=90&pace=' + pace)).body.getReader();"
                " for (;;) { const { done, value } = await r.read(); if (done) break;"
                " requestAnimationFrame(() => out.append(new TextDecoder().decode(value))); }"
                " requestAnimationFrame(final)")),
    _app("dashboard", "figures that are asked for every second, and a filter whose chart grows",
         "<p id=f>0</p><canvas id=c width=300 height=100></canvas><svg id=s width=300 height=9><rect/></svg>"
         "{{let n = 0; setInterval(async () => { await get(60); f.textContent = ++n; }, 1000)}}"
         + _click("out.textContent = await get(400); await tween(400, (at) => {"
                  " c.getContext('2d').fillRect(0, 0, 300 * at, 90);"
                  " s.firstChild.setAttribute('width', 300 * at); }); final()")),
    _app("hydration", "a page of the server that comes to life when its script is there",
         "<p id=out>Hello</p>{{globalThis.render = () => requestIdleCallback(async () => {"
         " show('Hello ' + await get(250)); })}}<script async src=/script?ms=400></script>", "open"),
    _app("suspense", "a document whose parts come later and take the places kept for them",
         "<div id=a class='skeleton grey'></div><div id=b class='skeleton grey'></div>"
         "<!--pause 300--><p hidden id=x>one</p>{{a.replaceWith(x); x.hidden = false}}"
         "<!--pause 500--><p hidden id=y>two</p>{{b.replaceWith(y); y.hidden = false; final()}}", "open"),
    _app("route", "a route: its code, its data, a transition between two views",
         "{{globalThis.render = async () => { const text = await get(200);"
         " const move = document.startViewTransition(() => { out.textContent = text; });"
         " await move.finished; final(); }}}"
         + _click("history.pushState(0, '', '/route'); await import('/script?ms=' + 250 * pace)")),
    _app("component", "a custom element whose code comes late, with data in its shadow",
         "<x-card>…</x-card>{{globalThis.render = () => customElements.define('x-card',"
         " class extends HTMLElement { async connectedCallback() {"
         " const root = this.attachShadow({ mode: 'open' }); root.innerHTML = '<p>…</p>';"
         " root.firstChild.textContent = await get(300); final(); } })}}"
         + _click("await import('/script?ms=' + 300 * pace)")),
    _app("widget", "a frame that is put in and says when it is done",
         "{{onmessage = final}}"
         + _click("const f = document.createElement('iframe'); f.src = '/p/frame-speaks?pace=' + pace;"
                  " await wait(150); out.append(f)")),
    _app("zoom", "a larger picture that fades in once it is decoded",
         _click("const i = new Image(); i.src = '/image?ms=' + 450 * pace; await i.decode();"
                " i.style.opacity = 0; out.append(i);"
                " await i.animate({ opacity: [0, 1] }, { duration: 250, fill: 'both' }).finished; final()")),
    _app("anchor", "a smooth scroll far down",
         "<div style='height: 5000px'></div><p id=out>there</p>"
         + _click("onscrollend = final; out.scrollIntoView({ behavior: 'smooth' })")),
    _app("login", "a form, a word, and another page",
         _click("out.textContent = 'Signing in'; await get(300); out.textContent = 'Redirecting…';"
                " later(600, () => { location = '/p/plain?ms=150&pace=' + pace; })")),
    _app("slices", "a large list that a framework renders piece by piece, then asks for more",
         "{{const c = new MessageChannel(); let n = 25; c.port1.onmessage = async () => {"
         " const end = performance.now() + 8; while (performance.now() < end); out.append(n + ' ');"
         " if (--n) return c.port2.postMessage(0); out.append(await get(150)); final(); }}}"
         + _click("c.port2.postMessage(0)")),
    _app("notice", "a word over a WebSocket whose answer is rendered in two frames",
         "{{const ws = new WebSocket(`ws://${location.host}/ws?ms=500&pace=${pace}`); ws.onmessage = (e) =>"
         " requestAnimationFrame(() => requestAnimationFrame(() => show(e.data)))}}"
         + _click("ws.send('?')")),
    _app("reload", "skeletons while a route is prepared in three steps, each after the one before",
         _click(f"{_SKELETONS} const a = await get(250); await wait(200); await get(250);"
                " await wait(300); show(a)")),
]  # fmt: skip
