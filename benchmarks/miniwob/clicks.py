"""Tasks that ask for clicks on what has a name: buttons, links, boxes to tick, tabs, menus, lists."""

from __future__ import annotations

import re

from benchmarks.miniwob.hand import At, Hand, Unsolved
from benchmarks.miniwob.registry import solves

CLICK_SECONDS = 0.15
"""From a wait's end to the click after it, about."""


@solves("click-test", "click-test-transfer")
async def click_test(hand: Hand) -> None:
    await hand.click("#area button")


@solves("click-test-2")
async def click_test_2(hand: Hand) -> None:
    await hand.click_text("button", "ONE")


@solves("click-button", "unicode-test")
async def click_button(hand: Hand) -> None:
    await hand.click_text("#area button", hand.quoted()[0])


@solves("click-button-sequence")
async def click_button_sequence(hand: Hand) -> None:
    await hand.click_text("button", "ONE")
    await hand.click_text("button", "TWO")


@solves("button-delay")
async def button_delay(hand: Hand) -> None:
    await hand.click_text("button", "ONE")
    passed = await hand.js(
        "new Date().getTime() - currentTime"
    )  # the page's watch, for want of one of our own
    await hand.wait(max(float(hand.asked(r"wait (\d+) sec")[0]) - passed / 1000 - CLICK_SECONDS, 0))
    await hand.click_text("button", "TWO")


@solves("click-link")
async def click_link(hand: Hand) -> None:
    await hand.click_text(".alink", hand.quoted()[0])


@solves("click-dialog")
async def click_dialog(hand: Hand) -> None:
    await hand.click(".ui-dialog-titlebar-close")


@solves("click-dialog-2")
async def click_dialog_2(hand: Hand) -> None:
    name = hand.quoted()[0]
    if name == "x":
        await hand.click(".ui-dialog-titlebar-close")
    else:
        await hand.click_text(".ui-dialog-buttonpane button", name)


@solves("click-checkboxes", "click-checkboxes-large", "click-checkboxes-transfer", "click-option")
async def click_checkboxes(hand: Hand) -> None:
    (names,) = hand.asked(r"Select (.*) and click")
    for name in names.split(", ") if names != "nothing" else ():
        await hand.click_text("#area label", name)
    await hand.submit()


@solves("click-checkboxes-soft")
async def click_checkboxes_soft(hand: Hand) -> None:
    (names,) = hand.asked(r"similar to (.*) and click")
    meant = await hand.js(
        f"SYNONYMS.filter(words => {names.split(', ')}.some(name => words.includes(name))).flat()"
    )
    for text in await hand.texts("#area label"):
        if text in meant:
            await hand.click_text("#area label", text)
    await hand.submit()


@solves("number-checkboxes")
async def number_checkboxes(hand: Hand) -> None:
    pattern = await hand.js(f"PATTERNS[{hand.quoted()[0]}].flat()")
    for index, wanted in enumerate(pattern):
        if wanted:
            await hand.click(At("#area input[type=checkbox]", index=index))
    await hand.submit()


@solves("click-tab")
async def click_tab(hand: Hand) -> None:
    await hand.click_text("#area ul a", hand.asked(r"(Tab #\d)")[0])


@solves("click-tab-2", "click-tab-2-easy", "click-tab-2-medium", "click-tab-2-hard")
async def click_tab_2(hand: Hand) -> None:
    word = hand.quoted()[0]
    for index in range(len(await hand.boxes("#area ul a"))):
        if not await hand.shows(".alink", word):
            await hand.click(At("#area ul a", index=index))
        if await hand.shows(".alink", word):
            await hand.click_text(".alink", word)


@solves("click-collapsible", "click-collapsible-nodelay")
async def click_collapsible(hand: Hand) -> None:
    await hand.click("#area h3")
    await hand.submit()


@solves("click-collapsible-2", "click-collapsible-2-nodelay")
async def click_collapsible_2(hand: Hand) -> None:
    word = hand.quoted()[0]
    for index in range(3):
        await hand.click(At("#area h3", index=index))
        if await hand.shows(".alink", word):
            await hand.click_text(".alink", word)
        await hand.click(At("#area h3", index=index))


@solves("choose-list")
async def choose_list(hand: Hand) -> None:
    await hand.choose("#options", hand.asked(r"Select (.*) from the list")[0])
    await hand.submit()


@solves("click-scroll-list")
async def click_scroll_list(hand: Hand) -> None:
    names = hand.asked(r"Select (.*) from the scroll")[0].split(", ")
    if hand.space == "paper":
        await hand.type("#options", ", ".join(names))
        await hand.submit()
    held = ()
    for name in names:
        await _show(hand, "#options", "#options option", name)
        await hand.click(At("#options option", name), *held)
        held = ("Control",)  # type: ignore[assignment]
    await hand.submit()


async def _show(hand: Hand, box: str, css: str, text: str) -> None:
    """Scroll a box until an element in it is in view."""
    for side in ("down", "up"):
        for _ in range(12):
            x, y, width, height = await hand.box(box)
            _, top, _, tall = await hand.box(At(css, text))
            if top >= y - 1 and top + tall <= y + height + 1:
                return
            if (top > y) != (side == "down"):
                break
            await hand.scroll(side, (x + width / 3, y + height / 2))  # type: ignore[arg-type]
    raise Unsolved(f"{text!r} does not come into view")


@solves("click-menu")
async def click_menu(hand: Hand) -> None:
    path = hand.asked(r"Select (.*)")[0].split(">")
    for name in path[:-1]:
        await hand.hover(At("#menu li > div", name))
    await hand.click_text("#menu li > div", path[-1])


@solves("click-menu-2")
async def click_menu_2(hand: Hand) -> None:
    name = await hand.js(
        "(icon => icon ? Object.keys(PROBLEM_SET).find(key => icon.classList.contains(PROBLEM_SET[key]))"
        ": null)(document.querySelector('#query .ui-icon'))"
    )
    name = name or hand.quoted()[1]
    await hand.click("#open-menu")
    if not await hand.shows("#menu li > div", name):
        await hand.move(At("#menu li > div", "Playback"))
    await hand.click_text("#menu li > div", name)


@solves("click-widget")
async def click_widget(hand: Hand) -> None:
    await hand.click(f"#area [data-type={hand.quoted()[0]}]")


@solves("focus-text")
async def focus_text(hand: Hand) -> None:
    await hand.click("#tt")


@solves("focus-text-2")
async def focus_text_2(hand: Hand) -> None:
    await hand.click(At("#area input", index=int(hand.asked(r"(\d)")[0]) - 1))


@solves("click-color")
async def click_color(hand: Hand) -> None:
    await hand.click(f"#area [data-color='{hand.asked(r'the (.*) colored')[0]}']")


@solves("click-shades")
async def click_shades(hand: Hand) -> None:
    (color,) = hand.asked(r"Select all the shades of (\w+)")
    for index in range(len(await hand.boxes(f"#area span[data-color={color}]"))):
        await hand.click(At(f"#area span[data-color={color}]", index=index))
    await hand.submit()


@solves("navigate-tree")
async def navigate_tree(hand: Hand) -> None:
    name = hand.quoted()[0]
    opened: set[str] = set()
    while True:
        if await hand.shows("#tree span", name):
            await hand.click_text("#tree span", name)
        folders = await hand.js(
            "[...document.querySelectorAll('#tree .expandable > span.folder')]"
            ".filter(one => one.getClientRects().length).map(one => one.textContent)"
        )
        folder = next((one for one in folders if one not in opened), None)
        if folder is None:
            raise Unsolved(f"no {name!r} among {await hand.texts('#tree span')}")
        opened.add(folder)
        await hand.click_text("#tree .expandable > span.folder", folder)


@solves("odd-or-even")
async def odd_or_even(hand: Hand) -> None:
    for index, number in enumerate(await hand.texts(".display-number")):
        await hand.click(At(".even" if int(number) % 2 == 0 else ".odd", index=index))
    await hand.submit()


@solves("buy-ticket")
async def buy_ticket(hand: Hand) -> None:
    (wish,) = hand.asked(r"the (cheapest|shortest|longest|most expensive)")
    css, attribute = (
        (".buy-ticket", "data-price")
        if wish in {"cheapest", "most expensive"}
        else (".time-duration", "data-duration")
    )
    most = wish in {"longest", "most expensive"}
    await hand.click(At(".buy-ticket", index=await _extreme(hand, css, attribute, most=most)))


async def _extreme(hand: Hand, css: str, attribute: str, *, most: bool) -> int:
    """Which of these elements has the most or the least."""
    script = f"[...document.querySelectorAll('{css}')].map(one => +one.getAttribute('{attribute}'))"
    values = await hand.js(script)
    return int(values.index(max(values) if most else min(values)))


@solves("phone-book")
async def phone_book(hand: Hand) -> None:
    name, kind = hand.asked(r"Find (.*) in the contact book and click on their (\w+)")
    for _ in range(20):
        if any(name in text for text in await hand.texts("#contact .name")):
            await hand.click(f"#contact .{kind}")
        await hand.click(At("#pagination a", ">"))


@solves("generate-number")
async def generate_number(hand: Hand) -> None:
    fits = {
        "less than (\\d+)": lambda number, limit: number < limit,
        "greater than (\\d+)": lambda number, limit: number > limit,
        "odd( )": lambda number, _: number % 2 == 1,
        "even( )": lambda number, _: number % 2 == 0,
    }
    (pattern,) = [one for one in fits if re.search(one, hand.query)]
    limit = int("0" + hand.asked(pattern)[0].strip())
    while True:
        await hand.click("#generate")
        if fits[pattern](int((await hand.texts("#display-number"))[0]), limit):
            await hand.click("#submit")


@solves("find-greatest")
async def find_greatest(hand: Hand) -> None:
    values = []
    for index in range(3):
        await hand.click(At(".card", index=index))
        values.append(int((await hand.texts(".card .card-value"))[index]))
    await hand.click(At(".card", index=values.index(max(values))))
    await hand.submit()
