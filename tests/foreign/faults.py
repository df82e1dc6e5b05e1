"""Faults for tracer.c: each one wrong line of it, and what `lippmann regress` must say of it.

A fault is (display, old text, new text, word of the verdict); displays are those of `DISPLAYS`.
"""

#: Display files by name.
PLAIN = """
name = "plain"
gap_mm = 0.7
[panel]
width_px = 640
height_px = 400
pixel_pitch_mm = 0.05
[array]
grid = "square"
pitch_mm = 1.0
radius_mm = 1.2
index = 1.52
thickness_mm = 1.5
plano_side = "panel"
rotation_deg = 9.0
offset_mm = [0.31, -0.17]
"""
DISPLAYS = {
    "plain": PLAIN,
    "hex": PLAIN.replace('"square"', '"hex"'),
    "eye": PLAIN.replace("gap_mm", "viewing_distance_mm = 400.0\nviewing_axis_mm = [9.0, -5.0]\ngap_mm", 1),
    "skewed": PLAIN.replace("pitch_mm = 1.0", "pitch_mm = [1.0, 0.97]\nshear = 0.01\nextent_mm = [24.0, 16.0]"),
}  # fmt: skip

COMPLETE = "static void complete(void) {\n"
ASKED = "answer(u, v, a, b);"
TURNED = "c * ray.d[0] - s * ray.d[1], s * ray.d[0] + c * ray.d[1], ray.d[2]);"
LAST = "  centre(cell, &cx, &cy);\n  x = ray.p[0] + cx"
FAULTS = {
    "x flipped": ("plain", "(u - display.width / 2)", "(display.width / 2 - u)", "x flipped"),
    "y flipped": ("plain", "(display.height / 2 - v)", "(v - display.height / 2)", "y flipped"),
    "half a pixel": ("plain", ASKED, "answer(u - 0.5, v - 0.5, a, b);", "half a pixel"),
    "axes swapped": ("plain", ASKED, "answer(v, u, a, b);", "column and row swapped"),
    "column off by one": ("plain", ASKED, "answer(u + 1.0, v, a, b);", "pixel off by one: (+1, +0)"),
    "aperture halved": ("plain", ASKED, "answer(u, v, a / 2, b / 2);", "aperture points halved"),
    "outputs late": (
        "plain", ASKED,
        "{ static double q[4]; answer(q[0], q[1], q[2], q[3]); q[0] = u, q[1] = v, q[2] = a, q[3] = b; }",
        "outputs late by 1"),
    "pixel pitch": ("plain", COMPLETE, COMPLETE + "display.pixel_x *= 1.0005, display.pixel_y *= 1.0005;",
                    "pixel_pitch_mm is 0.050025 for 0.05"),
    "offset missing": ("plain", COMPLETE, COMPLETE + "display.offset_x = display.offset_y = 0;", "offset_mm left out"),
    "rotation's sense": ("plain", COMPLETE, COMPLETE + "display.turn *= -1;", "sign of rotation_deg"),
    "degrees for radians": ("plain", "display.turn *= acos(-1.0) / 180.0", "", "taken for radians"),
    "another rotation": ("plain", COMPLETE, COMPLETE + "display.turn += 2;", "rotation_deg is 11 for 9"),
    "wrong index": ("plain", COMPLETE, COMPLETE + "display.n = 1.4585;", "array.index is 1.4585 for 1.52"),
    "wrong gap": ("plain", COMPLETE, COMPLETE + "display.gap += 0.0125;", "gap_mm is 0.7125 for 0.7"),
    "wrong thickness": ("plain", COMPLETE, COMPLETE + "display.T += 0.02;", "thickness_mm is 1.52 for 1.5"),
    "wrong radius": ("plain", COMPLETE, COMPLETE + "display.R *= 1.01;", "radius_mm is 1.212 for 1.2"),
    "wrong pitch": ("plain", COMPLETE, COMPLETE + "display.px *= 1.002, display.py *= 1.002;",
                    "pitch_mm is 1.002 for 1"),
    "focal length for radius": ("plain", COMPLETE, COMPLETE + "display.R /= display.n - 1;", "focal length taken"),
    "plano side": ("plain", '!strcmp(text, "panel")', 'strcmp(text, "panel")', "plano_side reversed"),
    "lenslet off by one": ("plain", LAST, "  cell.i += 1;\n" + LAST, "lenslet off by one: (+1, +0)"),
    "neighbour's lenslet": ("plain", "Cell home = owner(&sx, &sy), cell = home;",
                            "Cell home = owner(&sx, &sy); home.i += 1; Cell cell = home;",
                            "neighbour's lenslet traced"),
    "aperture plane": ("plain", "display.gap + display.T / display.n", "display.gap + display.T",
                       "aperture plane without the index"),
    "direction's sign": ("plain", TURNED, "-" + TURNED.replace("c * ray.d[0] - s", "(c * ray.d[0] - s", 1).replace(
        "ray.d[1], s", "ray.d[1]), s", 1), "sign of the direction's x"),
    "normalisation missing": ("plain", LAST, "  ray.d[0] /= ray.d[2], ray.d[1] /= ray.d[2], ray.d[2] = 1;\n" + LAST,
                              "not normalised"),
    "a bias": ("plain", TURNED, "6e-5 + " + TURNED, "a constant added to the direction"),
    "few bits": ("plain", TURNED, "B(c * ray.d[0] - s * ray.d[1]), B(s * ray.d[0] + c * ray.d[1]), B(ray.d[2]));",
                 "rounded to 14 bits"),
    "wrong status code": ("skewed", 'printf(" %d\\n", BLOCKED)', 'printf(" %d\\n", MISSED)',
                          "wrong status code: 1 for 3"),
    "rows the other way": ("hex", "0.5 * c.j", "-0.5 * c.j", "hexagonal rows sheared the other way"),
    "square for hexagonal": ("hex", '!strcmp(text, "hex")', "0", "square grid for hex"),
    "eye missing": ("eye", "display.eye > 0.0", "0", "viewing_distance_mm left out"),
    "eye from the panel": ("eye", "(display.depth + display.eye)", "display.eye", "counted from the panel"),
    "axis missing": ("eye", COMPLETE, COMPLETE + "display.eye_x = display.eye_y = 0;", "viewing_axis_mm left out"),
    "shear missing": ("skewed", COMPLETE, COMPLETE + "display.shear = 0;", "shear left out"),
    "shear's sign": ("skewed", COMPLETE, COMPLETE + "display.shear *= -1;", "sign of the shear"),
    "pitches exchanged": ("skewed", COMPLETE,
                          COMPLETE + "double t = display.px; display.px = display.py, display.py = t;",
                          "axes of pitch_mm swapped"),
    "extent missing": ("skewed", COMPLETE, COMPLETE + "display.extent_x = 0;", "extent_mm left out"),
}  # fmt: skip
