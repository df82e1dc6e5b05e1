"""A film that plays while one looks: which of its frames is shown, and its scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lippmann.motion.shot import Shot, scene_of_shot
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene


@dataclass
class Reel:
    """The shots of a film, which is played round and round.

    No frame is left out: a film whose frames take longer than they should is slower.
    """

    shots: Sequence[Shot]
    frames_per_second: float
    playing: bool = True
    _place: float = 0.0

    @property
    def frame(self) -> int:
        """The frame that is to be shown."""
        return int(self._place)

    def advance(self, seconds: float) -> None:
        """Let time pass; of a film that does not play, nothing changes."""
        if self.playing:
            self._move(min(seconds * self.frames_per_second, 1.0))

    def step(self, frames: int) -> None:
        """Stop, and go to another frame."""
        self.playing = False
        self._place = float(self.frame)
        self._move(frames)

    def placement(self, frame: int) -> Placement:
        """Return how the scene stands at a frame."""
        return self.shots[frame].placement

    def scene(self, frame: int) -> Scene | None:
        """Return the scene at a frame; None when its shapes do not move, and one scene serves all frames."""
        shot = self.shots[frame]
        return scene_of_shot(shot) if shot.moves else None

    def _move(self, frames: float) -> None:
        self._place = (self._place + frames) % len(self.shots)
