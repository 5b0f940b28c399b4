// The theme: the system's, until the user chooses one.

/** Get or set a value in local storage, which some browsers refuse for local files. */
function stored(name, value) {
  try {
    if (value !== undefined) localStorage.setItem(name, value);
    return localStorage.getItem(name);
  } catch { return null; }
}
if (stored("webgym-theme")) document.documentElement.style.colorScheme = stored("webgym-theme");
byId("theme").addEventListener("click", () => {
  const chosen = document.documentElement.style.colorScheme;
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.style.colorScheme = dark ? "light" : "dark";
  stored("webgym-theme", dark ? "light" : "dark");
});
