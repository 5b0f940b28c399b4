"""All pages. Each records in its variable ``finalAt`` when its relevant content is complete.

``finalAt`` is a time in milliseconds since the epoch, or ``null`` while content is missing. It causes no
event and changes no element, so it helps no way of waiting. A page is not final before the action on it. In
the scripts of pages:

* ``later(ms, f)`` is ``setTimeout``; ``get(ms, text)`` fetches a text that arrives after ``ms``;
* ``out`` is the paragraph of the content, ``show(text)`` puts text into it and marks the page as final;
* ``final()`` and ``unfinal()`` set and clear the mark; ``go`` is the control for the action;
* all times are multiplied by ``pace``, which differs between rounds.
"""

from __future__ import annotations

import re

from benchmarks.settle.hardweb.apps import APPS
from benchmarks.settle.hardweb.page import HardPage

OTHER_HOST = "advert.test"
"""Host of a second site, which is mapped to the same server."""

TRUTH = "typeof finalAt === 'number' ? finalAt : null"
"""Script that returns when the page became final, or ``null``; runs in the world of the page."""

_PRELUDE = """
var finalAt = null;
const pace = PACE;
const final = () => { finalAt ??= performance.timeOrigin + performance.now(); };
const unfinal = () => { finalAt = null; };
const later = (ms, f) => setTimeout(f, ms * pace);
const get = async (ms, text = 'data') => (await fetch(`/data?ms=${ms * pace}&text=${text}`)).text();
const show = (text) => { out.textContent = text; final(); };
"""

_STYLE = """
body { font: 16px/1.5 sans-serif; margin: 100px 40px; }
#go { position: fixed; left: 0; top: 0; width: 256px; height: 76px; box-sizing: border-box; font: inherit; }
@keyframes spin { to { transform: rotate(1turn); } }
@keyframes pulse { 50% { opacity: .4; } }
.round { width: 32px; height: 32px; border: 4px solid #ccc; border-top-color: #06c; border-radius: 50%;
  animation: spin 1s linear infinite; }
.grey { height: 20px; margin: 8px 0; background: #ddd; animation: pulse 1.5s infinite; }
"""

_GO = "<button id=go>Go</button>"
_INTRO = "<h1>The hard web</h1><p>Some text that is here from the start.</p>"
WORKER = """
onmessage = async ({ data }) => {
  if (data.compute) { const end = performance.now() + data.compute; while (performance.now() < end); }
  if (data.fetch) await (await fetch(`/data?ms=${data.fetch}`)).text();
  if (data.timer) await new Promise((resolve) => setTimeout(resolve, data.timer));
  postMessage('from the worker');
};
oninstall = () => self.skipWaiting();
onactivate = (event) => event.waitUntil(clients.claim());
onfetch = (event) => {
  if (!event.request.url.endsWith('/offline')) return;
  event.respondWith(new Promise((resolve) => setTimeout(() => resolve(new Response('from the cache')), 300)));
};
"""
"""Script of the dedicated worker and the service worker of the pages."""


def page_html(page: HardPage, pace: float, other: str) -> str:
    """The HTML document of a page; ``other`` is the origin of the second site."""
    body = page.body if "<h1" in page.body else _INTRO + page.body
    control = "" if "id=go" in body or page.action in ("open", "scroll") else _GO
    return (
        (
            f"<!doctype html><meta charset=utf-8><title>{page.name}</title><link rel=icon href=data:,>"
            f"<style>{_STYLE}</style><script>{_PRELUDE}</script>{control}{_scripted(body)}"
        )
        .replace("OTHER", other)
        .replace("PACE", repr(pace))
    )


def _scripted(body: str) -> str:
    """Replace ``{{ ... }}`` by a script element, and add ``#out`` unless the page has one."""
    paragraph = "" if "id=out" in body else "<p id=out></p>"
    return paragraph + re.sub(r"\{\{(.*?)\}\}(?!\})", r"<script>\1</script>", body, flags=re.DOTALL)


def _on_click(script: str) -> str:
    return f"{{{{go.onclick = async () => {{ {script} }}}}}}"


_PLAIN = [
    HardPage("plain", "plain", "text, nothing else", "{{final()}}"),
    HardPage("plain-picture", "plain", "a picture", "<img src=/image onload=final()>"),
    HardPage("plain-click", "plain", "text at once", _on_click("show('done')"), "click"),
    HardPage("plain-dead", "plain", "nothing at all", "{{final()}}", "click"),
    HardPage("plain-link", "plain", "another page", _on_click("location = '/p/plain?ms=80&pace=' + pace"),
             "click"),
    HardPage(
        "plain-form", "plain", "another page, by a form",
        "<form action=/p/plain><input id=go name=q><input type=hidden name=ms value=150></form>", "type",
    ),
    HardPage(
        "plain-scroll", "plain", "further down",
        "<div style='height: 4000px'></div>{{onscroll = final}}", "scroll",
    ),
]  # fmt: skip

_SPINNER = "out.innerHTML = '<div class=round></div>';"

_REQUESTS = [
    *(
        HardPage(f"xhr-{ms}", "requests", f"data after {ms} ms", f"{{{{get({ms}).then(show)}}}}")
        for ms in (200, 1000, 3000)
    ),
    HardPage("xhr-chain", "requests", "three requests, one after the other",
             "{{(async () => { await get(300); await get(300); show(await get(300)); })()}}"),
    HardPage("xhr-click", "requests", "data after 600 ms", _on_click("show(await get(600))"), "click"),
    HardPage("xhr-click-chain", "requests", "two requests, one after the other",
             _on_click("await get(400); show(await get(400))"), "click"),
    HardPage("xhr-spinner", "requests", "a spinner for 2.5 s, then data",
             _on_click(f"{_SPINNER} show(await get(2500))"), "click"),
    HardPage("xhr-slow-spinner", "requests", "a spinner for 6 s, then data",
             f"{{{{{_SPINNER} get(6000).then(show)}}}}"),
    HardPage("xhr-after-timer", "requests", "a request that starts after 400 ms",
             "{{later(400, async () => show(await get(300)))}}"),
    HardPage("skeleton", "requests", "a skeleton for 900 ms, then data",
             "<div id=out><div class='skeleton grey'></div><div class='skeleton grey'></div></div>"
             "{{get(900).then(show)}}"),
    HardPage("two-speeds", "requests", "a part after 200 ms, the rest after 1.4 s",
             "{{get(200).then((text) => { out.before(text); }); get(1400).then(show)}}"),
    HardPage("preflight", "requests", "data from another site, after a preflight",
             "{{fetch('OTHER/data?ms=' + 500 * pace).then((r) => r.text()).then(show)}}"),
    HardPage("late-script", "requests", "a script after 700 ms, which renders",
             "{{globalThis.render = () => show('rendered')}}<script async src=/script?ms=700></script>"),
    HardPage("spa", "requests", "a route without a new document, data after 400 ms",
             _on_click("history.pushState(0, '', '/route'); out.textContent = ''; show(await get(400))"),
             "click"),
    HardPage("spa-chunk", "requests", "a route whose code comes first, then its data",
             "{{globalThis.render = async () => show(await get(250))}}"
             + _on_click("history.pushState(0, '', '/route'); await import('/script?ms=' + 400 * pace)"),
             "click"),
    HardPage("suggestions", "requests", "suggestions, asked for 300 ms after the last key",
             "<input id=go>{{let t; go.oninput = () => { clearTimeout(t);"
             " t = later(300, async () => show(await get(200))); }}}", "type"),
    HardPage("suggestions-slow", "requests", "suggestions, asked for 800 ms after the last key",
             "<input id=go>{{let t; go.oninput = () => { clearTimeout(t);"
             " t = later(800, async () => show(await get(200))); }}}", "type"),
    HardPage("infinite-scroll", "requests", "more of a list, when its end comes into view",
             "<div style='height: 1000px'></div><p id=out>more</p>"
             "{{new IntersectionObserver(async ([e], o) => {"
             " if (!e.isIntersecting) return; o.disconnect(); show(await get(500)); }).observe(out)}}",
             "scroll"),
]  # fmt: skip

_STREAMS = [
    HardPage("streamed-document", "streams", "a document in five pieces",
             "<p>1<!--pause 250--><p>2<!--pause 250--><p>3<!--pause 250--><p>4<!--pause 250--><p>5"
             "{{final()}}"),
    HardPage("slow-parser", "streams", "a script that holds the parser up, and a slow document",
             "<script src=/script?ms=500></script><p>then<!--pause 400--><p>the rest{{final()}}"),
    HardPage("endless-document", "streams", "a document that never ends", "<p>all there is{{final()}}"),
    HardPage("chat", "streams", "an answer in twelve pieces, 200 ms apart",
             _on_click("const r = (await fetch('/chunks?count=12&ms=' + 200 * pace)).body.getReader();"
                       " for (;;) { const { done, value } = await r.read(); if (done) break;"
                       " out.append(new TextDecoder().decode(value)); } final()"), "click"),
    HardPage("events", "streams", "server-sent events; the first one matters",
             "{{new EventSource('/events?ms=500&every=2000&pace=' + pace).onmessage = (e) => show(e.data)}}"),
    HardPage("events-fast", "streams", "server-sent events, eight a second; the first one matters",
             "{{new EventSource('/events?ms=300&every=120&pace=' + pace).onmessage ="
             " (e) => { out.textContent = e.data; final(); }}}"),
    HardPage("long-poll", "streams", "a request that is never answered", "{{fetch('/hang'); final()}}"),
    HardPage("long-poll-click", "streams", "text, and a long poll in the background",
             "{{fetch('/hang')}}" + _on_click("show(await get(200))"), "click"),
    HardPage("long-poll-push", "streams", "a long poll that brings the content, then another",
             "{{get(1200).then((text) => { show(text); fetch('/hang'); })}}"),
    HardPage("polling", "streams", "data, asked for again every second",
             "{{const poll = async () => { show(await get(150)); later(1000, poll); }; poll()}}"),
    HardPage("socket-push", "streams", "a WebSocket that speaks after 500 ms",
             "{{new WebSocket(`ws://${location.host}/ws?unasked&ms=500&pace=${pace}`).onmessage ="
             " (e) => show(e.data)}}"),
    HardPage("socket-reply", "streams", "a WebSocket that answers after 600 ms",
             "{{const ws = new WebSocket(`ws://${location.host}/ws?ms=600&pace=${pace}`);"
             " ws.onmessage = (e) => show(e.data)}}" + _on_click("ws.send('?')"), "click"),
]  # fmt: skip

_END = "/p/plain"
_REDIRECTS = [
    HardPage("redirect-http", "redirects", "three redirects by HTTP", "",
             path=f"/hop?left=3&ms=150&to={_END}"),
    HardPage("redirect-meta", "redirects", "a refresh at once",
             f"<meta http-equiv=refresh content='0;url={_END}'>"),
    HardPage("redirect-meta-late", "redirects", "a refresh after a second",
             f"<meta http-equiv=refresh content='1;url={_END}'>"),
    HardPage("redirect-script", "redirects", "by script, at once",
             f"{{{{location.replace('{_END}?ms=200&pace=' + pace)}}}}"),
    HardPage("redirect-script-late", "redirects", "by script, after 800 ms",
             f"<p>Redirecting…</p>{{{{later(800, () => location.replace('{_END}?pace=' + pace))}}}}"),
    HardPage("redirect-mixed", "redirects", "by HTTP, then by script", "",
             path="/hop?left=2&ms=100&to=/p/redirect-script"),
    HardPage("redirect-hop", "redirects", "a link that leads to a redirect by script",
             _on_click("location = '/p/redirect-meta?pace=' + pace"), "click"),
]  # fmt: skip

_SCRIPTS = [
    HardPage("idle-callback", "scripts", "rendered when the browser is idle",
             _on_click("requestIdleCallback(() => requestIdleCallback(() => show('idle')))"), "click"),
    HardPage("frames", "scripts", "rendered twelve frames later",
             _on_click("let n = 12;"
                       " const f = () => { --n ? requestAnimationFrame(f) : show('frame'); }; f()"),
             "click"),
    HardPage("slices", "scripts", "rendered in forty slices of 10 ms, as frameworks do",
             "{{const c = new MessageChannel(); let n = 40; c.port1.onmessage = () => {"
             " const end = performance.now() + 10 * pace; while (performance.now() < end);"
             " --n ? c.port2.postMessage(0) : show('sliced'); }}}" + _on_click("c.port2.postMessage(0)"),
             "click"),
    HardPage("long-task", "scripts", "a script that computes for 600 ms",
             _on_click("later(30, () => { const end = performance.now() + 600 * pace;"
                       " while (performance.now() < end); show('computed'); })"), "click"),
    HardPage("worker", "scripts", "a worker that computes for 700 ms",
             "{{const w = new Worker('/worker.js'); w.onmessage = (e) => show(e.data)}}"
             + _on_click("w.postMessage({ compute: 700 * pace })"), "click"),
    HardPage("worker-request", "scripts", "a worker that fetches",
             "{{const w = new Worker('/worker.js'); w.onmessage = (e) => show(e.data);"
             " w.postMessage({ fetch: 600 * pace })}}"),
    HardPage("service-worker", "scripts", "data by way of a service worker",
             "{{navigator.serviceWorker.register('/worker.js').then(async () => {"
             " await navigator.serviceWorker.ready;"
             " navigator.serviceWorker.controller || await new Promise((resolve) => {"
             " navigator.serviceWorker.oncontrollerchange = resolve; });"
             " show(await (await fetch('/offline')).text()); })}}"),
    HardPage("database", "scripts", "data out of the browser's own database",
             "{{const ready = new Promise((resolve) => { const r = indexedDB.open('d', 1);"
             " r.onupgradeneeded = () => r.result.createObjectStore('s').put('stored', 1);"
             " r.onsuccess = () => resolve(r.result); })}}"
             + _on_click("(await ready).transaction('s').objectStore('s').get(1).onsuccess ="
                         " (e) => show(e.target.result)"), "click"),
]  # fmt: skip

_TIMERS = [
    HardPage("timer-300", "timers", "text after 300 ms", _on_click("later(300, () => show('late'))"),
             "click"),
    HardPage("timer-1500", "timers", "nothing for 1.5 s, then text",
             _on_click("later(1500, () => show('late'))"), "click"),
    HardPage("tooltip", "timers", "a word 300 ms after the mouse has come",
             "{{onload = () => { go.onmouseenter = () => later(300, () => show('word')); }}}", "click"),
    HardPage("timer-open", "timers", "text 800 ms after the page", "{{later(800, () => show('late'))}}"),
    HardPage("timer-blank", "timers", "an empty page for 1.8 s",
             "<h1 hidden></h1>{{later(1800, () => show('late'))}}"),
    HardPage("stages", "timers", "four stages, 150 to 450 ms apart",
             _on_click("out.textContent = 1; later(150, () => { out.textContent = 2; later(300, () => {"
                       " out.textContent = 3; later(450, () => show(4)); }); })"), "click"),
    HardPage("skeleton-timer", "timers", "a skeleton for 2.2 s, no request",
             "<div id=out aria-busy=true><div class=grey></div><div class=grey></div></div>"
             "{{later(2200, () => { out.removeAttribute('aria-busy'); show('late'); })}}"),
    HardPage("timer-request-timer", "timers", "a timer, a request, a timer",
             _on_click("later(250, async () => {"
                       " const text = await get(250); later(250, () => show(text)); })"),
             "click"),
    HardPage("loading-text", "timers", '"Loading…" for 2 s',
             _on_click("out.textContent = 'Loading…'; later(2000, () => show('late'))"), "click"),
]  # fmt: skip

_CANVAS = """<canvas id=c width=40 height=40></canvas>{{const x = c.getContext('2d'); let n = 0;
(function turn() { x.fillStyle = `hsl(${n++ % 360} 80% 50%)`; x.fillRect(0, 0, 40, 40);
requestAnimationFrame(turn); })()}}"""
_GIF = ("<img width=32 height=32 alt='' src='data:image/gif;base64,"
        "R0lGODlhAQABAIAAAP8AAAAA/yH/C05FVFNDQVBFMi4wAwEAAAAh+QQACgAAACwAAAAAAQABAAACAkQBACH5"
        "BAAKAAAALAAAAAABAAEAAAICTAEAOw=='>")  # fmt: skip

_RENDERING = [
    HardPage("font", "rendering", "a font after 700 ms, swapped in",
             "<style>@font-face { font-family: late; src: url(/font?ms=700); font-display: swap }"
             " #out { font-family: late, serif }</style>"
             "{{out.textContent = 'text'; document.fonts.load('16px late').then(final)}}"),
    HardPage("images", "rendering", "six pictures, after 100 to 600 ms",
             "{{globalThis.left = 6}}"
             + "".join(f"<img src=/image?ms={ms} onload='--left || final()'>"
                       for ms in range(100, 700, 100))),
    HardPage("image-lazy", "rendering", "a lazy picture that is uncovered",
             "<div id=d hidden><img loading=lazy src=/image?ms=400 onload=final()></div>"
             + _on_click("d.hidden = false"), "click"),
    HardPage("image-observer", "rendering", "a picture that a script loads when scrolled to",
             "<div style='height: 1000px'></div><img id=i width=160 height=90>"
             "{{new IntersectionObserver(([e], o) => { if (!e.isIntersecting) return; o.disconnect();"
             " i.onload = final; i.src = '/image?ms=' + 400 * pace; }).observe(i)}}", "scroll"),
    HardPage("frame-late", "rendering", "a frame that is added after 400 ms, and its content later still",
             "{{onmessage = final; later(400, () => { const f = document.createElement('iframe');"
             " f.src = '/p/frame-speaks?pace=' + pace; document.body.append(f); })}}"),
    HardPage("frame-other-site", "rendering", "a frame of another site whose content comes late",
             "<iframe src='OTHER/p/frame-speaks?pace=PACE'></iframe>{{onmessage = final}}"),
    HardPage("frame-speaks", "rendering", "data after 700 ms, and word to the frame around",
             "{{get(700).then((text) => { show(text); parent.postMessage(1, '*'); })}}"),
    HardPage("menu", "rendering", "a menu that slides in for 350 ms",
             "<nav id=m style='position: fixed; left: -300px; top: 100px; transition: left .35s'>Menu</nav>"
             + _on_click("m.ontransitionend = final; m.style.left = '40px'"), "click"),
    HardPage("menu-delayed", "rendering", "a menu that waits 300 ms and fades in for 300 ms",
             "<nav id=m style='opacity: 0; transition: opacity .3s .3s'>Menu</nav>"
             + _on_click("m.ontransitionend = final; m.style.opacity = 1"), "click"),
    HardPage("component-dialog", "rendering", "a new component that fades in, in its shadow, for 500 ms",
             "{{customElements.define('x-dialog', class extends HTMLElement { async connectedCallback() {"
             " const root = this.attachShadow({ mode: 'open' }); root.innerHTML = '<p>Sure?</p>';"
             " const fade = { duration: 500 * pace };"
             " await root.firstChild.animate({ opacity: [0, 1] }, fade).finished; final(); } })}}"
             + _on_click("out.append(document.createElement('x-dialog'))"), "click"),
]  # fmt: skip

_ENDLESS = [
    HardPage("spinner-css", "endless", "a spinner that never ends",
             "<div class=round></div>" + _on_click("show('done')"), "click"),
    HardPage("spinner-css-open", "endless", "a spinner that never ends, on a page that is done",
             "<div class=round></div>{{final()}}"),
    HardPage("spinner-canvas", "endless", "a canvas that is drawn for ever",
             _CANVAS + _on_click("show(await get(300))"), "click"),
    HardPage("spinner-gif", "endless", "a picture that moves for ever",
             _GIF + _on_click("show(await get(300))"), "click"),
    HardPage("clock", "endless", "a clock that ticks every second",
             "<p id=t>0</p>{{let n = 0; setInterval(() => { t.textContent = ++n; }, 1000)}}"
             + _on_click("show(await get(300))"), "click"),
    HardPage("clock-fast", "endless", "a counter that changes every 40 ms",
             "<p id=t>0</p>{{let n = 0; setInterval(() => { t.textContent = ++n; }, 40)}}"
             + _on_click("show(await get(300))"), "click"),
    HardPage("carousel", "endless", "a carousel that moves on every 2 s",
             "<div id=t style='transition: margin .3s'>slide</div>{{let n = 0;"
             " setInterval(() => { t.style.marginLeft = ++n % 3 * 90 + 'px'; }, 2000)}}"
             + _on_click("show(await get(300))"), "click"),
    HardPage("advert-frame", "endless", "an advert in a frame that takes 6 s",
             "<iframe src='OTHER/p/plain?ms=6000&pace=PACE'></iframe>{{get(300).then(show)}}"),
    HardPage("advert-picture", "endless", "an advert's picture that takes 6 s",
             "{{get(300).then(show)}}<div style='height: 900px'></div>"
             "<img width=300 height=90 src='OTHER/image?ms=6000'>"),
    HardPage("beacon", "endless", "text at once, and a beacon that is never answered",
             _on_click("navigator.sendBeacon('/hang'); show('done')"), "click"),
]  # fmt: skip

_FLEETING = [
    HardPage("toast", "fleeting", "a confirmation after 300 ms, for 3 s",
             _on_click("const text = await get(300); show(text);"
                       " later(3000, () => { out.textContent = ''; unfinal(); })"), "click"),
    HardPage("copied", "fleeting", '"Copied" for 1.5 s',
             _on_click("show('Copied'); later(1500, () => { out.textContent = ''; unfinal(); })"), "click"),
]  # fmt: skip

_LATE = [
    HardPage("late-banner", "late", "a banner 3 s after a page that looks done",
             f"{_INTRO}{{{{later(3000, () => show('Subscribe?'))}}}}"),
    HardPage("late-document", "late", "a document that takes 13 s",
             f"{_INTRO}<p>1<!--pause 6500--><p>2<!--pause 6500--><p>3{{{{final()}}}}"),
]  # fmt: skip

PAGES: dict[str, HardPage] = {
    page.name: page
    for group in (
        _PLAIN, _REQUESTS, _STREAMS, _REDIRECTS, _SCRIPTS, _TIMERS, _RENDERING, _ENDLESS, APPS, _FLEETING,
        _LATE,
    )
    for page in group
}  # fmt: skip
"""All pages by name."""
