"""How long to wait for a reply: the estimate of TCP (RFC 6298), with a gentler back-off."""

from __future__ import annotations

#: Time-out before the first reply, shortest and longest time-out, s.
FIRST_S = 0.25
SHORTEST_S = 0.05
LONGEST_S = 5.0
#: What a time-out grows by with each silence. TCP doubles it, for there a loss tells of too much traffic; here it
#: tells of noise, and patience is better spent on more tries.
GROWTH = 1.5


class RoundTrip:
    """Smoothed round-trip time and its deviation; the time-out follows them and grows with each silence."""

    def __init__(self) -> None:
        self._smoothed: float | None = None
        self._deviation = 0.0
        self.time_out_s = FIRST_S

    def sample(self, seconds: float) -> None:
        """Take the time from a request to its reply."""
        if self._smoothed is None:
            self._smoothed = seconds
            self._deviation = seconds / 2.0
        else:
            self._deviation += (abs(self._smoothed - seconds) - self._deviation) / 4.0
            self._smoothed += (seconds - self._smoothed) / 8.0
        self.time_out_s = self._estimate()

    def back_off(self) -> None:
        """Take note of a time-out."""
        self.time_out_s = min(GROWTH * self.time_out_s, LONGEST_S)

    def ease(self) -> None:
        """Take note of a reply after a time-out, which may answer any of several sends and so tells no time."""
        self.time_out_s = max(self.time_out_s / GROWTH, self._estimate())

    def _estimate(self) -> float:
        """Return the time-out that the samples suggest."""
        if self._smoothed is None:
            return FIRST_S
        return min(max(self._smoothed + 4.0 * self._deviation, SHORTEST_S), LONGEST_S)
