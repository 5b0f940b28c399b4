"""Pages made of widely used packages of npm, one HTML file each in `npm_pages/`, served from a cache folder.

Nothing of the packages is part of this repository: they are installed at the first run.
"""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

PACKAGES = (
    "esbuild@0.28 @shoelace-style/shoelace@2 @material/web@2 @fluentui/web-components@2 ag-grid-community@36 "
    "tabulator-tables@6 codemirror@5 monaco-editor@0.52 jquery@3 jquery-ui-dist@1.13 flatpickr@4 leaflet@1 "
    "bootstrap@5 choices.js@11 react@18 react-dom@18 vue@3 quill@2 fullcalendar@6 select2@4 nouislider@15 "
    "datatables.net-dt@2 jstree@3 swiper@14 tom-select@2 pikaday@1 chart.js@4"
).split()
BUNDLES = {
    "shoelace": "import '@shoelace-style/shoelace/dist/shoelace.js'",
    "material": "import '@material/web/all.js'",
    "fluent": "import * as fluent from '@fluentui/web-components';"
    "fluent.provideFluentDesignSystem().register(fluent.allComponents)",
}
"""Modules by the page that wants them as one script."""

FOLDER = Path(__file__).with_name("npm_pages")
PAGES = sorted(file.stem for file in FOLDER.glob("*.html"))
CACHE = Path.home() / ".cache/webgym/npm_pages"


def install(cache: Path) -> None:
    """Install the packages, and bundle modules, where that has not been done."""
    if not (cache / "node_modules/esbuild").exists():
        cache.mkdir(parents=True, exist_ok=True)
        (cache / "package.json").write_text(json.dumps({"private": True}))
        npm = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *PACKAGES]
        subprocess.run(npm, cwd=cache, check=True, capture_output=True)
    for name, module in BUNDLES.items():
        bundle = cache / f"bundles/{name}.js"
        if not bundle.exists():
            esbuild = ["node_modules/.bin/esbuild", "--bundle", "--minify", f"--outfile={bundle}"]
            subprocess.run(esbuild, cwd=cache, input=module.encode(), check=True, capture_output=True)


@contextmanager
def serving(cache: Path) -> Iterator[str]:
    """Serve the pages and packages; gives the base address."""

    class Handler(SimpleHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def translate_path(self, path: str) -> str:
            name = path.split("?")[0].strip("/")
            return str(FOLDER / f"{name}.html" if name in PAGES else cache / name)

        def log_message(self, *_: object) -> None:
            pass

    install(cache)
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
