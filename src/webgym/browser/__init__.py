"""One browser slot: launch, act, observe, settle, marks. Raw CDP over a pipe; no open port.

slot.py      Slot: one browser process group, one fresh context and page per episode
page.py      Page: one tab or window, and everything that happens to it
windows.py   the windows of an episode, the newest in front
dialogs.py   alert, confirm, prompt and the question before leaving
notices.py   what the next observation reports of all of them
actions.py   from an Action to mouse, keyboard and history
pointer.py   the mouse: clicks, drags, the wheel
upload.py    choosing files that the task comes with
gestures.py  low-level mouse and keyboard gestures for programs that drive a slot
chords.py    keys by name, and keys pressed together
observe.py   from the page to an Observation and its picture; whether the action had an effect
document.py  reading a whole document, not only what the viewport shows of it
settle.py    when is a page quiet, and why do we say so
traffic.py   what the tab is loading at this moment
egress/      the only way out: a proxy that refuses what pages must not reach
process.py   a Chromium in its own process group, and the proof that nothing of it is left
memory.py    limits on the memory of a browser, by a watch and by cgroups
sandbox.py   Chromium's sandbox: requested, and verified
profiles.py  temporary profiles that a dead server cannot leave behind
cdp.py       the protocol: commands with deadlines, events to subscribers
cdp_messages.py  the parts of the protocol's messages that we read
config.py    every limit, with its unit and its reason
"""
