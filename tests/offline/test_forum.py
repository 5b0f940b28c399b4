"""Forums: contents without ties, lists that filter and sort, an account without which nobody can write."""

from __future__ import annotations

import re
from functools import lru_cache
from html import unescape
from urllib.parse import parse_qsl, quote_plus, unquote, urlsplit

import pytest

from webgym.core.text import fold, says
from webgym.offline.families.forum import Forum, stock
from webgym.offline.families.forum.schema import KINDS, STOCK
from webgym.offline.look import look
from webgym.offline.website import Response, State, Visit, slug

SEEDS = range(300, 340)
FEW = range(300, 306)


@lru_cache
def made(seed: int) -> Forum:
    brand, label = Forum.christen("Fernhill", seed)
    return Forum(seed=seed, brand=brand, label=label, look=look(seed))


def ask(site: Forum, url: str, state: State | None = None, form: dict[str, str] | None = None) -> Response:
    parts = urlsplit(url)
    query = dict(parse_qsl(parts.query))
    method = "GET" if form is None else "POST"
    held: State = {} if state is None else state
    return site.handle(Visit(method, unquote(parts.path), query, {}, form or {}, held))


def text_of(answer: Response) -> str:
    body = re.sub(r"(?s)<(script|style|select)\b.*?</\1>", " ", answer.body.decode())
    return fold(unescape(re.sub(r"<[^>]+>", " ", body)))


def signed_in(site: Forum) -> State:
    state: State = {}
    account = site.stock.account
    form = {"name": account.name, "password": account.password}
    answer = ask(site, site.path("/~enter"), state, form)
    assert answer.location == site.path("/~me")
    return state


@pytest.mark.parametrize("seed", SEEDS)
def test_contents_have_no_ties_where_tasks_rank(seed: int) -> None:
    site = made(seed)
    threads, users = site.stock.threads, site.stock.users
    assert len({thread.title for thread in threads}) == len(threads) >= 40
    assert len({thread.views for thread in threads}) == len(threads)
    assert len({thread.likes for thread in threads}) == len(threads)
    for value in ("joined", "posts", "thanks", "town"):
        assert len({getattr(user, value) for user in users}) == len(users)
    assert site.stock.account.name not in {user.name for user in users}
    for board, _ in site.stock.boards:
        assert [len(thread.replies) for thread in site.stock.on_board(board)].count(0) == 1
    for thread in threads:
        posts = [thread.opening, *thread.replies]
        assert len({post.author.name for post in posts}) == len(posts)
        assert len({reply.likes for reply in thread.replies}) == len(thread.replies)
        assert [post.when for post in posts] == sorted(post.when for post in posts)
        assert posts[-1].when < stock.NOW
        marks = [reply.mark for reply in thread.replies if reply.mark]
        assert len(set(marks)) == len(marks)
        assert thread.solution is None or thread.solution.mark


def test_websites_differ() -> None:
    sites = [made(seed) for seed in SEEDS]
    assert len({site.hobby.name for site in sites}) >= 15
    assert len({site.subdomain for site in sites}) >= 8
    assert len({ask(site, "/").body for site in sites}) == len(sites)
    assert {site.modal for site in sites} == {site.links for site in sites} == {True, False}


def test_every_hobby_can_be_built() -> None:
    for hobby in STOCK.hobbies:
        assert len(hobby.boards) == len(KINDS)
        assert len(stock.make(5, hobby).threads) >= 40, hobby.name


@pytest.mark.parametrize("seed", FEW)
def test_same_seed_same_bytes(seed: int) -> None:
    one, two = made(seed), made.__wrapped__(seed)
    for path in ("/", one.path("/~all"), one.thread_path(one.stock.threads[3])):
        assert ask(one, path).body == ask(two, path).body


@pytest.mark.parametrize("seed", FEW)
@pytest.mark.parametrize("key", ["likes", "views", "replies", "new"])
def test_boards_sort(seed: int, key: str) -> None:
    site = made(seed)
    board = site.stock.boards[1][0]
    threads = site.arranged(site.stock.on_board(board), key)[:8]
    values = {
        "likes": [thread.likes for thread in threads],
        "views": [thread.views for thread in threads],
        "replies": [len(thread.replies) for thread in threads],
        "new": [thread.opening.when.toordinal() for thread in threads],
    }[key]
    assert values == sorted(values, reverse=True)
    page = ask(site, f"{site.board_path(board)}?sort={key}").body.decode()
    places = [page.index(f'"{site.thread_path(thread)}"') for thread in threads]
    assert places == sorted(places)


@pytest.mark.parametrize("seed", FEW)
def test_filters_count(seed: int) -> None:
    site = made(seed)
    board = site.stock.boards[0][0]
    solved = [t for t in site.stock.on_board(board) if t.solution]
    said = f"{len(solved)} {site.word('thread')}{'' if len(solved) == 1 else 's'}"
    for url in (
        f"{site.board_path(board)}?state=solved",
        f"{site.path('/~all')}?state=solved&board={slug(board)}",
    ):
        assert says(text_of(ask(site, url)), said)
    assert ask(site, f"{site.path('/~all')}?state=x&tag=y&sort=z&page=-1").status == 200


@pytest.mark.parametrize("seed", FEW)
def test_search_finds_titles_and_forgives_a_slip(seed: int) -> None:
    site = made(seed)
    path, key = site.path("/~search"), site.paths["q"]
    for thread in site.stock.threads[:12]:
        page = ask(site, f"{path}?{key}={quote_plus(thread.title)}").body.decode()
        assert f'"{site.thread_path(thread)}"' in page
    thread = site.stock.threads[0]
    slip = quote_plus(f"{thread.title[:5]}x{thread.title[5:]}")
    assert "did you mean" in text_of(ask(site, f"{path}?{key}={slip}"))


@pytest.mark.parametrize("seed", FEW)
def test_nobody_writes_without_the_account(seed: int) -> None:
    site = made(seed)
    state: State = {}
    thread = site.stock.threads[0]
    path, enter = site.thread_path(thread), site.path("/~enter")
    for form in ({"text": "This is long enough"}, {"do": "follow"}, {"do": "like", "who": "X"}):
        assert (ask(site, path, state, form).location or "").startswith(enter)
    for page in ("/~me", "/~inbox", "/~inbox/1", "/~new"):
        assert (ask(site, site.path(page), state).location or "").startswith(enter)
    assert site.stock.messages[0].mark not in text_of(ask(site, "/", state))
    wrong = ask(site, enter, state, {"name": site.stock.account.name, "password": "guess"})
    assert wrong.status == 422
    assert f'value="{site.stock.account.name}"' in wrong.body.decode()
    assert site.report(state)["user"] is None


def test_signing_in_goes_on_where_it_was_asked_for_but_nowhere_else() -> None:
    site = made(300)
    account = site.stock.account
    form = {"name": account.name.lower(), "password": account.password}
    thread = site.thread_path(site.stock.threads[0])
    assert ask(site, site.path("/~enter"), {}, {**form, "next": thread}).location == thread
    for evil in ("//evil.example/", "http://evil.example/", "javascript:x"):
        assert ask(site, site.path("/~enter"), {}, {**form, "next": evil}).location == site.path("/~me")


@pytest.mark.parametrize("seed", FEW)
def test_what_a_member_does_is_shown_and_reported(seed: int) -> None:
    site = made(seed)
    state = signed_in(site)
    thread = next(thread for thread in site.stock.threads if thread.poll)
    path, title = site.thread_path(thread), thread.title
    assert thread.poll is not None
    option, author = thread.poll.options[2][0], thread.opening.author.name
    for form, said in (
        ({"do": "follow"}, f"you follow “{title}”"),
        ({"do": "like", "who": author}, f"You like what {author} wrote"),
        ({"do": "vote", "option": option}, f"You voted for “{option}”"),
        ({"text": "A reply that is long enough"}, "A reply that is long enough"),
    ):
        assert ask(site, path, state, form).location == path
        assert says(text_of(ask(site, path, state)), said)
    held = site.report(state)
    assert held["follows"] == {title: True}
    assert held["likes"] == {title: {author: True}}
    assert held["votes"] == {title: option}
    assert held["replies"] == {title: "A reply that is long enough"}
    board = text_of(ask(site, f"{site.board_path(thread.board)}?sort=replies", state))
    assert board == text_of(ask(site, f"{site.board_path(thread.board)}?sort=replies", signed_in(site)))


@pytest.mark.parametrize("seed", FEW)
def test_forms_are_checked_and_keep_what_was_typed(seed: int) -> None:
    site = made(seed)
    state = signed_in(site)
    thread = site.stock.threads[0]
    answer = ask(site, site.thread_path(thread), state, {"text": "short"})
    assert answer.status == 422
    assert 'value="short"' in answer.body.decode()
    board = site.stock.boards[2][0]
    bad = {"board": board, "tag": "", "title": "Tiny", "text": "Long enough to be taken"}
    answer = ask(site, site.path("/~new"), state, bad)
    page = answer.body.decode()
    assert answer.status == 422
    assert 'value="Tiny"' in page
    assert f'value="{board}" selected' in page.replace("&#39;", "'").replace("&amp;", "&")
    answer = ask(site, f"{site.thread_path(thread)}/report", state, {"reason": "", "text": "Spam all over"})
    assert answer.status == 422
    assert 'value="Spam all over"' in answer.body.decode()
    bad = {"home": board, "name": site.stock.users[0].name, "mail": "nobody"}
    answer = ask(site, site.path("/~join"), state, bad)
    assert answer.status == 422
    assert answer.body.decode().count('class="error"') == 2
    good = {**bad, "name": "Brisknew", "mail": "a@b.example"}
    assert ask(site, site.path("/~join"), state, good).status == 303
    held = site.report(state)
    assert held["joined"] == good
    assert held["threads"] == held["replies"] == held["reports"] == {}


def test_a_new_thread_has_a_page_and_stands_on_its_board() -> None:
    site = made(301)
    state = signed_in(site)
    board = site.stock.boards[4][0]
    sent = {
        "board": board,
        "tag": site.hobby.tags[0],
        "title": "A title that is new",
        "text": "Words and words",
    }
    answer = ask(site, site.path("/~new"), state, sent)
    assert says(text_of(ask(site, answer.location or "", state)), sent["text"])
    assert says(text_of(ask(site, site.board_path(board), state)), sent["title"])
    assert ask(site, answer.location or "", {}).status == 404
    assert site.report(state)["threads"] == {sent["title"]: sent}


def test_exactly_one_fulfils_an_either_or() -> None:
    """The clause is read back and applied to the whole board."""
    found = 0
    for seed in SEEDS:
        site = made(seed)
        for assignment in site.assignments():
            for part in assignment.parts:
                match = re.search(r"more than ([\d,]+) views OR more than (\d+) ", part.ask)
                if match is None:
                    continue
                found += 1
                views, likes = (int(text.replace(",", "")) for text in match.groups())
                board = next(name for name, _ in site.stock.boards if f"“{name}”" in part.ask)
                right = [t for t in site.stock.on_board(board) if t.views > views or t.likes > likes]
                assert [thread.title for thread in right] == [part.facts[0].answer[0]]
    assert found > 10


def test_unknown_pages_are_missing() -> None:
    site = made(302)
    for pattern in ("/~thread/1", "/~thread/x", "/~thread/mine-1", "/~user/nobody", "/~board/x", "/~tag/x"):
        assert ask(site, site.path(pattern)).status == 404
    assert ask(site, site.path("/~inbox/99"), signed_in(site)).status == 404
