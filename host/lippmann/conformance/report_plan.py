"""How much a run of the report measures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """Sizes of a run."""

    #: The shipped scene that is rendered, and the shipped displays on which engines and models are measured.
    scene: str = "fish"
    displays: tuple[str, ...] = ("paper-square", "paper-hex", "uhd-8k", "uhd-4k")
    #: Rays over which each error is taken; rays of one timed run of golden, twin or RTL, and of the fast engine; rays
    #: that are compared with 50 digits.
    rays: int = 400_000
    timed_rays: int = 300_000
    fast_rays: int = 1 << 24
    digits_rays: int = 200
    #: Repeats of each time.
    rounds: int = 5
    #: Whether the RTL is simulated. The first simulation of a build compiles it.
    simulate: bool = True
    #: Largest width and height of the panels that are rendered: of a larger panel, its middle.
    panel_px: int = 960
    #: Word lengths whose exact pipelines are measured, and whether all named configurations are, or only four.
    fraction_bits: tuple[int, ...] = tuple(range(14, 24))
    named: bool = True
    #: Renders whose noise is measured: width of the picture, samples a pixel, samples of the reference.
    noise_px: int = 320
    noise_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    reference_samples: int = 1024
    #: Configurations whose error is measured step by step.
    budget: tuple[str, ...] = ("widest-square", "widest-hex", "compact-square", "compact-hex")
    #: Width of the panels over which growth is measured (except with the pixels); repeats of each peak of memory.
    growth_px: int = 800
    memory_rounds: int = 3
    #: Sizes over which growth is measured.
    pixels_across: tuple[int, ...] = (600, 1200, 2400, 4800)
    lenslets_across: tuple[int, ...] = (11, 26, 51, 102, 204)
    triangles: tuple[int, ...] = (200, 2_000, 20_000, 200_000, 2_000_000)
    lights: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32)


WHOLE = Plan()
#: For tests, and for a first look: a scene whose programs compile in a third of the fish's time, and small sizes.
QUICK = Plan(
    scene="knot",
    displays=("vga-square",),
    rays=20_000,
    timed_rays=20_000,
    fast_rays=1 << 18,
    digits_rays=10,
    rounds=3,
    simulate=False,
    panel_px=160,
    fraction_bits=(16, 23),
    named=False,
    noise_px=64,
    noise_samples=(1, 4),
    reference_samples=16,
    budget=("compact-square",),
    growth_px=150,
    pixels_across=(150, 300),
    lenslets_across=(4, 8),
    triangles=(200, 2_000),
    lights=(1, 2),
    samples=(1, 2),
)
