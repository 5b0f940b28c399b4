"""Solvers of tasks with named elements: buttons, links, checkboxes, tabs, menus, lists."""

from __future__ import annotations

import re
from collections.abc import Callable

from benchmarks.miniwob.episode import At, Episode, Unsolved
from benchmarks.miniwob.registry import solves

CLICK_SECONDS = 0.15
"""Approximate time from the end of a wait to the next click."""


@solves("click-test", "click-test-transfer")
async def click_test(episode: Episode) -> None:
    await episode.click("#area button")


@solves("click-test-2")
async def click_test_2(episode: Episode) -> None:
    await episode.click_text("button", "ONE")


@solves("click-button", "unicode-test")
async def click_button(episode: Episode) -> None:
    await episode.click_text("#area button", episode.quoted()[0])


@solves("click-button-sequence")
async def click_button_sequence(episode: Episode) -> None:
    await episode.click_text("button", "ONE")
    await episode.click_text("button", "TWO")


@solves("button-delay")
async def button_delay(episode: Episode) -> None:
    await episode.click_text("button", "ONE")
    passed = await episode.js("new Date().getTime() - currentTime")  # the timer of the page, as we have none
    await episode.wait(max(float(episode.asked(r"wait (\d+) sec")[0]) - passed / 1000 - CLICK_SECONDS, 0))
    await episode.click_text("button", "TWO")


@solves("click-link")
async def click_link(episode: Episode) -> None:
    await episode.click_text(".alink", episode.quoted()[0])


@solves("click-dialog")
async def click_dialog(episode: Episode) -> None:
    await episode.click(".ui-dialog-titlebar-close")


@solves("click-dialog-2")
async def click_dialog_2(episode: Episode) -> None:
    name = episode.quoted()[0]
    if name == "x":
        await episode.click(".ui-dialog-titlebar-close")
    else:
        await episode.click_text(".ui-dialog-buttonpane button", name)


@solves("click-checkboxes", "click-checkboxes-large", "click-checkboxes-transfer", "click-option")
async def click_checkboxes(episode: Episode) -> None:
    (names,) = episode.asked(r"Select (.*) and click")
    for name in names.split(", ") if names != "nothing" else ():
        await episode.click_text("#area label", name)
    await episode.submit()


@solves("click-checkboxes-soft")
async def click_checkboxes_soft(episode: Episode) -> None:
    (names,) = episode.asked(r"similar to (.*) and click")
    meant = await episode.js(
        f"SYNONYMS.filter(words => {names.split(', ')}.some(name => words.includes(name))).flat()"
    )
    for text in await episode.texts("#area label"):
        if text in meant:
            await episode.click_text("#area label", text)
    await episode.submit()


@solves("number-checkboxes")
async def number_checkboxes(episode: Episode) -> None:
    pattern = await episode.js(f"PATTERNS[{episode.quoted()[0]}].flat()")
    for index, wanted in enumerate(pattern):
        if wanted:
            await episode.click(At("#area input[type=checkbox]", index=index))
    await episode.submit()


@solves("click-tab")
async def click_tab(episode: Episode) -> None:
    await episode.click_text("#area ul a", episode.asked(r"(Tab #\d)")[0])


@solves("click-tab-2", "click-tab-2-easy", "click-tab-2-medium", "click-tab-2-hard")
async def click_tab_2(episode: Episode) -> None:
    word = episode.quoted()[0]
    for index in range(len(await episode.boxes("#area ul a"))):
        if not await episode.shows(".alink", word):
            await episode.click(At("#area ul a", index=index))
        if await episode.shows(".alink", word):
            await episode.click_text(".alink", word)


@solves("click-collapsible", "click-collapsible-nodelay")
async def click_collapsible(episode: Episode) -> None:
    await episode.click("#area h3")
    await episode.submit()


@solves("click-collapsible-2", "click-collapsible-2-nodelay")
async def click_collapsible_2(episode: Episode) -> None:
    word = episode.quoted()[0]
    for index in range(3):
        await episode.click(At("#area h3", index=index))
        if await episode.shows(".alink", word):
            await episode.click_text(".alink", word)
        await episode.click(At("#area h3", index=index))


@solves("choose-list")
async def choose_list(episode: Episode) -> None:
    await episode.choose("#options", episode.asked(r"Select (.*) from the list")[0])
    await episode.submit()


@solves("click-scroll-list")
async def click_scroll_list(episode: Episode) -> None:
    names = episode.asked(r"Select (.*) from the scroll")[0].split(", ")
    if episode.space == "paper":
        await episode.type("#options", ", ".join(names))
        await episode.submit()
    modifiers = ()
    for name in names:
        await _show(episode, "#options", "#options option", name)
        await episode.click(At("#options option", name), *modifiers)
        modifiers = ("Control",)  # type: ignore[assignment]
    await episode.submit()


async def _show(episode: Episode, box: str, css: str, text: str) -> None:
    """Scroll a box until an element in it is visible."""
    for side in ("down", "up"):
        for _ in range(12):
            x, y, width, height = await episode.box(box)
            _, top, _, tall = await episode.box(At(css, text))
            if top >= y - 1 and top + tall <= y + height + 1:
                return
            if (top > y) != (side == "down"):
                break
            await episode.scroll(side, (x + width / 3, y + height / 2))
    raise Unsolved(f"{text!r} does not come into view")


@solves("click-menu")
async def click_menu(episode: Episode) -> None:
    path = episode.asked(r"Select (.*)")[0].split(">")
    for name in path[:-1]:
        await episode.hover(At("#menu li > div", name))
    await episode.click_text("#menu li > div", path[-1])


@solves("click-menu-2")
async def click_menu_2(episode: Episode) -> None:
    name = await episode.js(
        "(icon => icon ? Object.keys(PROBLEM_SET).find(key => icon.classList.contains(PROBLEM_SET[key]))"
        ": null)(document.querySelector('#query .ui-icon'))"
    )
    name = name or episode.quoted()[1]
    await episode.click("#open-menu")
    if not await episode.shows("#menu li > div", name):
        await episode.move(At("#menu li > div", "Playback"))
    await episode.click_text("#menu li > div", name)


@solves("click-widget")
async def click_widget(episode: Episode) -> None:
    await episode.click(f"#area [data-type={episode.quoted()[0]}]")


@solves("focus-text")
async def focus_text(episode: Episode) -> None:
    await episode.click("#tt")


@solves("focus-text-2")
async def focus_text_2(episode: Episode) -> None:
    await episode.click(At("#area input", index=int(episode.asked(r"(\d)")[0]) - 1))


@solves("click-color")
async def click_color(episode: Episode) -> None:
    await episode.click(f"#area [data-color='{episode.asked(r'the (.*) colored')[0]}']")


@solves("click-shades")
async def click_shades(episode: Episode) -> None:
    (color,) = episode.asked(r"Select all the shades of (\w+)")
    for index in range(len(await episode.boxes(f"#area span[data-color={color}]"))):
        await episode.click(At(f"#area span[data-color={color}]", index=index))
    await episode.submit()


@solves("navigate-tree")
async def navigate_tree(episode: Episode) -> None:
    name = episode.quoted()[0]
    opened: set[str] = set()
    while True:
        if await episode.shows("#tree span", name):
            await episode.click_text("#tree span", name)
        folders = await episode.js(
            "[...document.querySelectorAll('#tree .expandable > span.folder')]"
            ".filter(one => one.getClientRects().length).map(one => one.textContent)"
        )
        folder = next((one for one in folders if one not in opened), None)
        if folder is None:
            raise Unsolved(f"no {name!r} among {await episode.texts('#tree span')}")
        opened.add(folder)
        await episode.click_text("#tree .expandable > span.folder", folder)


@solves("odd-or-even")
async def odd_or_even(episode: Episode) -> None:
    for index, number in enumerate(await episode.texts(".display-number")):
        await episode.click(At(".even" if int(number) % 2 == 0 else ".odd", index=index))
    await episode.submit()


@solves("buy-ticket")
async def buy_ticket(episode: Episode) -> None:
    (wish,) = episode.asked(r"the (cheapest|shortest|longest|most expensive)")
    css, attribute = (
        (".buy-ticket", "data-price")
        if wish in {"cheapest", "most expensive"}
        else (".time-duration", "data-duration")
    )
    most = wish in {"longest", "most expensive"}
    await episode.click(At(".buy-ticket", index=await _extreme(episode, css, attribute, most=most)))


async def _extreme(episode: Episode, css: str, attribute: str, *, most: bool) -> int:
    """The index of the element with the greatest or least value of an attribute."""
    script = f"[...document.querySelectorAll('{css}')].map(one => +one.getAttribute('{attribute}'))"
    values = await episode.js(script)
    return int(values.index(max(values) if most else min(values)))


@solves("phone-book")
async def phone_book(episode: Episode) -> None:
    name, kind = episode.asked(r"Find (.*) in the contact book and click on their (\w+)")
    for _ in range(20):
        if any(name in text for text in await episode.texts("#contact .name")):
            await episode.click(f"#contact .{kind}")
        await episode.click(At("#pagination a", ">"))


@solves("generate-number")
async def generate_number(episode: Episode) -> None:
    fits: dict[str, Callable[[int, int], bool]] = {
        "less than (\\d+)": lambda number, limit: number < limit,
        "greater than (\\d+)": lambda number, limit: number > limit,
        "odd( )": lambda number, _: number % 2 == 1,
        "even( )": lambda number, _: number % 2 == 0,
    }
    (pattern,) = [one for one in fits if re.search(one, episode.query)]
    limit = int("0" + episode.asked(pattern)[0].strip())
    while True:
        await episode.click("#generate")
        if fits[pattern](int((await episode.texts("#display-number"))[0]), limit):
            await episode.click("#submit")


@solves("find-greatest")
async def find_greatest(episode: Episode) -> None:
    values = []
    for index in range(3):
        await episode.click(At(".card", index=index))
        values.append(int((await episode.texts(".card .card-value"))[index]))
    await episode.click(At(".card", index=values.index(max(values))))
    await episode.submit()
