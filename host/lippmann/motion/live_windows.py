"""Shows pictures in windows and on full monitors, and handles mouse and keys (SDL)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lippmann.base.fullscreen import Pixels, check_monitor, desktop, monitors, window_size
from lippmann.errors import DeviceError
from lippmann.motion.film_frames import Reel
from lippmann.scenes.placement import SCALE_RANGE, Matrix, Placement

#: Rotation per pixel of a mouse drag, degrees.
DRAG_DEG = 0.4
#: Rotation per press of an arrow key, degrees.
KEY_DEG = 5.0
#: Shift per press of an arrow key, in pixels of a mouse drag.
KEY_PX = 10.0
#: Scale factor per step of the mouse wheel, and per press of + or -.
ZOOM = 1.05
STEEP_DEG = 89.0


@dataclass
class Hand:
    """The user's motion of a scene about `pivot_mm`, after the placement `base`."""

    base: Placement
    pivot_mm: Matrix
    #: Shift for each pixel of a mouse drag, mm.
    drag_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    scale: float = 1.0
    shift_mm: Matrix = field(default_factory=lambda: np.zeros(3))

    def turn(self, yaw_deg: float, pitch_deg: float = 0.0) -> None:
        """Rotate the scene to the right by `yaw_deg`, upwards by `pitch_deg`."""
        self.yaw_deg = math.remainder(self.yaw_deg + yaw_deg, 360.0)
        self.pitch_deg = min(max(self.pitch_deg + pitch_deg, -STEEP_DEG), STEEP_DEG)

    def shift(self, right: float, up: float, nearer: float = 0.0) -> None:
        """Shift the scene by distances in pixels of a mouse drag."""
        self.shift_mm = self.shift_mm + self.drag_mm * np.array([right, up, nearer])

    def zoom(self, steps: float) -> None:
        """Scale the scene by a number of steps of the mouse wheel."""
        scale = self.scale * ZOOM**steps
        if SCALE_RANGE[0] <= scale * self.base.scale <= SCALE_RANGE[1]:
            self.scale = scale

    def reset(self) -> None:
        """Move the scene back to the placement `base`."""
        self.yaw_deg = self.pitch_deg = 0.0
        self.scale, self.shift_mm = 1.0, np.zeros(3)

    @property
    def motion(self) -> tuple[float, ...]:
        """All values of the motion; equal motions give the same placement."""
        return (self.yaw_deg, self.pitch_deg, self.scale, *self.shift_mm.tolist())

    def placement(self) -> Placement:
        """Return the moved scene's placement, without near and far depths after a motion."""
        if (self.yaw_deg, self.pitch_deg, self.scale) == (0.0, 0.0, 1.0) and not self.shift_mm.any():
            return self.base
        turns = (self.pitch_deg, 0.0, 0.0), (0.0, self.yaw_deg, 0.0)
        about_x, about_y = (Placement(rotation_deg=turn).display_from_scene for turn in turns)
        moved = about_x @ about_y
        moved[:3, :3] *= self.scale
        moved[:3, 3] = self.pivot_mm + self.shift_mm - moved[:3, :3] @ self.pivot_mm
        return Placement.of(moved @ self.base.display_from_scene, self.scale * self.base.scale)


class Screens:
    """The windows of a live picture; no window opens if `pygame` is None."""

    def __init__(self, pygame: Any = None) -> None:
        self._pygame = pygame
        self._windows: dict[str, Any] = {}

    def open(self, name: str, size: tuple[int, int], monitor: int | None = None) -> None:
        """Open a window that fits the desktop, or fill a monitor; raise InputError if the monitor is missing."""
        pygame = self._pygame
        if pygame is None:
            return
        sizes = pygame.display.get_desktop_sizes()
        if monitor is None:
            self._windows[name] = pygame.Window(name, window_size(size, sizes[0]))
            return
        check_monitor(sizes, monitor, size)
        place = pygame.WINDOWPOS_CENTERED | monitor  # SDL's code for a monitor's centre
        self._windows[name] = pygame.Window(name, size, (place, place), fullscreen=True)

    def show(self, name: str, pixels: Pixels, title: str) -> None:
        """Show a picture (height, width, 3); raise DeviceError if the window is gone."""
        pygame = self._pygame
        if pygame is None:
            return
        window = self._windows[name]
        try:
            surface = window.get_surface()
            picture = pygame.image.frombuffer(np.ascontiguousarray(pixels), pixels.shape[1::-1], "RGB")
            if picture.get_size() != surface.get_size():
                picture = pygame.transform.smoothscale(picture, surface.get_size())
            surface.blit(picture, (0, 0))
            window.flip()
            window.title = title
        except pygame.error as error:
            raise DeviceError(f"the window is gone ({error}); check the monitor") from None

    def waiting(self) -> bool:
        """Tell whether events of mouse or keys are waiting."""
        pygame = self._pygame
        if pygame is None:
            return False
        pygame.event.pump()
        if pygame.event.peek((pygame.KEYDOWN, pygame.MOUSEWHEEL, pygame.QUIT, pygame.WINDOWCLOSE)):
            return True
        return any(pygame.mouse.get_pressed()) and bool(pygame.event.peek(pygame.MOUSEMOTION))

    def obey(self, hand: Hand, reel: Reel | None = None) -> bool:
        """Apply mouse and key events to scene and film; return False if the user ends the loop."""
        pygame = self._pygame
        for event in [] if pygame is None else pygame.event.get():
            if event.type in (pygame.QUIT, pygame.WINDOWCLOSE):
                return False
            if event.type == pygame.MOUSEMOTION and any(event.buttons):
                right, down = event.rel
                if event.buttons[0]:
                    hand.turn(DRAG_DEG * right, DRAG_DEG * down)
                else:
                    hand.shift(right, -down)
            elif event.type == pygame.MOUSEWHEEL:
                hand.zoom(event.y)
            elif event.type == pygame.KEYDOWN and not self._press(event, hand, reel):
                return False
        return True

    def _press(self, event: Any, hand: Hand, reel: Reel | None) -> bool:
        pygame = self._pygame
        shifted = bool(getattr(event, "mod", 0) & pygame.KMOD_SHIFT)
        arrows = {pygame.K_LEFT: (-1, 0), pygame.K_RIGHT: (1, 0), pygame.K_UP: (0, 1), pygame.K_DOWN: (0, -1)}
        across, up = arrows.get(event.key, (0, 0))
        if event.key in (pygame.K_ESCAPE, pygame.K_q):
            return False
        if event.key == pygame.K_r:
            hand.reset()
        elif event.key in (pygame.K_PLUS, pygame.K_KP_PLUS, pygame.K_EQUALS):
            hand.zoom(1.0)
        elif event.key in (pygame.K_MINUS, pygame.K_KP_MINUS):
            hand.zoom(-1.0)
        elif event.key in (pygame.K_PAGEUP, pygame.K_PAGEDOWN):
            hand.shift(0.0, 0.0, KEY_PX if event.key == pygame.K_PAGEUP else -KEY_PX)
        elif event.key in (pygame.K_SPACE, pygame.K_COMMA, pygame.K_PERIOD):
            if reel is not None and event.key == pygame.K_SPACE:
                reel.playing = not reel.playing
            elif reel is not None:
                reel.step(1 if event.key == pygame.K_PERIOD else -1)
        elif shifted:
            hand.shift(KEY_PX * across, KEY_PX * up)
        else:
            hand.turn(KEY_DEG * across, -KEY_DEG * up)
        return True

    def close(self) -> None:
        """Close all windows."""
        for window in self._windows.values():
            window.destroy()
        self._windows.clear()


def check_screens(size: tuple[int, int], monitor: int | None) -> None:
    """Raise the errors of `screens` and `Screens.open` before a render."""
    sizes = monitors()
    if monitor is not None:
        check_monitor(sizes, monitor, size)


@contextmanager
def screens() -> Iterator[Screens]:
    """Yield the desktop's screens, then close them; raise DeviceError if there is no desktop."""
    with desktop("a window") as pygame, closing(Screens(pygame)) as windows:
        yield windows
