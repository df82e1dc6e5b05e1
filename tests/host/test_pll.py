"""The PLL's dividers: legal by the data sheet, near enough, and the best of all, by the formulas written again here."""

import random
from fractions import Fraction
from itertools import product

import pytest
from lippmann.errors import InputError
from tools.pll import Pll, panel_pixel_mhz, solve

MEMORY = Fraction(60), Fraction(125)
#: By the timings of CEA-861; those of 640 x 480 are VESA's.
HD_MHZ = panel_pixel_mhz(1280, 720, (110, 40, 220, 5, 5, 20))


def assert_legal(pll, pixel_mhz, dvi):
    """The data sheet's limits (FPGA-DS-02012: sysCLOCK PLL timing), and what the clocks are to each other."""
    assert 8 <= pll.oscillator_mhz <= 400
    assert 10 <= pll.oscillator_mhz / pll.input_div <= 400
    dividers = (pll.input_div, pll.back_div, pll.shift_div, pll.system_div, pll.memory_div)
    assert all(1 <= divider <= 128 for divider in dividers)
    # The phase detector compares the oscillator, divided, with the output that is fed back, divided.
    assert pll.oscillator_mhz / pll.input_div == pll.vco_mhz / pll.back_div
    assert 3.125 <= pll.vco_mhz / pll.back_div <= 400
    assert 400 <= pll.vco_mhz <= 800
    clocks = pll.clocks_mhz
    assert abs(clocks["system"] / pixel_mhz - 1) <= Fraction(11, 1000)
    if dvi:
        assert clocks["shift"] == 5 * clocks["system"]
    assert MEMORY[0] <= clocks["memory"] <= MEMORY[1]


def test_the_two_video_modes():
    """By hand: 25 MHz * 20 and 25 MHz * 30 are 500 and 750 MHz."""
    vga = solve(panel_pixel_mhz(640, 480, (16, 96, 48, 10, 2, 33)), Fraction(25), MEMORY)
    assert vga == Pll(Fraction(25), 1, 20, 4, 20, 4)
    assert (vga.vco_mhz, vga.clocks_mhz["memory"], vga.clocks_mhz["system"]) == (500, 125, 25)
    hd = solve(HD_MHZ, Fraction(25), MEMORY)
    assert hd == Pll(Fraction(25), 1, 30, 2, 10, 6)
    assert [hd.clocks_mhz[name] for name in ("shift", "system", "memory")] == [375, 75, 125]


def test_no_pixel_clock_is_above_the_fastest():
    """Below 75 MHz comes 73.75 MHz: 25 MHz / 2 * 59 is 737.5 MHz."""
    assert solve(HD_MHZ, Fraction(25), MEMORY, fastest_mhz=Fraction(75)).clocks_mhz["system"] == 75
    slower = solve(HD_MHZ, Fraction(25), MEMORY, fastest_mhz=Fraction(749, 10))
    assert slower.clocks_mhz["system"] == Fraction(7375, 100)
    assert_legal(slower, HD_MHZ, True)


def test_any_pixel_clock_that_has_dividers_finds_legal_ones():
    random.seed(1908)
    found = 0
    for _ in range(80):
        pixel = Fraction(random.randrange(6000, 80000), 1000)
        oscillator = Fraction(random.choice((12, 25, 27, 48, 100)))
        dvi = random.random() < 0.7
        try:
            pll = solve(pixel, oscillator, MEMORY, dvi=dvi)
        except InputError:
            continue
        found += 1
        assert_legal(pll, pixel, dvi)
    assert found > 40


def test_no_dividers_are_better():
    pixel, oscillator = Fraction(252, 10), Fraction(25)
    best = solve(pixel, oscillator, MEMORY)
    key = -best.clocks_mhz["memory"], best.input_div, abs(best.clocks_mhz["system"] / pixel - 1)
    tried = 0
    for input_div, shift, memory, times in product((1, 2), range(3, 7), range(3, 14), range(1, 81)):
        vco = oscillator / input_div * times
        error = abs(vco / (5 * shift) / pixel - 1)
        if 400 <= vco <= 800 and error <= Fraction(11, 1000) and MEMORY[0] <= vco / memory <= MEMORY[1]:
            tried += 1
            assert (-vco / memory, input_div, error) >= key
    assert tried > 20


@pytest.mark.parametrize(
    ("pixel", "oscillator", "memory", "said"),
    [
        (Fraction(200), Fraction(25), MEMORY, "no pixel clock within 1.1%"),  # VCO 2000 MHz
        (Fraction(1), Fraction(25), MEMORY, "no pixel clock within 1.1%"),  # VCO 128 MHz at most
        (Fraction(25), Fraction(25), (Fraction(124), Fraction(1241, 10)), "memory clock of 124 to 124 MHz"),
        (Fraction(25), Fraction(7), MEMORY, "an oscillator of 7 MHz"),
        (Fraction(25), Fraction(401), MEMORY, "an oscillator of 401 MHz"),
    ],
)
def test_what_has_no_dividers_is_refused(pixel, oscillator, memory, said):
    with pytest.raises(InputError, match=said):
        solve(pixel, oscillator, memory)
