// The theme: the system's, until somebody chooses. Storage may be refused, as for some local files.
function stored(value) {
  try {
    if (value !== undefined) localStorage.setItem("webgym-theme", value);
    return localStorage.getItem("webgym-theme");
  } catch { return null; }
}
if (stored()) document.documentElement.style.colorScheme = stored();
byId("theme").addEventListener("click", () => {
  const chosen = document.documentElement.style.colorScheme;
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.style.colorScheme = dark ? "light" : "dark";
  stored(dark ? "light" : "dark");
});
