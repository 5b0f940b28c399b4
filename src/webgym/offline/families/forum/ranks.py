"""Parts that are solved with lists: sorted, filtered, counted."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Move, See
from webgym.offline.families._phrases import day_texts, figure, nice_between
from webgym.offline.families.forum.desk import Desk
from webgym.offline.families.forum.schema import Thread
from webgym.offline.parts import Fact, Part
from webgym.offline.website import slug


class Ranks(Desk):
    """Writes parts that look for threads and members, or count them."""

    def _values(self, thread: Thread) -> dict[str, int]:
        return {"replies": len(thread.replies), "likes": thread.likes, "views": thread.views}

    def _word(self, key: str) -> str:
        return {"replies": self.site.replies, "likes": self.site.word("likes"), "views": "views"}[key]

    def _ranking(self, board: str, key: str) -> list[Thread]:
        return sorted(self.stock.on_board(board), key=lambda t: self._values(t)[key], reverse=True)

    def _row(self, thread: Thread, key: str) -> tuple[str, str]:
        return thread.title, f"{self._values(thread)[key]:,}"

    def extreme(self) -> Part | None:
        """The first thread of a board."""
        key = self.rng.choice(("replies", "likes", "views"))
        for board in self.shuffled_boards():
            first, second, *rest = self._ranking(board, key)
            if self._values(first)[key] == self._values(second)[key] or not self.take(first):
                continue
            word, row = self._word(key), self._row(first, key)
            proof = (Evidence(row, self.on_board(board, key)),)
            return Part(
                ask=f"find out which {self.thread_word} on the board “{board}” has the most {word}, and how "
                "many",
                description=f"Most {word} on {board}",
                facts=(
                    Fact(
                        f"the {self.thread_word} with the most {word} on {board} is found",
                        proof,
                        answer=(first.title,),
                        wrong=self.others([second, *rest]),
                    ),
                    Fact(
                        f"its number of {word} is found",
                        (*proof, Evidence((f"{row[1]} {word}",), self.on_thread(first))),
                        answer=figure(self._values(first)[key]),
                    ),
                ),
                moves=(*self.ranked(board, key), See(row)),
                says=f"“{first.title}” with {row[1]}.",
            )
        return None

    def top_three(self) -> Part | None:
        """The first three threads of a board, in order."""
        key = self.rng.choice(("likes", "views"))
        word = self._word(key)
        for board in self.shuffled_boards():
            ranked = self._ranking(board, key)
            top = ranked[:3]
            if len(ranked) < 4 or not self.take(*top):
                continue
            wrong = self.others(ranked[3:])
            ranks = ("the most", "the second most", "the third most")
            rows = [self._row(thread, key) for thread in top]
            return Part(
                ask=f"name the three {self.thread_word}s with the most {word} on the board “{board}”, "
                "in order",
                description=f"Three {self.thread_word}s with the most {word} on {board}",
                facts=tuple(
                    Fact(
                        f"the {self.thread_word} with {rank} {word} on {board} is found",
                        (Evidence(row, self.on_board(board, key)),),
                        answer=(thread.title,),
                        wrong=wrong,
                    )
                    for rank, thread, row in zip(ranks, top, rows, strict=True)
                ),
                moves=(*self.ranked(board, key), *(See(row) for row in rows)),
                says=f"1. {top[0].title} 2. {top[1].title} 3. {top[2].title}",
            )
        return None

    def count(self) -> Part | None:
        """How many threads of a board are solved or not."""
        board = self.rng.choice(self.shuffled_boards()[:3])
        threads = self.stock.on_board(board)
        tag = self.rng.choice(sorted({thread.tag for thread in threads}))
        solved = sum(thread.accepted is not None for thread in threads)
        counted = sum(thread.tag == tag for thread in threads)
        site = self.site
        if solved > 1:
            label, option, number = site.word("state"), site.word("solved"), solved
            pattern = self.on(site.board_path(board), state="solved") + "|"
            pattern += self.on(site.path("/~all"), state="solved", board=slug(board))
        else:
            label, option, number = site.word("tag"), tag, counted
            pattern = f"{self.on(site.board_path(board), tag=slug(tag))}|"
            pattern += f"{self.on(site.path('/~all'), tag=slug(tag), board=slug(board))}|"
            pattern += self.on(site.tag_path(tag), board=slug(board))
        said = f"{number} {self.thread_word}{'' if number == 1 else 's'}"
        moves: list[Move] = [Click(path=site.board_path(board)), Choose(label, option)]
        if not site.submits:
            moves.append(self.apply())
        return Part(
            ask=f"find out how many {self.thread_word}s on the board “{board}” are listed with “{option}” "
            f"under “{label}”",
            description=f"{board}: {option}",
            facts=(
                Fact(
                    f"the number of {self.thread_word}s with “{option}” on {board} is found",
                    (Evidence((said,), pattern),),
                    answer=figure(number),
                ),
            ),
            moves=(*moves, See((said,))),
            says=f"There are {said}." if number != 1 else f"There is {said}.",
        )

    def silent(self) -> Part | None:
        """The one thread of a board to which nobody replied."""
        for board in self.shuffled_boards():
            threads = self.stock.on_board(board)
            quiet = [thread for thread in threads if not thread.replies]
            if len(quiet) != 1 or not self.take(quiet[0]):
                continue
            thread = quiet[0]
            proof = (
                Evidence((thread.title, "0"), self.on_board(board, "replies")),
                Evidence(("Nobody has written yet",), self.on_thread(thread)),
            )
            return Part(
                ask=f"find out which {self.thread_word} on the board “{board}” has no {self.site.replies} "
                "yet, and who started it",
                description=f"No {self.site.replies} on {board}",
                facts=(
                    Fact(
                        f"the {self.thread_word} without {self.site.replies} on {board} is found",
                        proof,
                        answer=(thread.title,),
                        wrong=self.others(threads),
                    ),
                    Fact(
                        "the member who started it is found",
                        (
                            Evidence((thread.title, f"by {thread.author.name}"), self.on_lists()),
                            Evidence((f"Started by {thread.author.name}",), self.on_thread(thread)),
                        ),
                        answer=(thread.author.name,),
                    ),
                ),
                moves=(
                    Click(path=self.site.board_path(board)),
                    *self._onward(board, thread),
                    See((thread.title, "0", f"by {thread.author.name}")),
                ),
                says=f"“{thread.title}”, started by {thread.author.name}.",
            )
        return None

    def _onward(self, board: str, thread: Thread) -> list[Move]:
        from webgym.offline.families.forum import PAGE_SIZES

        place = self.stock.on_board(board).index(thread)
        return self.turn(self.site.board_path(board), place // PAGE_SIZES[self.site.look.listing] + 1)

    def either(self) -> Part | None:
        """The one thread of a board of which one thing or another is true."""
        likes = self._word("likes")
        for board in self.shuffled_boards():
            first, second, *rest = self._ranking(board, "views")
            over = nice_between(second.views, first.views)
            above = max(thread.likes for thread in (second, *rest))
            above = -(-above // 10) * 10
            if not self.take(first):
                continue
            row = self._row(first, "views")
            terms = f"more than {over:,} views OR more than {above} {likes}"
            return Part(
                ask=f"find the one {self.thread_word} on the board “{board}” that has {terms}",
                description=f"{board}: either of two conditions",
                facts=(
                    Fact(
                        f"the {self.thread_word} on {board} that has {terms} is found",
                        (Evidence(row, self.on_board(board, "(?:views|likes)")),),
                        answer=(first.title,),
                        wrong=self.others([second, *rest]),
                    ),
                ),
                moves=(*self.ranked(board, "views"), See(row)),
                says=f"It is “{first.title}”.",
            )
        return None

    def newest(self) -> Part | None:
        """The thread of a board that was started last."""
        for board in self.shuffled_boards():
            threads = sorted(self.stock.on_board(board), key=lambda t: t.opening.when, reverse=True)
            first, second, *rest = threads
            day = day_texts(first.opening.when.date())
            if second.opening.when.date() == first.opening.when.date() or not self.take(first):
                continue
            proof = (Evidence((first.title, day[0]), self.on_board(board, "new")),)
            return Part(
                ask=f"find out which {self.thread_word} on the board “{board}” was started last, and on "
                "which day",
                description=f"Newest on {board}",
                facts=(
                    Fact(
                        f"the {self.thread_word} that was started last on {board} is found",
                        proof,
                        answer=(first.title,),
                        wrong=self.others([second, *rest]),
                    ),
                    Fact(
                        "the day on which it was started is found",
                        (*proof, Evidence((f"on {day[0]}",), self.on_thread(first))),
                        answer=day,
                    ),
                ),
                moves=(*self.ranked(board, "new"), See((first.title, day[0]))),
                says=f"“{first.title}”, on {day[0]}.",
            )
        return None

    def member(self) -> Part | None:
        """The first member by posts, likes or time."""
        likes = self.site.word("likes")
        key = self.rng.choice(("joined", "posts", "thanks"))
        users = sorted(self.stock.users, key=lambda u: u.joined if key == "joined" else -getattr(u, key))
        first = users[0]
        if first.name in self.taken:
            return None
        day = day_texts(first.joined)
        who, what, option, answer = {
            "joined": ("has been here longest", "the day of joining", "Longest here", day),
            "posts": ("has written the most posts", "the number of posts", "Most posts", figure(first.posts)),
            "thanks": (
                f"has the most {likes}",
                f"the number of {likes}",
                f"Most {likes}",
                figure(first.thanks),
            ),
        }[key]
        self.taken |= {user.name for user in users[:4]}
        path = self.site.path("/~members")
        proof = (Evidence((first.name, answer[0]), self.on(path)),)
        return Part(
            ask=f"find out which member {who}, and give {what} too",
            description=f"Member who {who}",
            facts=(
                Fact(
                    f"the member who {who} is found",
                    proof,
                    answer=(first.name,),
                    wrong=tuple(user.name for user in users[1:4]),
                ),
                Fact(
                    f"{what} of that member is found",
                    (*proof, Evidence((answer[0],), self.on_user(first))),
                    answer=answer,
                ),
            ),
            moves=(Click(path=path), Choose(self.site.word("sort"), option), See((first.name, answer[0]))),
            says=f"{first.name}, {answer[0]}.",
        )

    def tag_count(self) -> Part | None:
        """How many threads carry a tag."""
        tag = self.rng.choice(self.site.hobby.tags)
        number = sum(thread.tag == tag for thread in self.stock.threads)
        if not number:
            return None
        said = f"{number} {self.thread_word}{'' if number == 1 else 's'}"
        word, path = self.site.word("tag").lower(), self.site.path("/~tags")
        return Part(
            ask=f"find out how many {self.thread_word}s of the whole forum carry the {word} “{tag}”",
            description=f"{self.thread_word.capitalize()}s with “{tag}”",
            facts=(
                Fact(
                    f"the number of {self.thread_word}s with the {word} “{tag}” is found",
                    (
                        Evidence((tag, said), self.on(path)),
                        Evidence((said,), self.on(self.site.tag_path(tag))),
                        Evidence((said,), self.on(self.site.path("/~all"), tag=slug(tag))),
                    ),
                    answer=figure(number),
                ),
            ),
            moves=(Click(path=path), See((tag, said))),
            says=f"There are {said}." if number != 1 else f"There is {said}.",
        )
