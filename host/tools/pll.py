"""Computes the dividers of an ECP5's PLL (EHXPLLL) for a board's clocks: system (a pixel per clock), shift, memory.

    VCO = oscillator / input_div * back_div

Each output has the VCO's frequency divided by the output's divider; the output of back_div is fed back. The limits, in
MHz, are those of the ECP5 and ECP5-5G data sheet (FPGA-DS-02012).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from lippmann.errors import InputError, input_error

#: Minimum and maximum of a frequency, MHz.
Span = tuple[Fraction, Fraction]
INPUT_MHZ = (8, 400)
PHASE_DETECTOR_MHZ = (10, 400)
VCO_MHZ = (Fraction(400), Fraction(800))
#: Maximum of every divider; the minimum is 1.
MAX_DIVIDER = 128
#: Maximum relative error of a pixel clock. Monitors accept this error. With a 25 MHz oscillator, the phase detector's
#: limit allows no finer steps: 1280 x 720 gets 75 MHz, not 74.25 (+1.0 %); 640 x 480 gets 25 MHz, not 25.2.
TOLERANCE = Fraction(11, 1000)
#: Shift clocks per pixel: a DVI pair sends ten bits per pixel, two per clock.
SHIFT_CLOCKS = 5


@dataclass(frozen=True)
class Pll:
    """A PLL's oscillator and dividers."""

    oscillator_mhz: Fraction
    input_div: int
    back_div: int
    shift_div: int
    system_div: int
    memory_div: int

    @property
    def vco_mhz(self) -> Fraction:
        """The VCO's frequency, MHz."""
        return self.oscillator_mhz / self.input_div * self.back_div

    @property
    def clocks_mhz(self) -> dict[str, Fraction]:
        """The outputs' frequencies, MHz, keyed by clock."""
        names = ("shift", "system", "memory")
        return {name: self.vco_mhz / getattr(self, f"{name}_div") for name in names}

    @property
    def parameters(self) -> dict[str, int]:
        """The dividers as RTL parameters."""
        return {
            "InputDiv": self.input_div, "BackDiv": self.back_div,
            "ShiftDiv": self.shift_div, "SystemDiv": self.system_div, "MemoryDiv": self.memory_div,
        }  # fmt: skip


def solve(
    pixel_mhz: Fraction,
    oscillator_mhz: Fraction,
    memory_mhz: Span,
    *,
    dvi: bool = True,
    fastest_mhz: Fraction | None = None,
) -> Pll:
    """Return dividers that give a pixel clock within `TOLERANCE` of `pixel_mhz` and at most `fastest_mhz`.

    The best dividers have the fastest memory clock within `memory_mhz`, then the fastest phase detector (for minimum
    jitter), then the nearest pixel clock. With `dvi`, a shift clock is added. Raises InputError if no dividers fit.
    """
    if not INPUT_MHZ[0] <= oscillator_mhz <= INPUT_MHZ[1]:
        what = f"an oscillator of {float(oscillator_mhz):g} MHz cannot drive the PLL"
        raise InputError(f"{what}; use one of {INPUT_MHZ[0]} to {INPUT_MHZ[1]} MHz")
    fastest = pixel_mhz * (1 + TOLERANCE) if fastest_mhz is None else min(pixel_mhz * (1 + TOLERANCE), fastest_mhz)
    candidates = list(_candidates((pixel_mhz * (1 - TOLERANCE), fastest), oscillator_mhz, memory_mhz, dvi))
    if not candidates:
        clocks = "with a memory clock of {:.0f} to {:.0f} MHz".format(*map(float, memory_mhz))
        what = f"the PLL has no pixel clock within {float(TOLERANCE):.1%} {clocks}"
        raise input_error(f"{float(pixel_mhz):.3f} MHz", what, "choose another panel size")

    def rank(pll: Pll) -> tuple[Fraction, ...]:
        clocks = pll.clocks_mhz
        return -clocks["memory"], Fraction(pll.input_div), abs(clocks["system"] / pixel_mhz - 1), pll.vco_mhz

    return min(candidates, key=rank)


def _candidates(pixel_mhz: Span, oscillator_mhz: Fraction, memory_mhz: Span, dvi: bool) -> Iterator[Pll]:
    unit = SHIFT_CLOCKS if dvi else 1
    for input_div in range(1, MAX_DIVIDER + 1):
        detector = oscillator_mhz / input_div
        if not PHASE_DETECTOR_MHZ[0] <= detector <= PHASE_DETECTOR_MHZ[1]:
            continue
        for system_div in range(unit, MAX_DIVIDER + 1, unit):
            low = max(pixel_mhz[0] * system_div, VCO_MHZ[0]) / detector
            high = min(pixel_mhz[1] * system_div, VCO_MHZ[1]) / detector
            for times in range(-(-low // 1), min(high // 1, MAX_DIVIDER) + 1):
                vco = detector * times
                first, last = -(-(vco / memory_mhz[1]) // 1), vco / memory_mhz[0] // 1
                for memory_div in range(max(first, 1), min(last, MAX_DIVIDER) + 1):
                    yield Pll(oscillator_mhz, input_div, times, system_div // unit, system_div, memory_div)


def panel_pixel_mhz(width: int, height: int, timing: tuple[int, ...], rate_hz: int = 60) -> Fraction:
    """Return a panel's pixel clock, MHz; `timing` has porches and syncs, in pixels and lines, as `TIMING`."""
    h_front, h_sync, h_back, v_front, v_sync, v_back = timing[:6]
    total = (width + h_front + h_sync + h_back) * (height + v_front + v_sync + v_back)
    return Fraction(total * rate_hz, 1_000_000)
