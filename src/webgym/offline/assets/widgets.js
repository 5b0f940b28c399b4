// Widgets of the large families: search suggestions, calendar, carousel, infinite scroll, sliders, chart, map, frames.
"use strict";
let timer = 0;
document.addEventListener("input", (event) => {
  const field = event.target.closest("[data-suggest]");
  if (!field) return;
  clearTimeout(timer);
  timer = setTimeout(async () => {
    const box = field.form.querySelector(".suggestions");
    const words = field.value.trim();
    const found = words ? await (await fetch(`${field.dataset.suggest}?${new URLSearchParams({ q: words })}`)).json() : [];
    box.replaceChildren(...found.map(({ name, path }) => Object.assign(document.createElement("a"), { href: path, textContent: name })));
    box.hidden = !found.length;
  }, 150);
});
document.addEventListener("click", (event) => {
  const target = event.target.closest("[data-open], [data-turn], [data-day], [data-slide]");
  if (!target) return;
  if (target.dataset.slide) {
    const slides = target.closest(".carousel").querySelector(".slides");
    slides.scrollBy({ left: Number(target.dataset.slide) * slides.clientWidth });
    return;
  }
  const picker = target.closest("[data-picker]");
  const calendar = picker.querySelector(".calendar");
  const opener = picker.querySelector("[data-open]");
  if (target === opener) {
    calendar.hidden = !calendar.hidden;
  } else if (target.dataset.turn) {
    const months = [...calendar.querySelectorAll("[data-month]")];
    const at = months.findIndex((month) => !month.hidden);
    months[at].hidden = true;
    months[at + Number(target.dataset.turn)].hidden = false;
  } else {
    picker.querySelector("input").value = target.dataset.day;
    picker.querySelector("[data-chosen]").textContent = target.dataset.day;
    calendar.hidden = true;
  }
  opener.setAttribute("aria-expanded", String(!calendar.hidden));
});

// An endless list loads more items when its end comes into view.
if (document.querySelector("[data-endless]")) {
  new MutationObserver(watch).observe(document.querySelector("[data-endless]"), { childList: true, subtree: true });
  watch();
}
function watch() {
  const button = document.querySelector("[data-endless] [data-do=more]:not([data-watched])");
  if (!button) return;
  button.dataset.watched = "";
  new IntersectionObserver(([entry], observer) => {
    if (!entry.isIntersecting) return;
    observer.disconnect();
    button.click();
  }).observe(button);
}

// A slider shows its value, and Enter does not submit its form.
document.addEventListener("input", ({ target }) => {
  if (target.type === "range") target.closest("label").querySelector("output").textContent = target.value;
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && event.target.type === "range") event.preventDefault();
  if (event.key === "Enter" && event.target.dataset.bar) showValue(event.target);
});

// A bar of a chart shows its value when it is clicked, a pin on a map the item at its place.
document.addEventListener("click", ({ target }) => {
  if (target.dataset.bar) showValue(target);
  if (!target.dataset.pin) return;
  const link = Object.assign(document.createElement("a"), { href: target.dataset.href, textContent: "View details" });
  document.querySelector("[data-here]").replaceChildren(`Here: ${target.dataset.pin} `, link);
});
function showValue(bar) {
  bar.closest("[data-chart]").querySelector("[role=status]").textContent = bar.dataset.bar;
}

// The background of the map: hills, a river and roads, drawn from the hostname.
for (const canvas of document.querySelectorAll("[data-map] canvas")) {
  let state = [...location.host].reduce((sum, letter) => (sum * 31 + letter.charCodeAt(0)) >>> 0, 7);
  const random = () => (state = (state * 1664525 + 1013904223) >>> 0) / 2 ** 32;
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.fillStyle = "#dfead2";
  pen.fillRect(0, 0, width, height);
  for (let hill = 0; hill < 26; hill++) {
    pen.fillStyle = `rgba(150, 176, 120, ${0.15 + random() * 0.25})`;
    pen.beginPath();
    pen.ellipse(random() * width, random() * height, 30 + random() * 80, 20 + random() * 40, random() * 3, 0, 7);
    pen.fill();
  }
  for (const [color, thick] of [["#9cc4e4", 14], ["#f4f1e6", 6], ["#f4f1e6", 4]]) {
    pen.strokeStyle = color;
    pen.lineWidth = thick;
    pen.beginPath();
    let y = height * (0.2 + random() * 0.6);
    pen.moveTo(0, y);
    for (let x = 60; x <= width; x += 60) pen.quadraticCurveTo(x - 30, y, x, (y += (random() - 0.5) * 90));
    pen.stroke();
  }
}

// A frame gets the height of its content once it is visible.
for (const frame of document.querySelectorAll("[data-fit]")) {
  const fit = () => {
    const page = frame.contentDocument?.documentElement;
    if (page && frame.clientWidth) frame.style.height = `${page.querySelector("body").scrollHeight + 4}px`;
  };
  frame.addEventListener("load", fit);
  new ResizeObserver(fit).observe(frame);
}
