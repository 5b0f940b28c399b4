"""Pages that use popular npm packages: an HTML file each in `npm_pages/`, served from a cache folder.

The packages are not part of this repository: they are installed at the first run. A script next to a page is
bundled with its imports. The pages in `half_a` and `half_b` were written before the first measurement, and
divided at random: the rules of marks and text were corrected by the results on `half_a`, those of marks later
by `half_b`. The pages in `unseen` were written after that and measured once before rules were corrected by
them; those in `unseen_2` and then those in `unseen_3` were written after that, and measured once before, too.
Those in `unseen_4` were written before the rules were corrected by `unseen_3`, and rules were corrected by
them later. Those in `unseen_5` and then those in `unseen_6` were written after that, and measured once
before, too, and those in `unseen_7` after the rules had been corrected by all of these.
"""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

PACKAGES = (
    "esbuild@0.28 @shoelace-style/shoelace@2 @material/web@2 @fluentui/web-components@2 ag-grid-community@36 "
    "tabulator-tables@6 codemirror@5 monaco-editor@0.52 jquery@3 jquery-ui-dist@1.13 flatpickr@4 leaflet@1 "
    "bootstrap@5 choices.js@11 react@18 react-dom@18 vue@3 quill@2 fullcalendar@6 select2@4 nouislider@15 "
    "datatables.net-dt@2 jstree@3 swiper@14 tom-select@2 pikaday@1 chart.js@4 "
    # of the two halves
    "@ionic/core@8 @vaadin/button@24 @vaadin/checkbox@24 @vaadin/text-field@24 @vaadin/select@24 "
    "@vaadin/combo-box@24 @vaadin/tabs@24 @vaadin/radio-group@24 @vaadin/details@24 "
    "@vaadin/date-picker@24 @vaadin/grid@24 @carbon/web-components@2 @ui5/webcomponents@2 "
    "wired-elements@2 antd@5 @mui/material@6 @emotion/react@11 @emotion/styled@11 @mantine/core@7 "
    "@mantine/hooks@7 radix-ui@1 vuetify@3 element-plus@2 uikit@3 fomantic-ui-css@2 materialize-css@1 "
    "foundation-sites@6 video.js@8 tinymce@7 handsontable@15 gridjs@6 d3@7 air-datepicker@3 "
    "@splidejs/splide@4 jquery.fancytree@2 sweetalert2@11 jodit@4 @toast-ui/calendar@2 "
    # of the unseen pages
    "slim-select@2 vanillajs-datepicker@1 @simonwep/pickr@1 jspreadsheet-ce@4 frappe-gantt@0.6 easymde@2 "
    "naive-ui@2 w2ui@2 simple-datatables@9 vis-timeline@7 plyr@3 "
    # of the second set of unseen pages
    "primereact@10 rsuite@5 @blueprintjs/core@5 quasar@2 ace-builds@1 tui-grid@4 slickgrid@5 sortablejs@1 "
    "litepicker@2 @event-calendar/build@4 intl-tel-input@25 @yaireo/tagify@4 jsoneditor@10 "
    "@spectrum-web-components/bundle@1 dockview-core@4 @melloware/coloris@0.25 wunderbaum@0.13 "
    "bootstrap-icons@1 "
    # of the third set of unseen pages
    "mdui@2 cally@0.9 emoji-picker-element@1 emoji-picker-element-data@1 media-chrome@4 @revolist/revogrid@4 "
    "vanilla-calendar-pro@3 @daypilot/daypilot-lite-javascript@5 jkanban@1 summernote@0.9 uppy@6 "
    "apexcharts@7 ol@10 @chakra-ui/react@3 @glidejs/glide@3 smartmenus@1 jqtree@1 "
    # of the fourth set of unseen pages
    "bootstrap-table@1 x-data-spreadsheet@1 dhtmlx-gantt@9 @schedule-x/calendar@2 "
    "@schedule-x/theme-default@2 trix@2 @toast-ui/editor@3 @editorjs/editorjs@2 @editorjs/header@2 "
    "@editorjs/list@2 billboard.js@3 plotly.js-dist-min@3 jsvectormap@1 mind-elixir@5 "
    "@esri/calcite-components@3 igniteui-webcomponents@6 @easepick/bundle@1 toolcool-range-slider@4 "
    "treeselectjs@0.14 ion-rangeslider@2 jquery-contextmenu@2 metismenu@3.0 lightgallery@2 flickity@3 "
    "viewerjs@1 dragula@3 gridstack@12 mediaelement@7 wavesurfer.js@7 react-aria-components@1 "
    "@internationalized/date@3 @arco-design/web-react@2 react-big-calendar@1 moment@2 "
    "@xyflow/react@12 @types/react@18 @types/react-dom@18 filepond@4 muuri@0.9 "
    # of the fifth set of unseen pages
    "@awesome.me/webawesome@3 @vaadin/menu-bar@24 @vaadin/accordion@24 @vaadin/multi-select-combo-box@24 "
    "@vaadin/time-picker@24 @vaadin/integer-field@24 @duetds/date-picker@1 vanilla-colorful@0.7 "
    "tui-date-picker@4 tui-pagination@3 bootstrap-datepicker@1 color-calendar@1 echarts@5 frappe-charts@1 "
    "cytoscape@3 konva@9 drawflow@0.0.60 tiny-slider@2 slick-carousel@1 medium-editor@5 suneditor@2 "
    "clusterize.js@1 react-window@1 react-select@5 react-datepicker@8 @headlessui/react@2 rc-tree@5 vant@4 "
    "@selectize/selectize@0.15 multiple-select@2 bootstrap-slider@11 glightbox@3 @ztree/ztree_v3@3 "
    "canvas-datagrid@0.4 pivottable@2 flowbite@3 semantic-ui-react@2 semantic-ui-css@2 "
    # of the sixth set of unseen pages
    "bulma@1 alpinejs@3 @tabler/core@1 list.js@2 @primer/css@20 @github/tab-container-element@4 "
    "@coreui/coreui@5 notyf@3 govuk-frontend@6 accessible-autocomplete@2 daisyui@5 @tailwindcss/browser@4 "
    "@telekom/scale-components@3.0.0-beta.161 @cds/core@6 @siemens/ix@4 @siemens/ix-icons@3 "
    "@patternfly/elements@4 emoji-mart@5 @emoji-mart/data@1 ninja-keys@1 @fluentui/react-components@9 "
    "react-bootstrap@2 react-paginate@8 @cloudscape-design/components@3 @cloudscape-design/global-styles@1 "
    "react-day-picker@9 react-colorful@5 react-tag-autocomplete@7 cmdk@1 react-tabs@6 "
    "@tanstack/react-table@8 @hello-pangea/dnd@18 primevue@4 @primevue/themes@4 primeicons@7 "
    "vue-select@4.0.0-beta.6 @vueform/multiselect@2 @vuepic/vue-datepicker@11 v-calendar@3 ckeditor5@48 "
    "@tiptap/core@3 @tiptap/pm@3 @tiptap/starter-kit@3 @eonasdan/tempus-dominus@6 daterangepicker@3 "
    "bootstrap-select@1.14.0-beta3 chosen-js@1 virtual-select-plugin@1 photoswipe@5 embla-carousel@8 "
    "keen-slider@6 highcharts@12 recharts@2 @cubone/react-file-manager@1 "
    # of the seventh set of unseen pages
    "@angular/core@19 @angular/common@19 @angular/compiler@19 @angular/platform-browser@19 @angular/forms@19 "
    "@angular/animations@19 @angular/cdk@19 @angular/material@19 zone.js@0.15 rxjs@7 swagger-ui-dist@5 "
    "rapidoc@9 @nordhealth/components@4 @nordhealth/css@4 @nordhealth/themes@9 "
    "@astrouxds/astro-web-components@8 @umbraco-ui/uui@1 @shopify/polaris@13 webix@11 grapesjs@0.22 "
    "react-date-range@2 date-fns@4 react-calendar@5 uplot@1 chartist@1 victory@37 vuestic-ui@1 "
    "material-icons@1 @uswds/uswds@3 font-awesome@4"
).split()

FOLDER = Path(__file__).with_name("npm_pages")
REMOTE = {f"remote/{file.stem}": file for file in sorted(FOLDER.glob("remote/*.html"))}
"""Pages by name whose data comes from the server, with a delay of `ms` in their address, milliseconds."""
FILES = REMOTE | {file.stem: file for file in sorted(FOLDER.rglob("*.html")) if file.parent.name != "remote"}
"""Files of all pages by name."""
PAGES: dict[str, list[str]] = {"first": []}
for _name in sorted(FILES.keys() - REMOTE.keys()):
    _folder = FILES[_name].parent
    PAGES.setdefault("first" if _folder == FOLDER else _folder.name, []).append(_name)
"""Names of pages by set."""
CACHE = Path.home() / ".cache/webgym/npm_pages"


def install(cache: Path) -> None:
    """Install the packages and bundle scripts, if that has not been done yet."""
    asked = cache / "packages.txt"
    if not asked.exists() or asked.read_text().split() != PACKAGES:
        cache.mkdir(parents=True, exist_ok=True)
        (cache / "package.json").write_text(json.dumps({"private": True}))
        npm = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *PACKAGES]
        subprocess.run(npm, cwd=cache, check=True, capture_output=True)
        asked.write_text(" ".join(PACKAGES))
    for script in FOLDER.rglob("*.js"):
        bundle = cache / "bundles" / script.name
        if not bundle.exists() or bundle.stat().st_mtime < script.stat().st_mtime:
            esbuild = [
                "node_modules/.bin/esbuild",
                "--bundle",
                "--minify",
                "--loader=jsx",
                f"--outfile={bundle}",
            ]
            subprocess.run(esbuild, cwd=cache, input=script.read_bytes(), check=True, capture_output=True)


class Handler(SimpleHTTPRequestHandler):
    """Serves pages by name, with a noise script if their address requests it; `/remote/rows`, `/remote/text`
    and `/remote/picture`; and all files of the cache folder."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        name = url.path.strip("/")
        if name == "noise.js":
            self._send((FOLDER / name).read_bytes(), "text/javascript")
        elif name in FILES:
            noise = b"<script src=/noise.js></script>" if "noise" in parse_qs(url.query) else b""
            self._send(FILES[name].read_bytes() + noise, "text/html")
        elif name.startswith("remote/"):
            of_page = parse_qs(urlsplit(self.headers.get("Referer", "")).query)
            time.sleep(float(of_page.get("ms", ["300"])[0]) / 1000)
            self._send(*_answer(name, {key: value[0] for key, value in parse_qs(url.query).items()}))
        else:
            super().do_GET()

    def _send(self, body: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        with suppress(ConnectionError):  # the page has navigated away
            self.end_headers()
            self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


_FRUITS = (
    "Apple Apricot Avocado Banana Blackberry Cherry Coconut Cranberry Date Elderberry Fig Grape Grapefruit "
    "Guava Kiwi Kumquat Lemon Lime Lychee Mango Melon Mulberry Nectarine Olive Orange Papaya Peach Pear "
    "Persimmon Pineapple Plum Pomegranate Quince Raspberry Strawberry Tangerine Watermelon"
).split()
_PICTURE = (
    b"<svg xmlns='http://www.w3.org/2000/svg' width='256' height='256'>"
    b"<rect width='250' height='250' fill='teal'/></svg>"
)


def _answer(name: str, wanted: dict[str, str]) -> tuple[bytes, str]:
    if name == "remote/picture":
        return _PICTURE, "image/svg+xml"
    if name == "remote/text":
        return b"This came from the server.", "text/plain"
    found = [fruit for fruit in _FRUITS * 6 if wanted.get("q", "").lower() in fruit.lower()]
    start, count = int(wanted.get("from", 0)), int(wanted.get("count", 10))
    rows = [
        {"id": n, "name": fruit, "city": f"Town {n % 7}"}
        for n, fruit in enumerate(found[start : start + count], start)
    ]
    return json.dumps(rows).encode(), "application/json"


@contextmanager
def serving(cache: Path) -> Iterator[str]:
    """Serve pages and packages until the block ends.

    Yields:
        The base URL.
    """
    install(cache)
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(cache))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
