"""The ports of the steps of the drawing that never stall, and the bench that holds them for F fraction bits."""

from bench import Instance, Segment, stream

#: Numbers of layers that are composited.
LAYERS = (1, 2, 3, 8)


def scene_steps(f: int) -> dict[str, Instance]:
    """Every step as an instance, by a short name."""
    index, near, far, place = 12, f + 2, f + 4, f + 9
    registers = dict.fromkeys(("s0_i", "t0_i", "depth_i", "a_i", "b_i", "c_i", "d_i"), 32)
    made = {
        "exit_line": Instance(
            "exit_line",
            {
                "i_i": index, "j_i": index, "x_i": far, "y_i": far, "z_i": far, "dx_i": near, "dy_i": near,
                "dz_i": near, "status_i": 3,
            },
            {"x_o": place, "y_o": place, "slope_x_o": far, "slope_y_o": far, "draws_o": 1},
            f"lipp_scene_pkg::exit_line_latency({f})",
            {"F": f},
            {"xi_i": 32, "xj_i": 32, "yj_i": 32},
        )
    }  # fmt: skip
    for bilinear in (0, 1):
        made[f"layer_coordinate-{bilinear}"] = Instance(
            "layer_coordinate",
            {"x_i": place, "y_i": place, "slope_x_i": far, "slope_y_i": far},
            {"s_o": 20, "t_o": 20, "beyond_o": 1},
            f"lipp_scene_pkg::layer_latency({f})",
            {"F": f, "Bilinear": bilinear},
            {**registers, "infinite_i": 1},
        )
    for taps in (1, 4):
        made[f"texel_blend-{taps}"] = Instance(
            "texel_blend",
            {"colour_i": 33 * taps, "weight_i": 17 * taps},
            {"light_o": 48, "opacity_o": 17},
            "lipp_scene_pkg::texel_blend_latency()",
            {"Taps": taps},
        )
    for layers in LAYERS:
        made[f"composite-{layers}"] = Instance(
            "composite",
            {"light_i": 48 * layers, "opacity_i": 17 * layers, "draws_i": 1},
            {"light_o": 48},
            f"lipp_scene_pkg::composite_latency({layers})",
            {"Layers": layers},
            {"brightness_i": 9 * layers, "background_i": 48},
        )
    return made


def stream_scene_step(name: str, f: int, segments: list[Segment], seed: int) -> None:
    """Stream words through one step's RTL and compare all that comes out."""
    made = scene_steps(f)
    stream(list(made.values()), [(made[name], segment) for segment in segments], f"scene-steps-F{f}", seed)


def joined(words, bits: int):
    """Words of several fields (N, ...) as one number each, the first field lowest."""
    flat = words.reshape(len(words), -1).astype(object)
    return sum(flat[:, k] << (bits * k) for k in range(flat.shape[1]))
