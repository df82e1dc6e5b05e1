"""Dividers of an ECP5's PLL (EHXPLLL) for a panel: clocks for the system, its pixels, their bits and the memory.

    VCO = oscillator / input_div * feedback_div * (divider of the output that is fed back)

Each output is the VCO by its own divider. Limits are those of the ECP5 and ECP5-5G data sheet (FPGA-DS-02012), MHz.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from lippmann.errors import InputError, input_error

INPUT_MHZ = (8, 400)
PHASE_DETECTOR_MHZ = (Fraction(25, 8), 400)
VCO_MHZ = (400, 800)
#: Greatest value of each divider; the least is 1.
MAX_DIVIDER = 128
#: How far a pixel clock may be from the one asked for, and the difference that does not matter.
TOLERANCE, ALIKE = Fraction(1, 200), Fraction(1, 1000)
#: Bits of a pixel on a pair of DVI's wires, two in each clock.
SHIFT_CLOCKS = 5


@dataclass(frozen=True)
class Pll:
    """A PLL's dividers; `feedback` is the output that is fed back: 0 shift, 1 system, 2 memory.

    Without DVI `shift_div` is `system_div`, and the output is not used.
    """

    oscillator_mhz: Fraction
    input_div: int
    feedback_div: int
    feedback: int
    shift_div: int
    system_div: int
    memory_div: int
    pixel_div: int

    @property
    def vco_mhz(self) -> Fraction:
        """Frequency of the oscillator inside."""
        back = (self.shift_div, self.system_div, self.memory_div)[self.feedback]
        return self.oscillator_mhz / self.input_div * self.feedback_div * back

    @property
    def clocks_mhz(self) -> dict[str, Fraction]:
        """Frequencies of the outputs."""
        names = ("shift", "system", "memory", "pixel")
        return {name: self.vco_mhz / getattr(self, f"{name}_div") for name in names}

    @property
    def parameters(self) -> dict[str, int]:
        """The RTL's parameters."""
        return {
            "InputDiv": self.input_div, "FeedbackDiv": self.feedback_div, "Feedback": self.feedback,
            "ShiftDiv": self.shift_div, "SystemDiv": self.system_div, "MemoryDiv": self.memory_div,
            "PixelDiv": self.pixel_div,
        }  # fmt: skip


def solve(
    pixel_mhz: Fraction,
    oscillator_mhz: Fraction,
    memory_mhz: tuple[Fraction, Fraction],
    *,
    samples: int = 1,
    dvi: bool = True,
) -> Pll:
    """Return the dividers whose pixel clock is nearest to `pixel_mhz`, and whose memory clock is then the fastest.

    Pixel clocks within `ALIKE` are equally near. `memory_mhz` are the least and the greatest clock of the memory. The
    system has `samples` clocks a pixel; with `dvi` there are five shift clocks a pixel. Raises InputError when no
    dividers give a pixel clock within `TOLERANCE`.
    """
    if not INPUT_MHZ[0] <= oscillator_mhz <= INPUT_MHZ[1]:
        what = f"an oscillator of {float(oscillator_mhz):g} MHz cannot drive the PLL"
        raise InputError(f"{what}; use one of {INPUT_MHZ[0]} to {INPUT_MHZ[1]} MHz")
    found = list(_candidates(pixel_mhz, oscillator_mhz, memory_mhz, samples, dvi))
    if not found:
        low, high = map(float, memory_mhz)
        raise input_error(
            f"{float(pixel_mhz):.3f} MHz",
            f"the PLL has no pixel clock within {float(TOLERANCE):.1%} beside one of {low:.0f} to {high:.0f} MHz",
            "choose another size of panel",
        )

    def rank(pll: Pll) -> tuple[Fraction, ...]:
        error = abs(pll.clocks_mhz["pixel"] / pixel_mhz - 1)
        # A faster phase detector makes less jitter.
        return max(error, ALIKE), -pll.clocks_mhz["memory"], error, Fraction(pll.input_div), pll.vco_mhz

    return min(found, key=rank)


def _candidates(
    pixel_mhz: Fraction, oscillator_mhz: Fraction, memory_mhz: tuple[Fraction, Fraction], samples: int, dvi: bool
) -> Iterator[Pll]:
    unit = samples * (SHIFT_CLOCKS if dvi else 1)
    for input_div in range(1, MAX_DIVIDER + 1):
        detector = oscillator_mhz / input_div
        if not PHASE_DETECTOR_MHZ[0] <= detector <= PHASE_DETECTOR_MHZ[1]:
            continue
        for pixel_div in range(unit, MAX_DIVIDER + 1, unit):
            asked = pixel_mhz * pixel_div / detector
            low = max(asked * (1 - TOLERANCE), VCO_MHZ[0] / detector)
            high = min(asked * (1 + TOLERANCE), VCO_MHZ[1] / detector)
            system_div = pixel_div // samples
            shift_div = pixel_div // SHIFT_CLOCKS if dvi else system_div
            for times in range(-(-low // 1), high // 1 + 1):
                vco = detector * times
                most, least = vco / memory_mhz[0] // 1, -(-(vco / memory_mhz[1]) // 1)
                for memory_div in range(max(least, 1), min(most, MAX_DIVIDER) + 1):
                    outputs = (shift_div, system_div, memory_div)
                    for feedback, back in enumerate(outputs):
                        if times % back == 0 and 1 <= times // back <= MAX_DIVIDER:
                            yield Pll(oscillator_mhz, input_div, times // back, feedback, *outputs, pixel_div)
                            break


def panel_pixel_mhz(width: int, height: int, timing: tuple[int, ...], rate_hz: int = 60) -> Fraction:
    """Return the pixel clock of a panel, px, with the porches and syncs of `virtual_board.TIMING`, MHz."""
    h_front, h_sync, h_back, v_front, v_sync, v_back = timing[:6]
    total = (width + h_front + h_sync + h_back) * (height + v_front + v_sync + v_back)
    return Fraction(total * rate_hz, 1_000_000)
