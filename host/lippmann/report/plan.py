"""How much a run of the report measures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """Sizes of a run.

    Attributes
    ----------
    displays
        Shipped displays that engines and models are measured on.
    rays
        Compared for each error.
    timed_rays
        Of one run of golden, twin or RTL against the clock.
    fast_rays
        The same of the fast engine.
    digits_rays
        Held to 50 digits.
    rounds
        How often each time is taken.
    simulate
        Whether the RTL is simulated, which compiles it at first use.
    panel_px
        Most pixels across of the panels that are rendered: the middle of larger ones.
    fraction_bits
        Word lengths whose exact pipelines are measured, beside the named configurations.
    named
        Whether all named configurations are measured, or only the widest and the compact ones.
    noise_px, noise_samples, reference_samples
        The pictures whose noise is measured: their side, their samples a pixel, those of what they are held to.
    budget
        Configurations whose error is told step by step.
    growth_px
        Pixels across of the panels over which growth is measured, save that with the pixels.
    memory_rounds
        How often each picture is rendered in a process of its own, whose memory is looked at.
    pixels_across, lenslets_across, triangles, lights, samples
        Sizes over which growth is measured.
    """

    displays: tuple[str, ...] = ("paper-square", "paper-hex", "uhd-8k", "uhd-4k")
    rays: int = 400_000
    timed_rays: int = 300_000
    fast_rays: int = 1 << 24
    digits_rays: int = 200
    rounds: int = 5
    simulate: bool = True
    panel_px: int = 960
    fraction_bits: tuple[int, ...] = tuple(range(14, 24))
    named: bool = True
    noise_px: int = 320
    noise_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    reference_samples: int = 1024
    budget: tuple[str, ...] = ("widest-square", "widest-hex", "compact-square", "compact-hex")
    growth_px: int = 800
    memory_rounds: int = 3
    pixels_across: tuple[int, ...] = (600, 1200, 2400, 4800)
    lenslets_across: tuple[int, ...] = (11, 26, 51, 102, 204)
    triangles: tuple[int, ...] = (200, 2_000, 20_000, 200_000, 2_000_000)
    lights: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32)


WHOLE = Plan()
#: For tests, and for a first look.
QUICK = Plan(
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
    memory_rounds=3,
    pixels_across=(150, 300),
    lenslets_across=(4, 8),
    triangles=(200, 2_000),
    lights=(1, 2),
    samples=(1, 2),
)
