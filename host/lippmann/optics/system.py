"""The optical system of a display as plain numbers, and the rays at its two ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from lippmann.display.description import Display
from lippmann.optics.backend import Arr, Backend
from lippmann.optics.faces import Dome, Ray
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel_frame import Convergence, PanelFrame
from lippmann.optics.rays import Status


@dataclass(frozen=True)
class System:
    """The optical system of a display: frames, lattice, domes, and distances in mm.

    `concave`: plano-concave lenslets, the domes pressed into the glass, the flat face to the panel; `thickness_mm` is
    their thickness at the vertex. Only capturing optics have them, and only `exact` rays from the panel pass them.
    """

    frame: PanelFrame
    lattice: Lattice
    dome: Dome
    index: float
    thickness_mm: float
    gap_mm: float
    aperture_distance_mm: float
    focal_length_mm: float
    plano_to_panel: bool
    convergence: Convergence
    concave: bool = False

    @classmethod
    def of(cls, display: Display) -> System:
        """Return the system of a display."""
        array = display.array
        lattice, frame = Lattice.of(array), PanelFrame.of(display)
        share = display.convergence / (1.0 + display.convergence)
        return cls(
            frame=frame,
            lattice=lattice,
            dome=Dome(lattice, array.radius_mm, array.sag_mm),
            index=array.index,
            thickness_mm=array.thickness_mm,
            gap_mm=display.gap_mm,
            aperture_distance_mm=display.aperture_distance_mm,
            focal_length_mm=array.focal_length_mm,
            plano_to_panel=array.plano_side == "panel",
            convergence=Convergence(share, *frame.array_from_panel(*display.viewing_axis_mm)),
        )

    @property
    def last_face_mm(self) -> float:
        """Height z of the plane that a ray to the viewer crosses last: dome vertices or flat face."""
        return 0.0 if self.plano_to_panel else self.thickness_mm

    def locate(self, b: Backend, u: Arr, v: Arr) -> tuple[Arr, Arr, Arr, Arr]:
        """Return the lenslet (i, j) that owns pixel coordinates, and their point from its centre, array's axes, mm."""
        x, y = self.frame.array_from_panel(*self.frame.panel_from_pixel(u, v))
        i, j, qx, qy = self.lattice.locate(b, *self.convergence.towards_eye(x, y))
        if self.convergence.share == 0.0:
            return i, j, qx, qy
        cx, cy = self.lattice.centre(i, j)
        return i, j, x - cx, y - cy  # not from q: its roundings would grow by 1 / (1 - s)

    def owns(self, x: Arr, y: Arr, cx: Arr, cy: Arr) -> Arr:
        """Tell whether the lenslet at (cx, cy) owns a point of the panel, measured from there; array's axes, mm."""
        return self.lattice.holds(*self.convergence.within_cell(x, y, cx, cy))

    def through_mount(
        self, b: Backend, status: Arr, passed: tuple[Arr, Arr], own: tuple[Arr, Arr] | None = None
    ) -> Arr:
        """Return statuses, blocked where lenslets (i, j) are missing: the mount is opaque there.

        `left` are those that rays pass, `own` the pixels' own ones. A ray that met no dome stays missed.
        """
        if self.lattice.half_steps is None:
            return status
        there = self.lattice.present(b, *passed) | (status == int(Status.MISSED))
        if own is not None:
            there = there & self.lattice.present(b, *own)
        return b.where(there, status, int(Status.BLOCKED))

    def centre(self, i: Arr, j: Arr) -> tuple[Arr, Arr]:
        """Return the centre of lenslet (i, j), panel frame, mm."""
        return self.frame.panel_from_array(*self.lattice.centre(i, j))


class Exit(NamedTuple):
    """A ray after the lenslet, in the array's axes, local to the lenslet (di, dj) steps from the pixel's own.

    `grazing` is the least squared cosine to a face's normal, on the air's side, launch and exit included: rounding
    turns the ray by about epsilon over its root.
    """

    ray: Ray
    di: Arr
    dj: Arr
    status: Arr
    grazing: Arr


class Landing(NamedTuple):
    """A ray from the world on the panel plane: point local to the lenslet passed, in the array's axes, mm.

    The status tells whether the ray got there, not whether the point is one of that lenslet's own.
    """

    x: Arr
    y: Arr
    di: Arr
    dj: Arr
    status: Arr
