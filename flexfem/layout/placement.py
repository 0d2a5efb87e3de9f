# SPDX-License-Identifier: LGPL-3.0-or-later
"""Placement of bodies, joints and nodes on ranks, the same on every rank."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from flexfem._types import IntArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Marker
from flexfem.layout.family import Family
from flexfem.mesh.distributed.partition import partition_bodies

__all__ = ["Placement", "place"]


@dataclass(frozen=True)
class Placement:
    """Distribution of a model.

    Attributes:
        elements: rank of each element of each family, body after body, by the family's number.
        body_ranks: ranks with a part of a body, by body name, ascending.
    """

    elements: dict[int, IntArray]
    body_ranks: dict[str, tuple[int, ...]]

    def joint_ranks(self, joint: Joint) -> tuple[int, ...]:
        """Ranks that evaluate a joint, ascending; its multipliers belong to the first of them."""
        ranks: set[int] = set()
        for marker in joint.markers:
            if isinstance(marker, Marker):
                ranks.update(self.body_ranks[marker.body])
        return tuple(sorted(ranks))


def place(
    families: Sequence[Family], joints: Sequence[tuple[Joint, int]], ranks: int, split_above: int
) -> Placement:
    """Distribute a model over ranks; only bodies above ``split_above`` elements are split.

    Args:
        families: the families of bodies of the model.
        joints: its joints, each with its number of rows.
        ranks: number of ranks.
        split_above: a body may be split if it has more elements than this, and is larger than a
            rank's share.
    """
    sizes = _sizes(families)
    hosts = _hosts(families, [joint for joint, _ in joints])
    own = [name for name in sizes if name not in hosts]
    numbers = {name: number for number, name in enumerate(own)}
    numbers |= {name: numbers[host] for name, host in hosts.items()}
    elements, weights = [sizes[name][0] for name in own], [sizes[name][1] for name in own]
    links = _links(families, numbers, joints)
    found = partition_bodies(elements, weights, links, ranks, split_above)
    rank = {name: found[numbers[name]][: 1 if name in hosts else None] for name in sizes}
    of_elements, body_ranks = dict[int, IntArray](), dict[str, tuple[int, ...]]()
    for family in families:
        of_elements[family.kind], names = family.share({b.name: rank[b.name] for b in family.own})
        body_ranks |= names
    return Placement(of_elements, body_ranks)


def _sizes(families: Sequence[Family]) -> dict[str, tuple[int, int]]:
    """Number of elements of every body, and the cost of one of them relative to a beam element."""
    costs = {name: cost for family in families for name, cost in family.costs().items()}
    model = families[0].serial.model
    # bodies in the order of the model, then cables with mass
    return {body.name: costs[body.name] for body in model.bodies} | costs


def _hosts(families: Sequence[Family], joints: Sequence[Joint]) -> dict[str, str]:
    """Bodies without elements, and the first body with elements to which each is joined.

    They are on the same rank: a body without computing cost is not worth an exchange of messages.
    """
    rigid = {body.name for family in families if family.follows for body in family.own}
    hosts = dict[str, str]()
    for joint in joints:
        names = [marker.body for marker in joint.markers if isinstance(marker, Marker)]
        flexible = [name for name in names if name not in rigid]
        for name in names:
            if flexible and name in rigid:
                hosts.setdefault(name, flexible[0])
    return hosts


def _links(
    families: Sequence[Family], numbers: Mapping[str, int], joints: Sequence[tuple[Joint, int]]
) -> dict[tuple[int, int], int]:
    """Number of couplings of two bodies: rows of their joints, and unknowns that they share."""
    links = dict[tuple[int, int], int]()
    for joint, rows in joints:
        bodies = {numbers[marker.body] for marker in joint.markers if isinstance(marker, Marker)}
        for pair in combinations(sorted(bodies), 2):
            links[pair] = links.get(pair, 0) + rows
    for family in families:
        for names, shared in family.links().items():
            first, second = sorted(numbers[name] for name in names)
            links[first, second] = links.get((first, second), 0) + shared
    return links
