"""A tracer of its own, written from docs/reference/optics.md, into which a fault can be built.

Plano side to the panel, aims inside the pixel's own cell. It stands for the design of somebody who regresses it, so it
uses nothing of lippmann; each fault is one wrong line.
"""

import math

import numpy as np


def trace(display, pixels, aims, fault=""):
    panel, array = display.panel, display.array
    R, n, T, gap = array.radius_mm, array.index, array.thickness_mm, display.gap_mm
    wide, high = array.pitches_mm[::-1] if fault == "pitches swapped" else array.pitches_mm
    shear = {"missing shear": 0.0, "shear's sign": -array.shear}.get(fault, array.shear)
    if fault == "wrong index":
        n = 1.4585
    if fault == "another glass":
        n, R = 1.4585, R / (n - 1.0) * 0.4585
    if fault == "radius for focal length":
        R = array.focal_length_mm
    if fault == "gap wrong":
        gap += 0.0125
    panel_pitch = panel.pixel_pitch_mm * (1.0005 if fault == "pixel pitch wrong" else 1.0)
    turn = array.rotation_deg if fault == "degrees for radians" else math.radians(array.rotation_deg)
    if fault == "rotation sense":
        turn = -turn
    c, s = math.cos(turn), math.sin(turn)
    offset = np.zeros(2) if fault == "missing offset" else np.array(array.offset_mm)

    # Pixel to panel to array.
    u, v = pixels.T
    if fault == "half pixel":
        u, v = u - 0.5, v - 0.5
    if fault == "axis swap":
        u, v = v, u
    if fault == "x sign":
        u = panel.width_px - u
    x, y = (u - panel.width_px / 2) * panel_pitch, (panel.height_px / 2 - v) * panel_pitch
    if fault == "y flipped":
        y = -y
    px, py = x, y
    x, y = x - offset[0], y - offset[1]
    X, Y = c * x + s * y, c * y - s * x

    # Where the straight line to the eye passes the aperture plane; without an eye, or with it left out, right above.
    seen_x, seen_y = X, Y
    if display.viewing_distance_mm is not None and fault != "missing eye":
        ax, ay = (0.0, 0.0) if fault == "missing axis" else display.viewing_axis_mm
        depth = gap + T / n
        height = display.viewing_distance_mm + (0.0 if fault == "eye from the panel" else depth)
        dx, dy = (depth / height * (ax - px), depth / height * (ay - py))
        seen_x, seen_y = X + c * dx + s * dy, Y + c * dy - s * dx

    # The cell: on the regular lattice of pitch 1 the nearest centre, ties to the larger coordinate.
    seen_x, seen_y = (seen_x - shear * seen_y) / wide, seen_y / high
    row = 1.0 if array.grid == "square" else math.sqrt(0.75)
    best = np.full(len(X), np.inf)
    i, j = np.zeros((2, len(X)))
    for k in (-1, 0, 1):
        jj = np.floor(seen_y / row + 0.5) + k
        shift = 0.0 if array.grid == "square" else jj / 2
        ii = np.floor(seen_x - shift + 0.5)
        if fault == "tie rule":
            ii = np.ceil(seen_x - shift - 0.5)
        near = (seen_x - (ii + shift)) ** 2 + (seen_y - jj * row) ** 2
        closer = near < best if fault == "tie rule" else near <= best
        best, i, j = np.where(closer, near, best), np.where(closer, ii, i), np.where(closer, jj, j)
    if fault == "neighbour's lenslet":
        i = i + 1
    shift = 0.0 if array.grid == "square" else j / 2
    cy = j * row * high
    cx = (i + shift) * wide + shear * cy
    x, y = X - cx, Y - cy
    a, b = aims.T

    # Aim, flat face.
    D = gap + (T if fault == "aperture plane" else T / n)
    d = np.stack([a - x, b - y, np.full_like(x, D)], axis=1)
    near = np.stack([x, y], axis=1) + gap / D * d[:, :2]
    d /= np.linalg.norm(d, axis=1)[:, None]
    lateral = d[:, :2] / n
    glass = np.column_stack([lateral, np.sqrt(np.maximum(1 - (lateral**2).sum(axis=1), 0.0))])

    # The sphere around (0, 0, -R), met from inside.
    start = np.column_stack([near, np.full_like(x, -T)])
    from_centre = start + np.array([0.0, 0.0, R])
    along = (from_centre * glass).sum(axis=1)
    t = -along + np.sqrt(np.maximum(along**2 - (from_centre**2).sum(axis=1) + R * R, 0.0))
    met = start + t[:, None] * glass
    normal = met / R + np.array([0.0, 0.0, 1.0])
    cosine = (glass * normal).sum(axis=1)
    square = 1 - n * n * (1 - cosine**2)
    out = n * glass + (np.sqrt(np.maximum(square, 0.0)) - n * cosine)[:, None] * normal
    out = np.where((square > 0)[:, None], out, glass)
    status = np.where(square > 0, 0, 2)
    if fault == "wrong status code":
        status = np.where(status == 2, 1, status)
    # A lenslet whose centre lies beyond half the extent, px U along the rows or py V across them, is not there.
    if array.extent_mm is not None and fault != "missing extent":
        w, h = array.extent_mm
        there = (abs((i + shift) * wide) <= w / 2) & (abs(j * row * high) <= h / 2)
        status = np.where(there, status, 3)
    if fault == "normalisation missing":
        out = out / out[:, 2:]

    # Back to the panel's axes.
    if fault == "off-by-one lenslet":
        i = i + 1
    shift = 0.0 if array.grid == "square" else j / 2
    if fault == "hex rows swapped":
        shift = -shift
    cy = j * row * high
    cx = (i + shift) * wide + shear * cy
    centre = np.stack([offset[0] + c * cx - s * cy, offset[1] + s * cx + c * cy], axis=1)

    def turned(w):
        return np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], axis=1)

    direction, local = turned(out), turned(met)
    if fault == "saturated value wrapped":
        # Words with F = 16 hold directions in [-1, 1): what rounds to 1 becomes -1.
        direction = np.where(np.round(direction * 2.0**17) >= 2.0**17, direction - 2.0, direction)
    if fault == "direction sign":
        direction = direction * (-1, 1, 1)
    return {
        **{"pixel": pixels, "aperture_mm": aims, "panel_mm": np.stack([px, py], axis=1)},
        **{"lenslet": np.stack([i, j], axis=1), "centre_mm": centre, "local_mm": local},
        "origin_mm": local + np.column_stack([centre, np.zeros(len(x))]),
        **{"direction": direction, "status": status},
    }
