"""All websites of a seed, their tasks, and the split between training and testing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from webgym.core.errors import ConfigError
from webgym.core.task import Task
from webgym.offline import names, small
from webgym.offline.config import DEFAULT_SEED, CollectionName
from webgym.offline.engine import cross_site
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.families import FAMILIES
from webgym.offline.look import look
from webgym.offline.parts import SENTENCES, Place, Wording, write
from webgym.offline.seeds import number, stream
from webgym.offline.website import TOP_LEVEL_DOMAIN, Behaviour, Split, Website

_OTHERS = 2
"""Websites of other families that a website has cross-site tasks with."""
MISBEHAVING: tuple[Behaviour, ...] = ("blocks", "down", "slow", "nags", "forgets")


@dataclass(frozen=True)
class Collection:
    """A set of families whose websites are made, served and split together.

    Attributes:
        families: the kinds of websites.
        per_family: well-behaved websites in every family, unless asked otherwise.
        test_share: of them are for testing.
        misbehaving: one more website for each of these, all for testing.
        viewport: the size, CSS pixels, that its pages are made for.
        wording: how its tasks are written out.
        is_cross_site: whether each of its tasks is about two websites, instead of one.
    """

    families: tuple[type[Website], ...]
    per_family: int
    test_share: float
    misbehaving: tuple[Behaviour, ...]
    viewport: tuple[int, int]
    wording: Wording
    is_cross_site: bool = False


COLLECTIONS: dict[CollectionName, Collection] = {
    "large": Collection(FAMILIES, 50, 0.2, MISBEHAVING, (1280, 768), SENTENCES),
    "small": Collection(small.FAMILIES, 72, 1 / 6, (), (192, 128), small.WORDING),
    "cross": Collection(
        FAMILIES, 50, 0.2, (), (1280, 768), replace(SENTENCES, source="offline-cross"), is_cross_site=True
    ),
}


def collection_name(name: str) -> CollectionName:
    """The collection of this name.

    Raises:
        ConfigError: there is none.
    """
    found = next((known for known in COLLECTIONS if known == name), None)
    if found is None:
        raise ConfigError(f"there is no collection {name!r}", hint=f"give {', '.join(COLLECTIONS)}")
    return found


@dataclass(frozen=True)
class Spec:
    """A website that may not have been built yet."""

    family: type[Website]
    seed: int
    brand: str
    label: str
    split: Split
    behaviour: Behaviour


class OfflineWeb:
    """The offline web of one seed.

    Websites are built when first asked for. The same seed gives the same websites, pages and tasks.

    Args:
        seed: of everything.
        per_family: well-behaved websites in every family; ``None`` for the collection's own number.
        collection: ``"large"``, pages as on real websites; ``"small"``, pages of a few large signs; or
            ``"cross"``, large websites with tasks about two of them.
        families: other families than the collection's.
    """

    def __init__(
        self,
        seed: int = DEFAULT_SEED,
        *,
        per_family: int | None = None,
        collection: CollectionName = "large",
        families: tuple[type[Website], ...] | None = None,
    ) -> None:
        self.seed = seed
        self.collection = COLLECTIONS[collection]
        if families is not None:
            self.collection = replace(self.collection, families=families)
        self.per_family = self.collection.per_family if per_family is None else per_family
        self._built: dict[str, Website] = {}

    @cached_property
    def specs(self) -> dict[str, Spec]:
        """All websites by hostname."""
        # Each family has its own names, so that a new family does not rename the others' websites.
        families = self.collection.families
        stems = {family: names.stems(self.seed, family.family) for family in families}
        found: dict[str, Spec] = {}

        def add(family: type[Website], index: int, split: Split, behaviour: Behaviour) -> None:
            seed = number(self.seed, family.family, index)
            brand, label = family.christen(stems[family][index], seed)
            spec = Spec(family, seed, brand, label, split, behaviour)
            found[family.host_of(label)] = spec

        for family in families:
            held_out = round(self.per_family * self.collection.test_share)
            order = list(range(self.per_family))
            stream(self.seed, "split", family.family).shuffle(order)
            test = set(order[:held_out])
            for index in range(self.per_family):
                add(family, index, "test" if index in test else "train", "good")
        for nth, behaviour in enumerate(self.collection.misbehaving):
            add(families[nth % len(families)], self.per_family + nth, "test", behaviour)
        return found

    def website(self, host: str) -> Website | None:
        """The website with this hostname, if there is one.

        Args:
            host: its name, such as ``silverfield-small-desk.webgym.test``; made when it is first asked for.
        """
        spec = self.specs.get(host)
        if spec is None:
            return None
        if host not in self._built:
            self._built[host] = spec.family(
                seed=spec.seed,
                brand=spec.brand,
                label=spec.label,
                look=look(spec.seed),
                behaviour=spec.behaviour,
                split=spec.split,
            )
        return self._built[host]

    def tasks(self, split: Split | None = None) -> Iterator[Task]:
        """All tasks, those derived by decomposition behind the task they come from.

        Args:
            split: ``train`` or ``test``; both if not given.
        """
        for host, spec in self.specs.items():
            if split in (None, spec.split):
                yield from self.tasks_of(host)

    def tasks_of(self, host: str) -> Iterator[Task]:
        """The tasks that begin on one website.

        Args:
            host: the website's name.

        Raises:
            KeyError: there is no such website.
        """
        split = self.specs[host].split
        site = self.website(host)
        assert site is not None
        place = Place(
            label=site.label,
            brand=site.brand,
            host=host,
            start=site.start,
            domain=site.domain,
            subdomain=site.subdomain,
            split=split,
            wording=self.collection.wording,
        )
        if not self.collection.is_cross_site:
            for assignment in site.expected_assignments():
                yield from write(place, assignment)
            return
        partners = self._partners(host)
        for other, assignment in cross_site.assignments(self._specified(host), *partners):
            brands = f"{site.brand} and {other.brand} ({other.start})"
            yield from write(replace(place, brand=brands, host=other.host), assignment)

    def _partners(self, host: str) -> tuple[SpecifiedWebsite | None, list[SpecifiedWebsite]]:
        """A website of the same family, if there is one, and some of others. All are of the same split."""
        spec = self.specs[host]
        peers = [each for each, other in self.specs.items() if other.split == spec.split]
        family = [each for each in peers if self.specs[each].family is spec.family]
        others = [each for each in peers if each not in family]
        twin = family[(family.index(host) + 1) % len(family)]
        chosen = stream(self.seed, "partners", host).sample(others, min(_OTHERS, len(others)))
        return (None if twin == host else self._specified(twin)), [*map(self._specified, chosen)]

    def _specified(self, host: str) -> SpecifiedWebsite:
        site = self.website(host)
        assert isinstance(site, SpecifiedWebsite)
        return site

    def allowed_hosts(self, address: str) -> list[str]:
        """Rules of the egress policy that lead browsers to the server at ``address`` (``host:port``).

        A website that is down has a name that does not resolve.

        Args:
            address: where the offline web is served, without a scheme.
        """
        down = [f"{host}=nowhere" for host, spec in self.specs.items() if spec.behaviour == "down"]
        return [*down, f"*.{TOP_LEVEL_DOMAIN}={address}"]
