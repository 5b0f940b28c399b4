"""Tasks that ask for text in fields, dates and times included."""

from __future__ import annotations

import re

from benchmarks.miniwob.hand import At, Hand
from benchmarks.miniwob.registry import solves


async def _fill(hand: Hand, *texts: str) -> None:
    """Write into the fields in their order and submit."""
    for index, text in enumerate(texts):
        await hand.type(At("#area input", index=index), text)
    await hand.click("#area button")


@solves("enter-text", "enter-text-dynamic")
async def enter_text(hand: Hand) -> None:
    await _fill(hand, hand.quoted()[0])


@solves("enter-text-2")
async def enter_text_2(hand: Hand) -> None:
    text = hand.quoted()[0]
    await _fill(hand, text.upper() if "upper case" in hand.query else text.lower())


@solves("text-transform")
async def text_transform(hand: Hand) -> None:
    await _fill(hand, (await hand.texts("#captcha"))[0])


@solves("enter-password")
async def enter_password(hand: Hand) -> None:
    await _fill(hand, *hand.quoted() * 2)


@solves("login-user")
async def login_user(hand: Hand) -> None:
    await _fill(hand, *hand.quoted())


@solves("login-user-popup")
async def login_user_popup(hand: Hand) -> None:
    user, password = hand.quoted()
    while (await hand.js("[username.value, password.value]")) != [user, password]:
        for css, text in (("#username", user), ("#password", password)):
            if not await hand.shows("#popup"):
                await hand.type(css, text)
            if await hand.shows("#popup-cancel"):
                await hand.click("#popup-cancel")
    await hand.click("#subbtn")


@solves("enter-date")
async def enter_date(hand: Hand) -> None:
    month, day, year = hand.asked(r"(\d+)/(\d+)/(\d+)")
    await _fill(hand, f"{year}-{month:0>2}-{day:0>2}")


@solves("enter-time")
async def enter_time(hand: Hand) -> None:
    hour, minute, half = hand.asked(r"(\d+):(\d+)\s*(\w+)")
    await _fill(hand, f"{int(hour) % 12 + 12 * (half.upper() == 'PM'):02}:{minute}")


@solves("read-table")
async def read_table(hand: Hand) -> None:
    cells = await hand.texts("#tab td")
    (key,) = hand.asked(r"value of (.*) into")
    await _fill(hand, cells[cells.index(key) + 1])


@solves("read-table-2")
async def read_table_2(hand: Hand) -> None:
    cells = await hand.texts("#tab td")
    keys = [label.rstrip(":") for label in await hand.texts("#form label")]
    await _fill(hand, *(cells[cells.index(key) + 1] for key in keys))


@solves("find-word")
async def find_word(hand: Hand) -> None:
    words = (await hand.texts("#area p"))[0].split()
    await _fill(hand, words[int(hand.asked(r"(\d+)\w\w word")[0]) - 1].strip(".,"))


@solves("scroll-text")
async def scroll_text(hand: Hand) -> None:
    text = await hand.js("document.querySelector('#text-area').value")
    await _fill(hand, re.sub(r"\W", "", text.split()[-1]))


@solves("guess-number")
async def guess_number(hand: Hand) -> None:
    low, high = 0, 9
    while True:
        guess = (low + high) // 2
        await _fill(hand, str(guess))
        low, high = (guess + 1, high) if await hand.shows("#higher") else (low, guess - 1)


@solves("copy-paste", "copy-paste-2")
async def copy_paste(hand: Hand) -> None:
    order = re.search(r"(\d)\w\w text area", hand.query)
    index = int(order[1]) - 1 if order else 0
    if hand.space == "paper":
        await hand.type(
            "#answer-input", await hand.js(f"document.querySelectorAll('#area textarea')[{index}].value")
        )
        await hand.submit()
    await hand.click(At("#area textarea", index=index))
    await hand.press("Control", "a")
    await hand.press("Control", "c")
    await hand.click("#answer-input")
    await hand.press("Control", "v")
    await hand.submit()


@solves("multi-layouts", "multi-orderings")
async def multi_layouts(hand: Hand) -> None:
    genre, name, year = hand.asked(r"Search for (.*) movies directed by (.*) from year (\d+)")
    names = await hand.js(
        """[...document.querySelectorAll('#area input')].map(one => {
            let around = one;
            while (!around.textContent.trim() && !around.placeholder) around = around.parentElement;
            return around.placeholder || around.textContent;
        })"""
    )
    for index, label in enumerate(names):
        is_year = "year" in label.lower() or "released" in label.lower()
        text = genre if "genre" in label.lower() else year if is_year else name
        await hand.type(At("#area input", index=index), text)
    end = "#area button, #area .ui-submit, #area .final, #area input[type=submit]"
    await hand.click(end)


@solves("simple-arithmetic", "simple-algebra", "visual-addition")
async def arithmetic(hand: Hand) -> None:
    answer = {"simple-arithmetic": _sum, "simple-algebra": _unknown, "visual-addition": _blocks}
    task = (await hand.js("location.pathname")).rsplit("/", 1)[-1].removesuffix(".html")
    await _fill(hand, str(await answer[task](hand)))


async def _sum(hand: Hand) -> int:
    first, sign, second = (await hand.texts("#math-problem"))[0].rstrip(" =").split()
    return _result(int(first), sign, int(second))


async def _unknown(hand: Hand) -> int:
    first, sign, second, _, result = (await hand.texts("#math-problem"))[0].split()
    return next(
        x
        for x in range(-200, 200)
        if _result(*((x, sign, int(second)) if first == "x" else (int(first), sign, x))) == int(result)
    )


def _result(one: int, sign: str, other: int) -> int:
    return {"+": one + other, "-": one - other, "x": one * other}[sign]


async def _blocks(hand: Hand) -> int:
    return len(await hand.boxes(".addition-block"))


@solves("form-sequence-2")
async def form_sequence_2(hand: Hand) -> None:
    radio, number, field = hand.asked(
        r'the (\d)\w\w radio button and enter the number "(-?\d+)" into the (\d)'
    )
    await hand.click(At("#area input[type=radio]", index=int(radio) - 1))
    await hand.type(f"#input-{field}", number)
    await hand.submit()
