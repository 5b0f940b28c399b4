"""A little shop without a browser: pages of boxes in a viewport, that scroll, cover, load and answer."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from urllib.parse import parse_qs, urlencode, urlsplit

from webgym.core.action import (
    GRID,
    Action,
    Answer,
    GoBack,
    LeftClick,
    Mode,
    Navigate,
    Scroll,
    Target,
    Type,
    Wait,
)
from webgym.core.observation import Element, Notice, Observation
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.truth import AnswerTruth, Move, Truth

HOST = "http://mugs.webgym.test"
WIDTH, HEIGHT, WHEEL = 1280, 768, 600
BAR = 60

Deed = Callable[[], None]


@dataclass(frozen=True)
class Box:
    """Something on a page: an element if it has a role, else text."""

    y: float
    name: str
    role: str = ""
    x: float = 100
    width: float = 300
    height: float = 30
    href: str | None = None
    value: str | None = None
    deed: Deed | None = field(default=None, repr=False)
    fixed: bool = False


@dataclass
class Shop:
    """The server's side and the tab in one."""

    sticky: bool = True
    banner: bool = False
    modal_after: int = 10_000
    slow: int = 0
    deaf: int = 0
    native_select: bool = True
    tall: int = 40
    url: str = HOST + "/"
    offset: float = 0
    history: list[tuple[str, float]] = field(default_factory=list)
    cart: list[str] = field(default_factory=list)
    typed: dict[str, str] = field(default_factory=dict)
    orders: list[dict[str, str]] = field(default_factory=list)
    complaint: str = ""
    tab: str = "About"
    is_open: bool = False
    is_modal: bool = False
    loading: int = 0
    is_animated: bool = False
    actions: list[Action] = field(default_factory=list)

    # --- the tab ------------------------------------------------------------------------------------

    def observe(self, mode: Mode = "coordinates") -> Observation:
        boxes, extent = self._laid_out()
        elements = tuple(
            Element(number, box.role, box.name, _cut(box), box.value, box.href)
            for number, box in enumerate(boxes, 1)
            if box.role
        )
        text = "\n".join(box.name for box in boxes)
        is_loading = self.loading > 0
        self.loading = max(0, self.loading - 1)
        look = (
            f"{self.url} {self.offset} {boxes} {self._frame()}" if not is_loading else f"{self.url} loading"
        )
        return Observation(
            screenshot=hashlib.sha256(look.encode()).hexdigest(),
            url=self.url,
            title="Mugs",
            viewport=(WIDTH, HEIGHT),
            status=200,
            scroll=(self.offset, extent),
            mode=mode,
            notices=(Notice("still_loading", "the page is not quiet"),) if is_loading else (),
            text="" if is_loading else text,
            elements=() if is_loading else elements,
        )

    def _frame(self) -> int:
        return len(self.actions) if self.is_animated else 0

    def act(self, action: Action | None) -> None:
        if action is None:
            return
        self.actions.append(action)
        match action:
            case LeftClick(target=target):
                self._click(self._hit(target))
            case Type(target=target, text=text):
                self._type(self._hit(target), text)
            case Scroll(direction=direction):
                most = max(0.0, self._laid_out()[1] - HEIGHT)
                self.offset = min(most, max(0.0, self.offset + (WHEEL if direction == "down" else -WHEEL)))
            case GoBack():
                if self.history:
                    self.url, self.offset = self.history.pop()
            case Navigate() | Wait() | Answer():
                pass
        if len(self.actions) == self.modal_after:
            self.is_modal = True

    def _laid_out(self) -> tuple[list[Box], float]:
        """The boxes in sight, at their places in the viewport, and how tall the page is."""
        boxes = self._boxes()
        extent = max((box.y + box.height + 40 for box in boxes if not box.fixed), default=HEIGHT)
        placed = [box if box.fixed else replace(box, y=box.y - self.offset) for box in boxes]
        top = BAR if self.sticky else 0
        seen = [box for box in placed if box.fixed or (box.y + box.height > top and box.y < HEIGHT)]
        if self.is_modal:  # it covers everything
            seen = [Box(300, "Join our newsletter!"), Box(400, "Close", "button", deed=self._close)]
        return seen, max(extent, HEIGHT)

    def _hit(self, target: Target) -> Box | None:
        boxes, _ = self._laid_out()
        if target.element is not None:
            return boxes[target.element - 1]
        assert target.coordinate is not None
        x, y = target.coordinate[0] / GRID * WIDTH, target.coordinate[1] / GRID * HEIGHT
        at = [b for b in boxes if b.x <= x <= b.x + b.width and b.y <= y <= b.y + b.height and b.role]
        return next((box for box in at if box.fixed), at[0] if at else None)

    def _click(self, box: Box | None) -> None:
        if box is None:
            return
        if self.deaf:
            self.deaf -= 1
        elif box.href is not None:
            self.go(box.href)
        elif box.deed is not None:
            box.deed()

    def _type(self, box: Box | None, text: str) -> None:
        if box is None or box.role not in ("textbox", "combobox"):
            return
        if box.role == "combobox":
            self.is_open = False
            self.go(f"/search?{urlencode({'q': self._query('q'), 'sort': text})}")
        elif box.name == "Search mugs":
            self.go(f"/search?{urlencode({'q': text})}")
        else:
            self.typed[box.name] = text
            self._order()

    def go(self, href: str) -> None:
        self.history.append((self.url, self.offset))
        self.url, self.offset = HOST + href.removeprefix(HOST), 0
        self.loading, self.tab, self.is_open = self.slow, "About", False

    # --- the server ---------------------------------------------------------------------------------

    def _query(self, key: str) -> str:
        return parse_qs(urlsplit(self.url).query).get(key, [""])[0]

    def _boxes(self) -> list[Box]:
        bar = [
            Box(10, "Mugs & Co", "link", href=HOST + "/", fixed=self.sticky, x=10, width=90),
            Box(10, "Search mugs", "textbox", x=500, value=self._query("q"), fixed=self.sticky),
            Box(10, "Cart", "link", x=1000, href=HOST + "/cart", fixed=self.sticky),
        ]
        page = {
            "/": self._front,
            "/search": self._results,
            "/cart": self._cart_page,
            "/order": self._order_page,
        }.get(urlsplit(self.url).path, self._mug_page)
        banner = [
            Box(700, "Accept all", "button", deed=self._accept, fixed=True),
            Box(700, "Only necessary", "button", x=500, deed=self._accept, fixed=True),
        ]
        return bar + (banner if self.banner else []) + page()

    def _front(self) -> list[Box]:
        return [Box(200, "Mugs for everybody"), Box(1500, "About us", "link", href=HOST + "/about")]

    def _results(self) -> list[Box]:
        mugs = range(self.tall)
        order = reversed(mugs) if "high" in self._query("sort") else mugs
        select = Box(
            100, "Sort by", "combobox", x=800, value=self._query("sort") or "Relevance", deed=self._open
        )
        options = [
            Box(140 + 30 * n, name, "option", x=800, deed=lambda name=name: self._sort(name))  # type: ignore[misc]
            for n, name in enumerate(("Relevance", "Price: high to low"))
        ]
        shown = options if self.is_open and not self.native_select else []
        mug = [
            Box(200 + 100 * place, f"Mug {number}", "link", href=f"{HOST}/mug/{number}")
            for place, number in enumerate(order)
        ]
        return [select, *shown, *mug]

    def _mug_page(self) -> list[Box]:
        number = urlsplit(self.url).path.rpartition("/")[2]
        about = [Box(300, f"Mug {number} costs"), Box(340, f"£{number}.50")]
        more = [Box(300, f"Mug {number} weighs"), Box(340, f"{number}00 g")]
        return [
            Box(120, "About", "tab", deed=lambda: setattr(self, "tab", "About")),
            Box(120, "Details", "tab", x=500, deed=lambda: setattr(self, "tab", "Details")),
            *(about if self.tab == "About" else more),
            Box(1900, "Add to cart", "button", deed=lambda: self._buy(number)),
            *([Box(1950, f"In the cart: {len(self.cart)}")] if self.cart else []),
        ]

    def _cart_page(self) -> list[Box]:
        lines = [Box(200 + 50 * n, f"1 x Mug {number}") for n, number in enumerate(self.cart)]
        return [*lines, Box(900, "Check out", "link", href=HOST + "/order")]

    def _order_page(self) -> list[Box]:
        if self.orders:
            return [Box(300, "Thank you for your order!")]
        fields = [
            Box(200 + 700 * n, name, "textbox", value=self.typed.get(name, ""))
            for n, name in enumerate(("Name", "Street", "Town"))
        ]
        complaint = [Box(120, self.complaint)] if self.complaint else []
        return [*complaint, *fields, Box(1700, "Place order", "button", deed=self._order)]

    def _order(self) -> None:
        missing = [name for name in ("Name", "Street", "Town") if not self.typed.get(name)]
        self.offset = 0  # the form is sent, and the page comes back at its top
        self.complaint = f"Missing: {', '.join(missing)}" if missing else ""
        if not missing:
            self.orders.append(dict(self.typed))

    def _buy(self, number: str) -> None:
        self.cart.append(number)

    def _open(self) -> None:
        self.is_open = True

    def _sort(self, name: str) -> None:
        self.go(f"/search?{urlencode({'q': self._query('q'), 'sort': name})}")

    def _accept(self) -> None:
        self.banner = False

    def _close(self) -> None:
        self.is_modal = False


def _cut(box: Box) -> tuple[float, float, float, float]:
    top, bottom = max(0.0, box.y), min(float(HEIGHT), box.y + box.height)
    return box.x, top, box.width, bottom - top


def task(*moves: Move, answer: AnswerTruth | None = None, task_id: str = "offline/mugs/1") -> Task:
    return Task(
        id=task_id,
        instruction="On Mugs & Co, do what must be done.",
        website=HOST + "/",
        domain="Shopping",
        subdomain="Kitchen",
        rubric=Rubric((FactGroup(1, "Everything", ("It is done",)),)),
        source="offline",
        truth=Truth(host="mugs.webgym.test", facts=(), answer=answer or AnswerTruth(), moves=moves),
    )
