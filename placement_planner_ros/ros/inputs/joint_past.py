"""The last moments of one joint, by its values' stamps: its speed, and since when it rests."""

from __future__ import annotations

from typing import NamedTuple

WINDOW_S = 0.3
"""Over which a speed is measured."""
JITTER = 4e-4
"""rad or m by which values of a joint that stands still differ, as encoders are noisy."""
REST_SPREAD = 0.005
"""rad or m by which a joint that is at rest changes at most."""


class Sample(NamedTuple):
    """A joint's position (rad or m) at a time (seconds)."""

    time: float
    position: float


class JointPast:
    """The values of one joint over `WINDOW_S`, and one before.

    Stamps are seconds of whatever clock the publisher and the clouds go by; they do not decrease.
    """

    def __init__(self, first: Sample) -> None:
        self._samples = [first]
        self._low = self._high = first.position
        self._resting_since = float("-inf")  # as far as anybody heard

    @property
    def newest(self) -> Sample:
        """The newest value."""
        return self._samples[-1]

    def add(self, sample: Sample) -> None:
        """Take in a value that is no older than the newest."""
        samples, position = self._samples, sample.position
        self._low, self._high = min(self._low, position), max(self._high, position)
        # the spread is counted anew from the value that is out of it
        if self._high - self._low > REST_SPREAD:
            self._low = self._high = position
            self._resting_since = sample.time
        # with a clock that stands still the newest replaces the one before
        if len(samples) > 1 and sample.time <= samples[-1].time:
            samples.pop()
        samples.append(sample)
        # one value before the window is kept, to tell where the joint was as it began
        while len(samples) > 2 and samples[1].time <= sample.time - WINDOW_S:
            del samples[0]

    def moves(self, rest_speed: float) -> bool:
        """Whether the joint is faster than that, rad/s or m/s."""
        first, *later = self._samples
        begin = max(self.newest.time - WINDOW_S, first.time)
        positions = [sample.position for sample in later]
        if later:
            # where the joint was as the window began, on the line between two values
            time = later[0].time - first.time
            share = (begin - first.time) / time if time > 0.0 else 0.0
            positions.append(first.position + share * (later[0].position - first.position))
        farthest = max(rest_speed * (self.newest.time - begin), JITTER)
        return max(positions, default=0.0) - min(positions, default=0.0) > farthest

    def rested_since(self, stamp: float) -> bool:
        """Whether no value from that stamp on was further than `REST_SPREAD` from another."""
        return self._resting_since <= stamp
