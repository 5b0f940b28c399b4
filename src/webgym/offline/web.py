"""All websites of a seed, their tasks, and the split between training and testing."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

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
"""Number of websites of other families with which a website has cross-site tasks."""
MISBEHAVING: tuple[Behaviour, ...] = ("blocks", "down", "slow", "nags", "forgets")


@dataclass(frozen=True)
class Collection:
    """A set of families of websites that are generated, served and split together.

    Attributes:
        families: the kinds of websites.
        per_family: default number of well-behaved websites per family.
        test_share: share of them that is for testing.
        misbehaving: behaviours for each of which there is one more website, for testing.
        viewport: width and height that its pages are designed for, CSS pixels.
        wording: of its tasks.
        is_cross_site: whether its tasks are about two websites each.
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


@dataclass(frozen=True)
class Spec:
    """The parameters from which a website is built."""

    family: type[Website]
    seed: int
    brand: str
    label: str
    split: Split
    behaviour: Behaviour

    @property
    def digest(self) -> str:
        """Differs if the website does: of its parameters, and of the code that builds it."""
        return f"{number(digest_of_code(), self.family.family, self.seed, self.brand, self.behaviour):016x}"


@cache
def digest_of_code() -> str:
    """Digest of all files that websites and their tasks are made from, but for families of a user's own."""
    digest = hashlib.sha256()
    offline = Path(__file__).parent
    for package in (offline, offline.parent / "core"):
        for file in sorted(package.rglob("*")):
            if file.is_file() and file.parent.name != "__pycache__":
                digest.update(f"{file.name} {file.stat().st_size}\n".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


class OfflineWeb:
    """The offline web of one seed.

    Websites are built on demand. The same seed gives the same websites, pages and tasks.

    Args:
        seed: of all websites.
        per_family: number of well-behaved websites per family; ``None`` for the collection's default. A
            website has the same split whatever the number. Of three or fewer (two large ones) none is for
            testing.
        collection: ``"large"``, pages as on real websites; ``"small"``, pages of a few large signs; or
            ``"cross"``, large websites with tasks about two of them.
        families: used instead of the collection's.
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
        # Each family has its own names, so that a new family does not rename websites of others.
        families = self.collection.families
        stems = {family: names.stems(self.seed, family.family) for family in families}
        specs_by_host: dict[str, Spec] = {}

        def add(family: type[Website], index: int, split: Split, behaviour: Behaviour) -> None:
            seed = number(self.seed, family.family, index)
            brand, label = family.christen(stems[family][index], seed)
            spec = Spec(family, seed, brand, label, split, behaviour)
            specs_by_host[family.host_of(label)] = spec

        for family in families:
            for index, split in self._split_of(family).items():
                add(family, index, split, "good")
        for nth, behaviour in enumerate(self.collection.misbehaving):
            add(families[nth % len(families)], self.collection.per_family + nth, "test", behaviour)
        return specs_by_host

    def _split_of(self, family: type[Website]) -> dict[int, Split]:
        """The split of a family's well-behaved websites, by index in ascending order.

        An index has the same split for every number of websites, so that none is for training in one web and
        for testing in another. A larger web has all websites of a smaller one.
        """
        size, share = self.collection.per_family, self.collection.test_share
        order = list(range(size))
        rng = stream(self.seed, "split", family.family)
        rng.shuffle(order)
        held_out = round(size * share)
        test, train = sorted(order[:held_out]), sorted(order[held_out:])
        wanted = round(self.per_family * share)
        start, block = size + len(MISBEHAVING), round(1 / share)  # websites that misbehave are between
        while len(test) < wanted or len(train) < self.per_family - wanted:
            chosen = start + rng.randrange(block)
            test.append(chosen)
            train += [index for index in range(start, start + block) if index != chosen]
            start += block
        splits: dict[int, Split] = dict.fromkeys(test[:wanted], "test")
        splits |= dict.fromkeys(train[: self.per_family - wanted], "train")
        return dict(sorted(splits.items()))

    def website(self, host: str) -> Website | None:
        """The website with this hostname; ``None`` if there is none.

        Args:
            host: such as ``silverfield-small-desk.webgym.test``.
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
        """All tasks; those derived by decomposition follow their parent.

        Args:
            split: ``train`` or ``test``; ``None`` for both.
        """
        for host, spec in self.specs.items():
            if split in (None, spec.split):
                yield from self.tasks_of(host)

    def tasks_of(self, host: str) -> Iterator[Task]:
        """The tasks that start on one website.

        Args:
            host: its hostname.

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
        """Another website of the same family, or ``None``, and some of other families, all of the same
        split."""
        spec = self.specs[host]
        peers = [peer for peer, other in self.specs.items() if other.split == spec.split]
        family = [peer for peer in peers if self.specs[peer].family is spec.family]
        others = [peer for peer in peers if peer not in family]
        twin = family[(family.index(host) + 1) % len(family)]
        chosen = stream(self.seed, "partners", host).sample(others, min(_OTHERS, len(others)))
        return (None if twin == host else self._specified(twin)), [*map(self._specified, chosen)]

    def _specified(self, host: str) -> SpecifiedWebsite:
        site = self.website(host)
        assert isinstance(site, SpecifiedWebsite)
        return site

    def allowed_hosts(self, address: str) -> list[str]:
        """The rules of the egress policy that direct browsers to the server of the offline web.

        The hostname of a website that is down does not resolve.

        Args:
            address: ``host:port`` of the server.
        """
        down = [f"{host}=nowhere" for host, spec in self.specs.items() if spec.behaviour == "down"]
        return [*down, f"*.{TOP_LEVEL_DOMAIN}={address}"]
