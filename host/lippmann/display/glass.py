"""Compute the refractive indices of lenslet glasses.

Each glass has a Sellmeier formula n^2 - 1 = sum B w^2 / (w^2 - C), where w is the
vacuum wavelength in micrometres. The sources of B and C are:

- N-BK7: Schott's data sheet.
- PMMA, polycarbonate, polystyrene: N. Sultanova, S. Kasarova, I. Nikolov, Acta Physica
  Polonica A 116 (2009) 585.
- fused silica: I. H. Malitson, J. Opt. Soc. Am. 55 (1965) 1205.
"""

from __future__ import annotations

import math

from lippmann.errors import InputError, as_number, did_you_mean

#: Wavelength for which a display file states the focal length, nm: the helium d line.
DESIGN_WAVELENGTH_NM = 587.5618

#: Accepted wavelengths, nm. The plastics' formulas extrapolate below 436.8 nm.
WAVELENGTH_RANGE_NM = (380.0, 1060.0)

#: Sellmeier coefficients (B, C) of each glass, C in square micrometres.
SELLMEIER: dict[str, tuple[tuple[float, float], ...]] = {
    "N-BK7": ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
    "PMMA": ((1.1819, 0.011313),),
    "polycarbonate": ((1.4182, 0.021304),),
    "polystyrene": ((1.4435, 0.020216),),
    "fused silica": ((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)),
}


def index_of(glass: str, wavelength_nm: float = DESIGN_WAVELENGTH_NM) -> float:
    """Return the refractive index of a glass (upper or lower case) at a vacuum wavelength.

    Raises InputError for an unknown glass or a wavelength out of range.
    """
    terms = {name.casefold(): terms for name, terms in SELLMEIER.items()}.get(glass.casefold())
    if terms is None:
        likely = did_you_mean(glass, SELLMEIER)
        raise InputError(f"unknown glass '{glass}'; {likely or 'choose from ' + ', '.join(SELLMEIER)} (or give index)")
    low, high = WAVELENGTH_RANGE_NM
    if not low <= as_number(wavelength_nm) <= high:
        raise InputError(f"wavelength {wavelength_nm} nm is out of range; give {low:g} to {high:g}")
    w2 = (wavelength_nm * 1e-3) ** 2
    return math.sqrt(1.0 + sum(b * w2 / (w2 - c) for b, c in terms))
