"""Solvers of tasks with text fields, including dates and times."""

from __future__ import annotations

import re

from benchmarks.miniwob.episode import At, Episode
from benchmarks.miniwob.registry import solves


async def _fill(episode: Episode, *texts: str) -> None:
    """Fill in the fields in order, and submit."""
    for index, text in enumerate(texts):
        await episode.type(At("#area input", index=index), text)
    await episode.click("#area button")


@solves("enter-text", "enter-text-dynamic")
async def enter_text(episode: Episode) -> None:
    await _fill(episode, episode.quoted()[0])


@solves("enter-text-2")
async def enter_text_2(episode: Episode) -> None:
    text = episode.quoted()[0]
    await _fill(episode, text.upper() if "upper case" in episode.query else text.lower())


@solves("text-transform")
async def text_transform(episode: Episode) -> None:
    await _fill(episode, (await episode.texts("#captcha"))[0])


@solves("enter-password")
async def enter_password(episode: Episode) -> None:
    await _fill(episode, *episode.quoted() * 2)


@solves("login-user")
async def login_user(episode: Episode) -> None:
    await _fill(episode, *episode.quoted())


@solves("login-user-popup")
async def login_user_popup(episode: Episode) -> None:
    user, password = episode.quoted()
    while (await episode.js("[username.value, password.value]")) != [user, password]:
        for css, text in (("#username", user), ("#password", password)):
            if not await episode.shows("#popup"):
                await episode.type(css, text)
            if await episode.shows("#popup-cancel"):
                await episode.click("#popup-cancel")
    await episode.click("#subbtn")


@solves("enter-date")
async def enter_date(episode: Episode) -> None:
    month, day, year = episode.asked(r"(\d+)/(\d+)/(\d+)")
    await _fill(episode, f"{year}-{month:0>2}-{day:0>2}")


@solves("enter-time")
async def enter_time(episode: Episode) -> None:
    hour, minute, half = episode.asked(r"(\d+):(\d+)\s*(\w+)")
    await _fill(episode, f"{int(hour) % 12 + 12 * (half.upper() == 'PM'):02}:{minute}")


@solves("read-table")
async def read_table(episode: Episode) -> None:
    cells = await episode.texts("#tab td")
    (key,) = episode.asked(r"value of (.*) into")
    await _fill(episode, cells[cells.index(key) + 1])


@solves("read-table-2")
async def read_table_2(episode: Episode) -> None:
    cells = await episode.texts("#tab td")
    keys = [label.rstrip(":") for label in await episode.texts("#form label")]
    await _fill(episode, *(cells[cells.index(key) + 1] for key in keys))


@solves("find-word")
async def find_word(episode: Episode) -> None:
    words = (await episode.texts("#area p"))[0].split()
    await _fill(episode, words[int(episode.asked(r"(\d+)\w\w word")[0]) - 1].strip(".,"))


@solves("scroll-text")
async def scroll_text(episode: Episode) -> None:
    text = await episode.js("document.querySelector('#text-area').value")
    await _fill(episode, re.sub(r"\W", "", text.split()[-1]))


@solves("guess-number")
async def guess_number(episode: Episode) -> None:
    low, high = 0, 9
    while True:
        guess = (low + high) // 2
        await _fill(episode, str(guess))
        low, high = (guess + 1, high) if await episode.shows("#higher") else (low, guess - 1)


@solves("copy-paste", "copy-paste-2")
async def copy_paste(episode: Episode) -> None:
    order = re.search(r"(\d)\w\w text area", episode.query)
    index = int(order[1]) - 1 if order else 0
    if episode.space == "paper":
        await episode.type(
            "#answer-input", await episode.js(f"document.querySelectorAll('#area textarea')[{index}].value")
        )
        await episode.submit()
    await episode.click(At("#area textarea", index=index))
    await episode.press("Control", "a")
    await episode.press("Control", "c")
    await episode.click("#answer-input")
    await episode.press("Control", "v")
    await episode.submit()


@solves("multi-layouts", "multi-orderings")
async def multi_layouts(episode: Episode) -> None:
    genre, name, year = episode.asked(r"Search for (.*) movies directed by (.*) from year (\d+)")
    names = await episode.js(
        """[...document.querySelectorAll('#area input')].map(one => {
            let around = one;
            while (!around.textContent.trim() && !around.placeholder) around = around.parentElement;
            return around.placeholder || around.textContent;
        })"""
    )
    for index, label in enumerate(names):
        is_year = "year" in label.lower() or "released" in label.lower()
        text = genre if "genre" in label.lower() else year if is_year else name
        await episode.type(At("#area input", index=index), text)
    end = "#area button, #area .ui-submit, #area .final, #area input[type=submit]"
    await episode.click(end)


@solves("simple-arithmetic", "simple-algebra", "visual-addition")
async def arithmetic(episode: Episode) -> None:
    answer = {"simple-arithmetic": _sum, "simple-algebra": _unknown, "visual-addition": _blocks}
    task = (await episode.js("location.pathname")).rsplit("/", 1)[-1].removesuffix(".html")
    await _fill(episode, str(await answer[task](episode)))


async def _sum(episode: Episode) -> int:
    first, sign, second = (await episode.texts("#math-problem"))[0].rstrip(" =").split()
    return _result(int(first), sign, int(second))


async def _unknown(episode: Episode) -> int:
    first, sign, second, _, result = (await episode.texts("#math-problem"))[0].split()
    return next(
        x
        for x in range(-200, 200)
        if _result(*((x, sign, int(second)) if first == "x" else (int(first), sign, x))) == int(result)
    )


def _result(one: int, sign: str, other: int) -> int:
    return {"+": one + other, "-": one - other, "x": one * other}[sign]


async def _blocks(episode: Episode) -> int:
    return len(await episode.boxes(".addition-block"))


@solves("form-sequence-2")
async def form_sequence_2(episode: Episode) -> None:
    radio, number, field = episode.asked(
        r'the (\d)\w\w radio button and enter the number "(-?\d+)" into the (\d)'
    )
    await episode.click(At("#area input[type=radio]", index=int(radio) - 1))
    await episode.type(f"#input-{field}", number)
    await episode.submit()
