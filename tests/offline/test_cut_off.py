"""Evidence that a page cuts off: how it is found, and that the widest pages have none at 1280 pixels."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Reply, Step, Trajectory
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Give, Truth
from webgym.offline.app import serving
from webgym.offline.config import SitesConfig
from webgym.offline.families import Timetable
from webgym.testing.solutions import cut_off

SITES = 6


TASK = Task(
    id="offline/fernhill/trip",
    instruction="Find the arrival time.",
    website="http://fernhill.webgym.test/",
    domain="Travel & Transportation",
    subdomain="Ground",
    rubric=Rubric((FactGroup(1, "The trip", ("the arrival time is found",)),)),
    source="offline",
    truth=Truth(
        host="fernhill.webgym.test",
        facts=(FactTruth(1, 0, evidence=(Evidence(("X 12", "15:45"), "/trip/"),)),),
        answer=AnswerTruth(),
        moves=(Give("15:45"),),
    ),
)
CUT = Observation(
    "a",
    "http://fernhill.webgym.test/trip/1",
    "",
    (1280, 768),
    text="X 12\n14:30 to …",
    cuts=(("14:30 to 15:45", "14:30 to …"),),
)


def looked(*seen: Observation) -> Trajectory:
    steps = tuple(Step(i, observation, (), Reply("…", "test")) for i, observation in enumerate(seen))
    ending = Ending.ANSWERED
    return Trajectory(Episode("x", TASK.id, 0, 0, 1, "test", 0.0, 1.0, steps, ending), Outcome.SUCCESS)


def test_evidence_in_a_line_that_does_not_show_it_is_found() -> None:
    change = msgspec.structs.replace
    shown = change(CUT, text="X 12\n14:30 to 15:45", cuts=())
    elsewhere = change(CUT, url="http://fernhill.webgym.test/")
    told = f'{TASK.id}: "15:45" is cut off on /trip/1, which shows "14:30 to …"'
    assert list(cut_off({TASK.id: TASK}, [looked(CUT)])) == [told]
    assert list(cut_off({TASK.id: TASK}, [looked(CUT, shown)])) == []
    assert list(cut_off({TASK.id: TASK}, [looked(elsewhere)])) == []


@pytest.mark.browser
async def test_the_widest_times_fit_the_narrowest_columns(tmp_path: Path) -> None:
    async with serving(SitesConfig(latency=0)) as sites:
        web = sites.web
        narrow = [
            site
            for host, spec in web.specs.items()
            if spec.family is Timetable and spec.behaviour == "good"
            if isinstance(site := web.website(host), Timetable) and site.look.listing == "grid"
        ]
        assert len(narrow) >= SITES
        async with Egress(EgressConfig(allow=tuple(sites.allowed_hosts))) as egress:
            slot = Slot(BrowserConfig(), find_browser().path, ProfileRoot(tmp_path), egress)
            await slot.open(PageOptions(text=True, cuts=True))
            try:
                for site in narrow[:SITES]:
                    look = await slot.step(Navigate(f"http://{site.host}{site.finder.path}"))
                    assert look.observation.cuts == (), site.host
            finally:
                await slot.stop()
