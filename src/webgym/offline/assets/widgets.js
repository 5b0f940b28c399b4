// Widgets of the specified families: suggestions while one types, a calendar, a carousel, an endless list.
"use strict";
let asked = 0;
document.addEventListener("input", (event) => {
  const field = event.target.closest("[data-suggest]");
  if (!field) return;
  clearTimeout(asked);
  asked = setTimeout(async () => {
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

// An endless list loads more of itself when its end comes into view.
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
