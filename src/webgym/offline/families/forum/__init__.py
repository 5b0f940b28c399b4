"""Forums: boards, threads and replies, members, votes, private messages, and an account to write with."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline.families.forum import stock, tasks, till
from webgym.offline.families.forum.schema import STOCK, Hobby, Post, Thread, User
from webgym.offline.families.forum.stock import Catalogue
from webgym.offline.families.forum.words import PLURALS, VOCABULARY, Topic, topics
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

PAGE_SIZES = {"grid": 12, "rows": 9, "table": 15}
MEMBERS_PER_PAGE = 12


@dataclass
class Forum(Website):
    """A discussion board on one hobby."""

    family: ClassVar[str] = "forum"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "board": ("board", "forum", "c", "section"),
        "thread": ("t", "thread", "topic", "d"),
        "user": ("u", "user", "profile"),
        "members": ("members", "people", "community"),
        "tag": ("tag", "label", "about"),
        "tags": ("tags", "labels", "keywords"),
        "all": ("latest", "all", "recent"),
        "search": ("search", "find", "results"),
        "enter": ("login", "sign-in", "enter"),
        "join": ("register", "join", "sign-up"),
        "new": ("new-post", "ask", "write"),
        "help": ("faq", "rules", "help"),
        "inbox": ("inbox", "messages", "mail"),
        "me": ("account", "me", "my"),
        "q": ("q", "query", "s", "keywords"),
    }

    hobby: Hobby = field(init=False)
    stock: Catalogue = field(init=False)
    topics: tuple[Topic, ...] = field(init=False)
    per_page: int = field(init=False)
    """Replies on one page of a thread."""
    submits: bool = field(init=False)
    """Whether filters apply as soon as they are changed."""
    links: bool = field(init=False)
    """Whether lists are sorted by links in place of a dropdown."""
    modal: bool = field(init=False)
    """Whether a thread is reported in a dialog in place of a page."""
    slugs: bool = field(init=False)
    """Whether a thread's address carries its title."""
    front: str = field(init=False)
    """What the front page shows."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """A name that tells the hobby."""
        brand = f"{stem} {pick(pick(STOCK.hobbies, seed, 'hobby').brands, seed, 'brand')}"
        return brand, slug(brand)

    def build(self) -> None:
        """Choose the hobby, and write all threads."""
        self.hobby = pick(STOCK.hobbies, self.seed, "hobby")
        self.domain, self.subdomain = self.hobby.domain, self.hobby.subdomain
        self.stock = stock.make(self.seed, self.hobby)
        self.topics = topics(self.seed, self.host, self.word("thread"))
        self.tagline = f"people who talk about {self.hobby.name}"
        rng = stream(self.seed, "manners")
        self.per_page = rng.choice((8, 10, 10))
        self.submits = rng.random() < 0.6
        self.links = rng.random() < 0.4
        self.modal = rng.random() < 0.5
        self.slugs = rng.random() < 0.6
        self.front = rng.choice(("boards", "boards", "feed", "tiles"))

    def word(self, name: str) -> str:
        """This website's word for something."""
        text = pick(VOCABULARY[name], self.seed, "word", name)
        if "{" not in text:
            return text
        thread, reply = self.word("thread"), self.word("reply")
        return text.format(
            thread=thread, threads=f"{thread}s", replies=PLURALS[reply], likes=self.word("likes")
        )

    @property
    def replies(self) -> str:
        """Plural of this website's word for a reply."""
        return PLURALS[self.word("reply")]

    def menu(self) -> list[tuple[str, str]]:
        """Everything, tags, members and help."""
        names = ["all", "tags", "members", "help"]
        return [(self.word(name), self.path(f"/~{name}")) for name in names]

    def report(self, state: State) -> dict[str, Any]:
        """What the account did."""
        return till.report(self, state)

    def assignments(self) -> Iterable[Assignment]:
        """The tasks."""
        return tasks.Author(self).assignments()

    # --- what templates and tasks ask -------------------------------------------------------------------

    def thread_path(self, thread: Thread, rest: str = "") -> str:
        """Where a thread stands."""
        name = f"{thread.number}-{thread.slug}" if self.slugs else str(thread.number)
        return self.path("/~thread/{name}", name=name) + rest

    def user_path(self, user: User) -> str:
        """Where a member's profile stands."""
        return self.path("/~user/{name}", name=slug(user.name))

    def board_path(self, board: str) -> str:
        """Where a board stands."""
        return self.path("/~board/{name}", name=slug(board))

    def tag_path(self, tag: str) -> str:
        """Where the threads with a tag are listed."""
        return self.path("/~tag/{name}", name=slug(tag))

    def orders(self) -> list[tuple[str, str]]:
        """How lists of threads can be sorted: (value, text)."""
        names = {"": "active", "new": "newest", "replies": "busy", "likes": "top", "views": "seen"}
        return [(value, self.word(name)) for value, name in names.items()]

    def reply_orders(self) -> list[tuple[str, str]]:
        """How replies can be sorted: (value, text)."""
        return [("", self.word("oldest")), ("new", self.word("newest")), ("likes", self.word("top"))]

    def page_of(self, thread: Thread, reply: Post) -> int:
        """The page of a thread, from 1, on which a reply stands."""
        return thread.replies.index(reply) // self.per_page + 1

    def arranged(self, threads: Sequence[Thread], order: str) -> list[Thread]:
        """Threads in the order that a ``sort`` parameter names; latest posts first if it names none."""
        keys = {
            "new": lambda thread: thread.opening.when,
            "replies": lambda thread: len(thread.replies),
            "likes": lambda thread: thread.likes,
            "views": lambda thread: thread.views,
        }
        return sorted(threads, key=keys[order], reverse=True) if order in keys else list(threads)

    # --- lists -------------------------------------------------------------------------------------------

    @page("/")
    def home(self, visit: Visit) -> Response:
        """The front page."""
        return self.render("forum/front.html", visit)

    def _listing(
        self, visit: Visit, title: str, threads: Sequence[Thread], *, about: str = "", board: str = "",
        close: Sequence[Thread] = (), members: Sequence[User] = (),
    ) -> Response:  # fmt: skip
        tag, state = visit.query.get("tag", ""), visit.query.get("state", "")
        wanted = visit.query.get("board", "")
        found = [
            thread
            for thread in threads
            if tag in ("", slug(thread.tag))
            and (state not in ("solved", "open") or (state == "solved") == (thread.accepted is not None))
            and wanted in ("", slug(thread.board))
        ]
        shown = paged(self.arranged(found, visit.query.get("sort", "")), visit, PAGE_SIZES[self.look.listing])
        own = [thread for thread in visit.state.get("threads", []) if thread["board"] == board]
        return self.render(
            "forum/listing.html", visit, title=title, about=about, board=board, results=shown, own=own,
            close=close, members=members, can_choose_board=not board,
        )  # fmt: skip

    @page("/~all")
    def everything(self, visit: Visit) -> Response:
        """All threads."""
        return self._listing(visit, self.word("all"), self.stock.threads)

    @page("/~board/{name}")
    def board(self, visit: Visit, name: str) -> Response:
        """The threads of a board."""
        found = next(((b, about) for b, about in self.stock.boards if slug(b) == name), None)
        if found is None:
            return self.missing(visit)
        board, about = found
        return self._listing(visit, board, self.stock.on_board(board), about=about, board=board)

    @page("/~tag/{name}")
    def tag(self, visit: Visit, name: str) -> Response:
        """The threads with a tag."""
        tag = next((tag for tag in self.hobby.tags if slug(tag) == name), None)
        if tag is None:
            return self.missing(visit)
        return self._listing(visit, f"#{tag}", [t for t in self.stock.threads if t.tag == tag])

    @page("/~tags")
    def tags(self, visit: Visit) -> Response:
        """All tags, with how many threads carry them."""
        counts = {tag: sum(t.tag == tag for t in self.stock.threads) for tag in sorted(self.hobby.tags)}
        return self.render("forum/tags.html", visit, counts=counts)

    @page("/~search")
    def search(self, visit: Visit) -> Response:
        """Threads and members that have all the words in their names."""
        asked = visit.query.get(self.paths["q"], "").strip()
        words = re.findall(r"\w+", asked.casefold())
        threads = self.stock.threads

        def has(text: str) -> bool:
            return bool(words) and all(word in text.casefold() for word in words)

        in_title = [thread for thread in threads if has(thread.title)]
        in_text = [t for t in threads if t not in in_title and has(f"{t.title} {t.author.name} {t.tag}")]
        members = [user for user in self.stock.users if has(user.name)]
        close: list[Thread] = []
        if not in_title and not in_text and not members:
            titles = {thread.title.casefold(): thread for thread in threads}
            near = difflib.get_close_matches(asked.casefold(), titles, n=3, cutoff=0.6)
            close = [titles[title] for title in near]
        return self._listing(visit, "Results", [*in_title, *in_text], close=close, members=members)

    # --- threads -----------------------------------------------------------------------------------------

    def _thread(self, name: str) -> Thread | None:
        number = name.split("-")[0]
        return self.stock.by_number.get(int(number)) if number.isdecimal() and len(number) < 8 else None

    @page("/~thread/{name}")
    def thread(self, visit: Visit, name: str) -> Response:
        """A thread."""
        thread = self._thread(name)
        if thread is None:
            return self._own_thread(visit, name)
        return self._show_thread(visit, thread)

    def _show_thread(
        self, visit: Visit, thread: Thread, errors: dict[str, str] | None = None, text: str = ""
    ) -> Response:
        order = visit.query.get("sort", "")
        replies = list(thread.replies)
        if order == "new":
            replies.reverse()
        elif order == "likes":
            replies.sort(key=lambda reply: reply.likes, reverse=True)
        number = str(thread.number)
        return self.render(
            "forum/thread.html",
            visit,
            status=422 if errors else 200,
            thread=thread,
            results=paged(replies, visit, self.per_page),
            mine=visit.state.get("replies", {}).get(number, []),
            liked=visit.state.get("likes", {}).get(number, []),
            follows=number in visit.state.get("follows", []),
            voted=visit.state.get("votes", {}).get(number),
            reasons=stock.REASONS,
            flash=visit.state.pop("flash", None),
            errors=errors or {},
            text=text,
        )

    def _own_thread(self, visit: Visit, name: str) -> Response:
        own = visit.state.get("threads", [])
        place = name.removeprefix("mine-")
        if not place.isdecimal() or not 0 < int(place) <= len(own):
            return self.missing(visit)
        return self.render("forum/own.html", visit, own=own[int(place) - 1])

    @page("/~thread/{name}", method="POST")
    def act(self, visit: Visit, name: str) -> Response:
        """Reply, like, follow or vote; for members only."""
        thread = self._thread(name)
        if thread is None:
            return self.missing(visit)
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        state, number = visit.state, str(thread.number)
        match visit.form.get("do"):
            case "like":
                till.like(state, thread, visit.form.get("who", ""))
                state["flash"] = f"You like what {visit.form.get('who', '')} wrote."
            case "follow":
                till.follow(state, thread)
                state["flash"] = f"From now on you follow “{thread.title}”."
            case "vote":
                option = visit.form.get("option", "")
                if thread.poll is None or option not in dict(thread.poll.options):
                    return self._show_thread(visit, thread, {"vote": "Please choose one."})
                state.setdefault("votes", {})[number] = option
                state["flash"] = f"You voted for “{option}”."
            case _:
                text, error = till.check_reply(visit.form)
                if error:
                    return self._show_thread(visit, thread, {"text": error}, text)
                state.setdefault("replies", {}).setdefault(number, []).append(text)
                state["flash"] = f"You wrote: “{text}”"
        return redirect(self.thread_path(thread))

    @page("/~thread/{name}/report")
    def report_form(self, visit: Visit, name: str) -> Response:
        """The form for a report."""
        return self._report(visit, name, {})

    def _report(self, visit: Visit, name: str, errors: dict[str, str]) -> Response:
        thread = self._thread(name)
        if thread is None:
            return self.missing(visit)
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        return self.render(
            "forum/report.html", visit, status=422 if errors else 200, thread=thread, errors=errors,
            reasons=stock.REASONS,
        )  # fmt: skip

    @page("/~thread/{name}/report", method="POST")
    def report_sent(self, visit: Visit, name: str) -> Response:
        """Take a report, or say what is wrong with it."""
        thread = self._thread(name)
        sent, errors = till.check_report(visit.form)
        if thread is None or "user" not in visit.state or errors:
            return self._report(visit, name, errors)
        visit.state.setdefault("reports", {})[str(thread.number)] = sent
        visit.state["flash"] = (
            f"Reported as {sent['reason']}: “{sent['text']}”. The moderators will look at it."
        )
        return redirect(self.thread_path(thread))

    @page("/~new")
    def new(self, visit: Visit) -> Response:
        """The form for a new thread."""
        return self._new(visit, {})

    def _new(self, visit: Visit, errors: dict[str, str]) -> Response:
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        return self.render("forum/new.html", visit, status=422 if errors else 200, errors=errors)

    @page("/~new", method="POST")
    def start_thread(self, visit: Visit) -> Response:
        """Start a thread, or say what is wrong."""
        sent, errors = till.check_thread(self, visit.form)
        if "user" not in visit.state or errors:
            return self._new(visit, errors)
        own: list[dict[str, str]] = visit.state.setdefault("threads", [])
        own.append(sent)
        return redirect(self.path("/~thread/{name}", name=f"mine-{len(own)}"))

    # --- members -----------------------------------------------------------------------------------------

    @page("/~members")
    def members(self, visit: Visit) -> Response:
        """All members."""
        order = visit.query.get("sort", "")
        users = list(self.stock.users)
        if order == "joined":
            users.sort(key=lambda user: user.joined)
        elif order in ("posts", "thanks"):
            users.sort(key=lambda user: user.posts if order == "posts" else user.thanks, reverse=True)
        return self.render("forum/members.html", visit, results=paged(users, visit, MEMBERS_PER_PAGE))

    @page("/~user/{name}")
    def user(self, visit: Visit, name: str) -> Response:
        """A member's profile."""
        return self._profile(visit, name, {})

    def _profile(self, visit: Visit, name: str, errors: dict[str, str]) -> Response:
        user = self.stock.user_by_slug.get(name)
        if user is None:
            return self.missing(visit)
        return self.render(
            "forum/user.html", visit, status=422 if errors else 200, user=user, errors=errors,
            flash=visit.state.pop("flash", None),
        )  # fmt: skip

    @page("/~user/{name}", method="POST")
    def write_to(self, visit: Visit, name: str) -> Response:
        """Send a private message."""
        user = self.stock.user_by_slug.get(name)
        if user is None:
            return self.missing(visit)
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        sent, errors = till.check_message(visit.form)
        if errors:
            return self._profile(visit, name, errors)
        visit.state.setdefault("messages", {})[user.name] = sent
        visit.state["flash"] = f"Sent to {user.name}: “{sent['subject']}”, “{sent['text']}”"
        return redirect(self.user_path(user))

    # --- the account -------------------------------------------------------------------------------------

    def _ask_to_sign_in(self, visit: Visit) -> Response:
        return redirect(self.path("/~enter") + f"?next={visit.path}")

    @page("/~enter")
    def enter(self, visit: Visit) -> Response:
        """The form to sign in."""
        return self.render("forum/enter.html", visit, error=None, name="")

    @page("/~enter", method="POST")
    def sign_in(self, visit: Visit) -> Response:
        """Sign in, or say that it did not work."""
        error = till.sign_in(self, visit.state, visit.form)
        if error:
            name = visit.form.get("name", "")
            return self.render("forum/enter.html", visit, status=422, error=error, name=name)
        goal = visit.form.get("next", "")
        return redirect(goal if re.match(r"/(?!/)", goal) else self.path("/~me"))

    @page("/~me")
    def me(self, visit: Visit) -> Response:
        """The account."""
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        followed = [self.stock.by_number[int(number)] for number in visit.state.get("follows", [])]
        flash = visit.state.pop("flash", None)
        return self.render("forum/me.html", visit, followed=followed, digests=stock.DIGESTS, flash=flash)

    @page("/~me", method="POST")
    def change_me(self, visit: Visit) -> Response:
        """Change the settings, or sign out."""
        if visit.form.get("do") == "leave":
            visit.state.pop("user", None)
            return redirect("/")
        if "user" in visit.state and visit.form.get("digest") in stock.DIGESTS:
            visit.state["digest"] = visit.form["digest"]
            visit.state["flash"] = f"Your choice was saved: {visit.form['digest']}."
        return redirect(self.path("/~me"))

    @page("/~inbox")
    def inbox(self, visit: Visit) -> Response:
        """Private messages."""
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        return self.render("forum/inbox.html", visit)

    @page("/~inbox/{number}")
    def message(self, visit: Visit, number: str) -> Response:
        """One private message."""
        if "user" not in visit.state:
            return self._ask_to_sign_in(visit)
        messages = self.stock.messages
        if not number.isdecimal() or not 0 < int(number) <= len(messages):
            return self.missing(visit)
        return self.render("forum/message.html", visit, message=messages[int(number) - 1])

    @page("/~join")
    def join(self, visit: Visit) -> Response:
        """The form to register."""
        return self.render("forum/join.html", visit, errors={})

    @page("/~join", method="POST")
    def joined(self, visit: Visit) -> Response:
        """Register, or say what is wrong."""
        sent, errors = till.check_join(self, visit.form)
        if errors:
            return self.render("forum/join.html", visit, status=422, errors=errors)
        visit.state["joined"] = sent
        return redirect(self.path("/~join/done"))

    @page("/~join/done")
    def join_done(self, visit: Visit) -> Response:
        """What was registered."""
        if "joined" not in visit.state:
            return self.missing(visit)
        return self.render("forum/joined.html", visit, sent=visit.state["joined"])

    @page("/~help")
    def help(self, visit: Visit) -> Response:
        """Questions and answers."""
        return self.render("forum/help.html", visit)
