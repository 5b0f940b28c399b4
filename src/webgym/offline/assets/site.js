// Behaviour of the offline web's pages: consent banner, tabs, load more. No framework.
"use strict";
document.addEventListener("click", (event) => {
  const target = event.target.closest("[data-do]");
  if (!target) return;
  const act = target.dataset.do;
  if (act === "consent") {
    document.querySelectorAll(".consent, .veil").forEach((node) => node.remove());
    fetch("/consent", { method: "POST", body: new URLSearchParams({ choice: target.value }) });
  } else if (act === "tab") {
    const list = target.closest("[role=tablist]");
    for (const tab of list.querySelectorAll("[role=tab]")) {
      const chosen = tab === target;
      tab.setAttribute("aria-selected", String(chosen));
      document.getElementById(tab.getAttribute("aria-controls")).hidden = !chosen;
    }
  } else if (act === "more") {
    loadMore(target);
  }
});

// "Load more": fetches the results of the next page and appends them.
async function loadMore(button) {
  button.disabled = true;
  button.textContent = "Loading…";
  const text = await (await fetch(button.dataset.url)).text();
  const next = new DOMParser().parseFromString(text, "text/html");
  document.querySelector("[data-results]").append(...next.querySelector("[data-results]").children);
  button.closest("[data-pager]").replaceWith(next.querySelector("[data-pager]") ?? "");
}

// A dropdown or checkbox with data-submit submits its form when it changes.
document.addEventListener("change", (event) => {
  if (event.target.matches("[data-submit]")) event.target.form.requestSubmit();
});
