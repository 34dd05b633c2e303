"""The page's colours, in one place, so that legend and scene agree."""

from __future__ import annotations

Rgb = tuple[int, int, int]

LINK: Rgb = (200, 202, 208)
CLOUD: Rgb = (155, 162, 172)
PLACED: Rgb = (30, 160, 60)
HELD: Rgb = (235, 120, 20)
STANDING: Rgb = (20, 130, 130)
VOLUME: Rgb = (217, 38, 140)
OBSTACLES: Rgb = (150, 75, 60)
REGION: Rgb = (90, 140, 215)
CONTACT: Rgb = (200, 30, 30)
WALL: Rgb = (128, 77, 180)
