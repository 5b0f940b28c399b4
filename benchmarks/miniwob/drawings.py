"""Solvers of tasks with drawings: shapes, angles, lines, moving and draggable elements."""

from __future__ import annotations

import cmath
import itertools
import math

from benchmarks.miniwob.episode import At, Box, Episode, Point, Unsolved, middle
from benchmarks.miniwob.registry import solves

from webgym.core.observation import Element


async def _origin(episode: Episode, css: str = "svg") -> Point:
    x, y, _, _ = await episode.box(css)
    return x, y


@solves("ascending-numbers")
async def ascending_numbers(episode: Episode) -> None:
    await episode.click(At("svg text", "1"))
    for number in range(2, 6):
        await episode.click(f"svg rect[data-index='{number}']")


FITTING = """(words => {
    const parts = ['', '', words.pop()];
    for (const word of words) parts[word === 'large' || word === 'small' ? 0 : 1] = word;
    return __grid.shapes.filter(one => shapes.shapeMatchesText(one, {parts}))
        .map(one => one.svg_shape.node().getBoundingClientRect())
        .map(box => [box.x, box.y, box.width, box.height]);
})"""
"""Script that returns the shapes that match a description, by the rules of the page."""


@solves("click-shape")
async def click_shape(episode: Episode) -> None:
    (words,) = episode.asked(r"Click on a (.*)")
    boxes = await episode.js(f"{FITTING}({words.split()})")
    await episode.click(Element(0, "", words, tuple(boxes[0])))


@solves("count-shape")
async def count_shape(episode: Episode) -> None:
    (words,) = episode.asked(r"How many (.*)s are there")
    boxes = await episode.js(f"{FITTING}({words.split()})")
    await episode.click(At("#count-buttons button", str(len(boxes))))


@solves("count-sides")
async def count_sides(episode: Episode) -> None:
    corners = """(() => {
        const {width, height} = c, data = c.getContext('2d').getImageData(0, 0, width, height).data;
        const far = [];
        for (let turn = 0; turn < 720; turn++) {
            const angle = turn * Math.PI / 360;
            let radius = 50;
            while (radius > 0) {
                const x = Math.round(75 + radius * Math.cos(angle));
                const y = Math.round(50 + radius * Math.sin(angle));
                if (data[4 * (y * width + x) + 3] > 127) break;
                radius -= 0.25;
            }
            far.push(radius);
        }
        return far;
    })()"""
    far = await episode.js(corners)
    # the distance of the outline from the middle has one period per side
    swings = {
        sides: abs(sum(radius * cmath.exp(1j * sides * math.radians(i / 2)) for i, radius in enumerate(far)))
        for sides in range(3, 8)
    }
    await episode.click(f"#form [data-sides='{max(swings, key=lambda sides: swings[sides])}']")


@solves("identify-shape")
async def identify_shape(episode: Episode) -> None:
    kind = await episode.js("(({type, text}) => type === 'shape' ? text : type)(__grid.shapes[0])")
    await episode.click(f"#area-buttons [data-type={kind}]")


@solves("grid-coordinate")
async def grid_coordinate(episode: Episode) -> None:
    (place,) = episode.asked(r"(\(-?\d,-?\d\))")
    await episode.click(f"circle[id='{place}']")


async def _dots(episode: Episode, css: str) -> list[Point]:
    return [middle(box) for box in await episode.boxes(css)]


async def _put_dot(episode: Episode, point: Point) -> None:
    """Click until the page has drawn the dot at a point: it is drawn at some distance from the mouse."""
    aim = point
    for _ in range(3):
        await episode.click(aim)
        x, y = middle(await episode.box("#blue-circle"))
        if math.hypot(point[0] - x, point[1] - y) < 0.8:
            return
        aim = (aim[0] + point[0] - x, aim[1] + point[1] - y)


def _far_along(corner: Point, way: Point, field: Box) -> Point:
    """The farthest point from a corner in a direction within a box: the farther, the more exact an angle."""
    left, top, width, height = field
    length = math.hypot(*way)
    places = [(corner[0] + way[0] / length * far, corner[1] + way[1] / length * far) for far in range(8, 200)]
    return next(
        (
            before
            for before, (x, y) in itertools.pairwise(places)
            if not (left + 8 < x < left + width - 8 and top + 8 < y < top + height - 8)
        ),
        places[0],
    )


@solves("find-midpoint")
async def find_midpoint(episode: Episode) -> None:
    (a, b), (c, d) = await _dots(episode, ".black-circle")
    await _put_dot(episode, ((a + c) / 2, (b + d) / 2))
    await episode.submit()


@solves("bisect-angle")
async def bisect_angle(episode: Episode) -> None:
    (corner,) = await _dots(episode, ".init-blue")
    one, other = await _dots(episode, ".init-black")
    away = [(x - corner[0], y - corner[1]) for x, y in (one, other)]
    shares = [(x / math.hypot(x, y), y / math.hypot(x, y)) for x, y in away]
    way = (sum(x for x, _ in shares), sum(y for _, y in shares))
    await _put_dot(episode, _far_along(corner, way, await episode.box("#svg-grid")))
    await episode.submit()


@solves("right-angle")
async def right_angle(episode: Episode) -> None:
    (start,) = await _dots(episode, "#init-black")
    (corner,) = await _dots(episode, "#init-blue")
    x, y = start[0] - corner[0], start[1] - corner[1]
    field = await episode.box("#svg-grid")
    ends = [_far_along(corner, way, field) for way in ((-y, x), (y, -x))]
    await _put_dot(episode, max(ends, key=lambda end: math.dist(end, corner)))
    await episode.submit()


@solves("circle-center")
async def circle_center(episode: Episode) -> None:
    await _put_dot(episode, middle(await episode.box("svg circle:not(.blue)")))
    await episode.submit()


@solves("hot-cold")
async def hot_cold(episode: Episode) -> None:
    """Search for the place in ever smaller steps, each around the best place of the last."""
    left, top, width, height = await episode.box("#touch-area")
    centre, reach = (left + width / 2, top + height / 2), max(width, height) / 2
    for step, near in ((28, {"COLD", "WARM", "HOT"}), (13, {"WARM", "HOT"}), (6, {"HOT"})):
        places = [
            (x, y)
            for y in _steps(centre[1] - reach, centre[1] + reach, step)
            for x in _steps(centre[0] - reach, centre[0] + reach, step)
            if left + 1 < x < left + width - 1 and top + 1 < y < top + height - 1
        ]
        for place in places:
            await episode.hover(place)
            if (await episode.texts("#display"))[0] in near:
                break
        else:
            raise Unsolved(f"nothing is {near}")
        centre, reach = place, 40 if step == 28 else 10
    await episode.click(centre)


def _steps(first: float, last: float, step: float) -> list[float]:
    """Positions from the first to the last, at most ``step`` apart."""
    count = math.ceil((last - first) / step)
    return [first + (index + 0.5) * (last - first) / count for index in range(count)]


@solves("drag-box")
async def drag_box(episode: Episode) -> None:
    await episode.drag("#draggableSmall", await _middle(episode, "#draggableLarge"))
    await episode.submit()


async def _middle(episode: Episode, css: str) -> Point:
    return middle(await episode.box(css))


def _moved(box: Box, way: str, by: float) -> Point:
    x, y = middle(box)
    across, down = {"left": (-1, 0), "right": (1, 0), "up": (0, -1), "down": (0, 1)}[way]
    return x + across * by, y + down * by


@solves("drag-circle", "drag-single-shape")
async def drag_circle(episode: Episode) -> None:
    (way,) = episode.asked(r"(left|right|up|down) then")
    box = await episode.box("svg circle, svg rect, svg polygon")
    await episode.drag(middle(box), _moved(box, way, 15))
    await episode.submit()


@solves("drag-items", "drag-items-grid")
async def drag_items(episode: Episode) -> None:
    names = await episode.texts("#sortable li")
    (name,) = episode.asked(r"Drag (\S+) ")
    old = names.index(name)
    wish = episode.query.split(name, 1)[1].strip(" .").removeprefix("to the ")
    rows, columns = {"top": 0, "center": 1, "bottom": 2}, {"left": 0, "center": 1, "right": 2}
    if len(names) == 5:
        new = {"top": 0, "bottom": 4, "down by one position": old + 1, "up by one position": old - 1}.get(
            wish
        )
        new = int(wish[0]) - 1 if new is None else new
    elif wish.endswith("by one"):
        new = old + {"up": -3, "down": 3, "left": -1, "right": 1}[wish.split()[0]]
    else:
        row, column = (wish.split() * 2)[:2]
        new = rows[row] * 3 + columns[column]
    await _sort(episode, old, new)


async def _sort(episode: Episode, old: int, new: int) -> None:
    """Drag an item of a sortable list past the middle of the item whose place it takes."""
    boxes = await episode.boxes("#sortable li")
    start, end = middle(boxes[old]), middle(boxes[new])
    past = 4 if new > old else -4
    is_list = abs(boxes[0][0] - boxes[1][0]) < 1
    across = 0 if is_list or abs(start[0] - end[0]) < 1 else math.copysign(4, end[0] - start[0])
    down = past if is_list or abs(start[1] - end[1]) > 1 else 0
    await episode.drag(At("#sortable li", index=old), (end[0] + across, end[1] + down))


@solves("drag-sort-numbers")
async def drag_sort_numbers(episode: Episode) -> None:
    for place in range(4):
        numbers = [int(text) for text in await episode.texts("#sortable li")]
        wanted = numbers.index(sorted(numbers)[place])
        if wanted != place:
            await _sort(episode, wanted, place)
    await episode.submit()


@solves("drag-shapes")
async def drag_shapes(episode: Episode) -> None:
    (kind,) = episode.asked(r"all (\w+) into")
    css = {"rectangles": "rect:not(#shape-container)", "circles": "circle", "triangles": "polygon"}[kind]
    x, y, width, height = await episode.box("#shape-container")
    for index, box in enumerate(await episode.boxes(f"#area_svg {css}")):
        await episode.drag(middle(box), (x + 15 + index * 16 % (width - 20), y + height / 2))
    await episode.submit()


@solves("highlight-text", "highlight-text-2")
async def highlight_text(episode: Episode) -> None:
    css = "#randomText"
    if "paragraph and" in episode.query:
        (place,) = episode.asked(r"(\d)")
        css += f" p:nth-of-type({place})"
    ends = await episode.js(
        f"""(one => {{
            const range = document.createRange();
            range.selectNodeContents(one);
            const lines = [...range.getClientRects()].filter(line => line.width > 1);
            const first = lines[0], last = lines[lines.length - 1];
            return [first.left, first.top + first.height / 2, last.right, last.top + last.height / 2];
        }})(document.querySelector("{css}"))"""
    )
    await episode.drag((ends[0] + 0.5, ends[1]), (ends[2] + 3, ends[3]))
    await episode.submit()


@solves("resize-textarea")
async def resize_textarea(episode: Episode) -> None:
    size, way = episode.asked(r"the (width|height) is (smaller|larger)")
    x, y, width, height = await episode.box(".ui-wrapper, #tt")
    corner = (x + width - 4, y + height - 4)
    by = 15 if way == "larger" else -15
    await episode.drag(corner, (corner[0] + by * (size == "width"), corner[1] + by * (size == "height")))
    await episode.submit()


@solves("chase-circle")
async def chase_circle(episode: Episode) -> None:
    while True:
        await episode.move("#circ")


@solves("moving-items")
async def moving_items(episode: Episode) -> None:
    while True:
        boxes = [box for box in await episode.boxes(".item") if 15 < box[0] < 130 and 55 < box[1] < 180]
        by_number = (episode.space, episode.options.mode) == ("paper", "marks")
        seen = [box for box in boxes if not by_number or episode.mark(box)]
        if seen:
            await episode.click(Element(0, "", "", seen[0]) if by_number else middle(seen[0]))
        else:
            await episode.wait(0.3)


@solves("drag-shapes-2")
async def drag_shapes_2(episode: Episode) -> None:
    (wish,) = episode.asked(r"Drag all (.*) into the left box")
    kinds = {"rectangles": "rect:not(#shape-container)", "circles": "circle", "triangles": "polygon"}
    every = ", ".join(f"#area_svg {css}" for css in kinds.values())
    css = f"#area_svg {kinds[wish]}" if wish in kinds else f"#area_svg [fill={wish.split()[0]}]"
    left, right = sorted(await episode.boxes("#shape-container"))
    chosen = await episode.boxes(css)
    for index, box in enumerate(await episode.boxes(every)):
        x, y, width, height = left if box in chosen else right
        await episode.drag(middle(box), (x + width / 2, y + height * (0.3 + 0.1 * index)))
    await episode.submit()


@solves("draw-line")
async def draw_line(episode: Episode) -> None:
    x, y = middle(await episode.box("#circ, svg circle"))
    if "horizontal" in episode.query:
        await episode.drag((x - 15, y), (x + 40, y))
    else:
        await episode.drag((x, y - 15), (x, y + 40))
    await episode.submit()


@solves("draw-circle")
async def draw_circle(episode: Episode) -> None:
    x, y = middle(await episode.box("#circ"))
    turns = [math.tau * part / 24 for part in range(25)]
    ring = [(x + 20 * math.cos(turn), y + 20 * math.sin(turn)) for turn in turns]
    await episode.drag(ring[0], ring[-1], *ring[1:-1])
    await episode.submit()


FRONT = {"6": (88, None), "1": (264, None), "5": (0, 86), "4": (0, 177), "3": (0, 269), "2": (0, 0)}
"""By side in front: rotation of the cube about the horizontal and the vertical axis, degrees."""


@solves("drag-cube")
async def drag_cube(episode: Episode) -> None:
    """Rotate by the remaining angle, and repeat: the cube keeps moving after the mouse is released."""
    number = episode.quoted()[0]
    place = middle(await episode.box("#wrapper .viewport"))
    for _ in range(30):
        if (await episode.texts(".cube-image.active"))[:1] == [number]:
            await episode.submit()
        down, across = await episode.js("[cube.viewport.positionY, cube.viewport.positionX]")
        wanted_down, wanted_across = FRONT[number]
        off_down = _shortest(wanted_down - down)
        off_across = 0 if wanted_across is None else _shortest(wanted_across - across)
        if 90 < down % 360 < 270:
            off_across = 0  # upside down, it rotates in the other direction
        by = [
            math.copysign(min(max(abs(off) / 2, 8), 50), off) if abs(off) > 10 else 0
            for off in (off_across, -off_down)
        ]
        await episode.drag(
            (place[0] - by[0] / 2, place[1] - by[1] / 2), (place[0] + by[0] / 2, place[1] + by[1] / 2)
        )
    raise Unsolved(f"{number} does not come to the front")


def _shortest(degrees: float) -> float:
    """The equivalent rotation of at most half a turn."""
    return (degrees + 180) % 360 - 180
