"""What one joint did in the last seconds, by the stamps of its values."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from typing import NamedTuple

HISTORY = 3.0
"""Seconds of stamps over which a joint's values are kept."""

SPACING = 0.005
"""Seconds between values that are kept, at least; of those closer together the newest is."""

GAP = 0.5
"""Seconds between two values beyond which nobody knows what lay between them."""

REST_SPEED = 0.02
"""rad/s or m/s; a faster joint is moving."""

REST_SPREAD = 0.005
"""rad or m by which a joint that is at rest changes at most."""

_WINDOW = 0.2
"""Seconds over which a speed is measured."""
_SHORTEST = 0.05
"""Seconds for which a shorter window counts, as encoders are noisy."""
_MOST = round(HISTORY / SPACING) + 2


class Sample(NamedTuple):
    """A joint's position (rad or m) and velocity (rad/s or m/s) at a stamp (seconds)."""

    stamp: float
    position: float
    velocity: float


class JointPast:
    """The values of one joint, at most `HISTORY` / `SPACING` of them and two more.

    Stamps are seconds of whatever clock the publisher and the clouds go by.
    """

    def __init__(self) -> None:
        self._samples: list[Sample] = []
        self._low = self._high = 0.0
        self._resting_since = float("-inf")

    @property
    def newest(self) -> float:
        """Stamp of the newest value; −∞ before the first."""
        return self._samples[-1].stamp if self._samples else float("-inf")

    def add(self, sample: Sample) -> None:
        """Take in a value, be it in order or not."""
        samples = self._samples
        self._note_rest(sample)
        if samples and sample.stamp < samples[-1].stamp:
            insort(samples, sample, key=_stamp)
        elif len(samples) > 1 and sample.stamp - samples[-2].stamp < SPACING:
            samples[-1] = sample
        else:
            samples.append(sample)
        oldest = samples[-1].stamp - HISTORY
        if samples[0].stamp < oldest or len(samples) > _MOST:
            kept = max(bisect_left(samples, oldest, key=_stamp), len(samples) - _MOST)
            del samples[:kept]

    def forget(self) -> None:
        """Begin anew: the clock that stamps the values was set back."""
        self._samples.clear()

    def at(self, stamp: float | None) -> float | None:
        """Where the joint was at a stamp; None where that is not known.

        Outside of what is kept, and without a stamp, that is where the joint is now, if it has
        been at rest since, as far as anybody heard; without a stamp, for as long as is kept.
        """
        samples = self._samples
        if not samples:
            return None
        if stamp is None or stamp < samples[0].stamp:
            resting = self._rested_since(samples[0].stamp if stamp is None else stamp)
            return samples[-1].position if resting and not self.moves(self.newest) else None
        if stamp > self.newest:
            return None if self.moves(self.newest) else samples[-1].position
        before, after = self._around(stamp)
        far = after.stamp - before.stamp > GAP
        if far and abs(after.position - before.position) > REST_SPREAD:
            return None
        return _between(before, after, stamp)

    def moves(self, stamp: float) -> bool:
        """Whether the joint was faster than `REST_SPEED` at a stamp; at one older than what is
        kept, whether it has moved since."""
        samples = self._samples
        if not samples:
            return False
        if stamp < samples[0].stamp and not self._rested_since(stamp):
            return True
        end = min(max(stamp + _WINDOW / 2, samples[0].stamp), self.newest)
        begin = max(end - _WINDOW, samples[0].stamp)
        inside = samples[
            bisect_right(samples, begin, key=_stamp) - 1 : bisect_left(samples, end, key=_stamp) + 1
        ]
        if any(abs(sample.velocity) > REST_SPEED for sample in inside):
            return True
        positions = [_between(*self._around(time), time) for time in (begin, end)]
        positions += [sample.position for sample in inside[1:-1]]
        spread = max(positions) - min(positions)
        return spread > REST_SPEED * max(end - begin, _SHORTEST) * (1.0 + 1e-6)

    def _note_rest(self, sample: Sample) -> None:
        position = sample.position
        low, high = min(self._low, position), max(self._high, position)
        if not self._samples:
            self._low = self._high = position
            self._resting_since = float("-inf")
        elif high - low <= REST_SPREAD:
            self._low, self._high = low, high
        else:
            self._resting_since = max(self._resting_since, sample.stamp)
            if sample.stamp >= self.newest:
                self._low = self._high = position

    def _rested_since(self, stamp: float) -> bool:
        """Whether no value from that stamp on was further than `REST_SPREAD` from another."""
        return self._resting_since <= stamp

    def _around(self, stamp: float) -> tuple[Sample, Sample]:
        """The values next to a stamp within what is kept, before and after it."""
        samples = self._samples
        before = samples[bisect_right(samples, stamp, key=_stamp) - 1]
        return before, samples[bisect_left(samples, stamp, key=_stamp)]


def _between(before: Sample, after: Sample, stamp: float) -> float:
    """The position at a stamp, on the line between two values."""
    time = after.stamp - before.stamp
    share = (stamp - before.stamp) / time if time > 0.0 else 0.0
    return before.position + share * (after.position - before.position)


def _stamp(sample: Sample) -> float:
    return sample.stamp
