"""How long a way to carry something is sought: the more searches have failed, the shorter the next one.

Whether there is a way is decided by where the hand is with the object, more than by where the object goes: what could not leave for one
region can't leave for the next. So each search that failed from a pick leaves the next one from there half as long, and what failed
searches of a scene cost in all is limited.
"""

from __future__ import annotations

from planning.motion.settings import PatienceSettings


class Patience:
    """The patience with one scene. full: iterations of a search where none has failed."""

    def __init__(self, settings: PatienceSettings, full: int) -> None:
        self.settings, self.full, self.spent = settings, full, 0

    def iterations(self, failures: int) -> int:
        """How long to search where so many searches have failed from the same pick in the same state."""
        least = min(self.settings.least, self.full)
        return least if self.spent >= self.settings.failed else max(least, int(self.full * self.settings.share**failures))

    def failed(self, iterations: int) -> None:
        """A search of so many iterations has failed."""
        self.spent += iterations
