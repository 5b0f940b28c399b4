"""Encyclopedias: one subject each, with articles, biographies, lists, comparisons and corrections."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline.families.encyclopedia import pictures, stock, tasks
from webgym.offline.families.encyclopedia.help import Topic, topics
from webgym.offline.families.encyclopedia.schema import NONE, STOCK, Article, Person, Subject
from webgym.offline.families.encyclopedia.stock import Catalogue
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

VOCABULARY: dict[str, tuple[str, ...]] = {
    "search": ("Search", "Search the encyclopedia", "Find an entry", "Look something up"),
    "entry": ("article", "entry", "page"),
    "list": ("Data table", "Fact finder", "All in figures", "Browse the data"),
    "compare": ("Compare", "Side by side", "Comparison"),
    "index": ("A–Z", "Index", "Register"),
    "people": ("People", "Biographies", "Who was who"),
    "changes": ("Recent changes", "Latest edits", "What changed"),
    "saved": ("Reading list", "Bookmarks", "My shelf"),
    "save": ("Add to {saved}", "Save to {saved}", "Put on {saved}"),
    "help": ("Help", "Questions", "How to use this site"),
    "report": ("Report a mistake", "Suggest a correction", "Tell us about an error"),
    "letter": ("Newsletter", "Mailing list", "Letter to readers"),
    "history": ("History", "Earlier versions", "Edits"),
    "cite": ("Cite", "Cite this {entry}", "How to cite"),
    "timeline": ("Timeline", "Year by year", "Chronology"),
    "sort": ("Sort by", "Order", "Arrange by"),
    "down": ("{label}: high to low", "{label}, descending", "{label} (highest first)"),
    "up": ("{label}: low to high", "{label}, ascending", "{label} (lowest first)"),
    "apply": ("Apply", "Show", "Filter"),
    "since": ("From year", "Not before", "Since"),
    "kind": ("Kind of mistake", "What is wrong?", "Type of problem"),
    "mail": ("Your e-mail", "E-mail address", "E-mail"),
    "text": ("Describe the mistake", "Your comment", "What should it say?"),
    "send": ("Send", "Submit", "Send report"),
    "topic": ("Topic", "Subject area", "Send me news about"),
    "often": ("How often", "Frequency", "Delivery"),
    "subscribe": ("Subscribe", "Sign up", "Join"),
}
MAIL = re.compile(r"[^@\s]+@[^@\s]+\.[^@\s]+")
TEXT_AT_LEAST = 12
PAGE_SIZES = {"grid": 12, "rows": 8, "table": 14}
RESULTS_PER_PAGE = 10


@dataclass
class Encyclopedia(Website):
    """A reference work on one subject."""

    family: ClassVar[str] = "encyclopedia"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "wiki": ("wiki", "article", "entry", "e", "lemma"),
        "list": ("table", "list", "data", "facts"),
        "group": ("category", "topic", "group", "portal"),
        "person": ("person", "biography", "who"),
        "people": ("people", "biographies", "authors"),
        "compare": ("compare", "versus", "side-by-side"),
        "index": ("a-z", "index", "register"),
        "saved": ("reading-list", "bookmarks", "shelf"),
        "report": ("report", "corrections", "feedback"),
        "help": ("help", "questions", "guide"),
        "changes": ("changes", "recent", "edits"),
        "search": ("search", "find", "lookup"),
        "letter": ("newsletter", "mailing", "letters"),
        "timeline": ("timeline", "years", "chronology"),
        "q": ("q", "query", "s", "term"),
    }

    subject: Subject = field(init=False)
    stock: Catalogue = field(init=False)
    topics: tuple[Topic, ...] = field(init=False)
    jumps: bool = field(init=False)
    """Whether a search for a whole title leads straight to the article."""
    submits: bool = field(init=False)
    """Whether filters apply as soon as they are changed."""
    headers: bool = field(init=False)
    """Whether a table is sorted by clicking its headings."""
    box: str = field(init=False)
    """Where the infobox stands."""
    front: str = field(init=False)
    """What the front page shows."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """A name that tells the subject."""
        brand = f"{stem} {pick(pick(STOCK.subjects, seed, 'subject').brands, seed, 'brand')}"
        return brand, slug(brand)

    def build(self) -> None:
        """Choose the subject, and write all articles."""
        self.subject = pick(STOCK.subjects, self.seed, "subject")
        self.domain, self.subdomain = self.subject.domain, self.subject.subdomain
        self.stock = stock.make(self.seed, self.subject)
        self.topics = topics(self.seed, self.host, self.word("entry"))
        self.tagline = f"{len(self.stock.articles)} {self.subject.plural}, described by hand"
        rng = stream(self.seed, "manners")
        self.jumps = rng.random() < 0.5
        self.submits = rng.random() < 0.6
        self.headers = self.look.listing == "table" and rng.random() < 0.6
        self.box = rng.choice(("right", "right", "left", "band"))
        self.front = rng.choice(("portal", "letters", "featured"))

    def word(self, name: str, **values: str) -> str:
        """This website's word for something."""
        text = pick(VOCABULARY[name], self.seed, "word", name)
        if name == "save":
            values["saved"] = self.word("saved").lower()
        if name == "cite":
            values["entry"] = self.word("entry")
        return text.format(**values)

    @property
    def entries(self) -> str:
        """Plural of this website's word for an article."""
        return {"article": "articles", "entry": "entries", "page": "pages"}[self.word("entry")]

    def menu(self) -> list[tuple[str, str]]:
        """Lists, tools and people."""
        names = ["list", "compare", "index", "people"]
        if self.seed % 2:
            names.insert(2, "timeline")
        return [(self.word(name), self.path(f"/~{name}")) for name in names]

    def report(self, state: State) -> dict[str, Any]:
        """The reading list, corrections by title, and the newsletter."""
        titles = self.stock.by_slug
        return {
            "saved": {titles[slug].title: True for slug in state.get("saved", [])},
            "reports": {titles[slug].title: sent for slug, sent in state.get("reports", {}).items()},
            "letter": state.get("letter", {}),
        }

    def assignments(self) -> Iterable[Assignment]:
        """The tasks."""
        return tasks.Author(self).assignments()

    # --- what templates ask ---------------------------------------------------------------------------

    def article_path(self, article: Article) -> str:
        """Where an article stands."""
        return self.path("/~wiki/{slug}", slug=article.slug)

    def person_path(self, person: Person) -> str:
        """Where a biography stands."""
        return self.path("/~person/{slug}", slug=person.slug)

    def group_path(self, group: str) -> str:
        """Where a group is listed."""
        return self.path("/~group/{slug}", slug=slug(group))

    def box_rows(self, article: Article) -> list[tuple[str, str]]:
        """The infobox, but for group and person, which are links."""
        subject = self.subject
        rows = [(m.label, m.show(article.numbers[m.key])) for m in self.stock.measures]
        rows += [(trait.label, article.traits[trait.key]) for trait in subject.traits]
        rows += [(subject.lack.label, article.lacking), (subject.event[0], str(article.year))]
        return [*rows, (subject.place, article.place)]

    def row(self, article: Article) -> list[tuple[str, str]]:
        """What lists say about an article."""
        first, second = self.stock.measures[:2]
        return [
            (self.subject.group_label, article.group),
            (first.label, first.show(article.numbers[first.key])),
            (second.label, second.show(article.numbers[second.key])),
            (self.subject.event[0], str(article.year)),
            (self.subject.lack.label, article.lacking),
        ]

    def sort_keys(self) -> list[tuple[str, str]]:
        """(key, label) of what lists can be sorted by, besides the name."""
        return [(m.key, m.label) for m in self.stock.measures[:2]] + [("year", self.subject.event[0])]

    def sort_options(self) -> list[tuple[str, str]]:
        """Options of the sorting dropdown: (value, text)."""
        options = [("", "Name")]
        for key, label in self.sort_keys():
            options.append((f"{key}-desc", self.word("down", label=label)))
            options.append((f"{key}-asc", self.word("up", label=label)))
        return options

    def count(self, number: int) -> str:
        """``"1 bird"``, ``"7 birds"``."""
        return f"{number} {self.subject.noun if number == 1 else self.subject.plural}"

    # --- lists ------------------------------------------------------------------------------------------

    def listed(self, visit: Visit) -> list[Article]:
        """The articles that a list's filters let through, in the order asked for."""
        query = visit.query
        trait = self.subject.traits[0]
        since = query.get("since", "")
        found = [
            article
            for article in self.stock.articles
            if query.get("group", "") in ("", slug(article.group))
            and query.get(trait.key, "") in ("", slug(article.traits[trait.key]))
            and query.get("lack", "") in ("", slug(article.lacking))
            and not (since.isdecimal() and len(since) < 6 and article.year < int(since))
        ]
        return self.arranged(found, query.get("sort", ""))

    def arranged(self, articles: Sequence[Article], sort: str) -> list[Article]:
        """Articles in the order that a ``sort`` parameter names; by name if it names none."""
        key, _, direction = sort.rpartition("-")
        if key == "year":
            return sorted(articles, key=lambda a: a.year, reverse=direction == "desc")
        if any(key == measure.key for measure in self.stock.measures):
            return sorted(articles, key=lambda a: a.numbers[key], reverse=direction == "desc")
        return list(articles)

    def page_size(self) -> int:
        """Articles on one page of a list."""
        return PAGE_SIZES[self.look.listing]

    # --- pages --------------------------------------------------------------------------------------------

    @page("/")
    def home(self, visit: Visit) -> Response:
        """The front page."""
        featured = pick(self.stock.articles, self.seed, "featured")
        return self.render("encyclopedia/front.html", visit, featured=featured, initial=stock.initial)

    @page("/picture/{kind}/{name}")
    def picture(self, visit: Visit, kind: str, name: str) -> Response:
        """An illustration of an article, or a portrait."""
        del visit
        drawn = pictures.draw(kind, name.removesuffix(".svg"), self.look)
        return Response(drawn.encode(), media_type="image/svg+xml")

    @page("/~search")
    def search(self, visit: Visit) -> Response:
        """Search by title first, then by everything in the infobox."""
        asked = visit.query.get(self.paths["q"], "").strip()
        wanted = asked.casefold()
        exact = [a for a in self.stock.articles if a.title.casefold() == wanted]
        if exact and self.jumps:
            return redirect(self.article_path(exact[0]))
        words = re.findall(r"\w+", wanted)
        found = exact + [a for a in self.stock.articles if a not in exact and self._matches(a, words)]
        people = [p for p in self.stock.people if words and all(w in p.name.casefold() for w in words)]
        close: list[str] = []
        if not found and not people:
            everything = {a.title.casefold(): a.title for a in self.stock.articles}
            close = [everything[t] for t in difflib.get_close_matches(wanted, everything, n=3, cutoff=0.5)]
        return self.render(
            "encyclopedia/search.html",
            visit,
            asked=asked,
            people=people,
            close=[a for a in self.stock.articles if a.title in close],
            results=paged(found if words else [], visit, RESULTS_PER_PAGE),
        )

    def _matches(self, article: Article, words: list[str]) -> bool:
        # Only names and words: a figure in the results would give away what the article is for.
        text = " ".join((article.title, article.group, article.person.name, article.place)).casefold()
        return all(word in text for word in words)

    @page("/~list")
    def table(self, visit: Visit) -> Response:
        """All articles, with filters and sorting."""
        found = self.listed(visit)
        return self.render("encyclopedia/list.html", visit, results=paged(found, visit, self.page_size()))

    @page("/~group/{name}")
    def group(self, visit: Visit, name: str) -> Response:
        """The articles of one group."""
        group = next((g for g in self.stock.groups if slug(g) == name), None)
        if group is None:
            return self.missing(visit)
        results = paged(self.stock.members(group), visit, self.page_size())
        return self.render("encyclopedia/group.html", visit, group=group, results=results)

    @page("/~index")
    def index(self, visit: Visit) -> Response:
        """Articles by first letter."""
        letters = self.stock.letters()
        letter = visit.query.get("letter", letters[0])
        found = [a for a in self.stock.articles if stock.initial(a.title) == letter]
        return self.render("encyclopedia/index.html", visit, letters=letters, letter=letter, found=found)

    @page("/~timeline")
    def timeline(self, visit: Visit) -> Response:
        """Articles by the quarter of a century."""
        spans: dict[int, list[Article]] = {}
        for article in sorted(self.stock.articles, key=lambda a: (a.year, a.title)):
            spans.setdefault(article.year // 25 * 25, []).append(article)
        return self.render("encyclopedia/timeline.html", visit, spans=spans)

    @page("/~people")
    def people(self, visit: Visit) -> Response:
        """All biographies."""
        return self.render("encyclopedia/people.html", visit)

    @page("/~person/{name}")
    def person(self, visit: Visit, name: str) -> Response:
        """A biography."""
        person = self.stock.person_by_slug.get(name)
        if person is None:
            return self.missing(visit)
        return self.render("encyclopedia/person.html", visit, person=person, works=self.stock.works(person))

    @page("/~compare")
    def compare(self, visit: Visit) -> Response:
        """Two articles side by side."""
        pair = [self.stock.by_slug.get(visit.query.get(name, "")) for name in ("a", "b")]
        first, second = pair
        error = None
        if first is not None and first == second:
            error = f"Choose two different {self.subject.plural}."
        rows = []
        if first and second and not error:
            rows = [
                (label, mine, theirs)
                for (label, mine), (_, theirs) in zip(
                    self.box_rows(first), self.box_rows(second), strict=True
                )
            ]
        return self.render("encyclopedia/compare.html", visit, pair=pair, rows=rows, error=error)

    @page("/~wiki/{name}")
    def article(self, visit: Visit, name: str) -> Response:
        """An article."""
        article = self.stock.by_slug.get(name)
        if article is None:
            return self.missing(visit)
        others = [self.stock.by_slug[other] for other in article.seealso]
        return self.render(
            "encyclopedia/article.html",
            visit,
            article=article,
            others=others,
            saved=article.slug in visit.state.get("saved", []),
            overview=stock.OVERVIEW,
            none=NONE,
        )

    @page("/~wiki/{name}/history")
    def history(self, visit: Visit, name: str) -> Response:
        """An article's edits."""
        article = self.stock.by_slug.get(name)
        if article is None:
            return self.missing(visit)
        return self.render("encyclopedia/history.html", visit, article=article)

    @page("/~changes")
    def changes(self, visit: Visit) -> Response:
        """The latest edits of all articles."""
        results = paged(self.stock.changes, visit, stock.CHANGES_PER_PAGE)
        return self.render("encyclopedia/changes.html", visit, results=results)

    @page("/~help")
    def help(self, visit: Visit) -> Response:
        """Questions and answers."""
        return self.render("encyclopedia/help.html", visit)

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """The reading list."""
        found = [self.stock.by_slug[slug] for slug in visit.state.get("saved", [])]
        return self.render("encyclopedia/saved.html", visit, found=found)

    @page("/~saved/{name}", method="POST")
    def save(self, visit: Visit, name: str) -> Response:
        """Put an article on the reading list, or take it off."""
        article = self.stock.by_slug.get(name)
        if article is None:
            return self.missing(visit)
        slugs = [slug for slug in visit.state.get("saved", []) if slug != name]
        if visit.form.get("do") == "remove":
            visit.state["saved"] = slugs
            return redirect(self.path("/~saved"))
        visit.state["saved"] = [*slugs, name]
        return redirect(self.article_path(article))

    @page("/~report/{name}")
    def report_form(self, visit: Visit, name: str) -> Response:
        """The form for a correction."""
        article = self.stock.by_slug.get(name)
        if article is None:
            return self.missing(visit)
        return self.render("encyclopedia/report.html", visit, article=article, errors={}, kinds=stock.KINDS)

    @page("/~report/{name}", method="POST")
    def report_sent(self, visit: Visit, name: str) -> Response:
        """Take a correction, or say what is wrong with it."""
        article = self.stock.by_slug.get(name)
        if article is None:
            return self.missing(visit)
        sent = {key: visit.form.get(key, "").strip() for key in ("kind", "mail", "text")}
        errors = {}
        if sent["kind"] not in stock.KINDS:
            errors["kind"] = "Please choose what it is about."
        if not MAIL.fullmatch(sent["mail"]):
            errors["mail"] = "This is not an e-mail address."
        if len(sent["text"]) < TEXT_AT_LEAST:
            errors["text"] = f"Please write at least {TEXT_AT_LEAST} characters."
        if errors:
            return self.render(
                "encyclopedia/report.html",
                visit,
                status=422,
                article=article,
                errors=errors,
                kinds=stock.KINDS,
            )
        visit.state.setdefault("reports", {})[name] = sent
        return redirect(self.path("/~report/{name}/thanks", name=name))

    @page("/~report/{name}/thanks")
    def report_thanks(self, visit: Visit, name: str) -> Response:
        """What was sent."""
        sent = visit.state.get("reports", {}).get(name)
        if sent is None:
            return self.missing(visit)
        article = self.stock.by_slug[name]
        return self.render("encyclopedia/reported.html", visit, article=article, sent=sent)

    @page("/~letter")
    def letter(self, visit: Visit) -> Response:
        """The form for the newsletter."""
        return self.render("encyclopedia/letter.html", visit, errors={}, often=stock.OFTEN)

    @page("/~letter", method="POST")
    def letter_sent(self, visit: Visit) -> Response:
        """Subscribe, or say what is wrong."""
        sent = {key: visit.form.get(key, "").strip() for key in ("often", "topic", "mail")}
        errors = {}
        if sent["often"] not in stock.OFTEN:
            errors["often"] = "Please choose one."
        if sent["topic"] not in self.stock.groups:
            errors["topic"] = "Please choose one."
        if not MAIL.fullmatch(sent["mail"]):
            errors["mail"] = "This is not an e-mail address."
        if errors:
            return self.render(
                "encyclopedia/letter.html", visit, status=422, errors=errors, often=stock.OFTEN
            )
        visit.state["letter"] = sent
        return redirect(self.path("/~letter/done"))

    @page("/~letter/done")
    def letter_done(self, visit: Visit) -> Response:
        """What was subscribed to."""
        if "letter" not in visit.state:
            return self.missing(visit)
        return self.render("encyclopedia/lettered.html", visit, sent=visit.state["letter"])
