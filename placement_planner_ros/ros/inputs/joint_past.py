"""What one joint did in the last seconds, by the stamps of its values."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from typing import NamedTuple

HISTORY_S = 3.0
"""Of stamps over which a joint's values are kept."""
SPACING_S = 0.005
"""Between values that are kept, at least; of those closer together the newest is."""
WINDOW_S = 0.3
"""Over which a speed is measured; nobody knows what lay between two values farther apart."""
SHORTEST_S = 0.05
"""For which a shorter window counts, as encoders are noisy."""
REST_SPREAD = 0.005
"""rad or m by which a joint that is at rest changes at most."""


class Sample(NamedTuple):
    """A joint's position (rad or m) at a time (seconds)."""

    time: float
    position: float


class JointPast:
    """The values of one joint, at most `HISTORY_S` / `SPACING_S` of them and two more.

    Stamps are seconds of whatever clock the publisher and the clouds go by.
    """

    def __init__(self) -> None:
        self._samples: list[Sample] = []
        self._low = self._high = 0.0
        self._resting_since = float("-inf")

    @property
    def newest(self) -> float:
        """Stamp of the newest value; −∞ before the first."""
        return self._samples[-1].time if self._samples else float("-inf")

    @property
    def latest(self) -> float:
        """The newest value."""
        return self._samples[-1].position

    def add(self, sample: Sample) -> None:
        """Take in a value, be it in order or not."""
        samples = self._samples
        self._note_rest(sample)
        if samples and sample.time < samples[-1].time:
            insort(samples, sample, key=_time)
        elif len(samples) > 1 and sample.time - samples[-2].time < SPACING_S:
            samples[-1] = sample
        else:
            samples.append(sample)
        oldest = samples[-1].time - HISTORY_S
        most = round(HISTORY_S / SPACING_S) + 2  # of those out of order, too
        if samples[0].time < oldest or len(samples) > most:
            del samples[: max(bisect_left(samples, oldest, key=_time), len(samples) - most)]

    def forget(self) -> None:
        """Begin anew: the clock that stamps the values was set back."""
        self._samples.clear()

    def at(self, stamp: float | None, rest_speed: float) -> float | None:
        """Where the joint was at a stamp; None where that is not known.

        Outside of what is kept, and without a stamp, that is where the joint is now, if it has
        been at rest since, as far as anybody heard; without a stamp, for as long as is kept.

        Args:
            rest_speed: rad/s or m/s up to which it is at rest.
        """
        samples = self._samples
        if not samples:
            return None
        oldest = samples[0].time if stamp is None else min(stamp, samples[0].time)
        if (stamp is None or stamp < samples[0].time) and not self._rested_since(oldest):
            return None
        if stamp is None or not samples[0].time <= stamp <= self.newest:
            return None if self.moves(self.newest, rest_speed) else samples[-1].position
        before, after = self._around(stamp)
        far = after.time - before.time > WINDOW_S
        if far and abs(after.position - before.position) > REST_SPREAD:
            return None
        return _between(before, after, stamp)

    def moves(self, stamp: float, rest_speed: float) -> bool:
        """Whether the joint was faster than that (rad/s or m/s) around a stamp; at one older than
        what is kept, whether it has moved since."""
        samples = self._samples
        if not samples:
            return False
        if stamp < samples[0].time and not self._rested_since(stamp):
            return True
        end = min(max(stamp + WINDOW_S / 2, samples[0].time), self.newest)
        begin = max(end - WINDOW_S, samples[0].time)
        inside = slice(
            bisect_right(samples, begin, key=_time), bisect_left(samples, end, key=_time)
        )
        positions = [_between(*self._around(time), time) for time in (begin, end)]
        positions += [sample.position for sample in samples[inside]]
        farthest = rest_speed * max(end - begin, SHORTEST_S) * (1.0 + 1e-6)
        return max(positions) - min(positions) > farthest

    def _note_rest(self, sample: Sample) -> None:
        position = sample.position
        low, high = min(self._low, position), max(self._high, position)
        if not self._samples:
            self._low = self._high = position
            self._resting_since = float("-inf")
        elif high - low <= REST_SPREAD:
            self._low, self._high = low, high
        else:
            self._resting_since = max(self._resting_since, sample.time)
            if sample.time >= self.newest:
                self._low = self._high = position

    def _rested_since(self, stamp: float) -> bool:
        """Whether no value from that stamp on was further than `REST_SPREAD` from another."""
        return self._resting_since <= stamp

    def _around(self, stamp: float) -> tuple[Sample, Sample]:
        """The values next to a stamp within what is kept, before and after it."""
        samples = self._samples
        before = samples[bisect_right(samples, stamp, key=_time) - 1]
        return before, samples[bisect_left(samples, stamp, key=_time)]


def _between(before: Sample, after: Sample, stamp: float) -> float:
    """The position at a stamp, on the line between two values."""
    time = after.time - before.time
    share = (stamp - before.time) / time if time > 0.0 else 0.0
    return before.position + share * (after.position - before.position)


def _time(sample: Sample) -> float:
    return sample.time
