"""What all parts of a forum's tasks are written with: proofs, moves and words."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline.families.forum.schema import Post, Thread, User
from webgym.offline.parts import Fact
from webgym.offline.seeds import stream
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.forum import Forum


class Desk:
    """Shared by the modules that write parts.

    Attributes:
        site: the forum.
        rng: of the assignment that is being written.
        taken: titles and members that it speaks of already.
    """

    def __init__(self, site: Forum) -> None:
        self.site = site
        self.stock = site.stock
        self.thread_word = site.word("thread")
        self.begin("")

    def begin(self, name: str) -> None:
        """Begin an assignment."""
        self.rng = stream(self.site.seed, "task", name)
        self.taken: set[str] = set()

    # --- choosing ---------------------------------------------------------------------------------------

    def take(self, *threads: Thread) -> bool:
        """Reserve threads, if none of them is taken."""
        titles = {thread.title for thread in threads}
        if titles & self.taken:
            return False
        self.taken |= titles
        return True

    def fresh(self, threads: list[Thread]) -> Thread | None:
        """One of these threads that is not spoken of yet."""
        free = [thread for thread in threads if thread.title not in self.taken]
        if not free:
            return None
        chosen = self.rng.choice(free)
        self.taken.add(chosen.title)
        return chosen

    def fresh_user(self) -> User | None:
        """A member that is not spoken of yet."""
        free = [user for user in self.stock.users if user.name not in self.taken]
        if not free:
            return None
        chosen = self.rng.choice(free)
        self.taken.add(chosen.name)
        return chosen

    def shuffled_boards(self) -> list[str]:
        """All boards in random order."""
        boards = [name for name, _ in self.stock.boards]
        return self.rng.sample(boards, len(boards))

    def others(self, threads: list[Thread]) -> tuple[str, ...]:
        """Titles of up to three threads, as wrong answers; they are taken."""
        free = [thread.title for thread in threads if thread.title not in self.taken]
        wrong = self.rng.sample(free, min(3, len(free)))
        self.taken |= set(wrong)
        return tuple(wrong)

    # --- moves ------------------------------------------------------------------------------------------

    def go(self, name: str) -> Click:
        """Click a menu entry."""
        return Click(path=self.site.path(f"/~{name}"))

    def open(self, thread: Thread) -> list[Move]:
        """Get to a thread, by its board where it stands on its first page, else by searching."""
        if thread in self.stock.on_board(thread.board)[:6] and self.rng.random() < 0.5:
            there = Click(path=self.site.thread_path(thread))
            return [Click(path=self.site.board_path(thread.board)), there]
        return self.find(thread)

    def find(self, thread: Thread) -> list[Move]:
        """Get to a thread, from any page, by searching."""
        return [
            Fill(self.site.word("search"), thread.title),
            Click(path=self.site.thread_path(thread)),
        ]

    def open_user(self, user: User) -> list[Move]:
        """Get to a member's profile, by the first page of the list of members or by searching."""
        there = Click(path=self.site.user_path(user))
        if user in self.stock.users[:12] and self.rng.random() < 0.5:
            return [self.go("members"), there]
        return [Fill(self.site.word("search"), user.name), there]

    def turn(self, path: str, number: int) -> list[Move]:
        """From the first page of a list to another."""
        if self.site.look.pager == "numbers":
            return [Click(path=f"{path}?page={number}")] if number > 1 else []
        name = "Next" if self.site.look.pager == "steps" else "Load more"
        return [Click(name=name)] * (number - 1)

    def turn_to(self, thread: Thread, reply: Post) -> list[Move]:
        """From a thread's first page to the one with a reply."""
        return self.turn(self.site.thread_path(thread), self.site.page_of(thread, reply))

    def ranked(self, board: str, key: str) -> list[Move]:
        """From the front page to a board's threads, sorted."""
        path = self.site.board_path(board)
        if self.site.links:
            return [Click(path=path), Click(path=f"{path}?sort={key}")]
        text = dict(self.site.orders())[key]
        moves: list[Move] = [Click(path=path), Choose(self.site.word("sort"), text)]
        return moves if self.site.submits else [*moves, self.apply()]

    def apply(self) -> Click:
        """The button of the filters."""
        return Click(name=self.site.word("apply"), role="button")

    def sign_in(self) -> list[Move]:
        """Sign in with the account that the task gives."""
        account, site = self.stock.account, self.site
        return [
            self.go("enter"),
            Fill(site.word("name"), account.name),
            Fill(site.word("password"), account.password),
            See((f"Signed in as {account.name}",)),
        ]

    # --- words and facts --------------------------------------------------------------------------------

    def signing_in(self) -> str:
        """The words of a task that gives the account."""
        account = self.stock.account
        return f"{self.site.word('enter').lower()} as {account.name} with the password “{account.password}”"

    def signed_in(self) -> Fact:
        """The fact that the account is signed in."""
        name = self.stock.account.name
        return Fact(
            f"{name} is signed in",
            (
                Evidence((f"Signed in as {name}",), self.on(self.site.path("/~me"))),
                Evidence((name, self.site.word("inbox")), r"/(?=.)"),
            ),
            (StateCheck(("user",), name),),
        )

    def quoted(self, thread: Thread) -> str:
        """``the thread “…”``."""
        return f"the {self.thread_word} “{thread.title}”"

    # --- proofs -----------------------------------------------------------------------------------------

    def on(self, path: str, **query: str) -> str:
        """A pattern for a page with at least these query parameters."""
        wanted = "".join(rf"(?=.*[?&]{key}={value}(?:&|$))" for key, value in query.items())
        return re.escape(path) + r"(?=\?|$)" + wanted

    def on_thread(self, thread: Thread) -> str:
        """A pattern for the pages of a thread."""
        return self.on(self.site.thread_path(thread))

    def on_user(self, user: User) -> str:
        """A pattern for a member's profile."""
        return self.on(self.site.user_path(user))

    def on_board(self, board: str, key: str = "") -> str:
        """A pattern for lists that are narrowed to a board, or sorted by a key."""
        everything = self.site.path("/~all")
        found = f"{self.on(self.site.board_path(board))}|{self.on(everything, board=slug(board))}"
        return f"{found}|{self.on(everything, sort=key)}" if key else found

    def on_lists(self) -> str:
        """A pattern for every list of threads."""
        paths = [self.on(self.site.path(f"/~{name}")) for name in ("all", "search")]
        paths += [re.escape(self.site.path(f"/~{name}/")) for name in ("board", "tag")]
        return "|".join(paths)
