"""Errors that are smooth over a position: what lens distortion, aberrations and seams leave, and no average removes.

Of each of a position's four columns of residuals (panel points, photograph), with the scatter 1, the errors are taken
as

    e = n + t B m,   n and m normal with deviation 1,

where B are six polynomials of the place on the array up to the second degree, from -1 to 1 across it, and t is a share.
Their covariance is I + t^2 B B^T. With B = U S V^T,

    W = I - U (1 - 1 / sqrt(1 + t^2 S^2)) U^T

makes the covariance of W e the unit matrix: least squares of W e trusts no position's middle, scale or bend more than
it deserves, however many lenslets it has (generalised least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Smooth:
    """The errors of N lenslets: B (N, 6), the shares t (4,), U (N, 6), and of each column 1 - 1/sqrt(...) (4, 6)."""

    modes: Floats
    shares: Floats
    basis: Floats
    lost: Floats

    @classmethod
    def of(cls, places: Floats, shares: Floats) -> Smooth:
        """Return those of lenslets at places (N, 2) on the array, with a share for each column."""
        u, v = (2.0 * spread_out(places) - 1.0).T
        modes = np.stack([np.ones_like(u), u, v, u * u - 1.0 / 3.0, u * v, v * v - 1.0 / 3.0], axis=1)
        basis, values, _ = np.linalg.svd(modes, full_matrices=False)
        return cls(modes, shares, basis, 1.0 - 1.0 / np.sqrt(1.0 + np.outer(shares, values) ** 2))

    def whitened(self, values: Floats) -> Floats:
        """Return W times values (N, 4) or (N, 4, M)."""
        flat = values.reshape(len(values), 4, -1)
        part = np.einsum("nk,ncm->kcm", self.basis, flat) * self.lost.T[..., None]
        return np.asarray((flat - np.einsum("nk,kcm->ncm", self.basis, part)).reshape(values.shape))

    def whitened_rows(self, rows: Floats) -> Floats:
        """Return W times the rows (4 N, M) of a matrix of derivatives, four for each lenslet."""
        return self.whitened(rows.reshape(-1, 4, rows.shape[1])).reshape(rows.shape)


def spread_out(places: Floats) -> Floats:
    """Return places (N, 2) from 0 to 1 across all of them."""
    low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    return np.asarray((places - low) / size)
