"""Settings of s(x): the rule, and what is kept from the end of the support."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

SupportName = Literal["vertices", "polygon"]
SUPPORTS: tuple[SupportName, ...] = get_args(SupportName)
CONTACTS = ("face", "lean")
"""Contact classes."""


@dataclass(frozen=True, slots=True)
class SupportSettings:
    """The settings of s(x), see `PlannerSettings` for their words.

    Attributes:
        support: the rule.
        contact_tolerance: m that surface may be above or below what it carries.
        edge_margin: m, with `vertices`.
        support_margin: m, with `polygon`.
        contacts: the contact classes.
        friction: coefficient, of surfaces; walls count as smooth.
        stability_margin: share of the weight that leaning objects bear in any horizontal direction.
    """

    support: SupportName
    contact_tolerance: float
    edge_margin: float
    support_margin: float
    contacts: tuple[str, ...] = ("face",)
    friction: float = 0.3
    stability_margin: float = 0.05
