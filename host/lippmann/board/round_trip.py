"""Time-out of a reply: the estimate of TCP (RFC 6298), with a smaller back-off."""

from __future__ import annotations

#: Time-out before the first reply, shortest and longest time-out, s.
FIRST_S = 0.25
SHORTEST_S = 0.05
LONGEST_S = 5.0
#: Factor of a time-out after each missing reply. TCP doubles it, as losses there mean congestion; here they mean
#: noise, and more attempts are better than longer ones.
GROWTH = 1.5


class RoundTrip:
    """Smoothed round-trip time and its deviation, and the time-out that follows from them."""

    def __init__(self) -> None:
        self._smoothed: float | None = None
        self._deviation = 0.0
        self.time_out_s = FIRST_S

    def sample(self, seconds: float) -> None:
        """Add a measured time from a request to its reply, s."""
        if self._smoothed is None:
            self._smoothed = seconds
            self._deviation = seconds / 2.0
        else:
            self._deviation += (abs(self._smoothed - seconds) - self._deviation) / 4.0
            self._smoothed += (seconds - self._smoothed) / 8.0
        self.time_out_s = self._estimate()

    def back_off(self) -> None:
        """Lengthen the time-out after a missing reply."""
        self.time_out_s = min(GROWTH * self.time_out_s, LONGEST_S)

    def ease(self) -> None:
        """Shorten the time-out after the reply to a repeated request, which cannot be timed."""
        self.time_out_s = max(self.time_out_s / GROWTH, self._estimate())

    def give_up(self) -> None:
        """Forget the back-off after a request without a reply: the next one is repeated as often as the first was."""
        self.time_out_s = self._estimate()

    def _estimate(self) -> float:
        """Return the time-out of the samples."""
        if self._smoothed is None:
            return FIRST_S
        return min(max(self._smoothed + 4.0 * self._deviation, SHORTEST_S), LONGEST_S)
