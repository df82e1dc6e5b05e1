"""Shows images with SDL, either unscaled on a whole monitor or in a window."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lippmann.base.programs import silent_stderr
from lippmann.errors import DeviceError, InputError, as_number, missing_library

if TYPE_CHECKING:
    import pygame

Pixels = npt.NDArray[np.uint8]

#: SDL drivers without a screen, which SDL selects if the session has no desktop.
BLIND_DRIVERS = ("dummy", "evdev", "offscreen")
#: Interval between two checks of the keyboard, s.
LOOK_S = 0.05
#: Maximum size of a window, as a fraction of the desktop.
WINDOW_SHARE = 0.9


def monitors() -> list[tuple[int, int]]:
    """Return each monitor's width and height, px.

    Raises DeviceError if there is no desktop.
    """
    with desktop("its sizes") as pygame:
        return list(pygame.display.get_desktop_sizes())


def check_monitor(sizes: Sequence[tuple[int, int]], monitor: int, size: tuple[int, int]) -> None:
    """Raise InputError if a monitor is missing, or its size is not the image's."""
    if not 0 <= monitor < len(sizes):
        listed = ", ".join(f"{k}: {width} x {height}" for k, (width, height) in enumerate(sizes))
        raise InputError(f"monitor {monitor} does not exist; choose from {listed}")
    width, height = sizes[monitor]
    if (width, height) != size:
        what = f"monitor {monitor} has {width} x {height} pixels, but the image has {size[0]} x {size[1]}"
        raise InputError(f"{what}; set the monitor to the panel's native resolution, without scaling")


def window_size(size: tuple[int, int], desktop: tuple[int, int]) -> tuple[int, int]:
    """Return the window size for an image, scaled down if the desktop is smaller."""
    scale = min(1.0, *(WINDOW_SHARE * full / side for full, side in zip(desktop, size, strict=True)))
    width, height = (max(1, round(scale * side)) for side in size)
    return width, height


@contextmanager
def full_screen(size: tuple[int, int], monitor: int) -> Iterator[Callable[..., Pixels]]:
    """Provide a function that shows an image (height, width, 3) uint8 on the monitor `monitor` (from 0).

    The function takes the image and a duration in s, and returns the screen's pixels.
    The duration `None` ends with Escape or q. Raises InputError for a missing monitor,
    and for a `size` other than the monitor's: scaled pixels would not match the
    lenslets. Raises DeviceError if there is no desktop or no full screen.
    """
    check_monitor(monitors(), monitor, size)
    with desktop("a full screen") as pygame:
        screen = pygame.display.set_mode(size, pygame.FULLSCREEN | pygame.NOFRAME, display=monitor)
        if (offered := screen.get_size()) != size:
            raise DeviceError(f"the desktop offers {offered} px on monitor {monitor}, not {size}; disable scaling")
        pygame.mouse.set_visible(False)

        def show(image: Pixels, seconds: float | None = 0.0) -> Pixels:
            _show(pygame, screen, pygame.surfarray.make_surface(image.swapaxes(0, 1)), seconds)
            pygame.event.pump()
            return np.frombuffer(pygame.image.tobytes(screen, "RGB"), np.uint8).reshape(size[1], size[0], 3)

        yield show


def show_frames(frames: Sequence[Pixels], seconds: float | None, frame_s: float = LOOK_S) -> None:
    """Repeat frames (height, width, 3) uint8 in a window, for `seconds` or until Escape, q or close.

    Large frames are scaled down. Raises DeviceError if the session has no desktop.
    """
    if seconds is not None and not as_number(seconds) >= 0.0:
        raise InputError(f"seconds {seconds} is not a duration; give 0 or more, or None to wait for Escape")
    height, width = frames[0].shape[:2]
    size = window_size((width, height), monitors()[0])
    until = math.inf if seconds is None else time.monotonic() + seconds
    with desktop("a window") as pygame:
        screen = pygame.display.set_mode(size)
        pygame.display.set_caption("Lippmann")
        pictures = [pygame.surfarray.make_surface(frame.swapaxes(0, 1)) for frame in frames]
        scaled = [one if one.get_size() == size else pygame.transform.smoothscale(one, size) for one in pictures]
        for picture in itertools.cycle(scaled):
            if _show(pygame, screen, picture, frame_s) or time.monotonic() >= until:
                return


def _show(pygame: ModuleType, screen: pygame.Surface, picture: pygame.Surface, seconds: float | None) -> bool:
    screen.blit(picture, (0, 0))
    pygame.display.flip()
    until = math.inf if seconds is None else time.monotonic() + seconds
    while time.monotonic() < until:
        for event in pygame.event.get():
            if event.type == pygame.QUIT or (
                event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q)
            ):
                return True
        time.sleep(LOOK_S)
    return False


@contextmanager
def desktop(request: str) -> Iterator[ModuleType]:
    """Provide pygame with an open display; an SDL error raises a DeviceError that names `request`."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    # Do not minimise the window when it loses the keyboard focus.
    os.environ.setdefault("SDL_VIDEO_MINIMIZE_ON_FOCUS_LOSS", "0")
    try:
        import pygame
    except ImportError as error:
        raise missing_library(error) from None

    remedy = "run the command in a graphical session, such as with DISPLAY=:0"
    try:
        with silent_stderr():
            pygame.display.init()
    except pygame.error as error:
        raise DeviceError(f"there is no desktop ({error}); {remedy}") from None
    try:
        driver = pygame.display.get_driver()
        if driver in BLIND_DRIVERS and driver not in os.environ.get("SDL_VIDEODRIVER", "").split(","):
            raise DeviceError(f"there is no desktop (SDL's driver '{driver}' shows nothing); {remedy}")
        yield pygame
    except pygame.error as error:
        raise DeviceError(f"the desktop refuses {request} ({error}); {remedy}") from None
    finally:
        pygame.display.quit()
